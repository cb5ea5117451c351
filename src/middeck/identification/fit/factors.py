"""The model's columns and slopes as real combinations of few functions of the line.

With u = 1/(q - lambda) and l = 1/(q - conj lambda), any term of a pair is z u + conj(z) l = Re z (u + l) +
Im z j(u - l), whatever c and b are in z: so all columns and slopes of all outputs and inputs are made of
u + l, j(u - l), u^2 + l^2, j(u^2 - l^2) of each pair (ul, ul(u + l), j ul(u - l) where constants are real), u
and u^2 of each real pole, 1/s^2, 1/s and 1. Gram matrices of hundreds of columns follow from that of these
few.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.layout import Layout, Point
from middeck.identification.fit.terms import Fractions, linear_of_terms


def functions(
    layout: Layout, parts: Fractions, s: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "function line"]:
    """The functions: of pairs kind by kind, of real poles, then 1/s^2, 1/s and 1 if the layout has them."""
    pairs = layout.pairs
    u, low, real = parts.upper[:pairs], parts.lower[:pairs], parts.upper[pairs:]
    if layout.real_constants:
        both = u * low
        of_pairs = (both, both * (u + low), 1j * both * (u - low))
    else:
        up_squared, low_squared = u**2, low**2
        of_pairs = (u + low, 1j * (u - low), up_squared + low_squared, 1j * (up_squared - low_squared))
    constant = [np.ones((1, len(s)))] if layout.with_direct else []
    double = [1.0 / s[None] ** 2] if layout.with_lower or layout.rigid_pivot else []
    single = [1.0 / s[None]] if layout.integral_pivot else []
    return np.concatenate([*of_pairs, real, real**2, *double, *single, *constant])


def column_factors(layout: Layout, point: Point) -> Float[np.ndarray, "column input function"]:
    """Each column of an output by input and function."""
    at = _Places(layout)
    C = np.zeros((layout.columns, layout.inputs, at.size))
    pairs = layout.pairs * layout.copies
    b, of, first = point.b, at.mode[:pairs], at.first
    column = np.arange(pairs)
    if layout.real_constants:
        C[column, :, of] = np.real(b[:pairs])
        used = pairs
    else:
        C[2 * column, :, of] = np.real(b[:pairs])
        C[2 * column, :, layout.pairs + of] = np.imag(b[:pairs])
        C[2 * column + 1, :, of] = -np.imag(b[:pairs])
        C[2 * column + 1, :, layout.pairs + of] = np.real(b[:pairs])
        used = 2 * pairs
    single = np.arange(len(b) - pairs)
    C[used + single, :, first + at.mode[pairs:]] = np.real(b[pairs:])
    used = layout.mode_columns
    for row, psi in enumerate(() if point.psi is None else point.psi):
        C[used, :, at.zero[row]] = psi
        used += 1
    each = np.arange(layout.inputs)
    if layout.with_lower:
        C[used + each, each, at.double] = 1.0
        used += layout.inputs
    if layout.with_direct:
        C[used + each, each, at.constant] = 1.0
    return C


def slope_factors(
    layout: Layout, point: Point, parts: Fractions, x: Float[np.ndarray, " column"]
) -> Float[np.ndarray, "unknown input function"]:
    """Each slope by theta (delays apart) of an output with the linear unknowns ``x``."""
    at = _Places(layout)
    modes, pairs = len(layout.pair), layout.pairs
    free, free_psi = layout.free_b, layout.free_psi
    used = modes + pairs + len(free)
    C = np.zeros((used + len(free_psi), layout.inputs, at.size))
    c = linear_of_terms(layout, x)
    # Summed over the terms of each pole.
    z = np.add.reduceat(c[:, None] * point.b, np.arange(0, len(c), layout.copies))
    z = z * parts.slope[:, None] if len(z) else z
    m = np.arange(pairs)
    sigma, omega = np.real(point.poles)[:, None], np.imag(point.poles)[:pairs, None]
    if layout.real_constants:
        C[m, :, pairs + m] = sigma[:pairs] * np.real(z[:pairs])
        C[modes + m, :, 2 * pairs + m] = omega * np.real(z[:pairs])
    else:
        C[m, :, 2 * pairs + m] = sigma[:pairs] * np.real(z[:pairs])
        C[m, :, 3 * pairs + m] = sigma[:pairs] * np.imag(z[:pairs])
        C[modes + m, :, 2 * pairs + m] = -omega * np.imag(z[:pairs])
        C[modes + m, :, 3 * pairs + m] = omega * np.real(z[:pairs])
    single = np.arange(modes - pairs)
    C[pairs + single, :, at.first + len(single) + single] = sigma[pairs:] * np.real(z[pairs:])
    for k, (mode, i, part) in enumerate(free):
        # A pair's entry of b multiplies c: the same combination as c's own column at b = 1 or j.
        entry = 1j * c[mode] if part else c[mode]
        if mode >= pairs:
            C[modes + pairs + k, i, at.first + mode - pairs] = entry.real
        else:
            C[modes + pairs + k, i, mode] = entry.real
            if not layout.real_constants:
                C[modes + pairs + k, i, pairs + mode] = entry.imag
    for k, (r, i) in enumerate(free_psi):
        C[used + k, i, at.zero[r]] = x[layout.mode_columns + r]
    return C


class _Places:
    """Where the functions stand: ``mode`` of each term within its kind, ``first`` of the real poles.

    ``zero``: 1/s^2 or 1/s of each rigid mode and integrator.
    """

    def __init__(self, layout: Layout) -> None:
        real = len(layout.pair) - layout.pairs
        self.first = (3 if layout.real_constants else 4) * layout.pairs
        self.mode = np.concatenate(
            [np.repeat(np.arange(layout.pairs), layout.copies), np.repeat(np.arange(real), layout.copies)]
        )
        self.double = self.first + 2 * real
        single = self.double + int(layout.with_lower or bool(layout.rigid_pivot))
        self.zero = np.where(layout.powers == 2, self.double, single)
        self.constant = single + bool(layout.integral_pivot)
        self.size = self.constant + int(layout.with_direct)
