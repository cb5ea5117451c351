"""Refine an article on modes measured on the ground: the most probable unknowns, and what stays open.

Gauss-Newton on analytic slopes, the model's own errors found anew at every step (`posterior`): far from the
answer they are large, which keeps the steps small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import Structure
from middeck.structure.modes.solve import Modes
from middeck.updating.posterior import USUAL, Estimate, Linear, estimate
from middeck.updating.surveys import Compared, SetUp, Survey, compare, pair, set_up
from middeck.updating.unknowns import ENVIRONMENT, Unknown
from middeck.values import record

# Modes that live of gravity and suspension, and flexible ones, have errors of their own.
SORTS = ("suspension", "flexible")
STEPS = 12
# A step is the last that moves no unknown by more than this part of its deviation: it leaves its square.
SMALL = 0.2
# No step moves an unknown by more than this many of its prior deviations.
LARGEST = 2.0
HALVINGS = 6
# Steps back that are not this much smaller than the last swing about the answer.
SHRINKS = 0.7


@record(kw_only=True)
class Refined:
    """An article refined on surveys.

    Attributes:
        compared: Each survey beside the model at the most probable unknowns.
        estimate: Unknowns, the model's own errors, and their covariance, linear about there.
        before_hz: Frequencies of the modes of the mean of the prior that each survey's pairs were then.
        history: Largest move of an unknown in its own deviations, step by step.
        converged: Whether the last was small.
    """

    structure: Structure
    unknowns: tuple[Unknown, ...]
    compared: tuple[Compared, ...]
    estimate: Estimate
    before_hz: tuple[tuple[float, ...], ...]
    history: tuple[float, ...]
    converged: bool

    @property
    def x(self) -> Float[np.ndarray, " unknown"]:
        """The most probable unknowns."""
        return np.array([u.mean for u in self.unknowns]) + self.estimate.x

    @property
    def factors(self) -> dict[str, float]:
        """Of the article's parameters by name, as the ``[factors]`` of its file take them.

        What is added, and what belongs to an environment, has no place there (`left_out`).
        """
        factors: dict[str, float] = {}
        for unknown, x in zip(self.unknowns, self.x, strict=True):
            if unknown in self.left_out:
                continue
            for name in unknown.parameters:
                factors[name] = factors.get(name, 1.0) * float(np.exp(x))
        return factors

    @property
    def left_out(self) -> tuple[Unknown, ...]:
        """Unknowns that ``factors`` of an article cannot hold."""
        return tuple(
            u for u in self.unknowns if u.added or any(n.startswith(ENVIRONMENT) for n in u.parameters)
        )


def refine(
    structure: Structure, surveys: Sequence[Survey], unknowns: Sequence[Unknown], model_error: float = USUAL
) -> Refined:
    """The most probable unknowns. ``structure`` is the article as drawn, whatever they are.

    ``model_error`` is what the frequencies of a model of this sort are thought to be wrong by, in parts of
    one, whatever its numbers: what the surveys show takes its place, the less the fewer modes they have.

    Raises `ConfigError` for no survey, an unknown that no survey has, names given twice, or a survey without
    any mode in common; `NumericalError` where the article has no rest state at the mean of the prior.
    """
    _check_names(surveys, unknowns)
    places = _places(structure, surveys, unknowns)
    mean, spread = (np.array([getattr(u, name) for u in unknowns]) for name in ("mean", "spread"))
    x, history, pace, last = mean.copy(), [], 1.0, np.zeros(len(mean))
    modes = first = [place.solve(x) for place in places]
    while True:
        compared = [compare(m, s, place.bound) for m, s, place in zip(modes, surveys, places, strict=True)]
        found = estimate(_linear(compared, x - mean, spread), model_error)
        step = mean + found.x - x
        history.append(float(np.max(np.abs(step) / found.x_std, initial=0.0)))
        if history[-1] < SMALL or len(history) >= STEPS:
            break
        size, pace = step / spread, _pace(pace, step / spread, last)
        x, modes, last = *_moved(places, x, step * min(pace, LARGEST / np.max(np.abs(size)))), size
    return Refined(
        structure=structure,
        unknowns=tuple(unknowns),
        compared=tuple(compared),
        estimate=found,
        before_hz=tuple(_before(old, c) for old, c in zip(first, compared, strict=True)),
        history=tuple(history),
        converged=history[-1] < SMALL,
    )


def compare_at_first(
    structure: Structure, surveys: Sequence[Survey], unknowns: Sequence[Unknown]
) -> tuple[Compared, ...]:
    """Every survey beside the model at the mean of the prior. Raises `ConfigError` as `refine`."""
    _check_names(surveys, unknowns)
    x = np.array([u.mean for u in unknowns])
    places = _places(structure, surveys, unknowns)
    return tuple(compare(p.solve(x), s, p.bound) for p, s in zip(places, surveys, strict=True))


def _before(old: Modes, compared: Compared) -> tuple[float, ...]:
    """Of the modes that the measured ones were at first; where one was none, not a number."""
    hz = dict.fromkeys(compared.pairs[:, 1].tolist(), np.nan)
    hz |= {j: old.frequency_hz[i] for i, j in pair(old, compared.survey.measured).tolist() if j in hz}
    return tuple(hz[j] for j in compared.pairs[:, 1].tolist())


def _places(structure: Structure, surveys: Sequence[Survey], unknowns: Sequence[Unknown]) -> list[SetUp]:
    """The article as each survey had it."""
    places = [set_up(structure, s.environment, s.settings, unknowns) for s in surveys]
    for k, unknown in enumerate(unknowns):
        if not any(place.bound[k].parameters for place in places):
            raise ConfigError(
                f"no survey has {', '.join(unknown.parameters)}",
                where=f"unknown {unknown.name!r}",
                hint="`middeck sensitivity` lists the parameters",
            )
    return places


def _pace(pace: float, step: np.ndarray, last: np.ndarray) -> float:
    """Half of it for steps that swing, twice of it, up to one, for others.

    Both in deviations of the prior: those of the answer shrink with the model's errors on the way there.
    """
    swings = step @ last < 0.0 and np.linalg.norm(step) > SHRINKS * np.linalg.norm(last)
    return 0.5 * pace if swings else min(1.0, 2.0 * pace)


def _moved(places: Sequence[SetUp], x: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, list[Modes]]:
    """A step, shorter where the article has no rest state at its end."""
    for _ in range(HALVINGS):
        try:
            return x + step, [place.solve(x + step) for place in places]
        except NumericalError:
            step = 0.5 * step
    raise NumericalError(
        "the article has no rest state near the unknowns that fit best",
        where="refinement",
        hint="narrower spreads, or fewer unknowns",
    )


def _linear(compared: Sequence[Compared], from_mean: np.ndarray, spread: np.ndarray) -> Linear:
    """The surveys as one linear problem about the present unknowns."""
    J = np.vstack([c.slope for c in compared])
    y = np.concatenate([c.residual for c in compared]) + J @ from_mean
    first = compared[0]
    own = [np.arange(len(c.rows)) < len(c.pairs) for c in compared]
    S = np.vstack(
        [
            np.where(mine[:, None], shared_with(first, c.modes)[c.rows[:, 1]], 0.0)
            for c, mine in zip(compared, own, strict=True)
        ]
    )
    return Linear(
        y=y,
        std=np.concatenate([c.std for c in compared]),
        J=J,
        spread=spread,
        S=S,
        rest=np.maximum(1.0 - np.sum(S**2, axis=1), 0.0),
        sort=sorts_of(first.modes, first.pairs[:, 0]),
        row_sort=np.concatenate([sorts_of(c.modes, c.rows[:, 1]) for c in compared]),
        sorts=len(SORTS),
    )


def sorts_of(modes: Modes, index: Int[np.ndarray, " mode"]) -> Int[np.ndarray, " mode"]:
    """Of each mode, its place in `SORTS`."""
    return np.array([modes.kind[i] == "flexible" for i in index], dtype=int)


def shared_with(first: Compared, others: Modes) -> Float[np.ndarray, "mode pair"]:
    """Part of each of the other modes that is each of the first survey's paired ones, in strain of the whole.

    For a small error of the model d ln f of a mode is the sum of those of the modes that it is made of, each
    by its share, and of cross terms that nobody knows.
    """
    own = first.modes.shapes[:, first.pairs[:, 0]]
    weighted = first.modes.mass @ others.shapes
    size = np.einsum("im,im->m", others.shapes, weighted)
    return ((own.T @ weighted) ** 2 / size).T


def _check_names(surveys: Sequence[Survey], unknowns: Sequence[Unknown]) -> None:
    for what, given in (("survey", surveys), ("unknown", unknowns)):
        names = [g.name for g in given]
        if not names:
            raise ConfigError(f"no {what}", where="refinement", hint="one at least")
        twice = [n for n in names if names.count(n) > 1]
        if twice:
            raise ConfigError(f"two are called {twice[0]!r}", where=what, hint="a name for each")
