"""An article of the data sheet: assembly, pinned and hung rest state, modes in orbit and in the lab."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as sla
from scipy.spatial.transform import Rotation

from . import energies
from .energies import Ends, Gimbal, Section

ELEMENTS = 8  # a strut, as in the product's article files
KEPT = 26  # modes reported
RIGID_HZ = 0.05  # in orbit: rounding leaves 1e-5 Hz on rigid modes, the first flexible one is at 1.7 Hz
LONGEST_STEP = 0.1  # of a coordinate in one Newton step [m or rad]

Sheet = dict[str, Any]


class Poses(NamedTuple):
    """Positions and rotation matrices of all nodes, those of the mesh included."""

    x: np.ndarray
    R: np.ndarray


@dataclass(frozen=True)
class Hanger:
    """An attach point with its cable's anchor."""

    node: int
    offset: np.ndarray
    anchor: np.ndarray


@dataclass(frozen=True)
class GimbalAt:
    """A gimbal, its node, its coordinates and its angles [rad]."""

    name: str
    node: int
    coordinates: np.ndarray
    angle: np.ndarray
    parts: Gimbal


@dataclass(frozen=True)
class Article:
    """Six coordinates for each node of the mesh, then two angles for each gimbal."""

    table: Sheet
    gravity: float
    section: Section
    ends: np.ndarray  # (element, 2) node indices
    offsets: tuple[np.ndarray, np.ndarray]  # from the nodes to the elements' ends
    undeformed: Poses
    gimbals: tuple[GimbalAt, ...]
    hangers: tuple[Hanger, ...]
    wheel_node: int

    @property
    def node_coordinates(self) -> int:
        return 6 * len(self.undeformed.x)

    @property
    def size(self) -> int:
        return self.node_coordinates + 2 * len(self.gimbals)


def read_article(sheet: Sheet, name: str) -> Article:
    """Mesh of article ``name``; all struts of the sheet lie along x and are equally long."""
    table = sheet["article"][name]
    nodes, names = table["node"], [n["name"] for n in table["node"]]
    points = [np.array([n["x"], 0.0, 0.0]) for n in nodes]
    ends: list[tuple[int, int]] = []
    offsets: list[tuple[np.ndarray, np.ndarray]] = []
    lengths: list[float] = []
    for strut in table["strut"]:
        i, j = names.index(strut["from"]), names.index(strut["to"])
        start, end = nodes[i]["x"] + nodes[i]["size"] / 2, nodes[j]["x"] - nodes[j]["size"] / 2
        h = (end - start) / ELEMENTS
        here, offset = i, np.array([nodes[i]["size"] / 2, 0.0, 0.0])
        for k in range(ELEMENTS):
            if k < ELEMENTS - 1:
                points.append(np.array([start + (k + 1) * h, 0.0, 0.0]))
                there, other = len(points) - 1, np.zeros(3)
            else:
                there, other = j, np.array([-nodes[j]["size"] / 2, 0.0, 0.0])
            ends.append((here, there))
            offsets.append((offset, other))
            lengths.append(h)
            here, offset = there, np.zeros(3)
    assert np.ptp(lengths) < 1e-12
    x = np.array(points)
    coordinates = 6 * len(x)
    suspension = table["suspension"]
    rise = np.array([0.0, suspension["cable_length"], 0.0])
    held = [
        (names.index(n), np.array(o, float))
        for n, o in zip(suspension["nodes"], suspension["offsets"], strict=True)
    ]
    return Article(
        table,
        sheet["constants"]["gravity"],
        _section(sheet, float(lengths[0])),
        np.array(ends),
        (np.array([o[0] for o in offsets]), np.array([o[1] for o in offsets])),
        Poses(x, np.tile(np.eye(3), (len(x), 1, 1))),
        tuple(_gimbal(g, names, coordinates + 2 * q) for q, g in enumerate(table["gimbal"])),
        tuple(Hanger(n, o, x[n] + o + rise) for n, o in held),
        names.index(table["wheel_node"]),
    )


