"""In flight: compensators on the article behind the rig in orbit, which no promise has seen."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.qualification import decibels
from middeck.control.robust.verification.monte_carlo import noise_on, uncontrolled_rms
from middeck.control.sampled.emulation import emulate
from middeck.errors import NumericalError
from middeck.files.studies.documents import Study
from middeck.laboratory.article_rig import build_article_rig, linear_plant
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.runs import RigRun, run_closed_loop
from middeck.laboratory.rig_settings import RigSettings
from middeck.laboratory.tested_article import RigArticle
from middeck.signals.excitation.multisine import random_multisine
from middeck.signals.ports import once, port_indices
from middeck.signals.record import Record
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from middeck.updating.promise.plan import Plan, group_loop, weights_of
from middeck.values import record

SETTLE = 1  # unrecorded period of a run


@record(kw_only=True)
class Flown:
    """One compensator in orbit.

    Attributes:
        db: Decibels of the linear article: rms with the compensator over that without, in the band. None
            where it is unstable.
        rig_db: The same measured on the rig, with friction, limits and noise; None where there is no record,
            for ``cause``.
    """

    name: str
    db: float | None
    rig_db: float | None
    cause: str

    @property
    def stable(self) -> bool:
        """Whether the article's loop decays and the rig had a good end.

        A loop that grows may stay within the limits of the rig's motors, with decibels to be measured.
        """
        return self.db is not None and self.rig_db is not None


@record(kw_only=True)
class Orbit:
    """The article in orbit behind its rig, held by its analogue loops, and its record without control."""

    periods: int
    settings: RigSettings
    plan: Plan
    article: RigArticle
    plant: Plant
    rig: Rig
    excitation: np.ndarray
    without: Record


def launch(
    article: RigArticle, study: Study, settings: RigSettings, plan: Plan, rng: np.random.Generator
) -> Orbit:
    """Switch the rig of ``article`` on in orbit and measure it without a compensator.

    The study's disturbance acts at each of the plan's.
    """
    assert plan.ladder is not None
    form = study.promise
    inputs = once(*plan.disturbances, *plan.ladder.drives)
    outputs = once(*plan.performance, *plan.ladder.reads)
    plant = linear_plant(article, settings, inputs, outputs, plan.inner)
    rig = build_article_rig(article, settings, inputs=inputs, outputs=outputs, inner=plan.inner)
    u = np.zeros((round(form.flight_period_s * settings.sample_hz), len(inputs)))
    for k in range(len(plan.disturbances)):
        u[:, k] = random_multisine(
            form.loop_band_hz, form.flight_period_s, settings.sample_hz, form.disturbance_nm, rng
        )
    run = _measure(rig, None, u, form.flight_periods, settings, rng)
    assert run.record is not None, run.cause
    return Orbit(
        periods=form.flight_periods,
        settings=settings,
        plan=plan,
        article=article,
        plant=plant,
        rig=rig,
        excitation=u,
        without=run.record,
    )


def fly(orbit: Orbit, laws: Mapping[str, Compensator], rng: np.random.Generator) -> tuple[Flown, ...]:
    """Every compensator in turn; one that cannot be sampled has a cause and no decibels."""
    found, rest = list[Flown](), _rms(orbit.without, orbit.plan)
    for name, law in laws.items():
        run = _measure(orbit.rig, law, orbit.excitation, orbit.periods, orbit.settings, rng)
        rig_db = None if run.record is None else decibels(_rms(run.record, orbit.plan), rest)
        found.append(Flown(name=name, db=_linear_db(orbit, law), rig_db=rig_db, cause=run.cause))
    return tuple(found)


def _rms(taken: Record, plan: Plan) -> float:
    """Rms of the plan's weighted performance, in its band."""
    y = taken.y[0].mean(axis=0)[:, port_indices(taken.outputs, plan.performance, "output")]
    hz = np.fft.rfftfreq(len(y), 1.0 / taken.sample_hz)
    low, high = plan.band_hz or (0.0, np.inf)
    lines = np.fft.rfft(y * plan.weights, axis=0)[(hz >= low) & (hz <= high)]
    return float(np.linalg.norm(lines)) / len(y)


def _linear_db(orbit: Orbit, law: Compensator) -> float | None:
    plan = orbit.plan
    u, y = (tuple(p.name for p in side) for side in (law.outputs, law.inputs))
    plant, weights = group_loop(plan, orbit.plant, u, y), weights_of(plan, law.outputs, law.inputs)
    stable, rms, _ = noise_on([plant], _as_it_reads(law, orbit.article), weights, plan.band_hz)
    if not stable[0]:
        return None
    return decibels(float(rms[0]), float(uncontrolled_rms([plant], weights, plan.band_hz)[0]))


def _as_it_reads(law: Compensator, article: RigArticle) -> Compensator:
    """``law`` behind the errors of gain of the sensors that it reads."""
    gains = {} if article.hidden is None else dict(article.hidden.gain)
    gain = np.array([gains.get(p.name.removesuffix(RATE), 1.0) for p in law.inputs])
    s = law.system
    return dataclasses.replace(law, dynamics=StateSpace(s.A, s.B * gain, s.C, s.D * gain))


def _measure(
    rig: Rig,
    law: Compensator | None,
    u: np.ndarray,
    periods: int,
    settings: RigSettings,
    rng: np.random.Generator,
) -> RigRun:
    try:
        sampled = None if law is None else emulate(law, rig.period_s)
    except NumericalError as error:
        return RigRun(cause=str(error))
    return run_closed_loop(rig, sampled, u, periods=periods, rng=rng, settle=SETTLE, rest_s=settings.rest_s)
