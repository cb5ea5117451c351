"""Discretisation error of each frequency, estimated without another mesh.

Between its nodes a member moves by the static shapes of its elements, which omit the deflection of a clamped
element under its own inertia omega^2 rho w and its pull N w''. The energy of that deflection, to first order
in the flexibility, is what refinement takes off omega^2: the next term of the dynamic stiffness in powers of
omega^2 and N (Przemieniecki 1968, Theory of Matrix Structural Analysis, section 10.6), of order h^4 for a
beam and h^2 for a bar or shaft. Near buckling N alone makes it large. Above an element's own clamped
frequency the estimate fails: there a mesh lacks modes.

Mass that is lumped (``coupled``: half of it along, in rods all of it across) is more than the consistent
mass of the same motion, by share rho A L/6 times the square of what the ends move apart: that lowers the
frequency, in trusses more than the rest lifts it.

The rest state has an error too: an element is a cubic about its chord, off by the square of the angle at
which it leaves that. For random frames that sag by up to their own size, frequencies are off by at most 1.2
times that square, and by less than 1e-3 where no angle is above 0.04 (`tests/truth/test_mesh_error.py`).
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.beam_ends import element_poses
from middeck.structure.assembly.energy import inner_forces
from middeck.structure.elements.beam import BeamProperties
from middeck.structure.elements.beam_deformations import STRETCH, Y1, Y2, Z1, Z2
from middeck.structure.elements.beam_inertia import transverse_shapes
from middeck.structure.rest.equilibrium import Equilibrium

LIMIT = 1e-4
"""Relative error of a frequency above which `mesh_warnings` speaks; a mode damped by 1 % is 2 % wide."""
BENT = 0.04
"""Angle [rad] between the end of an element at rest and its chord above which `mesh_warnings` speaks."""
# Root of the flexibility of a clamped bar of unit length and stiffness under a load that is linear along it,
# by the load's end values.
BAR = np.linalg.cholesky([[1.0 / 45.0, 7.0 / 360.0], [7.0 / 360.0, 1.0 / 45.0]]).T
CLAMPED_BEAM = 500.5639  # 4.7300^4: omega^2 of its first vibration in EI / (rho A L^4)
CLAMPED_BAR = np.pi**2
CLAMPED_COLUMN = 4.0 * np.pi**2  # its critical load in EI / L^2
STRING = 1e-9  # EI / (N L^2) taken of a string, which has none: its tension holds it alone
# omega^2 over an element's own: beyond, the mesh has no shape like the mode.
BEYOND = 0.5
UNCOUPLED = 1e-9  # coupling over both bending stiffnesses below which rounding alone turns the axes
ORDER = 0.25  # errors fall with the fourth power of the number of elements at most: those of bending
POINTS = 8  # Gauss points, exact for the moments of cubic loads
MORE_ELEMENTS = "use more elements a member (mesh.elements_per_strut, or elements of a strut)"
ONE_ELEMENT = (
    "most of it is of rods, which have one element: to divide one, give it bending stiffness and ends that "
    "turn freely (in a deck a CBAR with pin flags)"
)


class ModesToJudge(Protocol):
    """What the estimates take of `Modes`, whose warnings ask for them."""

    @property
    def equilibrium(self) -> Equilibrium:
        """Rest state."""
        ...

    @property
    def omega(self) -> Float[np.ndarray, " mode"]:
        """Angular frequency [rad/s]."""
        ...

    @property
    def shapes(self) -> Float[np.ndarray, "coordinate mode"]:
        """Columns in the coordinates of the frame tree."""
        ...

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequency [Hz]."""
        ...

    @property
    def name(self) -> tuple[str, ...]:
        """Name of each mode."""
        ...


def estimate_mesh_error(modes: ModesToJudge, count: int | None = None) -> Float[np.ndarray, " mode"]:
    """Relative error by the mesh of each of the lowest ``count`` frequencies (default: all), negative if low.

    Infinite where elements vibrate by themselves at or below the mode's frequency. The error of the rest
    state is not in it (`rest_angles`).
    """
    return _element_errors(modes, count).sum(axis=0)


