"""The bench: one article on its rig, its excitation, and the responses measured on it.

Open loop and closed loop, before or after its pair of modes has shifted: commands in, records out. A design
uses nothing else of the rig; only the stability of a loop is read from the rig's own eigenvalues.
"""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.control.sampled.emulation import emulate
from middeck.identification.spectra.estimate import estimate_response
from middeck.laboratory.article_rig import build_article_rig
from middeck.laboratory.rig.plant.drifting_modes import Drift, nearest_modes
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.runs import RigRun, run_closed_loop, run_open_loop
from middeck.laboratory.rig_settings import LoopTest, RigSettings
from middeck.laboratory.tested_article import RigArticle, rig_article_plant
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine, random_multisine
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# A motor that is at its limit for more than this share of a run holds a loop that is unstable without it.
SATURATED = 1e-3
SETTLE = 2  # unrecorded periods of a run


def limit_cycle(run: RigRun) -> str:
    """Message for a run that only the motor's limit kept finite; empty for a good one."""
    share = 0.0 if run.events is None else float(np.max(run.events.saturated))
    return f"unstable: the motor is at its limit in {share:.0%} of the run" if share > SATURATED else ""


@record(kw_only=True)
class Bench:
    """A rig, one period of the torque command in open and in closed loop, and the number of periods."""

    rig: Rig
    open_loop: Float[np.ndarray, "sample input"]
    closed_loop: Float[np.ndarray, "sample input"]
    periods: int
    rest_s: float
    band_hz: tuple[float, float]


@record
class Taken:
    """A closed-loop run: its response or the reason for none, the rms torque of the compensator, and the
    warnings of the record."""

    response: FrequencyResponse | None
    cause: str
    control_rms: float | None
    warnings: tuple[str, ...] = ()


def build_bench(
    article: RigArticle,
    settings: RigSettings,
    test: LoopTest,
    sensors: tuple[str, ...],
    rng: np.random.Generator,
    *,
    shift_percent: float = 0.0,
) -> Bench:
    """The article with one motor and ``sensors``, excited by random-phase multisines over the band.

    In open loop all lines are alike; in closed loop power falls with frequency, as the angles of integrated
    gyros are noisiest where the loop holds best. Its pair of modes near ``test.pair_shift_hz`` has drifted by
    ``shift_percent``.
    """
    equal = random_multisine(test.band_hz, test.period_s, settings.sample_hz, test.open_nm, rng)
    limits = Limits(rms=test.closed_nm)
    falling = design_multisine(
        test.band_hz, test.period_s, settings.sample_hz, limits, rng, amplitude=lambda f: f**-0.5
    )
    inputs = (test.actuator,)
    drifts: tuple[Drift, ...] = ()
    if shift_percent:
        pair = nearest_modes(rig_article_plant(article, inputs=inputs, outputs=sensors), test.pair_shift_hz)
        drifts = (Drift(pair, shift_percent, 1.0),)
    rig = build_article_rig(article, settings, inputs=inputs, outputs=sensors, drifts=drifts, age_s=1.0)
    return Bench(
        rig=rig,
        open_loop=equal[:, None],
        closed_loop=falling.u[0],
        periods=test.periods,
        rest_s=settings.rest_s,
        band_hz=test.band_hz,
    )


def take_open_loop(bench: Bench, rng: np.random.Generator) -> FrequencyResponse:
    """The measured response from the torque command to all sensors."""
    run = run_open_loop(
        bench.rig, bench.open_loop, periods=bench.periods, rng=rng, settle=SETTLE, rest_s=bench.rest_s
    )
    assert run.record is not None, run.cause
    response = estimate_response(run.record, band_hz=bench.band_hz)
    # Continuous designs that run at this very rate: for them the hold is half a period of the plant's delay.
    return dataclasses.replace(response, hold_s=None)


def take_closed_loop(bench: Bench, compensator: Compensator, rng: np.random.Generator) -> Taken:
    """The response under control: the compensator runs in the rig's computer by Tustin's rule."""
    run = run_closed_loop(
        bench.rig,
        emulate(compensator, bench.rig.period_s),
        bench.closed_loop,
        periods=bench.periods,
        rng=rng,
        settle=SETTLE,
        rest_s=bench.rest_s,
    )
    cause = run.cause or limit_cycle(run)
    if cause or run.record is None or run.control is None:
        return Taken(None, cause, None)
    response, notes = _estimated(run.record, bench.band_hz)
    return Taken(response, "", float(np.sqrt(np.mean(run.control**2))), notes)


def _estimated(
    record: Record, band_hz: tuple[float, float] | None
) -> tuple[FrequencyResponse, tuple[str, ...]]:
    """The response, and the warnings of the record; those of arithmetic stay warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        response = estimate_response(record, band_hz=band_hz)
    for one in caught:
        if not issubclass(one.category, UserWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return response, tuple(str(one.message) for one in caught if issubclass(one.category, UserWarning))
