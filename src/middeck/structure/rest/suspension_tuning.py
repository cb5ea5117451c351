"""From an environment to loads: pinned reactions, then the force, stiffness and place of each device.

The paper's step 1. Devices that carry a given force, and springs, act while the others are tuned, so that a
tuned article stays where it was drawn.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Inexact

from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.assembly.environment_loads import Ground, Loads, no_loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import points_in_world
from middeck.structure.elements.springs_and_cables import SpringLaw
from middeck.structure.model.environment import AnchoredSpring, Device, DeviceKind, Environment
from middeck.structure.rest.pinned_reactions import PinnedPoints, PinnedState, settle_pinned, support_forces
from middeck.values import record

LEAST_RISE = 1e-3
"""Cosine to the vertical below which a cable is level, and could carry a weight with no finite force."""
STRAINED = 10.0
"""Push of a pinned point, over all loads together, that comes of points that strain the article."""


@record(kw_only=True)
class TunedSuspension:
    """Name, attach point, load R [N] and stiffness [N/m] of each device, those of the suspension first.

    The load of a tuned device is the vertical reaction at its attach point, if it is alone there and upright.
    ``pinned`` is the state with that reaction, None where nothing had to be tuned.
    """

    name: tuple[str, ...]
    attach: tuple[str, ...]
    reaction: Inexact[np.ndarray, " device"]
    stiffness: Inexact[np.ndarray, " device"]
    pinned: PinnedState | None = None


def tune_suspension(
    model: Model, environment: Environment, support: Inexact[np.ndarray, "pinned 3"] | None = None
) -> TunedSuspension:
    """Pin the article at the attach points of tuned devices, under full gravity; k = (R/g) (2 pi bounce)^2.

    Where ``support``, the forces of the pinned article, is known, all is analytic in it, in the model and in
    the environment. Raises `EquilibriumError` where a device would have to push: a cable cannot.
    """
    devices = environment.hung
    tuned = [d for d in devices if d.force is None]
    # Report an impossible anchor before anything computed from it.
    slope = {d.name: _rise(model, d, _up(environment)) for d in tuned}
    state = None
    if tuned and support is None:
        points = pinned_points(model, environment)
        state = settle_pinned(model, pinned_loads(model, environment), points)
        support = support_forces(state.supports, state.force, len(points.point))
    shares = {} if support is None else _tuned_forces(environment, tuned, slope, support)
    force = np.array([shares[d.name] if d.force is None else d.force for d in devices]) + 0.0
    stiffness = np.array([_stiffness(environment, d, R) for d, R in zip(devices, force, strict=True)]) + 0.0
    names, attach = tuple(d.name for d in devices), tuple(d.attach for d in devices)
    return TunedSuspension(name=names, attach=attach, reaction=force, stiffness=stiffness, pinned=state)


def _stiffness(environment: Environment, device: Device, force: float) -> float:
    if device.bounce_hz is None:
        return device.stiffness or 0.0
    return force / _norm(environment.gravity) * (2.0 * np.pi * device.bounce_hz) ** 2


def _tuned_forces(
    environment: Environment, tuned: Sequence[Device], slope: dict[str, float], support: np.ndarray
) -> dict[str, float]:
    """Load of each tuned device by name: its share of the vertical reaction over its slope."""
    pull = dict(zip(_tuned_attach(tuned), support @ _up(environment), strict=True))
    weight = float(np.real(sum(pull.values())))
    for name, value in pull.items():
        if np.real(value) <= 0.0:
            strained = bool(-np.real(value) > STRAINED * abs(weight))
            raise EquilibriumError(
                f"the cable at {name!r} would be slack: its pinned reaction is {np.real(value):.4g} N"
                + (f" of {weight:.4g} N in all; held, the points strain the article between them" * strained),
                where=f"suspension at {name!r}",
                hint="move the attach points so that each carries load, or hang the article by fewer",
                reactions_n={name: float(np.real(value)) for name, value in pull.items()},
            )
    together = [d.attach for d in tuned]
    return {d.name: pull[d.attach] / together.count(d.attach) / slope[d.name] for d in tuned}


def _tuned_attach(tuned: Sequence[Device]) -> tuple[str, ...]:
    """Each attach point of tuned devices once."""
    return tuple(dict.fromkeys(d.attach for d in tuned))


def pinned_points(model: Model, environment: Environment) -> PinnedPoints:
    """Points held while devices are tuned; none if no device is tuned."""
    tuned = [d for d in environment.hung if d.force is None]
    attach = _tuned_attach(tuned)
    held = tuple(
        "".join(c for c in "xyz" if any(c in d.held for d in tuned if d.attach == name)) for name in attach
    )
    return PinnedPoints(np.array([attach_index(model, name) for name in attach], dtype=int), held)


def _rise(model: Model, device: Device, up: np.ndarray) -> float:
    """Cosine of a drawn cable to the vertical."""
    if device.anchor is None:
        return 1.0
    span = device.anchor - _drawn(model, device)
    length = _positive_length(device, span)
    rise = span @ up
    if not np.real(rise) > LEAST_RISE * np.real(length):
        raise ConfigError(
            f"its anchor lies {np.real(rise):.3g} m above its attach point: it cannot be tuned to a weight",
            where=f"device {device.name!r}",
            hint="raise the anchor, or give the device a force",
        )
    return cast("float", rise / length)


def pinned_loads(model: Model, environment: Environment) -> Loads:
    """Loads while devices are tuned: gravity, devices of given force, and springs; analytic."""
    given = [(d, d.force) for d in environment.hung if d.force is not None]
    lines = [_line(model, environment, d, R, _stiffness(environment, d, R)) for d, R in given]
    return _loads(model, environment, [*lines, *(_tie(model, s) for s in environment.springs)])


def environment_loads(model: Model, environment: Environment, tuned: TunedSuspension) -> Loads:
    """Every device with its force, stiffness and anchor, then the environment's own springs.

    Analytic in all three. Raises `ConfigError` for a spring that
    would be longer than its cable, or an anchor in its attach point.
    """
    lines = [
        _line(model, environment, device, R, k)
        for device, R, k in zip(environment.hung, tuned.reaction, tuned.stiffness, strict=True)
    ]
    return _loads(model, environment, [*lines, *(_tie(model, s) for s in environment.springs)])


class _Line(NamedTuple):
    """Pose of an attach point, anchor in W, (preload, stiffness, length at which it acts), moving mass."""

    point: int
    anchor: np.ndarray
    law: tuple[float, float, float]
    mass: float


def _loads(model: Model, environment: Environment, lines: Sequence[_Line]) -> Loads:
    pushes = [np.concatenate([load.force, load.moment]) for load in model.structure.loads]
    base = dataclasses.replace(
        no_loads(),
        gravity=environment.gravity,
        push=np.array(pushes).reshape(-1, 6),
        ground=Ground(
            point=np.array([attach_index(model, b.attach) for b in environment.bushings], dtype=int),
            stiffness=np.array([b.stiffness for b in environment.bushings]).reshape(-1, 6, 6),
            axes=np.array([b.axes for b in environment.bushings]).reshape(-1, 3, 3),
        ),
    )
    if not lines:
        return base
    preload, stiffness, length = np.array([line.law for line in lines]).T
    return dataclasses.replace(
        base,
        anchor=np.array([line.anchor for line in lines]),
        attach_point=np.array([line.point for line in lines], dtype=int),
        law=SpringLaw(preload, stiffness, length),
        mass=np.array([line.mass for line in lines]),
    )


def _tie(model: Model, spring: AnchoredSpring) -> _Line:
    law = (0.0, spring.stiffness, spring.free_length)
    return _Line(attach_index(model, spring.attach), spring.anchor, law, 0.0)


def _line(model: Model, environment: Environment, device: Device, force: float, stiffness: float) -> _Line:
    """A constant force is carried at the drawn length; a spring is unstretched there, `sink` short of it."""
    drawn = _drawn(model, device)
    sink = force / stiffness if device.kind is DeviceKind.SPRING else 0.0
    if device.anchor is not None:
        anchor, length = device.anchor, _positive_length(device, device.anchor - drawn)
    else:
        length = (device.cable_length or 0.0) - sink
        anchor = drawn + _up(environment) * length
    if np.real(length) <= 0.0:
        raise ConfigError(
            f"under its load a spring of this stiffness is {np.real(sink):.4g} m longer than free, "
            f"more than its loaded length of {device.cable_length} m",
            where=f"device {device.name!r}",
            hint="lengthen the cable or raise the bounce frequency, or take a constant-force device",
        )
    # Store a spring's free length, so that it never pushes while the load is ramped.
    law = (0.0, stiffness, length) if device.kind is DeviceKind.SPRING else (force, stiffness, length)
    return _Line(attach_index(model, device.attach), anchor, law, device.moving_mass)


def _positive_length(device: Device, span: np.ndarray) -> float:
    length = _norm(span)
    if np.real(length) == 0.0:
        raise ConfigError("its anchor is its attach point", where=f"device {device.name!r}", hint="move it")
    return length


def _norm(v: np.ndarray) -> float:
    """Norm that is analytic, unlike `numpy.linalg.norm`."""
    return cast("float", np.sqrt(v @ v))


def _up(environment: Environment) -> Inexact[np.ndarray, "3"]:
    return -environment.gravity / _norm(environment.gravity)


def _drawn(model: Model, device: Device) -> Inexact[np.ndarray, "3"]:
    """Undeformed place of its attach point."""
    return points_in_world(model.points.of(np.array([attach_index(model, device.attach)])), model.drawn)[0]


def attach_index(model: Model, name: str) -> int:
    """Pose of the attach point ``name``; raises `ConfigError` if there is none."""
    if name not in model.attach_names:
        raise ConfigError(
            f"the article has no attach point {name!r}",
            where="environment",
            hint=f"attach points are {', '.join(model.attach_names) or 'none'}",
        )
    return int(model.attach_point[model.attach_names.index(name)])
