"""Drawing of an article: lines with several points a member, marks, and the motion of points in shapes.

One value for pictures, pages and files: whatever shows a shape shows these arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.assembly.beam_ends import element_poses
from middeck.structure.assembly.mesh import Model
from middeck.structure.eigenproblem.repeated import repeated
from middeck.structure.elements.beam_centre_line import beam_curve
from middeck.structure.elements.frames import PosePoints, points_in_world, pose_jacobian
from middeck.structure.elements.rotations import skew
from middeck.structure.model.article import Body, JointState
from middeck.structure.model.environment import Environment
from middeck.structure.model.links import Interpolation, Link
from middeck.structure.model.member_mesh import member_geometry
from middeck.structure.modes.motions.strain_shares import part_energy
from middeck.structure.modes.results.component_outputs import inner_points
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.values import record

# Segments of a member: for the S that a cubic can make, and smooth where there are few.
SEGMENTS, FINE = 6, 16
SPOKE = 5  # points of a line of a component, so that its colour changes along it
# Sizes over the article's: a section drawn around a member, a cut-off cable, a box without inertia.
SECTION, CABLE, BOX = 0.015, 0.22, 0.4
SLIM = 0.14  # largest size of a section over its member's length, so that short members are seen too
# Sections show torsion; more members than this, or cells of one, would hide it.
MOST_SECTIONED, CELLS = 60, 8
# The twelve edges of a box in one stroke, by the binary digits of its corners.
STROKE = (0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4)
CORNERS = np.array([[(c >> axis & 1) - 0.5 for axis in range(3)] for c in range(8)])
DECIMALS = 6  # decimals of distances over the size: rounding does not decide which of equal ones is drawn
STEP = 1e-30  # complex step
# Extent, over the largest coordinate, of what is a point to rounding; it is drawn this large [m].
POINT, POINT_M = 1e-9, 1.0


class Strand(NamedTuple):
    """Consecutive points ``first`` to ``last``, the latter not among them, that are joined.

    ``what`` is "member", "section" (around a member), "rigid" (an offset, an arm or a link of all six
    motions), "link" (any other, and from a frame that follows to those that it follows), "body", "spring",
    "bushing", "component" (between its grids and points of its outputs, or from its centre of mass) or
    "cable"; ``name`` that of the part.
    """

    what: str
    name: str
    first: int
    last: int


class Mark(NamedTuple):
    """A point with a meaning: "mass", "clamp", "support" (a clamp of some directions), "ground" (a bushing to
    it), "force", "moment" or "node" (of a survey).

    ``direction`` is a unit vector in W, zero where there is none.
    """

    what: str
    name: str
    point: int
    direction: tuple[float, float, float]


@record(kw_only=True)
class Drawing:
    """An article as drawn and at rest, with the motion of its points in each of some shapes.

    Attributes:
        title, environment: Titles of the article and of its environment.
        gravity: Gravity in W [m/s^2].
        up: Unit vector in W that is upwards; None if neither environment nor article states one.
        drawn, rest: Points [m] in W, undeformed and at rest; members curved as their elements are.
        lines, marks: Lines and marks between the points.
        motion: Motion of every point in each shape, about rest, in the scale of `Modes.shapes`.
        strain: Share of every line's member or component in the elastic energy of each shape; zero for the
            other lines.
        number: Number of each shape in its modes.
        frequency_hz, kind, name: Those of each shape.
        alike: Number of modes at the frequency of each shape: several have no unique basis. 1 at zero.
    """

    title: str
    environment: str
    gravity: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"] | None
    drawn: Float[np.ndarray, "point 3"]
    rest: Float[np.ndarray, "point 3"]
    lines: tuple[Strand, ...]
    marks: tuple[Mark, ...]
    motion: Float[np.ndarray, "shape point 3"]
    strain: Float[np.ndarray, "shape line"]
    number: tuple[int, ...]
    frequency_hz: Float[np.ndarray, " shape"]
    kind: tuple[str, ...]
    name: tuple[str, ...]
    alike: tuple[int, ...]

    @property
    def size(self) -> float:
        """Diagonal [m] of the box around what is drawn, cables left out; 1 m around a single point."""
        shown = [np.arange(line.first, line.last) for line in self.lines if line.what != "cable"]
        at = self.drawn[np.concatenate([*shown, [mark.point for mark in self.marks]]).astype(int)]
        across = _diagonal(at)
        return across if across > POINT * np.abs(at).max(initial=0.0) else POINT_M


def build_rest_drawing(equilibrium: Equilibrium) -> Drawing:
    """Points and lines of the article as drawn and at rest, without shapes."""
    return _draw(equilibrium, np.zeros((equilibrium.model.tree.size, 0)), None, ())


def build_mode_drawing(modes: Modes, chosen: Sequence[int] | None = None) -> Drawing:
    """Points and lines of the article with the ``chosen`` of its modes, by number; all by default."""
    numbers = tuple(range(len(modes.omega)) if chosen is None else chosen)
    return _draw(modes.equilibrium, modes.shapes[:, numbers], modes, numbers)


class _Piece(NamedTuple):
    """Some points with their lines, which count from the first of them."""

    lines: Sequence[Strand]
    drawn: np.ndarray
    rest: np.ndarray
    motion: np.ndarray


class _Stroke(NamedTuple):
    """A line through points of frames."""

    what: str
    name: str
    frames: Sequence[int]
    offsets: np.ndarray


def _draw(
    equilibrium: Equilibrium, shapes: np.ndarray, modes: Modes | None, numbers: tuple[int, ...]
) -> Drawing:
    model = equilibrium.model
    size = _diagonal(points_in_world(model.points, model.drawn))
    seats = list(_seats(equilibrium))
    marked = PosePoints(np.array([s[1] for s in seats], dtype=int), _rows([s[2] for s in seats]))
    strokes = [*_rigid(model), *_links(model), *_bodies(model, size), *_ties(model), *_sections(model, size)]
    pieces = (
        _Piece((), *_moved(equilibrium, marked, shapes)),
        _members(equilibrium, shapes),
        _stroked(equilibrium, strokes, shapes),
        _components(equilibrium, shapes),
        _cables(equilibrium, shapes, CABLE * size),
    )
    begin = np.cumsum([0, *(len(piece.rest) for piece in pieces)])
    lines = tuple(
        line._replace(first=line.first + int(b), last=line.last + int(b))
        for b, piece in zip(begin[:-1], pieces, strict=True)
        for line in piece.lines
    )
    chosen = list(numbers)
    return Drawing(
        title=model.structure.title,
        environment=equilibrium.environment.title,
        gravity=equilibrium.loads.gravity,
        up=equilibrium.upwards,
        drawn=np.concatenate([piece.drawn for piece in pieces]),
        rest=np.concatenate([piece.rest for piece in pieces]),
        lines=lines,
        marks=tuple(mark._replace(point=i) for i, (mark, _, _) in enumerate(seats)),
        motion=np.concatenate([piece.motion for piece in pieces], axis=1),
        strain=_strain(equilibrium, shapes, lines),
        number=numbers,
        frequency_hz=np.zeros(0) if modes is None else modes.frequency_hz[chosen],
        kind=() if modes is None else tuple(modes.kind[i] for i in chosen),
        name=() if modes is None else tuple(modes.name[i] for i in chosen),
        alike=() if modes is None else tuple(_many(modes)[i] for i in chosen),
    )


def _many(modes: Modes) -> list[int]:
    many = [1] * len(modes.omega)
    for cluster in repeated(modes.omega**2):
        for i in cluster:
            many[i] = len(cluster) if modes.omega[i] > 0.0 else 1
    return many


def _moved(
    equilibrium: Equilibrium, points: PosePoints, shapes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of frames as drawn and at rest, and how shapes move them."""
    model = equilibrium.model
    moved = pose_jacobian(model.tree, points, equilibrium.poses) @ shapes
    motion = moved.reshape(len(points.frame), 6, shapes.shape[1])[:, :3].transpose(2, 0, 1)
    return points_in_world(points, model.drawn), points_in_world(points, equilibrium.poses), motion