def _section(sheet: Sheet, length: float) -> Section:
    tube = sheet["section"]["strut"]
    material = sheet["material"][tube["material"]]
    D, d = tube["outer_diameter"], tube["inner_diameter"]
    area, second = np.pi / 4 * (D**2 - d**2), np.pi * (D**4 - d**4) / 64
    E, rho = material["E"], material["rho"]
    G = E / (2 * (1 + material["nu"]))
    return Section(
        EA=length,
        GJ=float(E * area),
        EI_y=float(E * second),
        EI_z=float(2 * G * second),
        rho_A=float(rho * area),
        rho_I_y=rho * second,
    )


def _gimbal(table: Sheet, names: list[str], first: int) -> GimbalAt:
    node = names.index(table["node"])
    parts = Gimbal(
        np.array(table["offset"]),
        table["stage_mass"],
        np.array(table["stage_cg"]),
        np.array(table["stage_inertia"]),
        table["payload_mass"],
        np.array(table["payload_cg"]),
        np.array(table["payload_inertia"]),
    )
    angle = np.deg2rad([table["angle_x_deg"], table["angle_z_deg"]])
    coordinates = np.r_[6 * node : 6 * node + 6, first, first + 1]
    return GimbalAt(table["name"], node, coordinates, angle, parts)


def _at(node: int) -> np.ndarray:
    return np.arange(6 * node, 6 * node + 6)


def _elements(article: Article, poses: Poses) -> tuple[Ends, np.ndarray]:
    a, b = article.ends.T
    ends = Ends(poses.x[a], poses.R[a], poses.x[b], poses.R[b], *article.offsets)
    return ends, np.hstack([6 * article.ends[:, :1] + np.arange(6), 6 * article.ends[:, 1:] + np.arange(6)])


