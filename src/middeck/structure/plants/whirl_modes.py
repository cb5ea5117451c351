"""Modes of a structure whose wheels spin: complex, each of them a whirl forward or backward.

Between the real modes at standstill, q'' + (g + d) q' + w^2 q = 0 with g = phi' G phi
(`assembly.wheel_forces`) and d = 2 zeta w. In the states x = (w q, q') that is x' = A x, and A is skew but
for d: its eigenvalues are as well conditioned as those of a symmetric matrix (Meirovitch 1974, AIAA J. 12).
A rigid mode has its rate alone as a state. A null vector of A is a drift: a rigid motion in which a static
deformation bears the torque of the wheels. Drifts are parted by the rank of g between rigid modes; any two
rigid modes that g joins make a nutation, and an attitude that stays where it is put and precesses under a
torque.

The sense of a whirl is that of n . (theta x theta'), n the axis of a wheel and theta the turn of its frame,
weighted by the momenta: the power of G on the motion a quarter of a period later. It is the derivative of the
frequency by the speed too, so that "forward" means both: with the spin, and faster with more of it.
"""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, NumericalError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.wheel_forces import Spin, spinning_wheels
from middeck.structure.model.article import Damping
from middeck.structure.modes.motions.rigid_motions import rigid_basis
from middeck.structure.modes.motions.strained_parts import leading_parts
from middeck.structure.modes.solve import EQUAL_SIZE, Modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.plants.residual_flexibility import residual_flexibility
from middeck.values import record

WHOLE = 300
"""Real modes that all enter; of more the lowest."""
JOINED = 1e-10
"""Part of the momenta on rigid modes that joins two of them; less is rounding."""
CLEAR = 1e-6
"""Part of a mode's frequency that the wheels make, from which on its whirl has a sense."""
FAR = 4e-4
"""Estimated relative error of a frequency that is warned about; of the last modes kept it is half."""


@record(kw_only=True)
class GyroscopicModes:
    """Modes at the wheel speeds of an environment: those at zero first, then by frequency.

    Attributes:
        standstill: The real modes about the same rest state with the wheels at rest.
        omega, zeta: Angular frequency [rad/s], the size of the eigenvalue s, and damping ratio.
        shapes: The motion is the real part of shape times exp(s t), in the coordinates of
            ``standstill.shapes``. Mass-normalised, shape^H M shape = 1, the entry of largest kinetic energy
            positive.
        whirl: d ln omega / d ln speed, of all wheels together: positive forward, 1 for the nutation of a
            rigid body, 0 where no wheel's axis circles.
        kind, name: Those of the standstill modes with most energy; a mode of rigid motions that the wheels
            alone hold is "gyroscopic".
        residual: |(s^2 M + s (G + C) + K) shape| of each, C that of the ratios, over the size of its terms:
            of the whole article, whatever modes it was solved in.
        warnings: Frequencies that the modes left out would change, and warnings of the damping.
    """

    standstill: Modes
    omega: Float[np.ndarray, " mode"]
    zeta: Float[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "coordinate mode"]
    whirl: Float[np.ndarray, " mode"]
    kind: tuple[str, ...]
    name: tuple[str, ...]
    residual: Float[np.ndarray, " mode"]
    warnings: tuple[str, ...]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """The size of s in Hz."""
        return self.omega / (2.0 * np.pi)

    @property
    def s(self) -> Complex[np.ndarray, " mode"]:
        """Eigenvalues [rad/s], those in the upper half plane."""
        return _eigenvalues(self.omega, self.zeta)

    @property
    def sense(self) -> tuple[str, ...]:
        """Sense of the wheels' axes: "forward" circling with the spin, "backward" against it, "" for none."""
        return tuple("" if abs(w) < CLEAR else "forward" if w > 0.0 else "backward" for w in self.whirl)

    @property
    def parts(self) -> Modes:
        """The real parts of the shapes, then the imaginary ones, as modes for drawings."""
        called = [f"{name}, {way}" if way else name for name, way in zip(self.name, self.sense, strict=True)]
        none = np.zeros(2 * len(called))
        return dataclasses.replace(
            self.standstill,
            omega=np.tile(self.omega, 2),
            shapes=np.hstack([np.real(self.shapes), np.imag(self.shapes)]),
            kind=self.kind * 2,
            stated_name=(*called, *(f"{name}, a quarter of a period before" for name in called)),
            rigid_share=none,
            strain_share=none,
            residual=none,
        )


