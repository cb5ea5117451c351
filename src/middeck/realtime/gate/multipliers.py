"""Weights of the inequalities of limited outputs with which their sum is negative at all frequencies.

The argument is in `recovery_proof`.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
import scipy.optimize as so
from jaxtyping import Complex, Float

from middeck.realtime.gate.limited_loop import Loop, bound_error
from middeck.realtime.gate.reached_limits import Limit

DELAYS = (1, 2, 4, 8, 16, 32)
DECAYS = np.exp(-1.0 / np.geomspace(2.0, 5000.0, 9))
"""Kernels, of either sign and both ways in time: delays of so many samples, and geometric series."""
ROUNDS, PIVOTS, PIECES, MOST_CUTS = 20, 3000, 1 << 16, 40
ROUNDING = 1e-11
"""Of the products in the sum, relative to their factors; a thousand times what they may err by."""


class _Form(NamedTuple):
    """The sum at some frequencies, a row for each force: what its terms multiply that force with."""

    kernels: Complex[np.ndarray, "kernel line"]
    moved: Complex[np.ndarray, "line force force"]
    sectors: Complex[np.ndarray, "line force force"]
    partners: Float[np.ndarray, "force force"]

    def sum(self, x: np.ndarray) -> np.ndarray:
        """Twice its Hermitian part for weights of each force: kernels, sector, partner with either sign."""
        count = len(self.kernels)
        own = np.conj(x[:, :count] @ self.kernels).T
        rows = own[:, :, None] * self.moved + x[:, count, None] * self.sectors
        rows = rows + (x[:, count + 1] - x[:, count + 2])[:, None] * self.partners
        return rows + np.conj(np.swapaxes(rows, 1, 2))

    def cut(self, line: int, v: np.ndarray) -> np.ndarray:
        """What each weight adds at a frequency in the direction ``v``."""
        moved = np.conj(v) * (self.moved[line] @ v)
        kernels = np.real(np.conj(self.kernels[:, line]) * moved[:, None])
        others = [np.real(np.conj(v) * (M @ v)) for M in (self.sectors[line], self.partners, -self.partners)]
        found = np.hstack([kernels, np.array(others).T]).ravel()
        return np.asarray(found / np.abs(found).max())


def form_sum(loop: Loop, limits: list[Limit], omega: np.ndarray) -> _Form:
    """The inequalities at frequencies ``omega`` [rad a sample], as forms of what is held back."""
    z = np.exp(1j * omega)
    on, slews = [limit.output for limit in limits], np.array([[limit.slew] for limit in limits], dtype=float)
    W = np.einsum("zk,kij->zij", 1.0 / (z[:, None] - loop.poles), loop.residues) + loop.direct
    asked, own = W[:, on][:, :, on], np.equal.outer(on, on).astype(float)
    before = (asked - own) / z[:, None, None]
    sector = np.array([[limit.sector] for limit in limits])
    eye = np.eye(len(limits))
    series = [(1.0 - a) / (z - a) for a in DECAYS]
    kernels = np.array([*(z**-n for n in DELAYS), *series])
    both = np.concatenate([kernels, np.conj(kernels)])
    return _Form(
        np.concatenate([np.ones((1, len(z))), 1.0 - both, 1.0 + both]),
        asked - own - slews * before, sector * (asked - slews * before) - eye, own - eye,
    )  # fmt: skip


def dies_out(loop: Loop, limits: list[Limit]) -> bool:
    """Weights by a linear programme; a direction in which their sum is not negative is one more row of it.

    So is one at a frequency at which it is not shown to be.
    """
    omega = _lines(loop)
    form = form_sum(loop, limits, omega)
    sparse = range(0, len(omega), max(1, len(omega) // 150))
    rows = [form.cut(k, v) for k in sparse for v in np.eye(len(limits))]
    for _ in range(ROUNDS):
        found = _weigh(rows)
        if found is None:
            return False
        x = np.maximum(found[:-1], 0.0).reshape(len(limits), -1)  # a solver may stray below zero
        more, top = _cuts(form, x, found[-1])
        if top < 0.0:
            left = _not_shown(loop, limits, x, omega)
            if not len(left):
                return True
            more += _cuts(form_sum(loop, limits, left), x, found[-1])[0]
        rows += more
    return False


def _cuts(form: _Form, x: np.ndarray, margin: float) -> tuple[list[np.ndarray], float]:
    """Rows where the sum peaks, in the directions in which it is not below ``margin``, and its largest."""
    size = 1.0 / (1.0 + np.abs(form.moved).max(axis=(1, 2)) ** 2)
    values, vectors = np.linalg.eigh(size[:, None, None] * form.sum(x))
    top = values[:, -1]
    peaks = np.flatnonzero((top >= np.append(-np.inf, top[:-1])) & (top >= np.append(top[1:], -np.inf)))
    worst = peaks[np.argsort(-top[peaks])][:MOST_CUTS]
    rows = [form.cut(k, v) for k in worst for v in vectors[k].T[values[k] > -size[k] * margin]]
    return rows, float(top.max())


def _weigh(rows: list[np.ndarray]) -> np.ndarray | None:
    """Weights of sum one, and by how much their sum is negative in all ``rows``; None where it is not."""
    count = len(rows[0])
    least, one = np.append(np.zeros(count), -1.0), np.append(np.ones(count), 0.0)
    found = so.linprog(
        least, np.hstack([rows, np.ones((len(rows), 1))]), np.zeros(len(rows)), one[None], [1.0],
        bounds=[(0.0, None)] * count + [(None, 1.0)], method="highs", options={"maxiter": PIVOTS},
    )  # fmt: skip
    return np.asarray(found.x) if found.status == 0 and found.x[-1] > 1e-9 else None


def _lines(loop: Loop) -> np.ndarray:
    """Frequencies [rad a sample] from 0 to pi, dense about the poles."""
    poles = loop.poles[np.abs(loop.poles) > 0.3]
    away = np.geomspace(0.02, 300.0, 60)
    steps = np.concatenate([-away, [0.0], away])
    near = np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * steps
    found = np.concatenate([np.geomspace(1e-6, np.pi, 600), np.linspace(0.0, np.pi, 200), near.ravel()])
    return np.unique(found[(found >= 0.0) & (found <= np.pi)])


def _not_shown(loop: Loop, limits: list[Limit], x: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Frequencies at which the sum is not shown to be negative; none where it is at all frequencies.

    Between two of them it lies no more than h^2 / 8 of its curvature above the line that joins its values.
    """
    low, high, seen = omega[:-1], omega[1:], 0
    while len(low):
        seen += len(low)
        ends = [form_sum(loop, limits, w).sum(x) for w in (low, high)]
        top = np.max([np.linalg.eigvalsh(P)[:, -1] for P in ends], axis=0)
        rounding, curvature = bound_sum(loop, limits, x, low, high)
        bent = curvature * (high - low) ** 2 / 8.0
        left = ~(top + bent + rounding < 0.0)  # what is no number is left too
        middle = 0.5 * (low + high)[left]
        lost = left & ~((top + rounding < 0.0) | (bent > rounding))  # no closer look will show it
        if seen > PIECES or np.any(lost) or np.any(high - low < 1e-14):
            return middle[:: 1 + len(middle) // MOST_CUTS]
        low, high = np.append(low[left], middle), np.append(middle, high[left])
    return low


def bound_sum(
    loop: Loop, limits: list[Limit], x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """In each piece, by its distance from poles: the sum's error of rounding, and its second derivative."""
    z, half = np.exp(0.5j * (low + high)), 0.5 * (high - low)
    ones, count, n = np.ones_like(half), len(DELAYS), np.array(DELAYS, dtype=float)
    twice = np.sqrt(max(Counter(limit.output for limit in limits).values()))  # an output with two forces
    W = twice * _bounds(z, half, loop.poles, np.linalg.norm(loop.residues, axis=(1, 2)))
    W[0] += twice * np.linalg.norm(loop.direct)
    moves = twice * bound_error(loop, np.maximum(np.abs(z[:, None] - loop.poles) - half[:, None], 0.0))
    u = W + twice * np.array([ones, 0.0 * ones, 0.0 * ones])
    change = np.array([np.minimum(2.0, high), ones, ones])
    rounding, curvature = np.zeros_like(half), np.zeros_like(half)
    for limit, weights in zip(limits, x, strict=True):
        signed = weights[1:-3].reshape(4, -1).sum(axis=0)
        kernel = _bounds(z, half, DECAYS, signed[count:] * (1.0 - DECAYS))
        kernel += np.outer(
            [weights[:-3].sum() + signed[:count].sum(), signed[:count] @ n, signed[:count] @ n**2], ones
        )
        by_kernel = _product(kernel, _product(change, u) if limit.slew else u)
        sector = W + limit.slew * _product(np.array([ones, ones, ones]), u)
        # Products round by what they multiply before they cancel, 1 - 1 / z by that of ones.
        size = kernel[0] * u[0] * 2.0 + weights[-3] * (1.0 + sector[0]) + weights[-2:].sum()
        rounding += ROUNDING * size + (kernel[0] + weights[-3]) * (1.0 + limit.slew) * moves
        curvature += by_kernel[2] + weights[-3] * sector[2]
    return 2.0 * rounding, 2.0 * curvature


def _bounds(z: np.ndarray, half: np.ndarray, poles: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Of sum sizes / (z - poles) on the circle, of its first and of its second derivative, in each piece."""
    with np.errstate(divide="ignore", invalid="ignore"):
        near = 1.0 / np.maximum(np.abs(z[:, None] - poles) - half[:, None], 0.0)
        return np.array([near @ sizes, near**2 @ sizes, (near**2 + 2.0 * near**3) @ sizes])


def _product(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Bounds of a product and its derivatives from those of its factors."""
    return np.array([f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2]])