def _element_errors(modes: ModesToJudge, count: int | None) -> Float[np.ndarray, "element mode"]:
    """Part of each element in the relative error of each of the lowest ``count`` frequencies."""
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    rest, omega = modes.equilibrium, modes.omega[:count]
    lost = np.zeros((len(rest.model.element_ends), count))
    if not lost.size:
        return lost
    pull = inner_forces(rest.model, rest.config, rest.loads).beam[:, STRETCH]
    beyond = np.zeros(lost.shape, dtype=bool)
    beams, turn = _principal(rest.model.beams)
    moves = _end_moves(modes, count)
    lumped = beams.lumped[:, [0, 1, 1]] * (beams.rho_A * beams.length / 6.0)[:, None]
    lost -= np.einsum("ei,eim->em", lumped, (moves[:, 1, 0] - moves[:, 0, 0]) ** 2)
    moves[..., 1, :], moves[..., 2, :] = _turned(moves[..., 1, :], moves[..., 2, :], turn)
    for part in _parts(beams, moves, pull):
        near = omega**2 / part.own[:, None] - (pull / part.critical)[:, None]
        load = omega * (part.inertia @ part.ends)
        load = load + (part.pulled @ part.ends) * _over(np.ones(count), omega)
        lost += np.sum(load**2, axis=1) / np.maximum(1.0 - near, 1.0 - BEYOND)
        beyond |= near > BEYOND
    return np.where(beyond, np.inf, 0.5 * lost)


def rest_angles(rest: Equilibrium) -> Float[np.ndarray, " element"]:
    """The larger angle [rad] of either end of each element with its chord, by which gravity has bent it."""
    beams, force = rest.model.beams, inner_forces(rest.model, rest.config, rest.loads).beam
    beams, turn = _principal(beams)
    first, last = (np.stack(_turned(force[:, y], force[:, z], turn), axis=1) for y, z in ((Y1, Z1), (Y2, Z2)))
    flexibility = np.column_stack([_over(beams.length, 6.0 * EI) for EI in (beams.EI_y, beams.EI_z)])
    angles = flexibility[:, None] * np.stack([2.0 * first - last, 2.0 * last - first], axis=1)
    return np.linalg.norm(angles, axis=2).max(axis=1, initial=0.0)


def mesh_warnings(modes: ModesToJudge, count: int) -> tuple[str, ...]:
    """A sentence where any of the ``count`` lowest frequencies is wrong by more than `LIMIT`, and one where
    an element at rest is bent by more than `BENT`."""
    return (*_coarse_modes(modes, count), *_coarse_rest(modes))


def _coarse_rest(modes: ModesToJudge) -> tuple[str, ...]:
    angles = rest_angles(modes.equilibrium)
    bent = float(angles.max(initial=0.0))
    if bent <= BENT:
        return ()
    off = f"every frequency may be off by {bent**2:.1%}" if bent < 0.5 else "frequencies mean little"
    more = int(np.ceil(bent / BENT))
    return (
        f"at rest {np.sum(angles > BENT)} of {len(angles)} elements are bent by more than "
        f"{np.degrees(BENT):.2g} deg between their nodes, up to {np.degrees(bent):.3g} deg: {off}; use more "
        f"elements a member (mesh.elements_per_strut, or elements of a strut), at least {more} times as many",
    )


