"""Measured modes that may be other modes of the model than those that they were paired with.

Where shapes cannot distinguish two modes, the frequency can; where the priors allow it for either, nothing
can. Other pairs, one at a time and all that one draws along by the unknowns that it asks for, are compared by
their likelihood with the pairs as they are: linear about the refined article, with half the square of what
the priors allow as the error of that.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from middeck.structure.correlation.assurance import modal_assurance
from middeck.updating.refinement.model_errors import sorts_of
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.pairing import COMMON, WINDOW, at_channels
from middeck.updating.residuals.surveys import Compared
from middeck.updating.unknowns.unknowns import product_slopes
from middeck.values import record

# Share of the pair's MAC: a shape of another mode with more than this cannot be distinguished.
ALIKE = 0.8
# Least likelihood, over that of the pairs as they are, of another pair that is named.
LIKELY = 0.05
# Sweeps over the pairs that move with one; a cost that no pair has.
SWEEPS, FORBIDDEN = 4, 1e12


@record(kw_only=True)
class OtherPair:
    """Frequencies [Hz] of a measured mode, of the mode paired with it, and of another that is possible.

    If it is, ``unknown`` is off by so many of its stated deviations, the most of all.
    """

    survey: str
    measured_hz: float
    paired_hz: float
    other_hz: float
    unknown: str
    off: float


@record(kw_only=True)
class _Rows:
    """Errors of ln f at the mean of the prior, slopes over prior deviations, deviations without the unknowns.

    One row for each mode that a measured one may be, first those that were taken. ``measured`` numbers the
    measured modes of all surveys, ``mode`` the modes of the model in all.
    """

    y: np.ndarray
    J: np.ndarray
    std: np.ndarray
    measured: np.ndarray
    mode: np.ndarray

    @property
    def noise(self) -> np.ndarray:
        """Variances, with what the priors allow of other than slopes."""
        return self.std**2 + (0.5 * np.sum(self.J**2, axis=1)) ** 2

    def unlikely(self, taken: np.ndarray) -> float:
        """Minus the logarithm of the likelihood of these rows."""
        J, y = self.J[taken], self.y[taken]
        root = np.linalg.cholesky(J @ J.T + np.diag(self.noise[taken]))
        white = np.linalg.solve(root, y)
        return float(np.sum(np.log(np.diag(root))) + 0.5 * white @ white)

    def found(self, taken: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean of the unknowns by these rows, over prior deviations, and covariance."""
        J = self.J[taken]
        P = np.linalg.inv(np.eye(J.shape[1]) + J.T @ (J / noise[taken][:, None]))
        return P @ (J.T @ (self.y[taken] / noise[taken])), P

    def exchanged(self, taken: np.ndarray, row: int) -> np.ndarray | None:
        """``taken`` with this row, who had its mode taking the other; None if it cannot."""
        out, k = taken.copy(), self.measured[row]
        for k2 in np.flatnonzero(self.mode[taken] == self.mode[row]):
            other = np.flatnonzero((self.measured == k2) & (self.mode == self.mode[taken[k]]))
            if not len(other):
                return None
            out[k2] = other[0]
        out[k] = row
        return out

    def drawn_along(self, taken: np.ndarray, row: int) -> Iterator[np.ndarray]:
        """Likeliest rows with the unknowns that this one asks for, and again with those of all rows."""
        known, last = np.array([row]), taken
        for _ in range(SWEEPS):
            x, P = self.found(known, self.noise)
            var = np.einsum("ij,jk,ik->i", self.J, P, self.J) + self.noise
            cost = np.full((self.mode.max() + 1, len(taken)), FORBIDDEN)
            cost[self.mode, self.measured] = (self.y - self.J @ x) ** 2 / var + np.log(var)
            cost[:, self.measured[row]] = FORBIDDEN
            cost[self.mode[row], :] = FORBIDDEN
            cost[self.mode[row], self.measured[row]] = 0.0
            mode, measured = linear_sum_assignment(cost)
            if len(measured) < len(taken) or np.any(cost[mode, measured] >= FORBIDDEN):
                return
            place = {
                pair: n for n, pair in enumerate(zip(self.mode.tolist(), self.measured.tolist(), strict=True))
            }
            known = np.empty_like(taken)
            known[measured] = [place[pair] for pair in zip(mode.tolist(), measured.tolist(), strict=True)]
            if np.array_equal(known, last):
                return
            yield known
            last = known