def _stroked(equilibrium: Equilibrium, strokes: Sequence[_Stroke], shapes: np.ndarray) -> _Piece:
    ends = np.cumsum([len(s.frames) for s in strokes], dtype=int).tolist()
    lines = [Strand(s.what, s.name, end - len(s.frames), end) for s, end in zip(strokes, ends, strict=True)]
    frames = np.array([f for s in strokes for f in s.frames], dtype=int)
    points = PosePoints(frames, _rows([o for s in strokes for o in s.offsets]))
    return _Piece(lines, *_moved(equilibrium, points, shapes))


def _members(equilibrium: Equilibrium, shapes: np.ndarray) -> _Piece:
    """Every member as one curve; its motion is the derivative of that curve, by complex step."""
    model = equilibrium.model
    members = model.structure.members
    if not members:
        return _Piece((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((shapes.shape[1], 0, 3)))
    segments = FINE if len(members) <= MOST_SECTIONED else SEGMENTS
    each = np.array([-(-segments // m.elements) for m in members])[model.element_member, None]
    station = np.arange(each.max() + 1)
    at = np.minimum(station / each, 1.0)
    # The last station of an element is the first of the next, but for the last element of a member.
    ends = np.append(np.diff(model.element_member) != 0, True)[:, None]
    keep = station < each + ends
    x, T = element_poses(model, equilibrium.config)
    changes = equilibrium.moves(shapes)
    motion = np.empty((shapes.shape[1], int(keep.sum()), 3))
    for m in range(shapes.shape[1]):
        step = 1j * STEP * changes[model.element_ends][..., m]
        moved = beam_curve(model.beams, x + step[..., :3], T + skew(step[..., 3:]) @ T, at)
        motion[m] = np.imag(moved)[keep] / STEP
    counts = np.bincount(np.repeat(model.element_member, keep.sum(axis=1)), minlength=len(members))
    last = np.cumsum(counts).tolist()
    lines = [Strand("member", m.name, e - int(n), e) for m, e, n in zip(members, last, counts, strict=True)]
    drawn = beam_curve(model.beams, *element_poses(model, model.rest), at)[keep]
    return _Piece(lines, drawn, beam_curve(model.beams, x, T, at)[keep], motion)


def _sections(model: Model, size: float) -> Iterator[_Stroke]:
    """A diamond in the own axes of a member at ends of its elements, so that torsion is seen."""
    members = model.structure.members
    if not 0 < len(members) <= MOST_SECTIONED:
        return
    length = member_geometry(model.structure).length
    shown = np.concatenate([np.arange(m.elements) % -(-m.elements // CELLS) == 0 for m in members])
    for e, ends in enumerate(model.element_ends):
        radius = min(SECTION * size, SLIM * length[model.element_member[e]])
        y, z = radius * model.element_triad[e, :, 1], radius * model.element_triad[e, :, 2]
        last = e + 1 == len(model.element_ends) or model.element_member[e + 1] != model.element_member[e]
        name = members[model.element_member[e]].name
        for pose in (*ends[: int(shown[e])], *ends[1 : 1 + last]):
            at = model.points.offset[pose]
            ring = np.array([at + y, at + z, at - y, at - z, at + y])
            yield _Stroke("section", name, [int(model.points.frame[pose])] * 5, ring)


def _rigid(model: Model) -> Iterator[_Stroke]:
    """Offsets of member ends from their nodes; arms from a carrier to the joint and what it carries."""
    for pose in model.element_ends.ravel():
        frame, offset = int(model.points.frame[pose]), model.points.offset[pose]
        if np.any(offset):
            yield _Stroke("rigid", model.frames[frame], [frame, frame], np.array([np.zeros(3), offset]))
    for joint in (j for j in model.structure.joints if j.state is not JointState.INTERNAL):
        frame, carrier = model.frames.index(joint.name), model.frames.index(joint.parent)
        arm = np.array([np.zeros(3), np.zeros(3), joint.body.cg])
        yield _Stroke("rigid", joint.name, [carrier, frame, frame], arm)


def _links(model: Model) -> Iterator[_Stroke]:
    """Arms of attach points, links to the point of their second frame, and averages as spiders."""
    structure, none = model.structure, np.zeros(3)
    for point in structure.attach_points:
        if np.any(point.offset):
            frame = model.frames.index(point.frame)
            yield _Stroke("rigid", point.name, [frame, frame], np.array([none, point.offset]))
    for link in structure.links:
        first, *others = (model.frames.index(frame) for frame in link.frames)
        if isinstance(link, Link):
            what = "rigid" if (len(link.along), len(link.about)) == (3, 3) else "link"
            yield _Stroke(what, link.name, [first, *others * 2], np.array([none, link.offset, none]))
        elif isinstance(link, Interpolation):
            for other in others:
                yield _Stroke("link", link.name, [first, other], np.zeros((2, 3)))


def _bodies(model: Model, size: float) -> Iterator[_Stroke]:
    """Nodes as boxes of their size; other bodies as the uniform box with their inertia, if there is one."""
    for part in (*model.structure.nodes, *model.structure.joints):
        body = part.body
        edges, axes = np.full(3, getattr(part, "size", 0.0)), np.eye(3)
        if not np.any(edges) and body.mass > 0.0:
            edges, axes = _box(body)
            edges = np.minimum(edges, BOX * size or np.inf)
        if np.any(edges):
            centre = np.zeros(3) if np.any(getattr(part, "size", 0.0)) else body.cg
            corners = (centre + CORNERS * edges @ axes.T)[list(STROKE)]
            yield _Stroke("body", part.name, [model.frames.index(part.name)] * len(STROKE), corners)


def _box(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the uniform box with this mass and inertia, and its axes as columns."""
    plain = not np.any(body.inertia - np.diag(np.diag(body.inertia)))
    moments, axes = (np.diag(body.inertia), np.eye(3)) if plain else np.linalg.eigh(body.inertia)
    return np.sqrt(np.maximum(6.0 / body.mass * (moments.sum() - 2.0 * moments), 0.0)), axes


def _ties(model: Model) -> Iterator[_Stroke]:
    structure = model.structure
    for what, ties, ends in (
        ("spring", structure.springs, model.spring_ends),
        ("bushing", structure.bushings, model.bushing_ends),
    ):
        for tie, pair in zip(ties, ends, strict=True):
            yield _Stroke(what, tie.name, model.points.frame[pair].tolist(), model.points.offset[pair])


def _components(equilibrium: Equilibrium, shapes: np.ndarray) -> _Piece:
    """The grids of each component and the points that its outputs move, joined by the shortest lines.

    Where no two points are known inside, lines go from the centre of mass, which moves by the momentum of all
    coordinates, the modal ones too.
    """
    model = equilibrium.model
    lines: list[Strand] = []
    places = [np.zeros((2, 0, 3))]
    moved = [np.zeros((shapes.shape[1], 0, 3))]
    for part, element, state, rows in equilibrium.components:
        *at, at_grids = _moved(equilibrium, model.points.of(element.point), shapes)
        points, weight = inner_points(part), element.weights[:, 0] / element.weights[:, 0].sum()
        about = [element.moment, *(part.axes @ (p.place - weight @ part.positions) for p in points)]
        shift = np.array([element.drag, *(part.axes @ p.shift @ element.basis for p in points)])
        scale = np.array([part.weight, *(1.0 for _ in points)])[:, None]
        strain = np.stack([np.zeros((len(shift), 3)), shift @ state.deformation])
        axes = (np.eye(3), state.axes)
        inner = [weight @ x + (about + e) / scale @ Q.T for x, e, Q in zip(at, strain, axes, strict=True)]
        turned = state.axes @ (shift @ state.seen(rows @ shapes)) / scale[:, :, None]
        x = np.concatenate([np.array(inner), np.array(at)], axis=1)
        motion = np.concatenate([turned.transpose(2, 0, 1), at_grids], axis=1)
        ends = _shortest_lines(x[0, 1:]) + 1 if len(points) > 1 else _from_first(x.shape[1])
        first = sum(p.shape[1] for p in places)
        lines += [
            Strand("component", part.name, first + SPOKE * i, first + SPOKE * (i + 1))
            for i in range(len(ends))
        ]
        places.append(_spokes(x, ends))
        moved.append(_spokes(motion, ends))
    drawn, rest = np.concatenate(places, axis=1)
    return _Piece(lines, drawn, rest, np.concatenate(moved, axis=1))


def _from_first(count: int) -> Int[np.ndarray, "line 2"]:
    return np.array([(0, i) for i in range(1, count)], dtype=int).reshape(-1, 2)


def _shortest_lines(x: Float[np.ndarray, "point 3"]) -> Int[np.ndarray, "line 2"]:
    """Pairs of points whose lines join all of them and are shortest in sum (Prim 1957)."""
    size = _diagonal(x) or 1.0
    far, nearest = np.full(len(x), np.inf), np.zeros(len(x), dtype=int)
    left, last, ends = np.ones(len(x), dtype=bool), 0, list[tuple[int, int]]()
    left[0] = False
    while left.any():
        apart = np.round(np.linalg.norm(x - x[last], axis=1) / size, DECIMALS)
        nearest, far = np.where(apart < far, last, nearest), np.minimum(apart, far)
        last = int(np.argmin(np.where(left, far, np.inf)))
        left[last] = False
        ends.append((int(nearest[last]), last))
    return np.array(ends, dtype=int)


def _spokes(
    x: Float[np.ndarray, "state point 3"], ends: Int[np.ndarray, "line 2"]
) -> Float[np.ndarray, "state spoke 3"]:
    """Points of straight lines between pairs of points, one line after the other."""
    part = np.linspace(0.0, 1.0, SPOKE)[:, None]
    along = (1.0 - part) * x[:, ends[:, 0], None] + part * x[:, ends[:, 1], None]
    return along.reshape(len(x), SPOKE * len(ends), 3)


def _cables(equilibrium: Equilibrium, shapes: np.ndarray, longest: float) -> _Piece:
    """The lower part of each device, straight to its anchor, which does not move."""
    model, loads = equilibrium.model, equilibrium.loads
    places: list[np.ndarray] = []
    drawn, rest, moved = _moved(equilibrium, model.points.of(loads.attach_point), shapes)
    part = np.zeros((len(rest), 1))
    for x in (drawn, rest):
        span = loads.anchor - x
        length = np.maximum(np.linalg.norm(span, axis=1), np.finfo(float).tiny)[:, None]
        part = np.minimum(longest / length, 1.0)
        places.append(np.stack([x, x + part * span], axis=1).reshape(-1, 3))
    motion = np.stack([moved, (1.0 - part) * moved], axis=2).reshape(len(moved), 2 * len(rest), 3)
    lines = [Strand("cable", name, 2 * i, 2 * i + 2) for i, name in enumerate(equilibrium.devices)]
    return _Piece(lines, places[0], places[1], motion)


def _seats(equilibrium: Equilibrium) -> Iterator[tuple[Mark, int, np.ndarray]]:
    """Marks with their frame and offset."""
    model, loads, none = equilibrium.model, equilibrium.loads, (0.0, 0.0, 0.0)
    structure = model.structure
    for part in structure.nodes:
        if part.body.mass > 0.0 and not part.size and not np.any(_box(part.body)[0]):
            yield Mark("mass", part.name, 0, none), model.frames.index(part.name), part.body.cg
    for mass in structure.masses:
        yield Mark("mass", mass.name, 0, none), model.frames.index(mass.frame), mass.body.cg
    for node in dict.fromkeys(clamp.node for clamp in equilibrium.environment.clamps):
        what = "clamp" if _all_held(equilibrium.environment, node) else "support"
        yield Mark(what, node, 0, none), model.frames.index(node), np.zeros(3)
    for bushing, pose in zip(equilibrium.environment.bushings, loads.ground.point, strict=True):
        yield Mark("ground", bushing.name, 0, none), int(model.points.frame[pose]), model.points.offset[pose]
    for load, pose in zip(structure.loads, model.load_point, strict=True):
        for what, vector in (("force", load.force), ("moment", load.moment)):
            if np.any(vector):
                x, y, z = (vector / np.linalg.norm(vector)).tolist()
                yield Mark(what, load.name, 0, (x, y, z)), int(model.points.frame[pose]), load.offset


def _all_held(environment: Environment, node: str) -> bool:
    """Whether the clamps of ``node`` together hold all six of its degrees of freedom."""
    own = [clamp for clamp in environment.clamps if clamp.node == node]
    for held in ([(c, c.along) for c in own], [(c, c.about) for c in own]):
        directions = np.hstack(
            [c.axes[:, ["xyz".index(letter) for letter in letters]] for c, letters in held]
        )
        if np.linalg.matrix_rank(directions, tol=1e-6) < 3:
            return False
    return True


def _strain(equilibrium: Equilibrium, shapes: np.ndarray, lines: Sequence[Strand]) -> np.ndarray:
    energy, structure = part_energy(equilibrium, shapes), equilibrium.model.structure
    whole = energy.sum(axis=1)
    share = np.column_stack([energy / np.where(whole > 0.0, whole, 1.0)[:, None], np.zeros(len(energy))])
    place = {("member", m.name): i for i, m in enumerate(structure.members)}
    behind = energy.shape[1] - len(structure.components)
    place |= {("component", c.name): behind + i for i, c in enumerate(structure.components)}
    return share[:, np.array([place.get((line.what, line.name), -1) for line in lines], dtype=int)]


def _rows(vectors: Sequence[np.ndarray]) -> np.ndarray:
    return np.array(vectors, dtype=float).reshape(-1, 3)


def _diagonal(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