def _coarse_modes(modes: ModesToJudge, count: int) -> tuple[str, ...]:
    each = _element_errors(modes, count)
    error = each.sum(axis=0)
    off = np.flatnonzero(np.abs(error) > LIMIT)
    if not len(off):
        return ()
    worst = int(off[np.argmax(np.abs(error[off]))])
    f = modes.frequency_hz[worst]
    few = (
        f"{len(off)} of the {len(error)} lowest frequencies {'is' if len(off) == 1 else 'are'} "
        f"{_side(error[off])} by more than {LIMIT:.2%}, because the mesh is coarse"
    )
    rods = bool(modes.equilibrium.model.beams.straight[int(np.argmax(np.abs(each[:, worst])))])
    if np.isinf(error[worst]):
        return (
            f"{few}; from {f:.4g} Hz (mode {worst}) on modes are missing, since members vibrate between "
            f"their nodes there; {ONE_ELEMENT if rods else MORE_ELEMENTS}",
        )
    off_by = f"{100.0 * abs(error[worst]):.2g} % {_side(error[[worst]])}"
    mode = f"the worst is mode {worst} {modes.name[worst]!r} of {f:.4g} Hz, {off_by}"
    more = max(int(np.ceil((abs(error[worst]) / LIMIT) ** ORDER)), 2)
    cure = ONE_ELEMENT if rods else f"{MORE_ELEMENTS}, at least {more} times as many"
    return (f"{few}: {mode}; {cure}",)


def _side(error: np.ndarray) -> str:
    return "too high" if error.min() > 0.0 else "too low" if error.max() < 0.0 else "off"


def _end_moves(modes: ModesToJudge, count: int) -> Float[np.ndarray, "element 2 2 3 mode"]:
    """Displacement and rotation of both ends of every element in its own axes."""
    rest = modes.equilibrium
    model = rest.model
    moves = rest.moves(modes.shapes[:, :count])[model.element_ends].reshape(-1, 2, 2, 3, count)
    axes = element_poses(model, rest.config)[1][:, 0]
    return np.einsum("eij,enbim->enbjm", axes, moves)


def _principal(beams: BeamProperties) -> tuple[BeamProperties, Float[np.ndarray, " element"]]:
    """The properties in axes across each element that decouple its bendings, and their angle [rad].

    The angle is zero unless a section couples them. Ends that turn alike and oppositely leave the constant
    bending, whose stiffness 2 D / L has no shear.
    """
    K = beams.stiffness
    near, far = (K[:, [[Y1], [Z1]], [last]] for last in ([Y1, Z1], [Y2, Z2]))
    D = 0.5 * beams.length[:, None, None] * (near - far)
    y, z, both = D[:, 0, 0], D[:, 1, 1], D[:, 0, 1]
    coupled = np.abs(both) > UNCOUPLED * (y + z)
    turn = np.where(coupled, 0.5 * np.arctan2(2.0 * both, y - z), 0.0)
    c2, s2, twice = np.cos(turn) ** 2, np.sin(turn) ** 2, np.sin(2.0 * turn) * both
    I_y, I_z = beams.rho_I_y, beams.rho_I_z
    phi_y, phi_z = beams.shear_y, beams.shear_z
    turned = dataclasses.replace(
        beams,
        EI_y=np.where(coupled, c2 * y + s2 * z + twice, beams.EI_y),
        EI_z=np.where(coupled, s2 * y + c2 * z - twice, beams.EI_z),
        rho_I_y=c2 * I_y + s2 * I_z,
        rho_I_z=s2 * I_y + c2 * I_z,
        shear_y=c2 * phi_y + s2 * phi_z,
        shear_z=s2 * phi_y + c2 * phi_z,
    )
    return turned, turn


