"""The terms of the fit: factors of the unknowns that are linear, and slopes by those that are not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.unknowns_layout import Layout, Point


class Fractions(NamedTuple):
    """1/(q - lambda) and 1/(q - conj lambda) of each mode, with d lambda / d pole."""

    upper: Complex[np.ndarray, "mode line"]
    lower: Complex[np.ndarray, "mode line"]
    slope: Complex[np.ndarray, " mode"]


class Driven(NamedTuple):
    """Input vectors of each term and their conjugates, times the drive."""

    along: Complex[np.ndarray, "term line column"]
    conjugate: Complex[np.ndarray, "term line column"]


def fractions(layout: Layout, poles: np.ndarray, s: Complex[np.ndarray, " line"]) -> Fractions:
    """The partial fractions at ``s`` = j omega."""
    T = layout.options.period_s
    q, pole = (np.exp(s * T), np.exp(poles * T)) if T else (s, poles)
    slope = T * pole if T else np.ones_like(pole)
    return Fractions(1.0 / (q - pole[:, None]), 1.0 / (q - pole.conj()[:, None]), slope)


def columns(
    layout: Layout,
    point: Point,
    parts: Fractions,
    s: Complex[np.ndarray, " line"],
    drive: Complex[np.ndarray, "line input column"] | None = None,
    driven: Driven | None = None,
) -> Complex[np.ndarray, "unknown line column"]:
    """Factors of the linear unknowns of an output, without its delay: modes, 1/s^2 and 1/s, constant.

    ``driven`` is what `drive_terms` makes of the drive, where that is known.
    """
    each_input = _of_inputs(layout, drive)
    X = np.empty((layout.columns, len(s), each_input.shape[2]), dtype=complex)
    up, low = (np.repeat(x, layout.copies, axis=0)[:, :, None] for x in (parts.upper, parts.lower))
    pairs = layout.pairs * layout.copies
    if layout.options.real_constants:
        X[:pairs] = _along(np.real(point.b)[:pairs], drive) * (up * low)[:pairs]
        used = pairs
    else:
        along, conjugate = driven or drive_terms(point, drive)
        first, second = along[:pairs] * up[:pairs], conjugate[:pairs] * low[:pairs]
        X[0 : 2 * pairs : 2] = first + second
        X[1 : 2 * pairs : 2] = 1j * (first - second)
        used = 2 * pairs
    X[used : layout.mode_columns] = _along(np.real(point.b)[pairs:], drive) * up[pairs:]
    used = layout.mode_columns
    if point.psi is not None and len(point.psi):
        X[used : used + len(point.psi)] = _along(point.psi, drive) / (s ** layout.powers[:, None])[:, :, None]
        used += len(point.psi)
    if layout.options.residuals:
        X[used : used + layout.inputs] = each_input / (s**2)[None, :, None]
        used += layout.inputs
    if layout.options.direct:
        X[used:] = each_input
    return X


def drive_terms(point: Point, drive: Complex[np.ndarray, "line input column"] | None) -> Driven:
    """Drive of each term, and of the conjugate of its pole."""
    return Driven(_along(point.b, drive), _along(point.b.conj(), drive))


def _along(b: np.ndarray, drive: np.ndarray | None) -> np.ndarray:
    """Input vectors times the drive: [mode, line (or 1), column]."""
    if drive is None:
        return b[:, None, :]
    lines, inputs, columns = drive.shape
    # One product of matrices, not one a line.
    return (b @ drive.swapaxes(0, 1).reshape(inputs, -1)).reshape(len(b), lines, columns)


def _of_inputs(layout: Layout, drive: np.ndarray | None) -> np.ndarray:
    """The drive of each input alone: [input, line (or 1), column]."""
    return np.eye(layout.inputs)[:, None] if drive is None else drive.swapaxes(0, 1)


def shapes(layout: Layout, point: Point, x: Float[np.ndarray, " column"]) -> Complex[np.ndarray, " term"]:
    """The output vector c of one output from its linear unknowns, as residues of each term."""
    c = linear_of_terms(layout, x)
    if layout.options.real_constants:
        # phi / ((s - p)(s - conj p)) has the residue phi / (2 j omega_d) at p.
        pairs = layout.pairs * layout.copies
        c[:pairs] /= 2j * np.repeat(np.imag(point.poles)[: layout.pairs], layout.copies)
    return c


def constant_terms(
    layout: Layout, point: Point, linear: Float[np.ndarray, "output column"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """R of rigid modes, Q of integrators, L and D [output, input], from the outputs' linear unknowns."""
    x = linear[:, layout.mode_columns : layout.columns]
    drifting, inputs = len(layout.powers), layout.inputs
    none = np.zeros((len(x), inputs))
    R, Q = (none, none) if point.psi is None else (x[:, own] @ point.psi[own] for own in layout.at_zero)
    L = x[:, drifting : drifting + inputs] if layout.options.residuals else none
    return R, Q, L, x[:, -inputs:] if layout.options.direct else none


