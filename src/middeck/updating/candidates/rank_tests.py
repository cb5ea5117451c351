"""Ranking of tests: the uncertainty of the promised quantities after each candidate test.

The information of a test is in the slopes of its readings, not in the values: so the deviations after it are
known before it is made (Lindley 1956, Ann. Math. Stat. 27; Chaloner and Verdinelli 1995, Statist. Sci. 10).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.environment import Environment
from middeck.updating.candidates.candidate_survey import CandidateSurvey
from middeck.updating.candidates.refinement_after_one_test import Foreseen, foresee
from middeck.updating.orbit.deflections import Deflection
from middeck.updating.orbit.predicted_frequencies import SolvedModes, predict_at, solve_there
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.static_tests import StaticTest
from middeck.values import record

# Digits of a ratio beyond which two tests are as good as each other.
DIGITS = 6


@record(kw_only=True)
class Promised:
    """A promised frequency or gauge reading.

    Attributes:
        where: The environment of a mode, the load case of a gauge.
        name: Name of the mode, or of the gauge.
        value: Value in ``unit``.
        std: Standard deviation of the logarithm of a frequency; of a reading over the largest that is
            promised of its gauge.
    """

    where: str
    name: str
    value: float
    unit: str
    std: float


@record(kw_only=True)
class Ranked:
    """The uncertainty after one test.

    Attributes:
        std: Standard deviations after the test of all that is promised, as in `Promised`.
        ratio: Each of these over its value before.
        widest: Ratio of the quantity with the widest interval before.
        median: Median of all ratios.
        foreseen: The refinement with the test, on which promises would stand.
    """

    name: str
    std: Float[np.ndarray, " promised"]
    ratio: Float[np.ndarray, " promised"]
    widest: float
    median: float
    foreseen: Foreseen


@record(kw_only=True)
class Ranking:
    """The promised quantities, the widest of them, and tests from the best to the worst."""

    promised: tuple[Promised, ...]
    widest: int
    tests: tuple[Ranked, ...]


def rank_tests(
    refined: Refined,
    candidates: Sequence[CandidateSurvey | StaticTest],
    environments: Mapping[str, Environment],
    *,
    count: int = 10,
    readings: Callable[[Refined], Sequence[Deflection]] | None = None,
) -> Ranking:
    """The candidates ranked by the widest promised interval that each alone would leave, then by the median.

    Promised are the lowest ``count`` modes that are not rigid, in each of the ``environments``, and what
    ``readings`` gives of a refinement, such as `predict_deflections` with load cases and gauges. A static
    test is a `StaticTest` whose values are not looked at. Each candidate is evaluated by
    `refinement_after_one_test.foresee`, which assumes that the article is as the refinement estimates it.

    Raises `ConfigError` for no candidate, nothing promised, a gauge that reads no more than its deviation,
    names given twice, and as `foresee`, which raises `NumericalError` too.
    """
    names = [c.name for c in candidates]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(f"the name {twice[0]!r} is given twice", where="candidate", hint="a name for each")
    if not candidates:
        raise ConfigError("no candidate", where="ranking of tests", hint="a test that may be made")
    places = {n: solve_there(refined, place, count=count) for n, place in environments.items()}
    promise = partial(_promised, places=places, readings=readings)
    promised = promise(refined)
    if not promised:
        raise ConfigError("nothing is promised", where="ranking of tests", hint="an environment, as orbit")
    before = np.array([p.std for p in promised])
    widest = int(np.argmax(before))
    tests = [_ranked(c.name, foresee(refined, c), promise, before, widest) for c in candidates]
    ordered = sorted(tests, key=lambda t: (round(t.widest, DIGITS), round(t.median, DIGITS), t.name))
    return Ranking(promised=promised, widest=widest, tests=tuple(ordered))


def _promised(
    refined: Refined,
    places: Mapping[str, SolvedModes],
    readings: Callable[[Refined], Sequence[Deflection]] | None,
) -> tuple[Promised, ...]:
    found: list[Promised] = []
    for name, place in places.items():
        predicted = predict_at(refined, place)
        found += [
            Promised(where=name, name=predicted.modes.name[i], value=float(hz), unit="Hz", std=float(std))
            for i, hz, std in zip(predicted.index, predicted.frequency_hz, predicted.log_std, strict=True)
        ]
    cases = readings(refined) if readings else ()
    most: dict[str, float] = {}
    for case in cases:
        for gauge, value in zip(case.gauges, case.value.tolist(), strict=True):
            most[gauge.name] = max(abs(value), most.get(gauge.name, 0.0))
    for case in cases:
        for gauge, value, std in zip(case.gauges, case.value.tolist(), case.std.tolist(), strict=True):
            scale = most[gauge.name]
            if not scale > gauge.std:
                raise ConfigError(
                    f"it reads {scale:.2g} {gauge.unit} at most, less than its deviation of {gauge.std:.2g}",
                    where=f"promised gauge {gauge.name!r}",
                    hint="leave it out, or promise what it reads under another load",
                )
            found.append(
                Promised(where=case.name, name=gauge.name, value=value, unit=gauge.unit, std=std / scale)
            )
    return tuple(found)


def _ranked(
    name: str,
    foreseen: Foreseen,
    promise: Callable[[Refined], tuple[Promised, ...]],
    before: Float[np.ndarray, " promised"],
    widest: int,
) -> Ranked:
    after = np.array([p.std for p in promise(foreseen.refined)])
    ratio = after / before
    return Ranked(
        name=name,
        std=after,
        ratio=ratio,
        widest=float(ratio[widest]),
        median=float(np.median(ratio)),
        foreseen=foreseen,
    )