def other_pairs(refined: Refined) -> tuple[OtherPair, ...]:
    """The likeliest alternative mode of each measured mode, where it would move an unknown."""
    asked = [_candidates(c) for c in refined.compared]
    if not any(map(len, asked)):
        return ()
    rows = _rows(refined, asked)
    taken = np.arange(sum(len(c.pairs) for c in refined.compared))
    now, (x, _) = rows.unlikely(taken), rows.found(taken, rows.std**2)
    stated = refined.estimate.x_std / np.array([u.spread for u in refined.unknowns])
    places = [(c, k) for c in refined.compared for k in range(len(c.pairs))]
    others = [(c, int(i)) for c, pairs in zip(refined.compared, asked, strict=True) for i in pairs[:, 0]]
    best: dict[int, tuple[float, OtherPair]] = {}
    for row, (c, i) in enumerate(others, start=len(taken)):
        exchanged, k = rows.exchanged(taken, row), int(rows.measured[row])
        for by in (*rows.drawn_along(taken, row), *(() if exchanged is None else (exchanged,))):
            less = rows.unlikely(by) - now
            off = np.abs(rows.found(by, rows.std**2)[0] - x) / stated
            if less < -np.log(LIKELY) and off.max() > 1.0 and less < best.get(k, (np.inf,))[0]:
                paired, j = c.pairs[places[k][1]]
                most = int(np.argmax(off))
                best[k] = (
                    less,
                    OtherPair(
                        survey=c.survey.name,
                        measured_hz=float(c.survey.measured.frequency_hz[j]),
                        paired_hz=float(c.modes.frequency_hz[paired]),
                        other_hz=float(c.modes.frequency_hz[i]),
                        unknown=refined.unknowns[most].name,
                        off=float(off[most]),
                    ),
                )
    return tuple(best[k][1] for k in sorted(best))


def _rows(refined: Refined, asked: Sequence[np.ndarray]) -> _Rows:
    """Rows of the pairs as they are, then of the pairs ``asked`` for each survey."""
    spread = np.array([u.spread for u in refined.unknowns])
    parts, count, first = [], 0, 0
    for c, pairs in zip(refined.compared, asked, strict=True):
        number = np.full(len(c.survey.measured.frequency_hz), -1)
        number[c.pairs[:, 1]] = count + np.arange(len(c.pairs))
        for some in (c.pairs, pairs):
            y, J, std = _errors(refined, c, some)
            parts.append((y, J * spread, std, number[some[:, 1]], first + some[:, 0] % c.paired.own.count))
        count, first = count + len(c.pairs), first + c.paired.own.count
    y, J, std, number, mode = (np.concatenate(part) for part in zip(*parts[::2], *parts[1::2], strict=True))
    return _Rows(y=y, J=J, std=std, measured=number, mode=mode)


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


def _errors(refined: Refined, c: Compared, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of ln f at the mean of the prior, their slopes, and deviations without the unknowns."""
    i, j = pairs.T
    lam = c.modes.omega[i] ** 2
    place = c.survey.set_up(refined.structure, refined.unknowns)
    pushed = product_slopes(c.modes, place.bound, i, i, lam)
    for joint in c.paired.added:
        pushed += (np.real(joint.slope[:, j]) * c.modes.shapes[joint.coordinate, i] ** 2).T
    J = pushed / (2.0 * lam[:, None])
    mean = np.array([u.mean for u in refined.unknowns])
    y = np.log(c.survey.measured.frequency_hz[j] / c.modes.frequency_hz[i])
    tau = refined.estimate.tau[sorts_of(c.modes, i)]
    return y + J @ (refined.linear_at - mean), J, np.hypot(c.survey.std[j], tau)