@named_kinds
def solve_gyroscopic_modes(
    modes: Modes, damping: Damping | None = None, *, count: int | None = None
) -> GyroscopicModes:
    """The lowest ``count`` modes (all by default) at the wheel speeds of the environment of ``modes``.

    Args:
        damping: The article's by default. Its ratios are those of the modes at standstill: of what does not
            turn with a rotor. Beyond ``count`` the last of them holds.

    With all wheels at rest these are ``modes``. Raises `ConfigError` if `estimate_damping` does.
    """
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    damped = estimate_damping(modes, damping, count=count)
    equilibrium = modes.equilibrium
    spin = spinning_wheels(equilibrium.model, equilibrium.config, equilibrium.environment)
    still = GyroscopicModes(
        standstill=modes,
        omega=modes.omega[:count],
        zeta=damped.zeta,
        shapes=modes.shapes[:, :count].astype(complex),
        whirl=np.zeros(count),
        kind=modes.kind[:count],
        name=modes.name[:count],
        residual=modes.residual[:count],
        warnings=damped.warnings,
    )
    if not spin.turns:
        return still
    kept = min(len(modes.omega), max(WHOLE, 2 * count))
    omega, basis = modes.omega[:kept], modes.shapes[:, :kept]
    beyond = np.full(kept - count, damped.zeta[-1] if count else 0.0)
    zeta = np.where(omega > 0.0, np.concatenate([damped.zeta, beyond]), 0.0)
    found = solve_whirls(omega, zeta, spin, spin.turn @ basis)
    first = found.drifts + found.attitudes
    share = np.abs(found.q) ** 2 * (found.omega**2 + omega[:, None] ** 2)
    share[:, :first] = np.abs(found.q[:, :first]) ** 2
    names = [leading_parts(modes.name[:kept], part)[0] for part in share.T]
    names[found.drifts : first] = [f"attitude: {name}" for name in names[found.drifts : first]]
    shapes = _in_phase(modes, basis @ found.q)
    shapes[:, : found.drifts], names[: found.drifts] = rigid_basis(
        equilibrium, modes.mass, np.real(basis @ found.q[:, : found.drifts])
    )
    return dataclasses.replace(
        still,
        omega=found.omega[:count],
        zeta=found.zeta[:count],
        shapes=shapes[:, :count],
        whirl=found.whirl[:count],
        kind=tuple(_kind(modes.kind[:kept], part, m < first) for m, part in enumerate(share.T))[:count],
        name=tuple(names[:count]),
        residual=_residual(modes, spin, basis, 2.0 * zeta * omega, found)[:count],
        warnings=(*damped.warnings, *_left_out(modes, spin, kept, found)),
    )


def momentum_warnings(modes: Modes, spin: Spin, zeta: Float[np.ndarray, " mode"]) -> tuple[str, ...]:
    """Warnings of the change in the other modes by those beyond the ratios ``zeta``, where wheels spin."""
    kept = len(zeta)
    if not spin.turns:
        return ()
    return _left_out(
        modes, spin, kept, solve_whirls(modes.omega[:kept], zeta, spin, spin.turn @ modes.shapes[:, :kept])
    )


def _kind(kinds: tuple[str, ...], share: np.ndarray, at_zero: bool) -> str:
    """The kind with most of the energy; rigid motions that oscillate are held by momentum alone."""
    known = sorted(set(kinds))
    most = known[int(np.argmax([share[[k == kind for k in kinds]].sum() for kind in known]))]
    return "gyroscopic" if most == "rigid" and not at_zero else most


