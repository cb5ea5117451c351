"""Environment of the structure: gravity and supports, joined to the article by attach-point names."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import field
from enum import Enum

import numpy as np
from jaxtyping import Inexact

from middeck.errors import ConfigError
from middeck.joints.friction import Friction
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.values import record, require_kind


class DeviceKind(Enum):
    """State of a device at which the article starts; under its load all kinds pull alike."""

    CONSTANT_FORCE = "constant_force"  # carries its load at the drawn height: no static deflection
    SPRING = "spring"  # is unstretched at the drawn height: the article sinks by load over stiffness


@record(kw_only=True)
class Device:
    """A cable from an anchor to an attach point, with a device that gives it a force and a stiffness.

    At length l it pulls with R + k (l - L): R is its load, L its length under that load. It cannot push.

    Attributes:
        name, attach: Its own name, and that of the attach point which hangs on it.
        kind: A constant force with a small stiffness, or a linear spring that starts unstretched.
        force: R [N]; None to tune it to its share of the vertical reaction of the pinned article.
        held: World directions ("xyz" letters) pinned at the attach point while that reaction is found.
        stiffness, bounce_hz: k [N/m], or the frequency from which k = (R/g) (2 pi bounce_hz)^2 follows: one
            of the two.
        cable_length, anchor: L [m], the anchor being straight above the drawn attach point; or the anchor in
            W [m]: one of the two.
        moving_mass: Mass [kg] that moves with the attach point along the cable, and whose weight the device
            bears itself.
        friction: Along the cable: N and N/m stand in place of N m and N m/rad. It does not enter the rest
            state.

    Raises `ConfigError` for values that cannot be, or that contradict each other.
    """

    name: str
    attach: str
    kind: DeviceKind = DeviceKind.CONSTANT_FORCE
    force: float | None = None
    held: str = ""
    stiffness: float | None = None
    bounce_hz: float | None = None
    cable_length: float | None = None
    anchor: Inexact[np.ndarray, "3"] | None = None
    moving_mass: float = 0.0
    friction: Friction | None = None

    def __post_init__(self) -> None:
        for what, hint in self._faults():
            raise ConfigError(what, where=f"device {self.name!r}", hint=hint)

    def _faults(self) -> Iterator[tuple[str, str]]:
        sizes = (self.force, self.stiffness, self.bounce_hz, self.cable_length)
        if any(size is not None and not 0.0 < np.real(size) < math.inf for size in sizes):
            yield f"force, stiffness, bounce_hz, cable_length are {sizes}", "each positive and finite"
        if not 0.0 <= np.real(self.moving_mass) < math.inf:
            yield f"a moving mass of {self.moving_mass} kg", "from zero, finite"
        for this, that in (("stiffness", "bounce_hz"), ("cable_length", "anchor")):
            if (getattr(self, this) is None) == (getattr(self, that) is None):
                what = f"{this} or {that}: one of them, not both"
                yield what, "remove one of the two, or give the one that is missing"
        if (self.force is None) != bool(self.held):
            what = "pinned directions are for a tuned device, and a tuned device needs them"
            yield what, "give a force, or held such as 'yz'"

    @property
    def needs_gravity(self) -> bool:
        """Whether its load, stiffness or anchor follows from gravity."""
        return self.force is None or self.bounce_hz is not None or self.cable_length is not None


@record(kw_only=True)
class Suspension:
    """One cable per attach point, rising to an anchor straight above the undeformed attach point.

    The force along a cable is R + k (length - cable_length), with R the vertical reaction when the article
    is pinned at its attach points, and k = (R/g) (2 pi bounce_hz)^2.

    Attributes:
        attach: Names of the attach points that hang on a cable.
        held: World directions ("xyz" letters) held at each of them while the reactions are found.
        cable_length: Loaded length [m]; it sets the pendulum stiffness.
        bounce_hz: Bounce frequency to which every device is tuned.
        kind, moving_mass, friction: Those of every device, see `Device`.
    """

    attach: tuple[str, ...]
    held: tuple[str, ...]
    cable_length: float
    bounce_hz: float
    kind: DeviceKind = DeviceKind.CONSTANT_FORCE
    moving_mass: float = 0.0
    friction: Friction | None = None

    def __post_init__(self) -> None:
        if len(self.held) != len(self.attach):
            raise ConfigError(
                f"{len(self.attach)} attach points and {len(self.held)} sets of held directions",
                where="suspension",
                hint="one set of xyz letters for each attach point",
            )

    @functools.cached_property
    def devices(self) -> tuple[Device, ...]:
        """Its devices, each named after its attach point."""
        return tuple(
            Device(
                name=name,
                attach=name,
                kind=self.kind,
                held=held,
                bounce_hz=self.bounce_hz,
                cable_length=self.cable_length,
                moving_mass=self.moving_mass,
                friction=self.friction,
            )
            for name, held in zip(self.attach, self.held, strict=True)
        )


@record(kw_only=True)
class AnchoredSpring:
    """A linear spring from an attach point to a fixed anchor in W: stiffness [N/m], free length [m].

    Unlike a `Device` it may push.
    """

    name: str
    attach: str
    anchor: Inexact[np.ndarray, "3"]
    stiffness: float
    free_length: float


@record(kw_only=True)
class GroundBushing:
    """A 6x6 stiffness from an attach point to the ground, which strains nothing as drawn.

    As a `Bushing` whose first frame is W: ``stiffness`` in the directions of ``axes``, its x, y and z in W.
    """

    name: str
    attach: str
    stiffness: Inexact[np.ndarray, "6 6"]
    axes: Inexact[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))


@record(kw_only=True)
class Environment:
    """Gravity vector in the world frame [m/s^2], and the supports of the article, if any.

    ``suspension`` is one tuned cable per attach point, ``springs`` and ``bushings`` tie it to the ground,
    ``devices`` hang it in any other way, any number of them at an attach point, and ``clamps`` hold nodes
    outright. ``wheel_speeds`` are (wheel, speed [rad/s]) of the article's wheels that spin. ``up`` is what
    pictures without gravity draw upwards.

    Raises `ConfigError` where two devices have one name, or two supports, and for two speeds of one wheel.

    >>> Environment.orbit().gravity.tolist()
    [0.0, 0.0, 0.0]
    """

    title: str
    gravity: Inexact[np.ndarray, "3"]
    suspension: Suspension | None = None
    springs: tuple[AnchoredSpring, ...] = ()
    devices: tuple[Device, ...] = ()
    clamps: tuple[Clamp, ...] = ()
    bushings: tuple[GroundBushing, ...] = ()
    wheel_speeds: tuple[tuple[str, float], ...] = ()
    up: Inexact[np.ndarray, "3"] | None = None

    def __post_init__(self) -> None:
        for what, hint in self._named_twice():
            raise ConfigError(what, where=f"environment {self.title!r}", hint=hint)

    def _named_twice(self) -> Iterator[tuple[str, str]]:
        for name in _twice([device.name for device in self.hung]):
            hint = "a suspension's devices have the names of their attach points"
            yield f"two devices are called {name!r}", hint
        for name in _twice([*dict.fromkeys(c.node for c in self.clamps), *(b.name for b in self.bushings)]):
            hint = "each bushing needs a name of its own, which no clamped node has"
            yield f"two supports are called {name!r}: reactions could not be told apart", hint
        for name in _twice([name for name, _ in self.wheel_speeds]):
            yield f"two speeds of wheel {name!r}", "one speed [rad/s] for each"

    @property
    def spins(self) -> bool:
        """Whether any wheel turns."""
        return any(speed != 0.0 for _, speed in self.wheel_speeds)

    @property
    def upwards(self) -> Inexact[np.ndarray, "3"] | None:
        """Unit vector against gravity, ``up`` where there is none."""
        size = float(np.linalg.norm(np.real(self.gravity)))
        return np.real(-self.gravity) / size + 0.0 if size > 0.0 else self.up

    @functools.cached_property
    def hung(self) -> tuple[Device, ...]:
        """Every device that can only pull, those of the suspension first."""
        return (*(() if self.suspension is None else self.suspension.devices), *self.devices)

    @staticmethod
    def orbit() -> Environment:
        """Zero gravity, no suspension: the free, undeformed structure."""
        return Environment(title="orbit", gravity=np.zeros(3))

    @staticmethod
    def clamped(*nodes: str, gravity: float = 9.80665) -> Environment:
        """Gravity along -y, and all six degrees of freedom of ``nodes`` held: a cantilever on the bench."""
        for name in nodes:
            require_kind(name, str, "name of a node", 'each name by itself: Environment.clamped("a", "b")')
        return Environment(
            title="clamped",
            gravity=np.array([0.0, -gravity, 0.0]),
            clamps=tuple(Clamp(node=name) for name in nodes),
        )

    @staticmethod
    def lab(
        structure: Structure, *, cable_length: float = 4.0, bounce_hz: float = 0.25, gravity: float = 9.80665
    ) -> Environment:
        """Gravity along -y and a cable at every attach point of ``structure``, but for ends of its ties.

        Ends of its own springs and bushings are no points to hang from. For an article along x, see
        `hang_along_x`. Raises `ConfigError` if there is no attach point.
        """
        ends = {end for tie in (*structure.springs, *structure.bushings) for end in (tie.start, tie.end)}
        held = hang_along_x([point.name for point in structure.attach_points if point.name not in ends])
        return Environment(
            title="lab",
            gravity=np.array([0.0, -gravity, 0.0]),
            suspension=Suspension(
                attach=tuple(held), held=tuple(held.values()), cable_length=cable_length, bounce_hz=bounce_hz
            ),
        )


def _twice(names: Sequence[str]) -> list[str]:
    return [name for name in names if names.count(name) > 1]


def hang_along_x(attach: Sequence[str]) -> dict[str, str]:
    """World directions in which each attach point of an article along x is held for the reactions.

    These are y and z at each, and x at the middle one only, so that the held article is not strained. Raises
    `ConfigError` if there is no attach point.

    >>> hang_along_x(["n1", "n3", "n5"])
    {'n1': 'yz', 'n3': 'xyz', 'n5': 'yz'}
    """
    if not attach:
        raise ConfigError(
            "the article has no attach point to hang from (ends of springs and bushings do not count)",
            hint="give it attach points (in its file a table [suspension] with nodes = [names] and "
            "offsets_m, an [x, y, z] from each), name an environment file with clamps (middeck convert "
            "writes that of a deck), or use the environment orbit",
        )
    middle = len(attach) // 2
    return {name: "xyz" if i == middle else "yz" for i, name in enumerate(attach)}
