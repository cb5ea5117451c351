"""Measured modes that may be other modes of the model than those they were compared with.

Where shapes cannot distinguish two modes, the frequency can; where the priors allow it for either, nothing
can. Other pairs are compared by their likelihood with the pairs as they are: linear about the refined
article, with half the square of what the priors allow as the error of that.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from middeck.structure.correlation.assurance import modal_assurance
from middeck.updating.refinement.model_errors import sorts_of
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.pairing import COMMON, WINDOW, at_channels
from middeck.updating.residuals.surveys import Compared, set_up
from middeck.updating.unknowns.unknowns import product_slopes

# Share of the pair's MAC: a shape of another mode with more than this cannot be distinguished.
ALIKE = 0.8
# Least likelihood, over that of the pairs as they are, of another pair that is named.
LIKELY = 0.05


class OtherPair(NamedTuple):
    """Frequencies [Hz] of a measured mode, of that it was paired with, and of that it may be as well."""

    survey: str
    measured_hz: float
    paired_hz: float
    other_hz: float


class _Errors(NamedTuple):
    """Errors of ln f at the mean of the prior, their slopes, and deviations without the unknowns."""

    y: np.ndarray
    J: np.ndarray
    std: np.ndarray

    def put(self, rows: list[int], others: _Errors, taken: list[int]) -> _Errors:
        """The errors with some ``rows`` replaced by those of ``others``."""
        changed = [part.copy() for part in self]
        for part, new in zip(changed, others, strict=True):
            part[rows] = new[taken]
        return _Errors(*changed)

    def unlikely(self, spread: np.ndarray) -> float:
        """Minus the logarithm of their likelihood."""
        by_priors = self.J * spread
        reach = np.sum(by_priors**2, axis=1)
        root = np.linalg.cholesky(by_priors @ by_priors.T + np.diag(self.std**2 + (0.5 * reach) ** 2))
        white = np.linalg.solve(root, self.y)
        return float(np.sum(np.log(np.diag(root))) + 0.5 * white @ white)


def other_pairs(refined: Refined) -> tuple[OtherPair, ...]:
    """The likeliest other mode of each measured one that may be another."""
    asked = [_candidates(c) for c in refined.compared]
    if not any(map(len, asked)):
        return ()
    whole = [_errors(refined, c, c.pairs) for c in refined.compared]
    errors = _Errors(*(np.concatenate(parts) for parts in zip(*whole, strict=True)))
    first = np.cumsum([0, *(len(c.pairs) for c in refined.compared)])
    return tuple(
        found
        for c, pairs, at in zip(refined.compared, asked, first, strict=False)
        if len(pairs)
        for found in _likely(refined, c, pairs, errors, int(at))
    )


def _likely(
    refined: Refined, c: Compared, asked: np.ndarray, errors: _Errors, first: int
) -> Iterator[OtherPair]:
    spread = np.array([u.spread for u in refined.unknowns])
    others, now, hz = _errors(refined, c, asked), errors.unlikely(spread), c.modes.frequency_hz
    number = {pair: n for n, pair in enumerate(map(tuple, asked.tolist()))}
    for k, (paired, j) in enumerate(c.pairs.tolist()):
        less = {}
        for n in np.flatnonzero(asked[:, 1] == j).tolist():
            rows, taken = [first + k], [n]
            # Another measured mode was paired with that one: they change places.
            for k2 in np.flatnonzero(c.paired.column[k] == asked[n, 0]).tolist():
                rows.append(first + k2)
                taken.append(number.get((int(c.paired.column[k2, k]), int(c.pairs[k2, 1])), -1))
            if min(taken) >= 0:
                less[n] = errors.put(rows, others, taken).unlikely(spread) - now
        best = min(less, key=lambda n: less[n], default=-1)
        if best >= 0 and less[best] < -np.log(LIKELY):
            measured = c.survey.measured.frequency_hz[j]
            yield OtherPair(c.survey.name, float(measured), float(hz[paired]), float(hz[asked[best, 0]]))


def _candidates(c: Compared) -> np.ndarray:
    """(other mode, measured mode) of paired ones that shapes do not exclude."""
    measured, hz = c.survey.measured, c.modes.frequency_hz
    alike = modal_assurance(at_channels(c.modes, measured), measured.shape) if measured.node else None
    found = [
        (i, j)
        for paired, j in c.pairs.tolist()
        for i in c.paired.own.columns(np.array([j]))[:, 0].tolist()
        if i != paired
        and 1.0 / WINDOW < hz[i] / measured.frequency_hz[j] < WINDOW
        and (alike is None or alike[i, j] > max(COMMON, ALIKE * alike[paired, j]))
    ]
    return np.array(found, dtype=int).reshape(-1, 2)


def _errors(refined: Refined, c: Compared, pairs: np.ndarray) -> _Errors:
    i, j = pairs.T
    lam = c.modes.omega[i] ** 2
    place = set_up(refined.structure, c.survey.environment, c.survey.settings, refined.unknowns)
    pushed = product_slopes(c.modes, place.bound, i, i, lam)
    for joint in c.paired.added:
        pushed += (np.real(joint.slope[:, j]) * c.modes.shapes[joint.coordinate, i] ** 2).T
    J = pushed / (2.0 * lam[:, None])
    mean = np.array([u.mean for u in refined.unknowns])
    y = np.log(c.survey.measured.frequency_hz[j] / c.modes.frequency_hz[i])
    tau = refined.estimate.tau[sorts_of(c.modes, i)]
    return _Errors(y + J @ (refined.linear_at - mean), J, np.hypot(c.survey.std[j], tau))