def _in_phase(modes: Modes, shapes: np.ndarray) -> np.ndarray:
    kinetic = np.real(shapes.conj() * (modes.mass @ shapes))
    largest = np.argmax(kinetic >= (1.0 - EQUAL_SIZE) * kinetic.max(axis=0), axis=0)
    entry = shapes[largest, np.arange(shapes.shape[1])]
    return shapes * (np.abs(entry) / entry)


@record(kw_only=True)
class Whirls:
    """Frequencies, modal coordinates of unit size, whirl; the ``drifts`` first, then ``attitudes``."""

    omega: Float[np.ndarray, " mode"]
    zeta: Float[np.ndarray, " mode"]
    q: Complex[np.ndarray, "basis mode"]
    whirl: Float[np.ndarray, " mode"]
    drifts: int
    attitudes: int

    @property
    def s(self) -> Complex[np.ndarray, " mode"]:
        """Eigenvalues."""
        return _eigenvalues(self.omega, self.zeta)


def _eigenvalues(omega: np.ndarray, zeta: np.ndarray) -> Complex[np.ndarray, " mode"]:
    return omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))


def solve_whirls(omega: np.ndarray, zeta: np.ndarray, spin: Spin, turn: np.ndarray) -> Whirls:
    """Modes of q'' + (g + 2 zeta omega) q' + omega^2 q = 0, of which the rigid ones (omega = 0) come first.

    ``turn`` is the turn of the wheels' frames in each of them.
    """
    n, rigid = len(omega), int(np.sum(omega == 0.0))
    flexible = n - rigid
    g = turn.T @ spin.forces(turn)
    g = 0.5 * (g - g.T)
    drift, attitude = _part_rigid(g[:rigid, :rigid], spin, turn[:, :rigid])
    w, d = omega[rigid:], 2.0 * zeta * omega
    A = np.zeros((flexible + n, flexible + n))
    A[:flexible, n:] = np.diag(w)
    A[n:, :flexible] = -np.diag(w)
    A[flexible:, flexible:] = -g - np.diag(d)
    # To zero A takes (-g v / w, v) for a drift v; what is normal to all of them is mapped into itself.
    null = np.vstack([-(g[rigid:, :rigid] @ drift) / w[:, None], drift, np.zeros((flexible, drift.shape[1]))])
    rest = cast("Any", sla.qr(null))[0][:, drift.shape[1] :]
    inner = rest.T @ A @ rest
    if np.any(d):
        values, vectors = np.linalg.eig(inner)
    else:
        rate, vectors = np.linalg.eigh(0.5j * (inner - inner.T))
        values = -1j * rate
    upper = np.imag(values) >= 0.0
    s, x = values[upper], rest @ vectors[:, upper]
    q = x[flexible:] * np.conj(s)  # from either state, as far as it is determined
    q[rigid:] += w[:, None] * x[:flexible]
    q = q / (omega[:, None] ** 2 + np.abs(s) ** 2)
    q = q / np.linalg.norm(q, axis=0)
    s, whirl = _refined(omega, d, g, q, s)
    rank = np.argsort(np.abs(s), kind="stable")
    still = np.zeros((n, drift.shape[1] + attitude.shape[1]), dtype=complex)
    still[:rigid] = np.hstack([drift, attitude])
    zero = np.zeros(still.shape[1])
    return Whirls(
        omega=np.concatenate([zero, np.abs(s[rank])]),
        zeta=np.concatenate([zero, np.minimum(-np.real(s[rank]) / np.abs(s[rank]), 1.0)]),
        q=np.hstack([still, q[:, rank]]),
        whirl=np.concatenate([zero, whirl[rank]]),
        drifts=drift.shape[1],
        attitudes=attitude.shape[1],
    )


