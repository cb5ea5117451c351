"""Gram matrices of partial fractions from sums over the lines, without a product for each pair of them.

On the unit circle, with g = 1/2 + p/(q - p) = (q + p)/(2(q - p)) of a pole p,

    conj(1/(q - p_m)) 1/(q - p_n) = D (conj(g_m) + g_n),    D = 1/(1 - conj(p_m) p_n),

and on the imaginary axis the same with g = 1/(s - p), D = -1/(conj(p_m) + p_n): weighted sums of products of
fractions are a matrix of Cauchy's kind, of which one sum of g for each pole tells all (of displacement rank
two: Heinig and Rost 1984). Squares of fractions are derivatives by the pole, and so are their products. A
stable pole and another's mirror image never meet, so that no difference is divided by zero; rounding grows
with the distance of lines that are heavy over a pole's decay rate, and `normal_equations` sees what it did.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.layout import Layout
from middeck.identification.fit.terms import Fractions

# Twins closer than their distance to where fractions are summed by more are one but for three digits.
CLOSE = 0.03


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
    """Re sum conj(f) weight g of all functions of poles (`factors`), for each ``weight`` [weight, line]."""
    second = _sums(layout, poles, parts, weight)
    first = _sums(layout, poles, parts, weight.conj()) if np.iscomplexobj(weight) else second
    P = _kernel(layout, poles.conj(), poles).times(Sums(first.value.conj(), first.slope.conj()), second)
    Q = _kernel(layout, poles, poles).times(first, second)
    more, less = P + Q, P - Q
    # Among u + l and j(u - l), from the products of u with u and of l with u.
    kinds = np.array([[np.real(more), -np.imag(more)], [np.imag(less), np.real(less)]])
    size = 4 * len(poles)
    # [kind, kind, slope, slope, weight, mode, mode] to rows: slope, kind, mode.
    return _own(layout, poles, kinds.transpose(4, 2, 0, 5, 3, 1, 6).reshape(len(weight), size, size))


def close_twins(layout: Layout, poles: Complex[np.ndarray, " pair"]) -> np.ndarray:
    """Pairs whose difference u - l would be rounding of their products."""
    p = np.exp(poles * layout.period_s) if layout.period_s else poles
    inside = 1.0 - np.abs(p) if layout.period_s else -np.real(p)
    return np.abs(np.imag(p)) < CLOSE * inside


def _sums(layout: Layout, poles: np.ndarray, parts: Fractions, weight: np.ndarray) -> Sums:
    u, low = parts.upper, parts.lower
    by, by_squared = (weight @ a.T + (weight @ b.T).conj() for a, b in ((u, low), (u**2, low**2)))
    if not layout.period_s:
        return Sums(by, by_squared)
    p = np.exp(poles * layout.period_s)
    return Sums(np.sum(np.real(weight), axis=1)[:, None] + p * by, by + p * by_squared)


def _kernel(layout: Layout, first: np.ndarray, second: np.ndarray) -> Kernel:
    """Of the conjugate of a stable pole, or of the pole itself where its twin is conjugated."""
    total = first[:, None] + second
    if not layout.period_s:
        plain = -1.0 / total
        return Kernel(plain, plain**2, plain**2, 2.0 * plain**3)
    p, q = np.exp(first * layout.period_s)[:, None], np.exp(second * layout.period_s)
    D = -1.0 / np.expm1(total * layout.period_s)
    return Kernel(D, q * D**2, p * D**2, D**2 + 2.0 * p * q * D**3)


def _own(
    layout: Layout, poles: np.ndarray, whole: Float[np.ndarray, "weight row column"]
) -> Float[np.ndarray, "weight function function"]:
    """Of the functions that a layout has, from those of u + l, j(u - l) and squares, as if all were pairs."""
    modes, pairs = len(poles), layout.pairs
    m, single = np.arange(pairs), np.arange(pairs, modes)
    if not layout.real_constants:
        if pairs == modes:
            return whole
        place = np.concatenate([*(k * modes + m for k in range(4)), single, 2 * modes + single])
        half = np.where(np.arange(len(place)) < 4 * pairs, 1.0, 0.5)
        return whole[:, place[:, None], place] * half[:, None] * half
    omega = np.imag(poles)[:pairs]
    R = np.zeros((3 * pairs + 2 * len(single), 4 * modes))
    R[m, modes + m] = -0.5 / omega
    R[pairs + m, 3 * modes + m] = -0.5 / omega
    R[2 * pairs + m, 2 * modes + m] = 0.5 / omega
    R[2 * pairs + m, modes + m] = 0.5 / omega**2
    k = 3 * pairs + np.arange(len(single))
    R[k, single] = R[k + len(single), 2 * modes + single] = 0.5
    return R @ whole @ R.T
