"""Gram matrices of partial fractions from sums over the lines, without a product for each pair of them.

On the unit circle, with g = 1/2 + p/(q - p) = (q + p)/(2(q - p)) of a pole p,

    conj(1/(q - p_m)) 1/(q - p_n) = D (conj(g_m) + g_n),    D = 1/(1 - conj(p_m) p_n),

and on the imaginary axis the same with g = 1/(s - p), D = -1/(conj(p_m) + p_n): weighted sums of products of
fractions are a matrix of Cauchy's kind, which one sum of g for each pole determines (displacement rank two:
Heinig and Rost 1984). Squares of fractions are derivatives by the pole, and so are their products. A
stable pole and another's mirror image never meet, so that no difference is divided by zero; rounding grows
with the distance of lines that are heavy over a pole's decay rate. What that does to the linear unknowns is
seen in their residual (`normal_equations`); what it does to theta's Gram matrix is not, so that a search has
it formed line by line before it ends (`refine`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.terms import Fractions
from middeck.identification.problem.unknowns_layout import Layout

# Twins closer than their distance to where fractions are summed by more are one but for three digits.
CLOSE = 0.01


class Sums(NamedTuple):
    """Sum over lines of weight g + conj(weight g*), g of a pole and g* of its twin; its slope by the pole."""

    value: Complex[np.ndarray, "weight mode"]
    slope: Complex[np.ndarray, "weight mode"]


class Kernel(NamedTuple):
    """D of two sets of poles, its slopes by the first, by the second and by both."""

    value: Complex[np.ndarray, "mode other"]
    by_first: Complex[np.ndarray, "mode other"]
    by_second: Complex[np.ndarray, "mode other"]
    by_both: Complex[np.ndarray, "mode other"]

    def times(self, first: Sums, second: Sums) -> Complex[np.ndarray, "2 2 weight mode other"]:
        """D (first + second): as it is, by the second, by the first and by both."""
        total = first.value[:, :, None] + second.value[:, None, :]
        one, two = first.slope[:, :, None], second.slope[:, None, :]
        return np.array(
            [
                [self.value * total, self.by_second * total + self.value * two],
                [
                    self.by_first * total + self.value * one,
                    self.by_both * total + self.by_second * one + self.by_first * two,
                ],
            ]
        )


def cauchy_gram(
    layout: Layout, poles: Complex[np.ndarray, " mode"], parts: Fractions, weight: np.ndarray
) -> Float[np.ndarray, "weight function function"]:
    """Re sum conj(f) weight g of `basis_functions` of poles and 1, for each ``weight`` [weight, line]."""
    sums = _sums(parts, weight)
    conjugate = _sums(parts, weight.conj()) if np.iscomplexobj(weight) else sums
    first, second = (_of_kernel(layout, poles, of, weight) for of in (conjugate, sums))
    P = _kernel(layout, poles.conj(), poles).times(Sums(first.value.conj(), first.slope.conj()), second)
    Q = _kernel(layout, poles, poles).times(first, second)
    more, less = P + Q, P - Q
    # Among u + l and j(u - l), from the products of u with u and of l with u.
    kinds = np.array([[np.real(more), -np.imag(more)], [np.imag(less), np.real(less)]])
    size = 4 * len(poles)
    whole = np.empty((len(weight), size + 1, size + 1))
    # [kind, kind, slope, slope, weight, mode, mode] to rows: slope, kind, mode.
    whole[:, :-1, :-1] = kinds.transpose(4, 2, 0, 5, 3, 1, 6).reshape(len(weight), size, size)
    whole[:, -1, :-1], whole[:, :-1, -1] = _with_one(sums), _with_one(conjugate)
    whole[:, -1, -1] = np.sum(np.real(weight), axis=1)
    return _own(layout, poles, whole)


def _with_one(sums: Sums) -> Float[np.ndarray, "weight function"]:
    """Products of u + l, j(u - l) and the same of squares with one."""
    parts = (v for z in sums for v in (np.real(z), -np.imag(z)))
    return np.concatenate(list(parts), axis=1)


def close_twins(layout: Layout, poles: Complex[np.ndarray, " pair"]) -> np.ndarray:
    """Pairs whose difference u - l would be rounding of their products."""
    p = np.exp(poles * layout.options.period_s) if layout.options.period_s else poles
    inside = 1.0 - np.abs(p) if layout.options.period_s else -np.real(p)
    return np.abs(np.imag(p)) < CLOSE * inside


def _sums(parts: Fractions, weight: np.ndarray) -> Sums:
    """Sums over the lines for the fractions themselves."""
    u, low = parts.upper, parts.lower
    if np.iscomplexobj(weight):
        return Sums(*(weight @ a.T + (weight @ b.T).conj() for a, b in ((u, low), (u**2, low**2))))
    twins = u + low.conj()
    # u^2 + conj(l)^2 by the sum and the difference.
    return Sums(weight @ twins.T, weight @ (0.5 * (twins**2 + (u - low.conj()) ** 2)).T)


def _of_kernel(layout: Layout, poles: np.ndarray, sums: Sums, weight: np.ndarray) -> Sums:
    """Sums over the lines for the kernel g."""
    if not layout.options.period_s:
        return sums
    p = np.exp(poles * layout.options.period_s)
    total = np.sum(np.real(weight), axis=1)[:, None]
    return Sums(total + p * sums.value, sums.value + p * sums.slope)


def _kernel(layout: Layout, first: np.ndarray, second: np.ndarray) -> Kernel:
    """The kernel of conjugated stable poles, or of the poles where their twins are conjugated."""
    total = first[:, None] + second
    if not layout.options.period_s:
        plain = -1.0 / total
        return Kernel(plain, plain**2, plain**2, 2.0 * plain**3)
    p, q = np.exp(first * layout.options.period_s)[:, None], np.exp(second * layout.options.period_s)
    D = -1.0 / np.expm1(total * layout.options.period_s)
    return Kernel(D, q * D**2, p * D**2, D**2 + 2.0 * p * q * D**3)


def _own(
    layout: Layout, poles: np.ndarray, whole: Float[np.ndarray, "weight row column"]
) -> Float[np.ndarray, "weight function function"]:
    """Products of the layout's own functions from u + l, j(u - l), squares and 1 of all poles as pairs."""
    modes, pairs = len(poles), layout.pairs
    m, single = np.arange(pairs), np.arange(pairs, modes)
    if not layout.options.real_constants:
        if pairs == modes:
            return whole
        place = np.concatenate([*(k * modes + m for k in range(4)), single, 2 * modes + single, [4 * modes]])
        half = np.repeat([1.0, 0.5, 1.0], [4 * pairs, 2 * len(single), 1])
        return whole[:, place[:, None], place] * half[:, None] * half
    # Rows of close twins are formed line by line instead: here they need but be finite.
    omega = np.where(close_twins(layout, poles[:pairs]), 1.0, np.imag(poles)[:pairs])
    R = np.zeros((3 * pairs + 2 * len(single) + 1, 4 * modes + 1))
    R[m, modes + m] = -0.5 / omega
    R[pairs + m, 3 * modes + m] = -0.5 / omega
    R[2 * pairs + m, 2 * modes + m] = 0.5 / omega
    R[2 * pairs + m, modes + m] = 0.5 / omega**2
    k = 3 * pairs + np.arange(len(single))
    R[k, single] = R[k + len(single), 2 * modes + single] = 0.5
    R[-1, -1] = 1.0
    return R @ whole @ R.T
