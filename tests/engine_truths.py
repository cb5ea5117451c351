"""Laws that are stable on every model on board and destabilise the truth, and what stops each."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import NamedTuple

import numpy as np

from engine_destabilising import (
    LEAST_RATE,
    MOST_RATE,
    Destabiliser,
    own_limits,
    own_ranges,
    shifted_article,
)
from engine_rigs import (
    RigCase,
    article_of,
    closed_states,
    growth,
    pack,
    rig_case,
    settings_of,
    weighted_lqg,
)
from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_on_rig import (
    GateRig,
    GateTrials,
    check_dry_run,
    check_engagement,
    check_shadow_run,
)
from middeck.realtime.gate.steps_without_rig import GateMargins, check_poles
from middeck.realtime.package.package import ControllerPackage

TURNED_DEG = 20.0
"""By which the primary payload is turned in the second model on board."""
DECADES = (0.0, 8.0)
"""Of authority."""
LEAST_SHIFT, MOST_SHIFT = 0.02, 0.05
TRUTHS = 4
"""That are drawn for one law."""
TRIALS = GateTrials(dry_s=5.0, shadow_s=2.0)


class Family(NamedTuple):
    """An engine's rig, and the ports of a law on it: one or two motors to angles, or all; of the second kind
    ``drives`` and ``sensors`` are empty."""

    article: str
    environment: str
    drives: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()

    @property
    def rig(self) -> tuple[str, str]:
        return self.article, self.environment

    @property
    def ports(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        case = rig_case(*self.rig)
        return self.drives or case.drives[: case.controlled], self.sensors or case.sensors[: case.measured]


FAMILIES = (
    Family("dm", "lab"),
    Family("simple", "lab"),
    Family("dm", "lab", ("pri_rel_z",), ("pri_in_z",)),
    Family("simple", "orbit"),
    Family("dm", "orbit"),
    Family("simple", "orbit", ("pri_rel_x", "pri_rel_z"), ("pri_in_x", "pri_in_z")),
)
"""In turn."""


class Draw(NamedTuple):
    """A package of a family, its article, and its decades of authority."""

    found: Destabiliser
    family: Family
    decades: float


@functools.cache
def on_board(article: str, environment: str) -> dict[str, tuple[RigCase, LinearArticle]]:
    """The models, and as an engine steps them."""
    angles = {"straight": 0.0, "turned": TURNED_DEG}
    cases = {name: rig_case(article, environment, angle) for name, angle in angles.items()}
    return {name: (case, article_of(case)) for name, case in cases.items()}


def first_attempt(number: int) -> tuple[int, Draw]:
    """The first attempt at package ``number`` that gives one."""
    tried = ((trial, attempt(number, trial)) for trial in itertools.count())
    return next((trial, draw) for trial, draw in tried if draw is not None)


def attempt(number: int, trial: int) -> Draw | None:
    """Of package ``number``; None where the law is not stable on board, or is so on all of `TRUTHS` truths.

    Every weight, intensity and frequency is drawn from a continuum: no two laws are alike.
    """
    rng, family = np.random.default_rng([number, trial]), FAMILIES[number % len(FAMILIES)]
    decades = float(rng.uniform(*DECADES))
    law = drawn_law(rng, family, decades)
    models = on_board(*family.rig)
    if any(growth(closed_states(case, model, law)) >= 0.0 for case, model in models.values()):
        return None
    for _ in range(TRUTHS):
        case, _ = models[str(rng.choice(list(models)))]
        truth = shifted_article(rng, case, LEAST_SHIFT, MOST_SHIFT)
        rate = growth(closed_states(case, truth, law))
        if LEAST_RATE < rate < MOST_RATE:
            share = float(10.0 ** rng.uniform(-1.0, 0.0))
            found = Destabiliser(kind="truth", law=law, article=truth, rate=rate, share=share)
            return Draw(found, family, decades)
    return None


def drawn_law(rng: np.random.Generator, family: Family, decades: float) -> Compensator:
    """LQG on the model that is straight, its weights and intensities up to a decade to either side."""
    case, model = on_board(*family.rig)["straight"]
    drives, sensors = family.ports
    angles = sum(not name.endswith("_rate") for name in sensors)
    weights = 10.0 ** rng.uniform(-1.0, 1.0, angles), 10.0 ** (rng.uniform(-1.0, 1.0, len(drives)) - decades)
    intensities = float(10.0 ** rng.uniform(-1.0, 1.0)), float(10.0 ** rng.uniform(-8.0, -4.0))
    noise = 10.0 ** rng.uniform(-1.0, 1.0, len(sensors))
    return weighted_lqg(case, model, (drives, sensors), weights, (*intensities, noise))


def packed(draw: Draw) -> ControllerPackage:
    """It declares itself unstable where it is: for such a law the gate wants a proof."""
    found, settings = draw.found, settings_of(*draw.family.rig)
    ranges, limits = own_ranges(found.law, settings), own_limits(found, settings)
    unstable = growth(found.law.sampled.A) >= 0.0
    return pack(found.law, input_range=ranges, limit=limits, unstable=unstable)


def refusals(draw: Draw) -> list[str]:
    """The cheap steps of the gate that refuse it, each asked for itself; the truth is the rig.

    Dry run and shadow run are shorter than the gate's own.
    """
    poles = check_poles(with_hold(packed(draw), settings_of(*draw.family.rig)))
    on_paper = {"poles": not poles.passed, "model": has_weak_motor(draw)}
    return [*(step for step, refused in on_paper.items() if refused), *refusals_in_runs(draw, TRIALS)]


def refusals_in_runs(draw: Draw, trials: GateTrials) -> list[str]:
    """The runs of the gate that refuse it, each asked for itself."""
    package, settings = packed(draw), settings_of(*draw.family.rig)
    bench = GateRig(draw.found.article, settings)
    models = on_board(*draw.family.rig).items()
    dry = (check_dry_run(package, name, case.plant, trials, settings) for name, (case, _) in models)
    passed = {
        "dry run": all(step.passed for step in dry),
        "shadow run": check_shadow_run(package, bench, trials).passed,
        "engagement": check_engagement(package, bench, trials)[0].passed,
    }
    return [step for step, good in passed.items() if not good]


def refusal_on_paper(draw: Draw) -> str:
    """The step that refuses it on paper, "" for none: margins at every fade, and recovery.

    That takes half a minute of a package which passes, and is left for those that no cheap step refuses.
    """
    plants = {name: case.plant for name, (case, _) in on_board(*draw.family.rig).items()}
    steps = examine_package(packed(draw), plants, settings=settings_of(*draw.family.rig)).steps
    return next((step.name.split()[0] for step in steps if not step.passed), "")


def has_weak_motor(draw: Draw) -> bool:
    """Whether 6 dB of gain more or less at one motor let a model on board grow: the gate asks for more."""
    law, factor = draw.found.law, 10.0 ** (GateMargins().gain_db / 20.0)
    return any(
        growth(closed_states(case, scaled_drive(model, k, gain), law)) >= 0.0
        for case, model in on_board(*draw.family.rig).values()
        for k in range(len(case.drives))
        for gain in (factor, 1.0 / factor)
    )


def scaled_drive(article: LinearArticle, k: int, gain: float) -> LinearArticle:
    B = article.B.copy()
    B[:, k] *= gain
    return dataclasses.replace(article, B=B)
