"""The model's columns and slopes as real combinations of few functions of the line.

With u = 1/(q - lambda) and l = 1/(q - conj lambda), any term of a pair is z u + conj(z) l = Re z (u + l) +
Im z j(u - l), whatever c and b are in z: so all columns and slopes of all outputs and inputs are made of
u + l, j(u - l), u^2 + l^2, j(u^2 - l^2) of each pair (ul, ul(u + l), j ul(u - l) where constants are real), u
and u^2 of each real pole, 1/s^2, 1/s and 1. Gram matrices of hundreds of columns follow from those of few.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.terms import Fractions, linear_of_terms
from middeck.identification.problem.unknowns_layout import Layout, Point


def functions(
    layout: Layout, parts: Fractions, s: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "function line"]:
    """The functions: of pairs kind by kind, of real poles, then 1/s^2, 1/s and 1 if the layout has them."""
    pairs, at = layout.pairs, _Places(layout)
    u, low, real = parts.upper[:pairs], parts.lower[:pairs], parts.upper[pairs:]
    found = np.empty((at.size, len(s)), dtype=complex)
    both, difference = u + low, u - low
    if layout.options.real_constants:
        product = found[:pairs]
        np.multiply(u, low, out=product)
        np.multiply(product, both, out=found[pairs : 2 * pairs])
        np.multiply(product, 1j * difference, out=found[2 * pairs : at.first])
    else:
        found[:pairs] = both
        np.multiply(1j, difference, out=found[pairs : 2 * pairs])
        # u^2 + l^2 and u^2 - l^2 by the sum and the difference.
        squares = found[2 * pairs : 3 * pairs]
        np.add(both**2, difference**2, out=squares)
        squares *= 0.5
        np.multiply(found[pairs : 2 * pairs], both, out=found[3 * pairs : at.first])
    found[at.first : at.first + len(real)] = real
    found[at.first + len(real) : at.double] = real**2
    found[at.double : at.single] = 1.0 / s**2
    found[at.single : at.constant] = 1.0 / s
    found[at.constant :] = 1.0
    return found


def column_factors(layout: Layout, point: Point) -> Float[np.ndarray, "column input function"]:
    """Each column of an output by input and function."""
    at = _Places(layout)
    C = np.zeros((layout.columns, layout.inputs, at.size))
    pairs = layout.pairs * layout.copies
    b, of, first = point.b, at.mode[:pairs], at.first
    column = np.arange(pairs)
    if layout.options.real_constants:
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
    if layout.options.residuals:
        C[used + each, each, at.double] = 1.0
        used += layout.inputs
    if layout.options.direct:
        C[used + each, each, at.constant] = 1.0
    return C


def slope_factors(
    layout: Layout, point: Point, parts: Fractions, x: Float[np.ndarray, "output column"]
) -> Float[np.ndarray, "output unknown input function"]:
    """Each slope by theta (delays apart) of outputs with the linear unknowns ``x``."""
    at = _Places(layout)
    modes, pairs = len(layout.pair), layout.pairs
    used = modes + pairs + len(layout.free_b)
    C = np.zeros((len(x), used + len(layout.free_psi), layout.inputs, at.size))
    c = np.array([linear_of_terms(layout, one) for one in x])
    # Summed over the terms of each pole.
    z = (c[:, :, None] * point.b).reshape(len(x), modes, layout.copies, -1).sum(axis=2)
    z = z * parts.slope[:, None]
    m = np.arange(pairs)
    # An index beside a slice puts its axis first.
    pair = np.moveaxis(z[:, :pairs], 1, 0)
    sigma, omega = np.real(point.poles)[:, None, None], np.imag(point.poles)[:pairs, None, None]
    if layout.options.real_constants:
        C[:, m, :, pairs + m] = sigma[:pairs] * pair.real
        C[:, modes + m, :, 2 * pairs + m] = omega * pair.real
    else:
        C[:, m, :, 2 * pairs + m] = sigma[:pairs] * pair.real
        C[:, m, :, 3 * pairs + m] = sigma[:pairs] * pair.imag
        C[:, modes + m, :, 2 * pairs + m] = -omega * pair.imag
        C[:, modes + m, :, 3 * pairs + m] = omega * pair.real
    single = np.arange(modes - pairs)
    C[:, pairs + single, :, at.first + len(single) + single] = sigma[pairs:] * np.real(z[:, pairs:]).swapaxes(
        0, 1
    )
    _put_slopes_by_b(layout, at, c, C[:, modes + pairs : used])
    for k, (r, i) in enumerate(layout.free_psi):
        C[:, used + k, i, at.zero[r]] = x[:, layout.mode_columns + r]
    return C


def _put_slopes_by_b(
    layout: Layout, at: _Places, c: Complex[np.ndarray, "output term"], C: np.ndarray
) -> None:
    """A pair's entry of b multiplies c: the same combination as c's own column at b = 1 or j."""
    if not layout.free_b:
        return
    mode, i, part = (np.array(v) for v in zip(*layout.free_b, strict=True))
    k, pairs = np.arange(len(mode)), layout.pairs
    entry = np.where(part, 1j, 1.0) * c[:, mode]
    pair = mode < pairs
    C[:, k, i, np.where(pair, mode, at.first + mode - pairs)] = np.real(entry)
    if not layout.options.real_constants:
        C[:, k[pair], i[pair], pairs + mode[pair]] = np.imag(entry[:, pair])


class _Places:
    """Places of the functions: ``mode`` of each term within its kind, ``first`` of the real poles.

    ``zero``: 1/s^2 or 1/s of each rigid mode and integrator.
    """

    def __init__(self, layout: Layout) -> None:
        real = len(layout.pair) - layout.pairs
        self.first = (3 if layout.options.real_constants else 4) * layout.pairs
        self.mode = np.concatenate(
            [np.repeat(np.arange(layout.pairs), layout.copies), np.repeat(np.arange(real), layout.copies)]
        )
        self.double = self.first + 2 * real
        self.single = self.double + bool(layout.options.residuals or layout.rigid_pivot)
        self.zero = np.where(layout.powers == 2, self.double, self.single)
        self.constant = self.single + bool(layout.integral_pivot)
        self.size = self.constant + bool(layout.options.direct)
