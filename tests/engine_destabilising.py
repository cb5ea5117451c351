"""Random packages that destabilise an article, and what an engine makes of each."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from engine_rigs import (
    ENVELOPE,
    RigCase,
    article_of,
    closed_states,
    design,
    growth,
    nominal_article,
    pack,
    rig_case,
    scaled_rows,
    settings_of,
    wait_for_hold,
)  # fmt: skip
from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.settings import EngineSettings
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.gate.gate import examine_package
from middeck.systems.plants.mode_shift import shift_modes
from middeck.values import record
from ungated import Supervisor

SLOW_S = 10.0
"""Growth time from which a package counts as slow."""
GROWTHS, SATURATED_S = 10.0, 2.0
"""A trip may take so many growth times, and so long of saturation, whichever comes first."""
LEAST_RATE, MOST_RATE = 0.02, 1000.0
"""Growth that is drawn [1/s]: what takes 50 s for a factor of e, and what has no need of an engine."""
READY, AFTER, PIECE, LONGEST = 1600, 2500, 250, 60_000


@record(kw_only=True)
class Destabiliser:
    """A compensator, the article that it destabilises, and how fast.

    Attributes:
        kind: How it was made.
        rate: Of the fastest growth of the linear loop [1/s].
        share: Of the engine's limits that the package allows itself.
    """

    kind: str
    law: Compensator
    article: LinearArticle
    rate: float
    share: float


@record(kw_only=True)
class Outcome:
    """What came of it.

    Attributes:
        trip: Its kind; "" for none.
        after_s: From full authority to the trip; below zero before it; inf for none.
        allowed_s: How long it may take.
        peak: Largest angle, until long after the trip, over the envelope.
        torque: Largest torque over its limit.
        blacklisted: Whether the package was.
        held: Whether the safe state ended with the hold in action.
    """

    kind: str
    rate: float
    trip: str
    after_s: float
    allowed_s: float
    peak: float
    torque: float
    blacklisted: bool
    held: bool

    @property
    def bounded(self) -> bool:
        """Whether no angle went beyond twice its envelope, and no torque beyond its limit."""
        return self.peak <= 2.0 and self.torque <= 1.0

    @property
    def sound(self) -> bool:
        return self.after_s <= self.allowed_s and self.bounded


def wrong(rng: np.random.Generator, article: str, environment: str) -> tuple[str, Compensator]:
    """A compensator spoilt at random."""
    law = design(article, environment, rng.choice([0.0, 1.0, 2.0, 3.0, 4.0]))
    kind = str(rng.choice(["gain", "sign", "one sign", "swapped", "random", "late"]))
    u, y = law.sampled.D.shape
    if kind == "gain":
        return kind, scaled_rows(law, np.full(u, 10.0 ** rng.uniform(0.3, 2.5)))
    if kind == "sign":
        return kind, scaled_rows(law, np.full(u, -(10.0 ** rng.uniform(-1.0, 1.0))))
    if kind == "one sign":
        rows = np.ones(u)
        rows[rng.integers(u)] = -(10.0 ** rng.uniform(-0.5, 1.5))
        return kind, scaled_rows(law, rows)
    s = law.sampled
    if kind == "swapped":
        B = s.B[:, rng.permutation(y)]
        return kind, _with(law, s.A, B, s.C, s.D)
    if kind == "late":
        return kind, _late(law, int(rng.integers(3, 30)))
    n = 2 * int(rng.integers(1, 8))
    angle, radius = rng.uniform(0.01, 1.0, n // 2), rng.uniform(0.9, 0.999, n // 2)
    A = np.zeros((n, n))
    for i, (w, r) in enumerate(zip(angle, radius, strict=True)):
        c, d = r * np.cos(w), r * np.sin(w)
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[c, d], [-d, c]]
    size = 10.0 ** rng.uniform(-2.0, 1.0)
    B, C = rng.standard_normal((n, y)), size * rng.standard_normal((u, n)) / n
    return kind, _with(law, A, B, C, size * rng.standard_normal((u, y)), applied=False)


def _with(law: Compensator, A, B, C, D, applied: bool = True) -> Compensator:
    dynamics = type(law.sampled)(A, B, C, D, period_s=law.sampled.period_s)
    return Compensator(dynamics, law.inputs, law.outputs, applied=law.applied if applied else None)


def _late(law: Compensator, samples: int) -> Compensator:
    """Its outputs so many samples later."""
    s, u, n = law.sampled, len(law.outputs), len(law.sampled.A)
    k = samples * u
    A = np.zeros((n + k, n + k))
    A[:n, :n] = s.A
    A[n : n + u, :n] = s.C
    A[n + u :, n:-u] += np.eye(k - u)
    C = np.zeros((u, n + k))
    C[:, -u:] = np.eye(u)
    B = np.vstack([s.B, s.D, np.zeros((k - u, len(law.inputs)))])
    return _with(law, A, B, C, np.zeros_like(s.D), applied=False)


def shifted_truth(
    rng: np.random.Generator,
    article: str,
    environment: str,
    least: float,
    most: float,
    *,
    either: bool = True,
) -> LinearArticle:
    """The article with every frequency off by ``least`` to ``most``, to ``either`` side."""
    return shifted_article(rng, rig_case(article, environment), least, most, either=either)


def shifted_article(
    rng: np.random.Generator, case: RigCase, least: float, most: float, *, either: bool = True
) -> LinearArticle:
    """The article of ``case`` with every frequency off by ``least`` to ``most``, to ``either`` side."""
    modal = case.plant.modal
    moved = {
        name: 1.0 + (rng.choice([-1.0, 1.0]) if either else 1.0) * rng.uniform(least, most)
        for name, omega in zip(modal.names, modal.omega, strict=True)
        if omega > 0.0
    }
    return article_of(case, shift_modes(case.plant, moved), seed=int(rng.integers(1 << 30)))


@functools.cache
def draw(seed: int, article: str = "dm", environment: str = "lab") -> Destabiliser:
    """The first draw from ``seed`` that is unstable."""
    rng, case, model = (
        np.random.default_rng(seed),
        rig_case(article, environment),
        nominal_article(article, environment),
    )
    while True:
        kind, law = wrong(rng, article, environment)
        truth = dataclasses.replace(model, seed=int(rng.integers(1 << 30)))
        rate = growth(closed_states(case, truth, law))
        if LEAST_RATE < rate < MOST_RATE:
            share = float(10.0 ** rng.choice([0.0, 0.0, -1.0]))
            return Destabiliser(kind=kind, law=law, article=truth, rate=rate, share=share)


def refused_on_paper(law: Compensator, article: str, environment: str) -> str:
    """The step of the gate that refuses it on the model beside the hold; "" for none. Limits have no part."""
    settings = settings_of(article, environment)
    package = pack(law, input_range=own_ranges(law, settings), limit=np.ones(len(law.outputs)))
    models = {"on board": rig_case(article, environment).plant}
    verdict = examine_package(package, models, settings=settings)
    return next((step.name.removesuffix(" on board") for step in verdict.steps if not step.passed), "")


def own_limits(found: Destabiliser, settings: EngineSettings) -> np.ndarray:
    drives = [settings.drives[settings.drive(port.name)] for port in found.law.outputs]
    return found.share * np.array([drive.upper for drive in drives])


def own_ranges(law: Compensator, settings: EngineSettings) -> list[float]:
    names = [port.name for port in settings.inputs]
    return [settings.sensors[names.index(port.name)].range for port in law.inputs]


def judge(
    found: Destabiliser, article: str = "dm", environment: str = "lab", *, longest: int = LONGEST
) -> Outcome:
    """Engage it past the gate and see, for twice `GROWTHS` and ``longest`` samples at most."""
    settings = settings_of(article, environment)
    limits = np.array([drive.upper for drive in settings.drives])
    with Supervisor(settings, found.article) as engine:
        assert engine.load(pack(found.law, limit=own_limits(found, settings))).done
        engine.reset()
        engine.run(READY, keep=False)
        begun = wait_for_hold(engine)
        assert engine.command("engage", values=[1.0]).done
        seen = [_seen(engine.run(PIECE))]
        longest = min(longest, int(2.0 * GROWTHS / found.rate / settings.period_s) + 3000)
        while engine.state != "safe" and len(seen) * PIECE < longest:
            seen.append(_seen(engine.run(PIECE)))
        tripped = engine.state == "safe"
        events = engine.events()
        seen.append(_seen(engine.run(AFTER if tripped else 1)))
        banned = bool(engine.blacklist())
        held = bool(engine.file.status["hold_verified"]) and not any(
            e.kind == "hold lost" for e in engine.events()
        )
    angle, torque = (np.max([piece[i] for piece in seen], axis=0) for i in range(2))
    full = settings.samples(settings.ramp_s)
    trips = [e for e in events if e.trips]
    at = trips[0].sample - begun - full if trips else np.inf
    angles = [i for i, s in enumerate(settings.sensors) if np.isfinite(s.envelope)]
    return Outcome(
        kind=found.kind,
        rate=found.rate,
        trip=trips[0].kind if trips else "",
        after_s=at * settings.period_s,
        allowed_s=_allowed(np.concatenate([busy for *_, busy in seen]), found.rate, full, settings.period_s),
        peak=float(angle[angles].max() / np.radians(ENVELOPE[article, environment])),
        torque=float((torque / limits).max()),
        blacklisted=banned,
        held=held,
    )


def _seen(records: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest reading of each sensor, largest of each output, and when one was at its limit."""
    return np.abs(records["y"]).max(axis=0), np.abs(records["u"]).max(axis=0), records["saturated"] != 0


def _allowed(saturated: np.ndarray, rate: float, full: int, period_s: float) -> float:
    """Ten growth times, or two seconds in which some output is at its limit most of the time."""
    window = 100
    busy = np.convolve(saturated, np.ones(window) / window, "full")[: len(saturated)] > 0.5
    run, longest = 0, np.inf
    for k, one in enumerate(busy):
        run = run + 1 if one else 0
        if run * period_s >= SATURATED_S:
            longest = (k - full) * period_s
            break
    return min(GROWTHS / rate, longest)
