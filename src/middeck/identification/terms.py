"""The terms of the fit: what is linear in the unknowns, what is not, and the derivatives of the latter.

Unknowns that enter nonlinearly are packed in one vector theta:

    [log sigma of each mode | log omega_d of each pair | free entries of b | delay of each output]

with pole = -sigma + j omega_d, so that every model a solver can reach is stable. Linear in the model, and
solved for exactly (`refine`), are the output vectors c and the direct term. The largest entry of each b is
held at its start (the residue c b leaves one factor free), so that no direction of theta is empty.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.values import record


@record
class Layout:
    """What the entries of theta are.

    Parameters
    ----------
    pair:
        True for a conjugate pair, false for a real pole. Pairs come first.
    fixed_imag:
        Imaginary part of the real poles [rad/s]: zero, or pi / T for one on the negative real axis of z.
    pivot:
        The input whose entry of b is held, for each mode.
    real_constants:
        Pairs are phi psi / ((s - p)(s - conj p)) with real phi and psi: no velocity in the residue.
    with_delay, with_lower, with_direct:
        Whether each output has a delay, and the model a term 1/s^2 and a constant term.
    period_s:
        Sampling period, or zero in continuous time.
    """

    pair: np.ndarray
    fixed_imag: Float[np.ndarray, " mode"]
    pivot: np.ndarray
    inputs: int
    outputs: int
    real_constants: bool
    with_delay: bool
    with_lower: bool
    with_direct: bool
    period_s: float

    @property
    def free_b(self) -> list[tuple[int, int, bool]]:
        """(mode, input, is imaginary part) of each free entry of b, in the order of theta."""
        return [
            (m, i, part)
            for m, pair in enumerate(self.pair)
            for i in range(self.inputs)
            if i != self.pivot[m]
            for part in ((False, True) if pair and not self.real_constants else (False,))
        ]

    @property
    def columns(self) -> int:
        """Linear unknowns of one output."""
        pairs = int(np.sum(self.pair))
        per_pair = 1 if self.real_constants else 2
        terms = self.inputs * (self.with_lower + self.with_direct)
        return per_pair * pairs + len(self.pair) - pairs + terms

    @property
    def unknowns(self) -> int:
        """All unknowns of the model: theta and the linear ones."""
        pairs = int(np.sum(self.pair))
        theta = len(self.pair) + pairs + len(self.free_b) + (self.outputs if self.with_delay else 0)
        return theta + self.outputs * self.columns


@record
class Point:
    """theta unpacked: poles [rad/s], input vectors, delays."""

    poles: Complex[np.ndarray, " mode"]
    b: Complex[np.ndarray, "mode input"]
    delay_s: Float[np.ndarray, " output"]


def pack(layout: Layout, point: Point) -> Float[np.ndarray, " unknown"]:
    """theta of a point; entries of b are taken relative to the pivot entry, which becomes one."""
    pairs = int(np.sum(layout.pair))
    b = point.b / np.take_along_axis(point.b, layout.pivot[:, None], axis=1)
    entries = [b[m, i].imag if part else b[m, i].real for m, i, part in layout.free_b]
    delay = point.delay_s if layout.with_delay else np.zeros(0)
    sigma, omega = -np.real(point.poles), np.imag(point.poles)[:pairs]
    return np.concatenate([np.log(sigma), np.log(omega), np.array(entries), delay])


def unpack(layout: Layout, theta: Float[np.ndarray, " unknown"]) -> Point:
    """Inverse of `pack`."""
    modes, pairs = len(layout.pair), int(np.sum(layout.pair))
    imag = layout.fixed_imag.copy()
    imag[:pairs] = np.exp(theta[modes : modes + pairs])
    b = np.zeros((modes, layout.inputs), dtype=complex)
    b[np.arange(modes), layout.pivot] = 1.0
    free = layout.free_b
    for (m, i, part), value in zip(free, theta[modes + pairs :], strict=False):
        b[m, i] += 1j * value if part else value
    delay = theta[modes + pairs + len(free) :] if layout.with_delay else np.zeros(layout.outputs)
    return Point(-np.exp(theta[:modes]) + 1j * imag, b, delay)


@record
class Fractions:
    """1/(q - lambda) and 1/(q - conj lambda) of each mode, with d lambda / d pole."""

    upper: Complex[np.ndarray, "mode line"]
    lower: Complex[np.ndarray, "mode line"]
    slope: Complex[np.ndarray, " mode"]


def fractions(layout: Layout, poles: np.ndarray, s: Complex[np.ndarray, " line"]) -> Fractions:
    """The partial fractions at ``s`` = j omega."""
    T = layout.period_s
    q, pole = (np.exp(s * T), np.exp(poles * T)) if T else (s, poles)
    slope = T * pole if T else np.ones_like(pole)
    return Fractions(1.0 / (q - pole[:, None]), 1.0 / (q - pole.conj()[:, None]), slope)


def columns(
    layout: Layout,
    point: Point,
    parts: Fractions,
    s: Complex[np.ndarray, " line"],
    drive: Complex[np.ndarray, "line input column"] | None = None,
) -> Complex[np.ndarray, "unknown line column"]:
    """Factors of the linear unknowns of an output, without its delay: modes, 1/s^2, constant."""
    each_input = _along(np.eye(layout.inputs), drive)
    X = np.empty((layout.columns, len(s), each_input.shape[2]), dtype=complex)
    pairs, modes = int(np.sum(layout.pair)), len(layout.pair)
    up, low = parts.upper[:, :, None], parts.lower[:, :, None]
    if layout.real_constants:
        X[:pairs] = _along(np.real(point.b)[:pairs], drive) * (up * low)[:pairs]
        used = pairs
    else:
        first = _along(point.b[:pairs], drive) * up[:pairs]
        second = _along(point.b[:pairs].conj(), drive) * low[:pairs]
        X[0 : 2 * pairs : 2] = first + second
        X[1 : 2 * pairs : 2] = 1j * (first - second)
        used = 2 * pairs
    X[used : used + modes - pairs] = _along(np.real(point.b)[pairs:], drive) * up[pairs:]
    used += modes - pairs
    if layout.with_lower:
        X[used : used + layout.inputs] = each_input / (s**2)[None, :, None]
        used += layout.inputs
    if layout.with_direct:
        X[used:] = each_input
    return X


def _along(b: np.ndarray, drive: np.ndarray | None) -> np.ndarray:
    """What each vector of inputs makes of the drive: [mode, line (or 1), column]."""
    return b[:, None, :] if drive is None else np.moveaxis(b @ drive, 1, 0)


def shapes(layout: Layout, point: Point, x: Float[np.ndarray, " column"]) -> Complex[np.ndarray, " mode"]:
    """The output vector c of one output from its linear unknowns, as residues."""
    pairs, modes = int(np.sum(layout.pair)), len(layout.pair)
    c = np.zeros(modes, dtype=complex)
    if layout.real_constants:
        # phi / ((s - p)(s - conj p)) has the residue phi / (2 j omega_d) at p.
        c[:pairs] = x[:pairs] / (2j * np.imag(point.poles)[:pairs])
        c[pairs:] = x[pairs:modes]
    else:
        c[:pairs] = x[0 : 2 * pairs : 2] + 1j * x[1 : 2 * pairs : 2]
        c[pairs:] = x[2 * pairs : pairs + modes]
    return c


def slopes(
    layout: Layout,
    point: Point,
    parts: Fractions,
    x: Float[np.ndarray, " column"],
    drive: Complex[np.ndarray, "line input column"] | None = None,
) -> Complex[np.ndarray, "unknown line column"]:
    """Derivative of one output's response by theta (delays apart), at the linear unknowns ``x``."""
    pairs, modes = int(np.sum(layout.pair)), len(layout.pair)
    free = layout.free_b
    c = _linear_of_modes(layout, x)
    along, conjugate = _along(point.b, drive), _along(point.b.conj(), drive)
    each_input = _along(np.eye(layout.inputs), drive)
    G = np.zeros((modes + pairs + len(free), parts.upper.shape[1], along.shape[2]), dtype=complex)
    for m in range(modes):
        upper, lower = _by_pole(layout, parts, c[m], m)
        by_pole, by_conjugate = upper * along[m], lower * conjugate[m]
        decay = point.poles[m].real
        G[m] = decay * (by_pole + by_conjugate)
        if m < pairs:
            G[modes + m] = 1j * point.poles[m].imag * (by_pole - by_conjugate)
    for k, (m, i, part) in enumerate(free):
        upper, lower = _by_b(layout, parts, c[m], m)
        by_entry = 1j * (upper - lower) if part else upper + lower
        G[modes + pairs + k] = by_entry[:, None] * each_input[i]
    return G


