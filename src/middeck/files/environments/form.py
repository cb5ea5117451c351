"""The form of ``environments/*.toml``, its own checks and the `Environment` it describes."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from middeck.files.articles.boundary_form import ClampForm, GroundBushingForm, build_clamp, build_ground
from middeck.files.toml.faults import PathFault, finding, nearest
from middeck.files.toml.form import Direction, Finite, Form, Name, NotNegative, Positive, Vector, rule
from middeck.joints.friction import Friction
from middeck.structure.model.environment import (
    AnchoredSpring,
    Device,
    DeviceKind,
    Environment,
    Suspension,
    hang_along_x,
)

Held = Annotated[
    str,
    rule(
        lambda held: held and list(held) == sorted(set(held) & set("xyz")),
        'must be x, y, z, in this order, as in "yz"',
    ),
]
HUNG = rule(bool, "no attach point hangs on a cable", 'n1 = "xyz"')
Kind = Literal["constant_force", "spring"]
TUNED = "tuned"


def force_or_tuned(value: Any) -> float | None:
    """A positive force, or None for the word ``tuned``.

    >>> force_or_tuned("tuned"), force_or_tuned(12)
    (None, 12.0)
    """
    if value == TUNED:
        return None
    number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else -1.0
    if not 0.0 < number < np.inf:
        raise PydanticCustomError("range", "out of range", {"allowed": f'> 0 or "{TUNED}"'})
    return number


class ConstantsForm(Form):
    """Gravity; the direction need not be a unit vector."""

    gravity_m_s2: NotNegative
    gravity_direction: Direction = (0.0, -1.0, 0.0)


class CablesForm(Form):
    """One cable and device per attach point in ``held``, or per attach point of an article along x."""

    cable_length_m: Positive
    bounce_hz: Positive
    held: Annotated[dict[str, Held], HUNG] | None = None
    device: Kind = "constant_force"
    moving_mass_kg: NotNegative = 0.0
    friction_n: NotNegative = 0.0
    presliding_m: Positive | None = None


class DeviceForm(Form):
    """A cable and device of its own; any number of them may share an attach point."""

    name: Name
    attach: str
    kind: Kind = "constant_force"
    force_n: Annotated[float | None, PlainValidator(force_or_tuned)] = Field(TUNED, validate_default=True)
    held: Held | None = None
    stiffness_n_per_m: Positive | None = None
    bounce_hz: Positive | None = None
    cable_length_m: Positive | None = None
    anchor_m: Vector | None = None
    moving_mass_kg: NotNegative = 0.0
    friction_n: NotNegative = 0.0
    presliding_m: Positive | None = None


class AnchoredSpringForm(Form):
    """A linear spring from an attach point to a point fixed in the world."""

    name: Name | None = None
    attach: str
    anchor_m: Vector
    stiffness_n_per_m: Positive
    free_length_m: NotNegative


class EnvironmentForm(Form):
    """Gravity and supports of an article; without ``[constants]`` there is no gravity.

    ``wheel_speed_rpm`` has the speeds of the article's wheels by name; those left out stand still.
    """

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    constants: ConstantsForm | None = None
    suspension: CablesForm | None = None
    device: Annotated[tuple[DeviceForm, ...], Field(strict=False)] = ()
    spring: Annotated[tuple[AnchoredSpringForm, ...], Field(strict=False)] = ()
    clamp: Annotated[tuple[ClampForm, ...], Field(strict=False)] = ()
    bushing: Annotated[tuple[GroundBushingForm, ...], Field(strict=False)] = ()
    wheel_speed_rpm: dict[str, Finite] = Field(default_factory=dict)


def joint_findings(
    form: EnvironmentForm, attach_points: list[str], nodes: list[str], wheels: list[str], article: str
) -> list[PathFault]:
    """Names in the environment that the article does not have."""
    held = (form.suspension.held if form.suspension else None) or {}
    used = [(("suspension", "held", name), name) for name in held]
    devices = [(("device", i, "attach"), device.attach) for i, device in enumerate(form.device)]
    springs = [(("spring", i, "attach"), spring.attach) for i, spring in enumerate(form.spring)]
    bushings = [(("bushing", i, "attach"), bushing.attach) for i, bushing in enumerate(form.bushing)]
    clamps = [(("clamp", i, "node"), clamp.node) for i, clamp in enumerate(form.clamp)]
    wanted = (
        (attach_points, "attach point", (*used, *devices, *springs, *bushings)),
        (nodes, "node", clamps),
        (wheels, "wheel", [(("wheel_speed_rpm", name), name) for name in form.wheel_speed_rpm]),
    )
    return [
        finding(path, f"article {article!r} has no {kind} {name!r}", hint=nearest(name, known))
        for known, kind, names in wanted
        for path, name in names
        if name not in known
    ]


def build_environment(form: EnvironmentForm, attach: Sequence[str] = ()) -> Environment:
    """The value that a valid form describes, around an article with these attach points."""
    gravity, up = np.zeros(3), None
    if form.constants is not None:
        direction = np.array(form.constants.gravity_direction)
        direction = direction / np.linalg.norm(direction)
        gravity = form.constants.gravity_m_s2 * direction
        up = None if np.any(gravity) else -direction + 0.0
    springs = tuple(
        AnchoredSpring(
            name=s.name or default_name(s.attach),
            attach=s.attach,
            anchor=np.array(s.anchor_m),
            stiffness=s.stiffness_n_per_m,
            free_length=s.free_length_m,
        )
        for s in form.spring
    )
    devices = tuple(_device(d) for d in form.device)
    suspension = None if form.suspension is None else _suspension(form.suspension, attach)
    return Environment(
        title=form.name,
        gravity=gravity + 0.0,  # no negative zeros
        suspension=suspension,
        springs=springs,
        devices=devices,
        clamps=tuple(build_clamp(c) for c in form.clamp),
        bushings=tuple(build_ground(b) for b in form.bushing),
        wheel_speeds=tuple((name, rpm * np.pi / 30.0) for name, rpm in form.wheel_speed_rpm.items()),
        up=up,
    )


def default_name(attach: str) -> str:
    """Name of a spring without one."""
    return f"spring_{attach}"


def _suspension(cables: CablesForm, attach: Sequence[str]) -> Suspension:
    held = hang_along_x(attach) if cables.held is None else cables.held
    return Suspension(
        attach=tuple(held),
        held=tuple(held.values()),
        cable_length=cables.cable_length_m,
        bounce_hz=cables.bounce_hz,
        kind=DeviceKind(cables.device),
        moving_mass=cables.moving_mass_kg,
        friction=_friction(cables.friction_n, cables.presliding_m),
    )


def _device(d: DeviceForm) -> Device:
    return Device(
        name=d.name,
        attach=d.attach,
        kind=DeviceKind(d.kind),
        force=d.force_n,
        held=d.held or "",
        stiffness=d.stiffness_n_per_m,
        bounce_hz=d.bounce_hz,
        cable_length=d.cable_length_m,
        anchor=None if d.anchor_m is None else np.array(d.anchor_m),
        moving_mass=d.moving_mass_kg,
        friction=_friction(d.friction_n, d.presliding_m),
    )


def _friction(force: float, presliding: float | None) -> Friction | None:
    """A device's friction: forces and metres in place of torques and radians."""
    return Friction(force, force / presliding) if force and presliding else None
