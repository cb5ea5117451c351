"""A reduced component: matrices of boundary grids and modal coordinates in place of a part's members."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from middeck.errors import ConfigError
from middeck.structure.model.clamps import check_axes
from middeck.values import record

WAYS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
# Largest asymmetry over the geometric mean of two sizes (`_sizes`): printed digits.
UNEQUAL = 1e-7
# Mass that is rounding alone, over a coordinate's stiffness at a typical frequency.
ROUNDED = 1e-6
# Largest resistance to a motion as one body, over the sum of a row's terms.
RESISTS = 1e-6
# The same as energy over the kinetic energy of that motion at the lowest elastic frequency.
RESISTS_WHOLE = 1e-8
# The same of what rounding leaves.
ROUNDING = 1e-12
# Remainder of an energy whose terms cancel, over these: sums of hundreds of terms leave 1e-15.
CANCELS = 1e-14
# Negative values beyond rounding, over the lowest elastic omega^2 and the largest share of mass.
NEGATIVE, NEGATIVE_MASS = 1e-6, 1e-7
# Share of the inertia that is rounding: smaller than `NEGATIVE_MASS` of the whole.
SLIGHT = 1e-8
# Share of mass and inertia that a rigid body may lack.
BODY = 1e-6
# Largest distance, over the size, of a grid from the point that it is fixed to.
APART = 1e-6
# Share of modal masses other than one up to which these are reported where the others are one.
FEW = 0.25
# Frequency of a modal coordinate over the next lower one beyond which it is implausible.
ABSURD = 1e3
# Least weight of a turn in the best fit over the largest.
UNFITTED = 1e-9
# Weight of a grid's rotation in the component's frame, over that of its place at the mean arm.
LITTLE = 1e-4


@record(kw_only=True)
class Component:
    """A part of an article by its reduced matrices (Craig-Bampton or another basis with modal coordinates).

    Coordinates are shift [m] and rotation vector [rad] of each boundary grid, six each, then modal ones.

    Attributes:
        name: Its name.
        grids: Names of the boundary grids.
        frames, offsets: Frame of the article that each grid is fixed to, and where, in the frame's axes [m].
        positions: Places of the grids in the component's own axes [m].
        axes: Unit vectors of these axes in W as drawn, as columns.
        stiffness, mass: Matrices in SI units; modal coordinates may have any scale.
        damping: Viscous damping in the same coordinates, None for none.
        present: Whether the component has each of a grid's six coordinates; absent ones have zeros.
        outputs, recovery: Names of further results and their rows: results per coordinate.
        next_hz: Lowest frequency, with the boundary held, of the modes that the reduction left out; infinite
            where there are none, or none are known of.
        left_out: Sum over these of L L' / omega^2, where the acceleration of the first coordinates (of all
            others none) excites them by L; None where it is not known.
    """

    name: str
    grids: tuple[str, ...]
    frames: tuple[str, ...]
    positions: Float[np.ndarray, "grid 3"]
    stiffness: Float[np.ndarray, "n n"]
    mass: Float[np.ndarray, "n n"]
    offsets: Float[np.ndarray, "grid 3"] | None = None
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    damping: Float[np.ndarray, "n n"] | None = None
    present: Bool[np.ndarray, "grid 6"] | None = None
    outputs: tuple[str, ...] = ()
    recovery: Float[np.ndarray, "output n"] | None = None
    next_hz: float = np.inf
    left_out: Float[np.ndarray, "first first"] | None = None

    @property
    def modal(self) -> int:
        """Number of modal coordinates."""
        return len(self.stiffness) - 6 * len(self.grids)

    @property
    def has(self) -> Bool[np.ndarray, "grid 6"]:
        """``present``, all of them by default."""
        return np.ones((len(self.grids), 6), dtype=bool) if self.present is None else self.present

    @property
    def fixed_at(self) -> Float[np.ndarray, "grid 3"]:
        """``offsets``, none by default."""
        return np.zeros((len(self.grids), 3)) if self.offsets is None else self.offsets

    @property
    def weight(self) -> float:
        """Mass [kg]."""
        return float(rigid_mass(self)[0, 0])


def rigid_vectors(positions: Float[np.ndarray, "grid 3"], size: int) -> Float[np.ndarray, "size 6"]:
    """Unit translations, and unit rotations about the origin; modal coordinates take no part."""
    out = np.zeros((size, 6))
    for i, (x, y, z) in enumerate(positions):
        out[6 * i : 6 * i + 6] = np.eye(6)
        out[6 * i : 6 * i + 3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return out


def rigid_mass(component: Component) -> Float[np.ndarray, "6 6"]:
    """Mass matrix of the component as one body, about the origin of its axes."""
    R = rigid_vectors(component.positions, len(component.mass))
    return R.T @ component.mass @ R


class Whole(NamedTuple):
    """A component as one body, in its own axes: mass, centre of mass, inertia about it."""

    mass: float
    cg: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]


def body_of(component: Component) -> Whole:
    """Mass, centre and inertia of the component."""
    rigid = rigid_mass(component)
    m = float(np.trace(rigid[:3, :3])) / 3.0
    r = np.array([rigid[1, 5], rigid[2, 3], rigid[0, 4]]) / m
    return Whole(m, r, rigid[3:, 3:] - m * (r @ r * np.eye(3) - np.outer(r, r)))


def frame_weights(component: Component) -> Float[np.ndarray, "grid 2"]:
    """Weights of each grid's shift and rotation in the component's frame."""
    has = component.has
    place, turn = np.all(has[:, :3], axis=1).astype(float), np.all(has[:, 3:], axis=1).astype(float)
    if not np.any(place):
        place = np.ones(len(has))
    arms = component.positions - place @ component.positions / place.sum()
    square = float(place @ np.sum(arms**2, axis=1))
    return np.column_stack([place, turn * (LITTLE * square / len(has) if square > 0.0 else 1.0)])


def component_faults(component: Component) -> Iterator[str]:
    """Faults of the matrices of a component: the first of each kind, with its place."""
    name, n = f"component {component.name!r}", 6 * len(component.grids)
    sizes = (len(component.grids), len(component.frames), len(component.positions), len(component.has))
    if len(set(sizes)) > 1 or component.modal < 0 or not component.grids:
        yield (
            f"{name} has matrices of {len(component.stiffness)} rows for {sizes[0]} grids of six "
            f"coordinates, {sizes[1]} frames and {sizes[2]} places"
        )
        return
    if len(set(component.grids)) < len(component.grids):
        yield f"{name} has two grids of one name: {', '.join(component.grids)}"
    named = {"stiffness": component.stiffness, "mass": component.mass}
    named |= {} if component.damping is None else {"damping": component.damping}
    faults = [fault for what, matrix in named.items() for fault in _not_finite(component, what, matrix)]
    try:
        check_axes(component.axes, name)
    except ConfigError as error:
        faults.append(f"{error.what}; the matrices of a mirrored part are others: mirror them")
    if not faults:
        # Neither units nor a stiffness that is rounding alone, of a determinate boundary, have a say in them;
        # and a mass is no vaguer for a stiff tie from grid to grid.
        shift, size = _sizes(component)
        mass = np.sqrt(np.abs(np.diagonal(component.mass)) + ROUNDED / shift * size**2)
        by = {"stiffness": size, "mass": mass, "damping": size / shift**0.25}
        faults = [
            f for what, matrix in named.items() for f in _unsymmetric(component, what, matrix, by[what])
        ]
    if faults:
        yield from (f"{name}: {fault}" for fault in faults)
        return
    yield from (f"{name}: {fault}" for fault in _no_body(component))
    if not np.any(component.has[:n]):
        yield f"{name} has no boundary"
        return
    yield from (f"{name}: {fault}" for fault in (*_loose_frame(component), *_indefinite(component)))
    if component.damping is not None:
        size = np.sqrt(np.abs(np.diagonal(component.damping)))
        size[size == 0.0] = 1.0
        least, *_, most = np.linalg.eigvalsh(component.damping / np.outer(size, size))
        if least < -NEGATIVE * most:
            yield f"{name}: its damping is indefinite: some motion would be driven by it"
    if component.recovery is not None and component.recovery.shape != (
        len(component.outputs),
        n + component.modal,
    ):
        yield f"{name}: {len(component.outputs)} outputs, a recovery of {len(component.recovery)} rows"


def modal_hz(component: Component) -> Float[np.ndarray, " modal"]:
    """Frequencies of its modal coordinates alone [Hz], ascending, without massless ones."""
    k, m = _modal_diagonals(component)
    return np.sort(np.sqrt(np.maximum(k[m > 0.0], 0.0) / m[m > 0.0])) / (2.0 * np.pi)


def _modal_diagonals(component: Component) -> tuple[np.ndarray, np.ndarray]:
    first = 6 * len(component.grids)
    return np.diagonal(component.stiffness)[first:], np.diagonal(component.mass)[first:]


def warnings_on_component(component: Component) -> Iterator[str]:
    """Warnings for unusual components: a modal mass unlike the others, a frequency beyond all others."""
    first = 6 * len(component.grids)
    k, m = _modal_diagonals(component)
    usual = float(np.median(m)) if len(m) else 1.0  # one in units of the file
    off = np.flatnonzero((np.abs(m - usual) > BODY * usual) & (k > m))  # else the angle of a free joint
    if 0 < len(off) <= FEW * component.modal:
        at = coordinate_name(component, first + int(off[0]))
        yield (
            f"component {component.name!r} has a modal mass of {m[off[0]]:.6g} at {at} and of {usual:.6g} "
            "at nearly all others: is its file damaged?"
        )
    square = np.divide(k, m, out=np.zeros(len(k)), where=m > NEGATIVE_MASS * m.max(initial=0.0))
    rank = np.argsort(square)
    if len(k) > 1 and square[rank[-1]] > ABSURD**2 * square[rank[-2]] > 0.0:
        hz = np.sqrt(square[rank[-2:]]) / (2.0 * np.pi)
        at = coordinate_name(component, first + int(rank[-1]))
        yield (
            f"component {component.name!r} has {at} at {hz[1]:.3g} Hz and the next at {hz[0]:.3g} Hz: is its "
            "file damaged?"
        )


def coordinate_name(component: Component, index: int) -> str:
    """The coordinate of a row of the matrices: grid and way, or the number of a modal coordinate."""
    if index < 6 * len(component.grids):
        return f"grid {component.grids[index // 6]} {WAYS[index % 6]}"
    return f"modal coordinate {index - 6 * len(component.grids) + 1}"


def _not_finite(component: Component, what: str, matrix: np.ndarray) -> Iterator[str]:
    for i, j in np.argwhere(~np.isfinite(matrix))[:1].tolist():
        yield f"its {what} is not finite at {coordinate_name(component, i)}, {coordinate_name(component, j)}"


def _sizes(component: Component) -> tuple[float, np.ndarray]:
    """A typical omega^2 and, of each coordinate, the root of k + omega^2 m: the scale of its entries."""
    k, m = np.diagonal(component.stiffness), np.diagonal(component.mass)
    both = (k > 0.0) & (m > 0.0)
    # A determinate boundary has rounding alone for stiffness: the modal coordinates show how fast it is.
    modal = both & (np.arange(len(k)) >= 6 * len(component.grids))
    both = modal if np.any(modal) else both
    shift = float(np.median(k[both] / m[both])) if np.any(both) else 1.0
    return shift, np.sqrt(np.abs(k) + shift * np.abs(m))


def _unsymmetric(component: Component, what: str, matrix: np.ndarray, size: np.ndarray) -> Iterator[str]:
    apart = np.abs(matrix - matrix.T) - UNEQUAL * np.outer(size, size)
    i, j = divmod(int(np.argmax(apart)), len(apart))
    if apart[i, j] > 0.0:
        yield (
            f"its {what} is not symmetric: {matrix[i, j]:g} at {coordinate_name(component, i)}, "
            f"{coordinate_name(component, j)} and {matrix[j, i]:g} across the diagonal"
        )
    missing = np.flatnonzero(~component.has.ravel()).tolist()
    used = [k for k in missing if np.any(matrix[k]) or np.any(matrix[:, k])]
    if used:
        yield f"its {what} has entries at {coordinate_name(component, used[0])}, which it is declared to lack"


def _no_body(component: Component) -> Iterator[str]:
    """Faults of a component whose mass matrix is not that of one body."""
    rigid = rigid_mass(component)
    m = float(np.trace(rigid[:3, :3])) / 3.0
    if not m > 0.0:
        yield f"its mass is {m:g} kg"
        return
    if np.abs(rigid[:3, :3] - m * np.eye(3)).max() > BODY * m:
        by = ", ".join(f"{x:.6g}" for x in np.diagonal(rigid[:3, :3]))
        yield f"its mass differs by direction: {by} kg along x, y and z; do its grids and their axes fit?"
        return
    _, (x, y, z), inertia = body_of(component)
    cross = m * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    scale = max(float(np.abs(rigid[3:, 3:]).max()), m * float(np.abs(component.positions).max()) ** 2)
    least, middle, most = np.linalg.eigvalsh(inertia)
    length = np.sqrt(scale / m) or 1.0
    if np.abs(rigid[:3, 3:] - cross).max() > BODY * m * length or least < -BODY * scale:
        yield "turned as one body it has no body's moments of mass; do the places of its grids fit?"
    elif least + middle < most - BODY * scale:
        yield (
            f"its inertia is none that a body has: {least:.4g} + {middle:.4g} < {most:.4g} kg m^2; "
            "do the places of its grids fit?"
        )


def _loose_frame(component: Component) -> Iterator[str]:
    weights, x = frame_weights(component), component.positions
    arms = x - weights[:, 0] @ x / weights[:, 0].sum()
    resists = weights[:, 0] * np.sum(arms**2, axis=1) @ np.ones(len(x)) * np.eye(3)
    resists = resists - (weights[:, :1] * arms).T @ arms + 2.0 * weights[:, 1].sum() * np.eye(3)
    least, _, most = np.linalg.eigvalsh(resists)
    if not least > UNFITTED * most:
        yield "its boundary does not say how it is turned: one grid with rotations, or three out of line"


def _indefinite(component: Component) -> Iterator[str]:
    """Neither a negative stiffness nor a negative mass, nor resistance to motions as one body."""
    import scipy.linalg as sla  # articles are read without it

    there = np.concatenate([component.has.ravel(), np.ones(component.modal, dtype=bool)])
    some = np.ix_(there, there)
    K, M = (0.5 * (A + A.T)[some] for A in (component.stiffness, component.mass))
    index = np.flatnonzero(there)
    shift, size = _sizes(component)
    size = size[there]
    if not np.all(size > 0.0):
        lost = coordinate_name(component, int(index[np.argmin(size)]))
        yield f"{lost} has neither stiffness nor mass"
        return
    # About a line of grids without rotary inertia nothing resists: too little to change anything else does.
    R = rigid_vectors(component.positions - component.positions.mean(axis=0), len(there))[there, 3:]
    inertia = R.T @ M @ R
    turn = R @ np.linalg.eigh(inertia)[1][:, 0]
    M = M + SLIGHT * max(float(np.trace(inertia)), 0.0) / len(component.grids) * np.outer(turn, turn)
    scaled = np.outer(size, size)
    try:
        share, shapes = sla.eigh(M / scaled, (K + shift * M) / scaled)
    except sla.LinAlgError:
        yield "its stiffness or mass is indefinite"
        return
    if share[0] < -NEGATIVE_MASS * share[-1]:
        worst = coordinate_name(component, int(index[np.argmax(np.abs(shapes[:, 0]))]))
        yield f"its mass is indefinite: a motion, most of it {worst}, has a negative mass"
        return
    with np.errstate(divide="ignore"):
        squared = np.where(share > NEGATIVE_MASS * share[-1], 1.0 / share - shift, np.inf)
    # The six lowest are rigid: of them printed digits may leave more than a small part of a soft elastic one.
    elastic = np.sort(squared)[6:]
    elastic = elastic[elastic > NEGATIVE * shift]  # below, of either sign, it may be rounding
    lowest = float(elastic.min(initial=np.inf)) if np.isfinite(elastic.min(initial=np.inf)) else shift
    # Where a soft motion moves stiff parts as one, the terms that cancel in it have a rounding of their own.
    moved = np.abs(shapes / size[:, None])
    terms = np.einsum("im,im->m", moved, np.abs(K) @ moved)
    beyond = (
        squared + NEGATIVE * lowest + np.divide(CANCELS * terms, share, out=0.0 * share, where=share > 0.0)
    )
    if beyond.min() < 0.0:
        least = int(np.argmin(beyond))
        worst = coordinate_name(component, int(index[np.argmax(np.abs(shapes[:, least]))]))
        yield (
            f"its stiffness is indefinite: a motion, most of it {worst}, has a negative stiffness, an "
            f"omega^2 of {squared[least] / lowest:.2g} times the lowest elastic one ({-NEGATIVE:g} is "
            "allowed: near that the matrices need more digits)"
        )
        return
    yield from _resists(component, K, M, there, lowest)


def _resists(
    component: Component, K: np.ndarray, M: np.ndarray, there: np.ndarray, lowest: float
) -> Iterator[str]:
    """Faults by stiffness against a motion as one body, row by row, or else as energy."""
    R = rigid_vectors(component.positions - component.positions.mean(axis=0), len(there))[there]
    left, terms = K @ R, np.abs(K) @ np.abs(R)
    if np.all(np.abs(left) <= RESISTS * terms):
        return
    held = K + lowest * M
    size = np.sqrt(np.abs(np.diagonal(held)))
    own = left / size[:, None]
    held = held / np.outer(size, size)
    cost = np.diagonal(own.T @ np.linalg.solve(held, own))
    moved = lowest * np.diagonal(R.T @ M @ R)
    # About a line of grids without rotary inertia nothing moves: there any stiffness resists.
    # Rounding of stiff terms may push any motion, the softest most.
    softest = max(float(np.linalg.eigvalsh(held)[0]), CANCELS)
    rounding = max(ROUNDING, CANCELS / softest**0.5) ** 2 * np.sum((terms / size[:, None]) ** 2, axis=0)
    worst = np.divide(cost, moved, out=np.full(6, np.inf), where=moved > 0.0)
    worst[cost <= rounding] = 0.0
    if worst.max() > RESISTS_WHOLE:
        way = int(np.argmax(worst))
        row = int(np.flatnonzero(there)[np.argmax(np.abs(left[:, way]) / size)])
        yield (
            f"its stiffness resists a motion as one body ({WAYS[way]}), most at "
            f"{coordinate_name(component, row)}: is it grounded, or do the places of its grids not fit?"
        )


def require_component(component: Component) -> Component:
    """The component; raises `ConfigError` with all that is wrong with it."""
    faults = [*component_faults(component)]
    if faults:
        raise ConfigError(
            "; ".join(faults),
            where=f"component {component.name!r}",
            hint="correct its matrices and places, or export it again",
        )
    return component