def _linear_of_modes(layout: Layout, x: np.ndarray) -> np.ndarray:
    pairs, modes = int(np.sum(layout.pair)), len(layout.pair)
    if layout.real_constants:
        return x[:modes].astype(complex)
    return np.concatenate(
        [x[0 : 2 * pairs : 2] + 1j * x[1 : 2 * pairs : 2], x[2 * pairs : pairs + modes].astype(complex)]
    )


def _by_pole(layout: Layout, parts: Fractions, c: complex, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Factors of b and conj b in the derivatives of the term by its pole and by the conjugate pole."""
    up, low, slope = parts.upper[m], parts.lower[m], parts.slope[m]
    if not layout.pair[m]:
        return (c * slope * up**2)[:, None], np.zeros((len(up), 1))
    if layout.real_constants:
        term = c * slope * up * low
        return (term * up)[:, None], (term * low)[:, None]
    return (c * slope * up**2)[:, None], (np.conj(c * slope) * low**2)[:, None]


def _by_b(layout: Layout, parts: Fractions, c: complex, m: int) -> tuple[np.ndarray, np.ndarray]:
    """The term's derivatives by b and by conj b."""
    up, low = parts.upper[m], parts.lower[m]
    if not layout.pair[m]:
        return c * up, np.zeros_like(up)
    if layout.real_constants:
        return c * up * low, np.zeros_like(up)
    return c * up, np.conj(c) * low