def potential(
    article: Article, poses: Poses, gravity: float, cables: list[tuple[float, float]] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Hessian of the potential; ``cables`` gives preload [N] and stiffness [N/m] of each."""
    gradient, hessian = np.zeros(article.size), np.zeros((article.size, article.size))

    def add(index: np.ndarray, state: tuple[Any, Any, Any]) -> None:
        gradient[index] += np.asarray(state[1])
        hessian[np.ix_(index, index)] += np.asarray(state[2])

    ends, indices = _elements(article, poses)
    strained = map(np.asarray, energies.beams(ends, article.section, gravity))
    for index, *state in zip(indices, *strained, strict=True):
        add(index, tuple(state))
    if gravity:
        for i, node in enumerate(article.table["node"]):
            add(_at(i), energies.body(poses.x[i], poses.R[i], node["mass"], np.array(node["cg"]), gravity))
        for g in article.gimbals:
            state = energies.gimbal_state(poses.x[g.node], poses.R[g.node], g.angle, g.parts, gravity)
            add(g.coordinates, state)
    if cables is not None:
        length = article.table["suspension"]["cable_length"]
        for h, (preload, stiffness) in zip(article.hangers, cables, strict=True):
            pose = poses.x[h.node], poses.R[h.node]
            add(_at(h.node), energies.cable(*pose, h.offset, h.anchor, preload, stiffness, length))
    return gradient, hessian


def mass_matrix(article: Article, poses: Poses) -> np.ndarray:
    """Consistent mass of beams, nodes and gimbals."""
    M = np.zeros((article.size, article.size))
    ends, indices = _elements(article, poses)
    for index, block in zip(indices, np.asarray(energies.beam_masses(ends, article.section)), strict=True):
        M[np.ix_(index, index)] += block
    for i, node in enumerate(article.table["node"]):
        R, mass = poses.R[i], node["mass"]
        C = np.array(energies.skew(R @ np.array(node["cg"])))
        inertia = R @ np.diag(node["inertia"]) @ R.T
        block = np.block([[mass * np.eye(3), -mass * C], [mass * C, inertia - mass * C @ C]])
        M[np.ix_(_at(i), _at(i))] += block
    for g in article.gimbals:
        block = np.asarray(energies.gimbal_inertia(poses.x[g.node], poses.R[g.node], g.angle, g.parts))
        M[np.ix_(g.coordinates, g.coordinates)] += block
    return M


def _move(article: Article, poses: Poses, step: np.ndarray) -> Poses:
    q = step[: article.node_coordinates].reshape(-1, 6)
    return Poses(poses.x + q[:, :3], Rotation.from_rotvec(q[:, 3:]).as_matrix() @ poses.R)


def _settled(iteration: int, largest: float) -> bool:
    # The second limit is where rounding of a stiff article lets Newton end.
    return largest < 1e-13 or (iteration > 8 and largest < 1e-11)


def settle_pinned(article: Article) -> tuple[Poses, np.ndarray]:
    """Rest state held at the attach points (y and z of each, x at the wheel node); their vertical forces [N].

    Newton on the Lagrangian: the multipliers are the support forces, and the points' own second derivatives
    belong to its Hessian.
    """
    poses, n = article.undeformed, article.node_coordinates
    force = None
    for iteration in range(60):
        gradient, hessian = potential(article, poses, article.gravity)
        gradient, hessian = gradient[:n], hessian[:n, :n].copy()
        rows, slip, held = [], [], []
        for h in article.hangers:
            point, jacobian, curvature = map(
                np.asarray, energies.attach(poses.x[h.node], poses.R[h.node], h.offset)
            )
            start = article.undeformed.x[h.node] + h.offset
            for axis in (0, 1, 2) if h.node == article.wheel_node else (1, 2):
                row = np.zeros(n)
                row[_at(h.node)] = jacobian[axis]
                rows.append(row)
                slip.append(point[axis] - start[axis])
                held.append((h.node, axis, curvature[axis]))
        J = np.array(rows)
        if force is None:
            force = np.linalg.lstsq(J.T, gradient, rcond=None)[0]
        for value, (node, _, curvature) in zip(force, held, strict=True):
            hessian[np.ix_(_at(node), _at(node))] -= value * curvature
        saddle = np.block([[hessian, -J.T], [-J, np.zeros((len(J), len(J)))]])
        step = np.linalg.solve(saddle, np.r_[-gradient, slip])
        largest = np.abs(step[:n]).max()
        scale = min(1.0, LONGEST_STEP / largest)
        poses, force = _move(article, poses, step[:n] * scale), force + scale * (step[n:] - force)
        if _settled(iteration, largest):
            break
    return poses, np.array([value for value, (_, axis, _) in zip(force, held, strict=True) if axis == 1])


@dataclass(frozen=True)
class Hung:
    """The rest state on cables, its tangent, and what carries it."""

    poses: Poses
    hessian: np.ndarray
    reaction: np.ndarray
    holding_torque: np.ndarray


def settle_hung(article: Article) -> Hung:
    """The paper's steps 1 and 2: reactions, device stiffness from the bounce frequency, then equilibrium."""
    poses, reaction = settle_pinned(article)
    omega = 2 * np.pi * article.table["suspension"]["bounce_hz"]
    cables = [(r, r / article.gravity * omega**2) for r in reaction]
    n = article.node_coordinates
    for iteration in range(60):
        gradient, hessian = potential(article, poses, article.gravity, cables)
        step = np.linalg.solve(hessian[:n, :n], -gradient[:n])
        largest = np.abs(step).max()
        poses = _move(article, poses, step * min(1.0, LONGEST_STEP / largest))
        if _settled(iteration, largest):
            break
    gradient, hessian = potential(article, poses, article.gravity, cables)
    return Hung(poses, hessian, reaction, gradient[n:])


def sensor_rows(article: Article, poses: Poses) -> dict[str, np.ndarray]:
    """Angle per unit coordinate of every named angle; the same row is the torque's column."""
    rows: dict[str, np.ndarray] = {}

    def row(name: str, node: int | None, axis: Any, joint: int | None) -> None:
        rows[name] = np.zeros(article.size)
        if node is not None:
            rows[name][6 * node + 3 : 6 * node + 6] = axis
        if joint is not None:
            rows[name][joint] = 1.0

    for j, letter in enumerate("xyz"):
        row(f"bus_{letter}", article.wheel_node, poses.R[article.wheel_node][:, j], None)
    for g in article.gimbals:
        R_stage = poses.R[g.node] @ np.asarray(energies.about_x(g.angle[0]))
        for letter, axis, joint in (("x", 0, g.coordinates[6]), ("z", 2, g.coordinates[7])):
            row(f"{g.name}_rel_{letter}", None, None, joint)
            row(f"{g.name}_in_{letter}", g.node, R_stage[:, axis], joint)
    return rows


@dataclass(frozen=True)
class Side:
    """Modes on one side: mass matrix, frequencies [Hz] (rigid ones zero), shapes, sensor rows."""

    M: np.ndarray
    hz: np.ndarray
    shapes: np.ndarray
    rows: dict[str, np.ndarray]


@dataclass(frozen=True)
class Solved:
    """An article in orbit and in the laboratory."""

    article: Article
    rigid: int
    orbit: Side
    lab: Side
    hung: Hung


def solve(sheet: Sheet, name: str) -> Solved:
    """Modes about the free, undeformed state and about the hung one (the paper's step 3)."""
    article = read_article(sheet, name)
    _, K = potential(article, article.undeformed, 0.0)
    hung = settle_hung(article)
    M_orbit, M_lab = mass_matrix(article, article.undeformed), mass_matrix(article, hung.poses)
    orbit_hz, orbit_shapes = _lowest(K, M_orbit)
    lab_hz, lab_shapes = _lowest(hung.hessian, M_lab)
    rigid = np.abs(orbit_hz) < RIGID_HZ
    return Solved(
        article,
        int(rigid.sum()),
        Side(
            M_orbit,
            np.where(rigid, 0.0, orbit_hz)[:KEPT],
            orbit_shapes[:, :KEPT],
            sensor_rows(article, article.undeformed),
        ),
        Side(M_lab, lab_hz[:KEPT], lab_shapes[:, :KEPT], sensor_rows(article, hung.poses)),
        hung,
    )


def _lowest(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    lam, shapes = sla.eigh(K, M, subset_by_index=(0, KEPT + 3))
    return np.sign(lam) * np.sqrt(np.abs(lam)) / (2 * np.pi), shapes


def rigid_basis(solved: Solved) -> tuple[np.ndarray, np.ndarray]:
    """Mass-orthonormal translations, and rotations and gimbal angles mass-orthogonal to them."""
    article, M = solved.article, solved.orbit.M
    motions = np.zeros((article.size, 6 + 2 * len(article.gimbals)))
    for i, x in enumerate(article.undeformed.x):
        motions[6 * i : 6 * i + 3, 0:3] = motions[6 * i + 3 : 6 * i + 6, 3:6] = np.eye(3)
        motions[6 * i : 6 * i + 3, 3:6] = -np.array(energies.skew(x))
    joints = np.arange(article.node_coordinates, article.size)
    motions[joints, 6 + np.arange(len(joints))] = 1.0
    translations = _orthonormal(motions[:, :3], M)
    others = motions[:, 3:]
    for _ in range(2):  # once more for orthogonality at rounding level
        others = others - translations @ (translations.T @ M @ others)
    return translations, _orthonormal(others, M)


def _orthonormal(X: np.ndarray, M: np.ndarray) -> np.ndarray:
    return np.linalg.solve(np.linalg.cholesky(X.T @ M @ X), X.T).T
