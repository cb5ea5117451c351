"""Which test would help: what each of some tests would leave of the uncertainty of what is promised.

What a test tells is in the slopes of what it reads, not in the values: so the deviations after it are known
before it is made (Lindley 1956, Ann. Math. Stat. 27; Chaloner and Verdinelli 1995, Statist. Sci. 10).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.environment import Environment
from middeck.updating.candidate_survey import CandidateSurvey
from middeck.updating.foreseen import Foreseen, foresee
from middeck.updating.orbit import There, predict_at, solve_there
from middeck.updating.refine import Refined
from middeck.updating.statics import StaticTest
from middeck.values import record

# Digits of a ratio beyond which two tests are as good as each other.
DIGITS = 6


@record(kw_only=True)
class Promised:
    """A frequency that is promised.

    Attributes:
        std: Standard deviation of its logarithm, as things stand.
    """

    environment: str
    mode: str
    frequency_hz: float
    std: float


@record(kw_only=True)
class Ranked:
    """What one test would leave.

    Attributes:
        std: Of each frequency that is promised, the standard deviation of its logarithm after the test.
        ratio: Of these, each over that before.
        widest: The ratio of the frequency that is the widest before.
        median: Of all ratios.
        foreseen: The refinement with the test: what promises would stand on.
    """

    name: str
    std: Float[np.ndarray, " promised"]
    ratio: Float[np.ndarray, " promised"]
    widest: float
    median: float
    foreseen: Foreseen


@record(kw_only=True)
class Ranking:
    """Frequencies that are promised, which of them is the widest, and tests from the best to the worst."""

    promised: tuple[Promised, ...]
    widest: int
    tests: tuple[Ranked, ...]


def rank_tests(
    refined: Refined,
    candidates: Sequence[CandidateSurvey | StaticTest],
    environments: Mapping[str, Environment],
    *,
    count: int = 10,
) -> Ranking:
    """The candidates by what each, alone, leaves of the widest frequency, then of the median one.

    Promised are the lowest ``count`` modes that are not rigid, in each of the ``environments``. A static
    test is a `StaticTest` whose values are not looked at. Each candidate is refined on in thought, see
    `middeck.updating.foreseen.foresee`, which holds for the article as it is now thought to be.

    Raises `ConfigError` for no candidate, no environment, names given twice, and as `foresee`, which raises
    `NumericalError` too.
    """
    names = [c.name for c in candidates]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(f"two are called {twice[0]!r}", where="candidate", hint="a name for each")
    if not candidates or not environments:
        what, hint = ("candidate", "a test that may be made") if environments else ("environment", "orbit")
        raise ConfigError(f"no {what}", where="ranking of tests", hint=f"one at least: {hint}")
    places = [solve_there(refined, place, count=count) for place in environments.values()]
    told = [predict_at(refined, place) for place in places]
    promised = tuple(
        Promised(environment=name, mode=p.modes.name[i], frequency_hz=float(hz), std=float(std))
        for name, p in zip(environments, told, strict=True)
        for i, hz, std in zip(p.index, p.frequency_hz, p.log_std, strict=True)
    )
    before = np.array([p.std for p in promised])
    widest = int(np.argmax(before))
    tests = [_ranked(c.name, foresee(refined, c), places, before, widest) for c in candidates]
    ordered = sorted(tests, key=lambda t: (round(t.widest, DIGITS), round(t.median, DIGITS), t.name))
    return Ranking(promised=promised, widest=widest, tests=tuple(ordered))


def _ranked(
    name: str,
    foreseen: Foreseen,
    places: Sequence[There],
    before: Float[np.ndarray, " promised"],
    widest: int,
) -> Ranked:
    after = np.concatenate([predict_at(foreseen.refined, place).log_std for place in places])
    ratio = after / before
    return Ranked(
        name=name,
        std=after,
        ratio=ratio,
        widest=float(ratio[widest]),
        median=float(np.median(ratio)),
        foreseen=foreseen,
    )
