"""The parts of a test article: nodes, members, joints, springs, wheels, actuators and sensors.

Gravity, cables and devices are not here: they belong to the `Environment`. All positions are in the world
frame W of the undeformed state (x, y up, z = x cross y), in metres; a node frame is parallel to W there.
A *frame* is anything rigid that has a name: a node, or the body that a joint carries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from enum import Enum
from functools import cached_property
from typing import cast

import numpy as np
from jaxtyping import Float, Inexact

from middeck.errors import ConfigError
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import Component
from middeck.structure.model.links import AnyLink
from middeck.structure.model.section import MemberMass as MemberMass
from middeck.structure.model.section import Section, mean_section, sections_along
from middeck.values import record


@record
class Body:
    """Rigid mass on a frame: mass [kg], centre of mass [m] and inertia about it [kg m^2], frame axes.

    Of a body's three principal inertias no one is larger than the sum of the others. ``rotors_excluded`` says
    that these need not be: the inertia of rotors about their own spin axes is left out of them.
    """

    mass: float
    cg: Inexact[np.ndarray, "3"]
    inertia: Inexact[np.ndarray, "3 3"]
    rotors_excluded: bool = False


@record
class Node:
    """A rigid node with six degrees of freedom; members leave its ``size`` clear (see `Member`)."""

    name: str
    position: Inexact[np.ndarray, "3"]
    size: float
    body: Body


@record(kw_only=True)
class Member:
    """A straight beam between two nodes.

    It joins each node rigidly at the node's centre plus ``start_offset`` or ``end_offset`` [m], in the node's
    axes, and size/2 further, towards its other end. So members and bodies of any rigid part stand on one
    node. ``up`` fixes the member's own y axis: the part of ``up`` normal to the member. ``elements`` is the
    mesh.

    As drawn it pulls its ends together with ``tension`` [N]; a negative one pushes them apart. Its section
    may vary: ``section`` is then that at its start, and ``stations`` are (fraction of its clear length,
    section) of others, ascending up to 1; between them every number is linear. An element has the section at
    its middle. ``section_name`` is the name of its section in the article, "" for none.
    """

    name: str
    start: str
    end: str
    section: Section
    elements: int
    up: Inexact[np.ndarray, "3"]
    start_offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    end_offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    tension: float = 0.0
    stations: tuple[tuple[float, Section], ...] = ()
    section_name: str = ""

    @property
    def sections(self) -> tuple[Section, ...]:
        """The section of every element."""
        return sections_along(self.section, self.stations, self.elements)


class JointState(Enum):
    """State of a revolute axis."""

    FREE = "free"  # held at its angle in statics; free in dynamics under that constant holding torque
    SPRUNG = "sprung"  # a linear spring about its rest angle, in statics and dynamics; a hinge at stiffness 0
    LOCKED = "locked"  # welded at its nominal angle
    DRIVEN = "driven"  # held by a stiff servo at its commanded angle
    INTERNAL = "internal"  # no joint: a modal coordinate of a component, free in statics and dynamics


@record(kw_only=True)
class Joint:
    """A joint that carries a body, a frame of its own: it turns about its axis, or slides along it.

    Of a slide, angles are travels [m], torques forces [N] and stiffness is [N/m]: a proof mass.

    Attributes:
        name: Name of the joint and of the frame behind it.
        parent: Frame that carries it: a node or another joint.
        offset: Vector from the parent's origin to the axis, parent frame [m].
        axis: Unit vector, the same in the parent's and in the joint's frame.
        angle: Nominal angle [rad], positive by the right hand; a positive torque increases it.
        body: Body that moves with the joint.
        state: State of the axis, see `JointState`.
        stiffness: Spring of a sprung axis [N m/rad].
        target: Rest angle of a sprung axis or commanded angle of a driven one [rad].
        slides: Whether the joint shifts along its axis instead of turning about it.
        travel: Least and largest angle [rad] that the mechanism allows.
        torque_limit: Largest torque [N m] of its motor.
    """

    name: str
    parent: str
    offset: Inexact[np.ndarray, "3"]
    axis: Inexact[np.ndarray, "3"]
    angle: float
    body: Body
    state: JointState = JointState.FREE
    stiffness: float = 0.0
    target: float = 0.0
    slides: bool = False
    travel: tuple[float, float] = (-np.inf, np.inf)
    torque_limit: float = np.inf


def held_angle(joint: Joint) -> float:
    """Angle [rad] at which statics begin: the command of a driven axis, else the nominal one."""
    return joint.target if joint.state is JointState.DRIVEN else joint.angle


@record(kw_only=True)
class Wheel:
    """A rotor that spins about an axis fixed to a frame; its speed belongs to the `Environment`.

    Attributes:
        name: Its own name.
        frame: Frame of its bearings: a node, or the body of a joint.
        axis: Unit vector of its spin, frame axes; a positive speed is by the right hand about it.
        inertia: Inertia of the rotor about the axis [kg m^2].

    Only its momentum is here. Its mass and its inertia across the axis are in the frame's body; its inertia
    about the axis too if a drive holds its speed, and not if its motor leaves it free, as that of a torque
    wheel does (``rotors_excluded``).
    """

    name: str
    frame: str
    axis: Inexact[np.ndarray, "3"]
    inertia: float


@record
class AttachPoint:
    """A named point of a frame where an environment may attach a device or a spring."""

    name: str
    frame: str
    offset: Inexact[np.ndarray, "3"]


@record(kw_only=True)
class Spring:
    """A linear spring between two attach points: stiffness [N/m] and free length [m]."""

    name: str
    start: str
    end: str
    stiffness: float
    free_length: float


@record(kw_only=True)
class Bushing:
    """A 6x6 stiffness between two attach points, which strains nothing as drawn.

    Attributes:
        stiffness: On displacement [m] and rotation vector [rad] of ``end`` as ``start`` sees it: N/m,
            N and N m/rad; symmetric, no eigenvalue negative.
        axes: Unit vectors of its x, y and z in W as drawn, as columns; they follow the frame of ``start``.

    The law is linear in both, for any displacement and any relative turn below pi (`elements.bushings`); an
    elastomer's is not beyond some degrees.
    """

    name: str
    start: str
    end: str
    stiffness: Inexact[np.ndarray, "6 6"]
    axes: Inexact[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))


@record(kw_only=True)
class PointLoad:
    """A dead force [N] and moment [N m] on a frame, in W; the force acts at ``offset``, frame axes [m]."""

    name: str
    frame: str
    force: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    moment: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))


@record
class AddedMass:
    """A rigid body bolted to a frame, beside the frame's own; place and inertia in the frame's axes."""

    name: str
    frame: str
    body: Body


@record(kw_only=True)
class LoadCase:
    """Named loads on frames, masses on frames, and prescribed displacements of nodes.

    Gravity acts on the masses as on the article, and they take part in its modes. Forces and moments are
    dead: they keep their direction in W. ``prescribed`` are clamps with a displacement.

    >>> push = PointLoad(name="push", frame="b", force=np.array([0.0, -1.0, 0.0]))
    >>> LoadCase(name="tip", loads=(push,)).name
    'tip'
    """

    name: str
    loads: tuple[PointLoad, ...] = ()
    masses: tuple[AddedMass, ...] = ()
    prescribed: tuple[Clamp, ...] = ()


class ActuatorKind(Enum):
    """Kind of an actuator."""

    TORQUE = "torque"  # about an axis of a frame, or at a joint
    FORCE = "force"  # at a point of a frame along one of its axes


@record(kw_only=True)
class Actuator:
    """A torque [N m] on a frame about one of its axes, or at a joint (``axis`` is then None); or a force [N].

    A joint torque acts on the carried body, its opposite on the carrier. A force acts at ``offset`` from the
    frame's origin, in its axes. Axes turn with their bodies.
    """

    name: str
    frame: str
    axis: Inexact[np.ndarray, "3"] | None
    kind: ActuatorKind = ActuatorKind.TORQUE
    offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        _check_point(f"actuator {self.name!r}", self.kind is ActuatorKind.FORCE, self.axis, self.offset)


class SensorKind(Enum):
    """Kind of a sensor."""

    ANGLE = "angle"  # rotation [rad] about an axis, or a joint's angle; and its rate
    ACCELEROMETER = "accelerometer"  # specific force [m/s^2] at a point along an axis of its frame
    DISPLACEMENT = "displacement"  # shift [m] of a point along a line in W, from the ground; and its rate


@record(kw_only=True)
class Sensor:
    """A small inertial rotation of ``frame`` about an axis of frame ``axis_frame``, or a joint angle.

    ``axis`` is None for a joint angle. Every angle also delivers its rate, named ``<name>_rate``.

    A displacement is that of the point at ``offset`` on ``frame``, as a laser on the ground measures it:
    along ``axis`` in W, which stands still, so that it has no ``axis_frame``. It delivers its rate too.

    An accelerometer stands at ``offset`` from the origin of ``frame`` and reads n . (a - g), the acceleration
    less gravity along its own axis n, which is fixed to ``frame`` and tilts with it.
    """

    name: str
    frame: str
    axis: Inexact[np.ndarray, "3"] | None
    axis_frame: str = ""
    kind: SensorKind = SensorKind.ANGLE
    offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        stands = self.kind is not SensorKind.ANGLE
        _check_point(f"sensor {self.name!r}", stands, self.axis, self.offset)
        if stands and self.axis_frame not in ("", self.frame):
            fixed = {
                SensorKind.ACCELEROMETER: f"an accelerometer's axis is fixed to its own frame {self.frame!r}",
                SensorKind.DISPLACEMENT: "a displacement's axis stands still in the world",
            }
            raise ConfigError(f"sensor {self.name!r}: {fixed[self.kind]}", hint="leave axis_frame out")


def _check_point(port: str, at_point: bool, axis: np.ndarray | None, offset: np.ndarray) -> None:
    """A force, an accelerometer or a displacement needs an axis; of a rotation it does not matter where."""
    if at_point and axis is None:
        raise ConfigError(
            f"{port}: a force, an accelerometer or a displacement needs an axis", hint="a unit vector"
        )
    if not at_point and np.any(offset):
        raise ConfigError(
            f"{port}: a torque or an angle has no offset, it is the same all over its frame",
            hint="leave the offset out",
        )


class DamperPlace(Enum):
    """Place of a viscous damper."""

    JOINT = "joint"  # about the axis of a joint
    SPRING = "spring"  # along a spring of the article
    DEVICE = "device"  # along whatever the environment hangs or ties an attach point with


@record
class Damper:
    """A viscous damper at the joint, spring or attach point ``at``.

    ``c`` is in N m s/rad at a joint that turns, otherwise in N s/m. One at an attach point comes and goes
    with the device: in an environment that has none there it does nothing.
    """

    place: DamperPlace
    at: str
    c: float


@record
class DampingTable:
    """Damping ratios measured at ascending frequencies [Hz], interpolated in the logarithm of frequency.

    Outside of them a mode is refused, or with ``hold`` given the nearest ratio.
    """

    frequency_hz: Float[np.ndarray, " point"]
    zeta: Float[np.ndarray, " point"]
    hold: bool = False

    def __post_init__(self) -> None:
        f, zeta = self.frequency_hz, self.zeta
        if not (len(f) and np.all(np.isfinite(f)) and np.all(np.diff(f, prepend=0.0) > 0.0)):
            what = "a damping table needs positive, ascending frequencies"
            hint = "at least one frequency > 0 Hz, each higher than the one before"
            raise ConfigError(what, where="damping.table", hint=hint)
        if not np.all((zeta >= 0.0) & (zeta < 1.0)):
            what, hint = "a damping table holds ratios from 0 to below 1", "1 % of critical is 0.01"
            raise ConfigError(what, where="damping.table", hint=hint)


@record(kw_only=True)
class Damping:
    """Sources of damping; a mode's ratio is the sum of base, material and devices.

    Attributes:
        flexible, suspension, rigid: The base: of strain, of everything else that holds a mode (devices,
            weight), and of a mode at zero. A mode has both of the first two, weighted with the parts of its
            energy; where weight or preload softens it, these add up to more than one (`lossy_shares`).
        by_rank: Instead of that, the 1993 paper's rule: the n lowest modes have ``suspension`` and all others
            ``flexible``, n the number of rigid-body modes in orbit.
        table: The base of every mode that oscillates, instead of ``flexible`` and ``suspension``.
        loss_factor: (member, eta): adds half of eta weighted with the member's share of the mode's energy.
        dampers: Viscous dampers: add phi' C phi / (2 omega).
        by_mode: (name or number of a mode, ratio): that mode has this ratio and nothing else.
    """

    flexible: float = 0.0
    suspension: float = 0.0
    rigid: float = 0.0
    table: DampingTable | None = None
    loss_factor: tuple[tuple[str, float], ...] = ()
    dampers: tuple[Damper, ...] = ()
    by_mode: tuple[tuple[str | int, float], ...] = ()
    by_rank: bool = False

    def __post_init__(self) -> None:
        for what, hint in self._faults():
            raise ConfigError(what, where="damping", hint=hint)

    def _faults(self) -> Iterator[tuple[str, str]]:
        if self.table is not None and (self.flexible or self.suspension):
            hint = "leave out flexible and suspension, or the table"
            yield "ratios both by kind and from a table", hint
        ratios = (self.flexible, self.suspension, self.rigid, *(zeta for _, zeta in self.by_mode))
        if not all(0.0 <= np.real(zeta) < 1.0 for zeta in ratios):
            yield "a damping ratio must be >= 0 and < 1", "1 % of critical is 0.01"
        losses = (*(eta for _, eta in self.loss_factor), *(damper.c for damper in self.dampers))
        if not all(0.0 <= np.real(x) < np.inf for x in losses):
            hint = "zero or positive; a loss factor is about twice the damping ratio"
            yield "a loss factor or damper is negative or not finite", hint


@record(kw_only=True)
class Structure:
    """A test article, without gravity and without its suspension.

    ``masses`` and ``loads`` are those of the one of its ``load_cases`` that `apply_load_case` has chosen.
    ``up`` is the unit vector in W that pictures draw upwards where the environment has no vertical.
    """

    title: str
    nodes: tuple[Node, ...]
    members: tuple[Member, ...]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...]
    attach_points: tuple[AttachPoint, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...]
    damping: Damping
    bushings: tuple[Bushing, ...] = ()
    masses: tuple[AddedMass, ...] = ()
    loads: tuple[PointLoad, ...] = ()
    load_cases: tuple[LoadCase, ...] = ()
    components: tuple[Component, ...] = ()
    links: tuple[AnyLink, ...] = ()
    wheels: tuple[Wheel, ...] = ()
    up: Float[np.ndarray, "3"] | None = None

    @cached_property
    def mass(self) -> float:
        """Total mass [kg], members and components included."""
        rigid = sum(part.body.mass for part in (*self.nodes, *self.joints, *self.masses))
        rigid += sum(component.weight for component in self.components)
        by_name = {n.name: n for n in self.nodes}
        return rigid + sum(mean_section(m.sections).rho_A * clear_length(m, by_name) for m in self.members)


def clear_length(member: Member, nodes: dict[str, Node]) -> float:
    """Length of the flexible part [m]: the spacing of its ends less half of either node's size; analytic."""
    a, b = nodes[member.start], nodes[member.end]
    along = b.position + member.end_offset - a.position - member.start_offset
    return cast("float", np.sqrt(along @ along)) - 0.5 * (a.size + b.size)
