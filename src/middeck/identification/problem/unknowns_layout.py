"""The unknowns of a fit, and their places in theta.

Unknowns that enter nonlinearly are packed in one vector theta:

    [log sigma of each mode | log omega_d of each pair | free entries of b | of psi | delays]

with pole = -sigma + j omega_d, so that every model a solver can reach is stable. Linear in the model, and
solved for exactly (`refine`), are the output vectors c and the constant terms. The largest entry of each b is
held at one (the residue c b leaves one factor free), so that no direction of theta is empty; of the rigid
modes' psi, whose product phi psi leaves a whole matrix free, a unit matrix is held, and so of integrators'.
"""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.model.fit_options import FitOptions
from middeck.values import record


@record(kw_only=True)
class Layout:
    """The meaning of the entries of theta.

    Attributes:
        pair: True for a conjugate pair, false for a real pole. Pairs come first.
        fixed_imag: Imaginary part of the real poles [rad/s]: zero, or pi / T on the negative real axis of z.
        pivot: The input whose entry of b is held, for each mode.
        options: The kind of model, decided. Real constants: pairs are phi psi / ((s - p)(s - conj p)), phi
            and psi real. Full rank: each input has output vectors of its own, and there is no b.
        rigid_pivot, integral_pivot: The inputs whose entries of psi are held, one for each rigid mode phi psi
            / s^2 and each integrator phi psi / s; how many there are may differ from the options.
    """

    pair: np.ndarray
    fixed_imag: Float[np.ndarray, " mode"]
    pivot: np.ndarray
    inputs: int
    outputs: int
    options: FitOptions
    rigid_pivot: tuple[int, ...] = ()
    integral_pivot: tuple[int, ...] = ()

    @functools.cached_property
    def pairs(self) -> int:
        """Conjugate pairs."""
        return int(np.sum(self.pair))

    @property
    def states(self) -> int:
        """Order of the model but for poles at zero."""
        return len(self.pair) + self.pairs

    @property
    def copies(self) -> int:
        """Terms c b / (q - lambda) of each pole."""
        return self.inputs if self.options.full_rank else 1

    @functools.cached_property
    def free_b(self) -> list[tuple[int, int, bool]]:
        """(mode, input, is imaginary part) of each free entry of b, in the order of theta."""
        if self.options.full_rank:
            return []
        return [
            (m, i, part)
            for m, pair in enumerate(self.pair)
            for i in range(self.inputs)
            if i != self.pivot[m]
            for part in ((False, True) if pair and not self.options.real_constants else (False,))
        ]

    @functools.cached_property
    def free_psi(self) -> list[tuple[int, int]]:
        """(rigid mode or integrator, input) of each free entry of psi."""
        return [
            (r, i)
            for own in self.at_zero
            for r in range(*own.indices(len(self.powers)))
            for i in range(self.inputs)
            if i not in self.held_psi[own]
        ]

    @property
    def held_psi(self) -> tuple[int, ...]:
        """The input of the entry of psi that is held, of each rigid mode and then of each integrator."""
        return self.rigid_pivot + self.integral_pivot

    @property
    def at_zero(self) -> tuple[slice, slice]:
        """The rows of psi that belong to rigid modes, and those of integrators."""
        return slice(0, len(self.rigid_pivot)), slice(len(self.rigid_pivot), len(self.held_psi))

    @functools.cached_property
    def powers(self) -> Int[np.ndarray, " rigid"]:
        """Power of 1/s of each row of psi."""
        return np.repeat([2, 1], [len(self.rigid_pivot), len(self.integral_pivot)])

    @property
    def delays(self) -> tuple[int, int]:
        """Delays that differ: over outputs, and over inputs."""
        each = {
            "output": (self.outputs, 1),
            "path": (self.outputs, self.inputs),
            "common": (1, 1),
            None: (0, 0),
        }
        return each[self.options.delay_of]

    def columns_of(self, mode: int) -> np.ndarray:
        """Places of a mode's linear unknowns among those of an output."""
        each = (1 if self.options.real_constants else 2) * self.copies
        if self.pair[mode]:
            return np.arange(each * mode, each * (mode + 1))
        first = each * self.pairs + self.copies * (mode - self.pairs)
        return np.arange(first, first + self.copies)

    @property
    def mode_columns(self) -> int:
        """Linear unknowns of all modes in one output: they come first."""
        per_pair = 1 if self.options.real_constants else 2
        return self.copies * (per_pair * self.pairs + len(self.pair) - self.pairs)

    @property
    def columns(self) -> int:
        """Linear unknowns of one output: modes, rigid modes, integrators, 1/s^2, constant."""
        terms = self.inputs * (self.options.residuals + bool(self.options.direct))
        return self.mode_columns + len(self.powers) + terms

    @property
    def size(self) -> int:
        """Length of theta."""
        outputs, inputs = self.delays
        return len(self.pair) + self.pairs + len(self.free_b) + len(self.free_psi) + outputs * inputs

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the model: theta and the linear ones, less their constraints."""
        ties = self.inputs if self.options.zero_sum else 0
        return self.size + self.outputs * (self.columns - ties)


@record
class Point:
    """theta unpacked: poles [rad/s], input vectors of each term, delays [s], those of poles at zero.

    Rigid modes come before integrators.

    There is one delay for all paths of an output, or one for each.
    """

    poles: Complex[np.ndarray, " mode"]
    b: Complex[np.ndarray, "term input"]
    delay_s: Float[np.ndarray, "output path"]
    psi: Float[np.ndarray, "rigid input"] | None = None


def pack(layout: Layout, point: Point) -> Float[np.ndarray, " unknown"]:
    """theta of a point; entries of b are taken relative to the pivot entry, which becomes one."""
    sigma, omega = -np.real(point.poles), np.imag(point.poles)[: layout.pairs]
    entries: list[float] = []
    if free := layout.free_b:
        b = point.b / np.take_along_axis(point.b, layout.pivot[:, None], axis=1)
        entries = [b[m, i].imag if part else b[m, i].real for m, i, part in free]
    rigid: list[float] = []
    if point.psi is not None and (free_psi := layout.free_psi):
        held = layout.held_psi
        psi = np.vstack(
            [np.linalg.solve(point.psi[own][:, list(held[own])], point.psi[own]) for own in layout.at_zero]
        )
        rigid = [psi[r, i] for r, i in free_psi]
    return np.concatenate(
        [np.log(sigma), np.log(omega), np.array(entries), np.array(rigid), _delays_of(layout, point).ravel()]
    )


def _delays_of(layout: Layout, point: Point) -> np.ndarray:
    outputs, inputs = layout.delays
    if layout.options.delay_of == "common":
        return np.mean(point.delay_s, keepdims=True)
    return np.broadcast_to(point.delay_s[:outputs], (outputs, max(inputs, point.delay_s.shape[1])))[
        :, :inputs
    ]


def unpack(layout: Layout, theta: Float[np.ndarray, " unknown"]) -> Point:
    """Inverse of `pack`."""
    modes, pairs = len(layout.pair), layout.pairs
    imag = layout.fixed_imag.copy()
    imag[:pairs] = np.exp(theta[modes : modes + pairs])
    free, free_psi = layout.free_b, layout.free_psi
    used = modes + pairs + len(free)
    return Point(
        -np.exp(theta[:modes]) + 1j * imag,
        _input_vectors(layout, free, theta[modes + pairs : used]),
        _delays_at(layout, theta[used + len(free_psi) :]),
        _rigid_vectors(layout, free_psi, theta[used : used + len(free_psi)]),
    )


@record
class Start:
    """A layout and its theta: where a search begins, or has ended."""

    layout: Layout
    theta: Float[np.ndarray, " unknown"]

    @functools.cached_property
    def point(self) -> Point:
        """theta unpacked."""
        return unpack(self.layout, self.theta)


def _input_vectors(layout: Layout, free: list[tuple[int, int, bool]], values: np.ndarray) -> np.ndarray:
    modes = len(layout.pair)
    if layout.options.full_rank:
        return np.tile(np.eye(layout.inputs, dtype=complex), (modes, 1))
    b = np.zeros((modes, layout.inputs), dtype=complex)
    b[np.arange(modes), layout.pivot] = 1.0
    for (m, i, part), value in zip(free, values, strict=True):
        b[m, i] += 1j * value if part else value
    return b


def _rigid_vectors(layout: Layout, free: list[tuple[int, int]], values: np.ndarray) -> np.ndarray:
    rigid = len(layout.powers)
    psi = np.zeros((rigid, layout.inputs))
    psi[np.arange(rigid), list(layout.held_psi)] = 1.0
    for (r, i), value in zip(free, values, strict=True):
        psi[r, i] = value
    return psi


def _delays_at(layout: Layout, values: np.ndarray) -> np.ndarray:
    if not layout.options.delay_of:
        return np.zeros((layout.outputs, 1))
    outputs, inputs = layout.delays
    return np.broadcast_to(values.reshape(outputs, inputs), (layout.outputs, inputs))
