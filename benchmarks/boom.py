"""A suspended lattice boom that grows by bays and width, as plain arrays and as a `Structure`.

Cubic cells, ``width`` x ``width`` of them in a cross-section, and ``bays`` of those: x along the boom, y
up. Every edge of a cell is a strut (longerons along x, battens along y and z) and every
face has one diagonal, whose direction alternates from face to face. Struts are round aluminium tubes
without shear flexibility, rigidly joined, each of ``elements`` beam elements; a hub of 4 kg sits at every
joint, which keeps the modes of single struts above the lowest 40 from 1e4 degrees of freedom on.

It hangs by vertical springs from each joint of the top face at every ``width``-th station, with 0.25 Hz of
bounce and 1 m of free length. Each spring is as strong as the weight of its share of the top face; anchors
are where the undeformed boom is about at rest, so that what is left is its own sag.

Growing: by bays and width; the slices of a strut stay as they are, for (length/slice)^4 would soon exceed
double precision. A factorisation costs the sixth power of the width for each bay, hence the long boom at 1e6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from middeck.structure.model.article import AttachPoint, Body, Damping, Member, Node, Section, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment

GRAVITY = 9.80665
CELL = 0.5
BOUNCE_HZ = 0.25
FREE_LENGTH = 1.0
HUB_MASS, HUB_INERTIA = 4.0, 2e-3  # the moment of a ball of 35 mm radius
# 40 x 2 mm tube of aluminium.
E, G, RHO = 70e9, 27e9, 2700.0
OUTER, INNER = 0.040, 0.036
AREA = np.pi * (OUTER**2 - INNER**2) / 4.0
SECOND = np.pi * (OUTER**4 - INNER**4) / 64.0
SECTION = Section(
    EA=E * AREA,
    GJ=2.0 * G * SECOND,
    EI_y=E * SECOND,
    EI_z=E * SECOND,
    rho_A=RHO * AREA,
    rho_I_y=RHO * SECOND,
    rho_I_z=RHO * SECOND,
)
# Width and bays in cells, and elements a strut, by the number of degrees of freedom that they make, about.
SIZES = {"1e3": (1, 16, 2), "1e4": (2, 32, 2), "1e5": (5, 80, 2), "1e6": (7, 420, 2)}


@dataclass(frozen=True)
class Boom:
    """Joints (n, 3), struts (m, 2) as pairs of joints; springs: their joints, anchors (s, 3), stiffness."""

    joints: np.ndarray
    struts: np.ndarray
    spring_joint: np.ndarray
    spring_anchor: np.ndarray
    spring_stiffness: np.ndarray
    elements: int

    @property
    def dof(self) -> int:
        return 6 * (len(self.joints) + (self.elements - 1) * len(self.struts))


def build_boom(width: int, bays: int, elements: int) -> Boom:
    """The boom of ``bays`` times ``width`` x ``width`` cells; ``bays`` is a multiple of ``width``."""
    cells = (bays, width, width)
    shape = tuple(c + 1 for c in cells)
    index = np.arange(np.prod(shape)).reshape(shape)
    joints = CELL * (np.indices(shape).reshape(3, -1).T - [0.0, width, 0.5 * width])
    struts = np.concatenate(
        [_edges(index, axis) for axis in range(3)] + [_diagonals(index, a) for a in range(3)]
    )
    lengths = np.linalg.norm(joints[struts[:, 1]] - joints[struts[:, 0]], axis=1)
    mass = HUB_MASS * len(joints) + SECTION.rho_A * lengths.sum()
    along, across = np.ones(bays // width + 1), np.ones(width + 1)
    along[[0, -1]] = across[[0, -1]] = 0.5
    share = np.outer(along, across).ravel() / (along.sum() * across.sum())
    omega = 2.0 * np.pi * BOUNCE_HZ
    hung = index[::width, -1, :].ravel()
    rise = np.array([0.0, FREE_LENGTH + GRAVITY / omega**2, 0.0])
    return Boom(joints, struts, hung, joints[hung] + rise, mass * omega**2 * share, elements)


def _edges(index: np.ndarray, axis: int) -> np.ndarray:
    start = np.take(index, range(index.shape[axis] - 1), axis)
    end = np.take(index, range(1, index.shape[axis]), axis)
    return np.stack([start.ravel(), end.ravel()], axis=1)


def _diagonals(index: np.ndarray, normal: int) -> np.ndarray:
    """One a face of the planes with this normal: the rising one where the sum of indices is even."""
    faces = np.moveaxis(index, normal, 0)
    corner = [
        faces[:, a : faces.shape[1] - 1 + a, b : faces.shape[2] - 1 + b] for a in (0, 1) for b in (0, 1)
    ]
    even = np.indices(corner[0].shape).sum(axis=0) % 2 == 0
    start, end = np.where(even, corner[0], corner[1]), np.where(even, corner[3], corner[2])
    return np.stack([start.ravel(), end.ravel()], axis=1)


def frame_of_boom(boom: Boom) -> dict[str, np.ndarray]:
    """What the peers read: nodes and elements after slicing, one section, bodies, springs, gravity."""
    parts = boom.elements
    a, b = boom.joints[boom.struts[:, 0]], boom.joints[boom.struts[:, 1]]
    inner = a[:, None] + (b - a)[:, None] * (np.arange(1, parts) / parts)[:, None]
    numbers = len(boom.joints) + np.arange(len(a) * (parts - 1)).reshape(len(a), parts - 1)
    chain = np.concatenate([boom.struts[:, :1], numbers, boom.struts[:, 1:]], axis=1)
    n = len(boom.joints)
    return {
        "x": np.concatenate([boom.joints, inner.reshape(-1, 3)]),
        "ends": np.stack([chain[:, :-1].ravel(), chain[:, 1:].ravel()], axis=1),
        **section_arrays(SECTION),
        "body_node": np.arange(n),
        "body_mass": np.full(n, HUB_MASS),
        "body_cg": np.zeros((n, 3)),
        "body_inertia": np.full((n, 3), HUB_INERTIA),
        "spring_node": boom.spring_joint,
        "spring_anchor": boom.spring_anchor,
        "spring_stiffness": boom.spring_stiffness,
        "spring_free_length": np.full(len(boom.spring_joint), FREE_LENGTH),
        "gravity": np.array([0.0, -GRAVITY, 0.0]),
    }


def section_arrays(section: Section) -> dict[str, np.ndarray]:
    """Of a round section: GA is infinite without shear flexibility."""
    names = {"EA": "EA", "GJ": "GJ", "EI": "EI_y", "GA": "GA_y", "rho_A": "rho_A", "rho_I": "rho_I_y"}
    return {ours: np.array(getattr(section, theirs)) for ours, theirs in names.items()}


def structure_of_boom(boom: Boom) -> tuple[Structure, Environment]:
    """The same for the product."""
    hub = Body(HUB_MASS, np.zeros(3), HUB_INERTIA * np.eye(3))
    names = [f"j{i}" for i in range(len(boom.joints))]
    nodes = tuple(Node(name, x, 0.0, hub) for name, x in zip(names, boom.joints, strict=True))
    up, along_z = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    span = np.abs(boom.joints[boom.struts[:, 1]] - boom.joints[boom.struts[:, 0]])
    vertical = (span[:, 0] == 0.0) & (span[:, 1] == 0.0)
    members = tuple(
        Member(
            name=f"m{i}",
            start=names[a],
            end=names[b],
            section=SECTION,
            elements=boom.elements,
            up=along_z if v else up,
        )
        for i, ((a, b), v) in enumerate(zip(boom.struts.tolist(), vertical.tolist(), strict=True))
    )
    attach = tuple(AttachPoint(f"a{j}", names[j], np.zeros(3)) for j in boom.spring_joint.tolist())
    springs = tuple(
        AnchoredSpring(name=f"s{j}", attach=f"a{j}", anchor=anchor, stiffness=k, free_length=FREE_LENGTH)
        for j, anchor, k in zip(
            boom.spring_joint.tolist(), boom.spring_anchor, boom.spring_stiffness.tolist(), strict=True
        )
    )
    article = Structure(
        title="boom",
        nodes=nodes,
        members=members,
        joints=(),
        springs=(),
        attach_points=attach,
        actuators=(),
        sensors=(),
        damping=Damping(flexible=0.01, suspension=0.03),
    )
    return article, Environment(
        title="springs", gravity=np.array([0.0, -GRAVITY, 0.0]), suspension=None, springs=springs
    )
