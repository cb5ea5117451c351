"""What a test article is made of: nodes, members, joints, springs, and where one may attach, push or look.

Gravity, cables and devices are not here: they belong to the `Environment`. All positions are in the world
frame W of the undeformed state (x, y up, z = x cross y), in metres; a node frame is parallel to W there.
A *frame* is anything rigid that has a name: a node, or the body that a joint carries.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from jaxtyping import Float

from middeck.values import record


@record
class Section:
    """Cross-section of a member with its material, all constant along it.

    Parameters
    ----------
    EA, GJ:
        Axial [N] and torsional [N m^2] stiffness.
    EI_y, EI_z:
        Bending stiffness [N m^2] about the member's own y and z axes.
    rho_A:
        Mass per length [kg/m].
    rho_I_y, rho_I_z:
        Rotary inertia per length [kg m] about the own axes; their sum is the polar one.
    GA_y, GA_z:
        Shear stiffness [N] along own y and z; infinite for a Bernoulli beam.
    """

    EA: float
    GJ: float
    EI_y: float
    EI_z: float
    rho_A: float
    rho_I_y: float
    rho_I_z: float
    GA_y: float = np.inf
    GA_z: float = np.inf


@record
class Body:
    """Rigid mass on a frame: mass [kg], centre of mass [m] and inertia about it [kg m^2], frame axes."""

    mass: float
    cg: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]


@record
class Node:
    """A rigid node with six degrees of freedom; ``size`` is the clear distance members leave (see Member)."""

    name: str
    position: Float[np.ndarray, "3"]
    size: float
    body: Body


@record
class Member:
    """A straight beam between two nodes.

    It joins each node rigidly at size/2 from the node's centre, towards the other node. ``up`` fixes the
    member's own y axis: the part of ``up`` normal to the member. ``elements`` is the mesh.
    """

    name: str
    start: str
    end: str
    section: Section
    elements: int
    up: Float[np.ndarray, "3"]


class JointState(Enum):
    """What a revolute axis may do."""

    FREE = "free"  # held at its angle in statics; free in dynamics under that constant holding torque
    SPRUNG = "sprung"  # a linear spring about its rest angle, in statics and dynamics
    LOCKED = "locked"  # welded at its nominal angle
    DRIVEN = "driven"  # held by a stiff servo at its commanded angle


@record
class Joint:
    """A revolute joint that carries a body: a frame of its own.

    Parameters
    ----------
    name:
        Name of the joint and of the frame behind it.
    parent:
        Frame that carries it: a node or another joint.
    offset:
        From the parent's origin to the axis, parent frame [m].
    axis:
        Unit vector, the same in the parent's and in the joint's frame.
    angle:
        Nominal angle [rad], positive by the right hand; a positive torque increases it.
    body:
        What turns with it.
    state:
        What the axis may do.
    stiffness:
        Spring of a sprung axis [N m/rad].
    target:
        Rest angle of a sprung axis or commanded angle of a driven one [rad].
    """

    name: str
    parent: str
    offset: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    angle: float
    body: Body
    state: JointState = JointState.FREE
    stiffness: float = 0.0
    target: float = 0.0


@record
class AttachPoint:
    """A named point of a frame where an environment may attach a device or a spring."""

    name: str
    frame: str
    offset: Float[np.ndarray, "3"]


@record
class Spring:
    """A linear spring between two attach points: stiffness [N/m] and free length [m]."""

    name: str
    start: str
    end: str
    stiffness: float
    free_length: float


@record
class Actuator:
    """A torque [N m] on a frame about one of its axes, or at a joint (``axis`` is then None).

    A joint torque acts on the carried body, its opposite on the carrier. Axes turn with their bodies.
    """

    name: str
    frame: str
    axis: Float[np.ndarray, "3"] | None


@record
class Sensor:
    """A small inertial rotation of ``frame`` about an axis of frame ``axis_frame``, or a joint angle.

    ``axis`` is None for a joint angle. Every sensor also delivers its rate, named ``<name>_rate``.
    """

    name: str
    frame: str
    axis: Float[np.ndarray, "3"] | None
    axis_frame: str = ""


@record
class Damping:
    """Modal damping ratios by kind of mode."""

    flexible: float
    suspension: float
    rigid: float = 0.0


@record
class Structure:
    """A test article, without gravity and without its suspension."""

    title: str
    nodes: tuple[Node, ...]
    members: tuple[Member, ...]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...]
    attach_points: tuple[AttachPoint, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...]
    damping: Damping

    @property
    def mass(self) -> float:
        """Total mass [kg], members included."""
        rigid = sum(part.body.mass for part in (*self.nodes, *self.joints))
        by_name = {n.name: n for n in self.nodes}
        return rigid + sum(m.section.rho_A * clear_length(m, by_name) for m in self.members)


def clear_length(member: Member, nodes: dict[str, Node]) -> float:
    """Length of the flexible part [m]: the spacing less half of either node's size."""
    a, b = nodes[member.start], nodes[member.end]
    return float(np.linalg.norm(b.position - a.position)) - 0.5 * (a.size + b.size)