def slopes(
    layout: Layout,
    point: Point,
    parts: Fractions,
    x: Float[np.ndarray, " column"],
    s: Complex[np.ndarray, " line"],
    drive: Complex[np.ndarray, "line input column"] | None = None,
    driven: Driven | None = None,
) -> Complex[np.ndarray, "unknown line column"]:
    """Derivative of one output's response by theta (delays apart), at the linear unknowns ``x``.

    ``driven`` is what `drive_terms` makes of the drive, where that is known.
    """
    modes, pairs = len(layout.pair), layout.pairs
    free, free_psi = layout.free_b, layout.free_psi
    c = linear_of_terms(layout, x)
    along, conjugate = driven or drive_terms(point, drive)
    each_input = _of_inputs(layout, drive)
    used = modes + pairs + len(free)
    G = np.zeros((used + len(free_psi), len(s), along.shape[2]), dtype=complex)
    upper, lower = _by_pole(layout, parts, c)
    by_pole, by_conjugate = upper[:, :, None] * along, lower[:, :, None] * conjugate
    if layout.copies > 1:
        by_pole, by_conjugate = (
            np.sum(x.reshape(modes, layout.copies, *x.shape[1:]), axis=1) for x in (by_pole, by_conjugate)
        )
    G[:modes] = np.real(point.poles)[:, None, None] * (by_pole + by_conjugate)
    turned = 1j * np.imag(point.poles)[:pairs, None, None]
    G[modes : modes + pairs] = turned * (by_pole - by_conjugate)[:pairs]
    for k, (m, i, part) in enumerate(free):
        first, second = _by_b(layout, parts, c[m], m)
        by_entry = 1j * (first - second) if part else first + second
        G[modes + pairs + k] = by_entry[:, None] * each_input[i]
    for k, (r, i) in enumerate(free_psi):
        G[used + k] = (x[layout.mode_columns + r] / s ** layout.powers[r])[:, None] * each_input[i]
    return G


def linear_of_terms(layout: Layout, x: np.ndarray) -> Complex[np.ndarray, " term"]:
    """The linear unknowns of each term as one number: c, or phi."""
    pairs = layout.pairs * layout.copies
    if layout.options.real_constants:
        return x[: layout.mode_columns].astype(complex)
    real = x[2 * pairs : layout.mode_columns].astype(complex)
    return np.concatenate([x[0 : 2 * pairs : 2] + 1j * x[1 : 2 * pairs : 2], real])


def _by_pole(
    layout: Layout, parts: Fractions, c: Complex[np.ndarray, " term"]
) -> tuple[Complex[np.ndarray, "term line"], Complex[np.ndarray, "term line"]]:
    """Factors of b and conj b in the derivatives of each term by its pole and by the conjugate pole."""
    up, low, slope = parts.upper, parts.lower, parts.slope
    if layout.copies > 1:
        up, low, slope = (np.repeat(x, layout.copies, axis=0) for x in (up, low, slope))
    factor, pairs = (c * slope)[:, None], layout.pairs * layout.copies
    upper, lower = factor * up, np.zeros_like(low)
    if layout.options.real_constants:
        upper[:pairs] *= low[:pairs]
        lower[:pairs] = upper[:pairs] * low[:pairs]
    else:
        lower[:pairs] = factor[:pairs].conj() * low[:pairs] ** 2
    upper *= up
    return upper, lower


def _by_b(layout: Layout, parts: Fractions, c: complex, m: int) -> tuple[np.ndarray, np.ndarray]:
    """The term's derivatives by b and by conj b."""
    up, low = parts.upper[m], parts.lower[m]
    if not layout.pair[m]:
        return c * up, np.zeros_like(up)
    if layout.options.real_constants:
        return c * up * low, np.zeros_like(up)
    return c * up, np.conj(c) * low