def _turned(y: np.ndarray, z: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Components of vectors across elements (first axis) in axes that are turned about each."""
    c, s = (f(turn).reshape(-1, *[1] * (y.ndim - 1)) for f in (np.cos, np.sin))
    return c * y + s * z, c * z - s * y


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """One way for elements to deform.

    Attributes:
        ends: Motion of their ends in each mode.
        inertia, pulled: Root of the energy that their inertia at omega = 1, and their axial force, give them.
        own, critical: Their lowest omega^2 with clamped ends, and the axial force at which they buckle so.
    """

    ends: Float[np.ndarray, "element end mode"]
    inertia: Float[np.ndarray, "element point end"]
    pulled: Float[np.ndarray, "element point end"]
    own: Float[np.ndarray, " element"]
    critical: Float[np.ndarray, " element"]


def _parts(beams: BeamProperties, moves: np.ndarray, pull: np.ndarray) -> list[_Part]:
    """Stretch, twist and both bendings."""
    L = beams.length
    parts: list[_Part] = []
    for field, inertia, stiffness in (
        (0, beams.rho_A, beams.EA),
        (1, beams.rho_I_y + beams.rho_I_z, beams.GJ),
    ):
        load = np.sqrt(_over(inertia**2 * L**3, stiffness))[:, None, None] * BAR
        own = CLAMPED_BAR * _own(stiffness, inertia * L**2)
        parts.append(
            _Part(
                ends=moves[:, :, field, 0],
                inertia=load,
                pulled=0.0 * load,
                own=own,
                critical=np.full(len(L), np.inf),
            )
        )
    for across, about, sign, EI, rho_I, shear in (
        (1, 2, 1.0, beams.EI_z, beams.rho_I_z, beams.shear_y),
        (2, 1, -1.0, beams.EI_y, beams.rho_I_y, beams.shear_z),  # w' = -theta_y
    ):
        ends = np.stack(
            [m for n in (0, 1) for m in (moves[:, n, 0, across], sign * moves[:, n, 1, about])], axis=1
        )
        # A rod goes straight by its definition, a string does not.
        string = (EI == 0.0) & (pull > 0.0) & ~beams.straight
        EI = np.where(string, STRING * pull * L**2, EI)
        own = CLAMPED_BEAM * _own(EI, beams.rho_A * L**4) / (1.0 + shear)
        critical = CLAMPED_COLUMN * _own(EI, L**2) / (1.0 + CLAMPED_COLUMN / 12.0 * shear)
        load, pulled = _bending_loads(L, EI, beams.rho_A, rho_I, shear, pull)
        parts.append(_Part(ends=ends, inertia=load, pulled=pulled, own=own, critical=critical))
    return parts


def _over(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Zero where there is nothing that could give way."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)


def _own(stiffness: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Infinite for a deformation without inertia, or without elastic stiffness."""
    return np.divide(
        stiffness, inertia, out=np.full(len(stiffness), np.inf), where=(inertia > 0.0) & (stiffness > 0.0)
    )


def _bending_loads(
    L: np.ndarray, EI: np.ndarray, rho_A: np.ndarray, rho_I: np.ndarray, shear: np.ndarray, pull: np.ndarray
) -> tuple[Float[np.ndarray, "element point 4"], Float[np.ndarray, "element point 4"]]:
    """Root of a clamped element's energy under the inertia of its four static shapes, and under their pull.

    The stress resultants of each load are those of a cantilever less the end forces that make the
    complementary energy least: exact for Bernoulli and Timoshenko beams.
    """
    x, weight, integral = _gauss()
    shapes = [transverse_shapes(at, L, shear) for at in x]
    v, slope = (np.stack([s[k] for s in shapes], axis=1) for k in (0, 1))
    long = L[:, None, None]
    bend = np.sqrt(weight[None, :, None] * _over(L, EI)[:, None, None])
    across = bend * np.sqrt(shear / 12.0)[:, None, None] * long
    ends = np.concatenate(
        [
            np.concatenate([-long * x[None, :, None] * bend, bend], axis=2),
            np.concatenate([across, 0.0 * across], axis=2),
        ],
        axis=1,
    )
    Q = np.linalg.qr(ends)[0]

    def root(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
        loads = np.concatenate([moment * bend, force * across], axis=1)
        return loads - Q @ (np.swapaxes(Q, 1, 2) @ loads)

    force = -long * (integral @ (rho_A[:, None, None] * v))
    moment = -long * (integral @ (force + rho_I[:, None, None] * slope))
    pulled = pull[:, None, None]
    return root(force, moment), root(-pulled * slope, pulled * v)


@functools.cache  # each step of a refinement asks for them
def _gauss() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and weights on (0, 1), and the matrix that integrates from 0 to each of the points."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    legendre = np.polynomial.legendre
    values = legendre.legvander(points, POINTS - 1)
    sums = [legendre.legval(points, legendre.legint(c, lbnd=-1)) for c in np.eye(POINTS)]
    integral = 0.5 * np.stack(sums, axis=1) @ np.linalg.inv(values)
    return 0.5 * (points + 1.0), 0.5 * weights, integral