def _part_rigid(g: np.ndarray, spin: Spin, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rigid modes that no momentum joins, and the others in circling pairs."""
    sizes = np.linalg.norm(spin.momentum, axis=1) @ np.sum(turn.reshape(len(spin.momentum), -1) ** 2, axis=1)
    rate, pairs = np.linalg.eigh(1j * g)
    free = pairs[:, np.abs(rate) <= JOINED * sizes]
    real = np.linalg.svd(np.real(free @ free.conj().T))[0]  # a space that is its own conjugate
    return real[:, : free.shape[1]], pairs[:, rate > JOINED * sizes]


def _refined(
    omega: np.ndarray, d: np.ndarray, g: np.ndarray, q: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Roots of each mode's equation with itself, s^2 + s (d + j c) + k = 0, and their whirl."""
    size = np.abs(q) ** 2
    k, swirl = omega**2 @ size, np.imag(np.einsum("im,im->m", q.conj(), g @ q))
    b = 0.5 * (d @ size + 1j * swirl)
    root = np.sqrt(b**2 - k + 0j)
    large = -(b + np.where(np.real(np.conj(b) * root) < 0.0, -root, root))  # nothing cancels
    small = k / large
    s = np.where(np.abs(large - s) <= np.abs(small - s), large, small)
    return s, -np.imag(s) * swirl / (np.abs(s) ** 2 + k)


def _residual(modes: Modes, spin: Spin, basis: np.ndarray, d: np.ndarray, found: Whirls) -> np.ndarray:
    """Residuals of the modes in the moving coordinates."""
    at = modes.equilibrium
    free = dynamic_freedom(at.model, at.config, in_world=True)
    K, M = assemble(at.model, at.config, at.loads).tangent, modes.mass
    shapes, rates = basis @ found.q, basis @ (found.s**2 * found.q + found.s * d[:, None] * found.q)
    force = spin.turn.T @ spin.forces(spin.turn @ (shapes * found.s))
    left = np.abs(free.part(K @ shapes + M @ rates + force)).max(axis=0, initial=0.0)
    terms = free.part(abs(K) @ np.abs(shapes) + abs(M) @ np.abs(rates) + np.abs(force))
    size = terms.max(axis=0, initial=0.0)
    return left / np.where(size > 0.0, size, 1.0)


def _left_out(modes: Modes, spin: Spin, kept: int, found: Whirls) -> tuple[str, ...]:
    """A warning where the modes beyond ``kept`` would move a frequency, by their flexibility at the wheels.

    They give way to the torques f of the wheels by R f, which takes f^H R f from the stiffness of a mode.
    """
    rigid = int(np.sum(modes.omega == 0.0))
    if kept < rigid:
        raise ConfigError(
            f"{kept} modes kept of {rigid} rigid ones, which the momentum of wheels joins",
            where=f"environment {modes.equilibrium.environment.title!r}",
            hint=f"keep {rigid} or more",
        )
    if _complete(modes, kept):
        return ()
    turn = spin.turn @ modes.shapes
    try:
        if _complete(modes, len(modes.omega)):
            gives = (turn[:, kept:] / modes.omega[kept:] ** 2) @ turn[:, kept:].T
        else:
            rows = spin.turn.toarray()
            gives = residual_flexibility(modes, rows, rows, kept)
    except NumericalError as error:
        return (f"what the modes beyond {kept} do to those of the spinning wheels is unknown: {error.what}",)
    f = spin.forces(turn[:, :kept] @ found.q) * found.s
    taken = np.real(np.einsum("im,im->m", f.conj(), gives @ f))
    store = modes.omega[:kept] ** 2 @ np.abs(found.q) ** 2 + found.omega**2
    error = np.divide(taken, store, out=np.zeros_like(taken), where=store > 0.0)
    worst = int(np.argmax(error))
    if error[worst] <= FAR:
        return ()
    hz = found.omega[worst] / (2.0 * np.pi)
    return (
        f"of {len(modes.omega)} modes at standstill {kept} are taken: by what the others give way to the "
        f"wheels, the whirl at {hz:.4g} Hz is {100.0 * error[worst]:.2g} % lower; take more modes",
    )


def _complete(modes: Modes, kept: int) -> bool:
    """Whether the lowest ``kept`` modes are all that move mass."""
    at = modes.equilibrium
    mass = dynamic_freedom(at.model, at.config, in_world=True).matrix(modes.mass)
    return kept >= int(np.sum(abs(mass).max(axis=1).toarray() > 0.0))
