"""Further results of components from their own output transformations: at rest, and of each mode.

Points inside a component whose shifts are among its outputs have places, though no file states them: unit
turns of the whole shift a point by their cross product with its place.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import points_in_world
from middeck.structure.model.component import WAYS, Component, rigid_vectors
from middeck.structure.modes.solve import Modes

# Largest error of outputs that are shifts, over a unit translation, and over the size times a unit turn.
APART = 1e-6


class Recovered(NamedTuple):
    """Outputs of a component by name: as its frame sees the rest state, and modes of unit amplitude.

    ``rest`` has what deformation gives, no motion as one body; ``modes`` have both, in the axes of the frame.
    """

    names: tuple[str, ...]
    rest: Float[np.ndarray, " output"]
    modes: Float[np.ndarray, "output mode"]


def recover_outputs(modes: Modes, component: str) -> Recovered:
    """Results of the component's output transformation; raises `ConfigError` for one that has none."""
    at = modes.equilibrium
    for part, element, state, rows in at.components:
        if part.name == component and part.recovery is not None:
            back = part.recovery @ element.basis
            return Recovered(part.outputs, back @ state.deformation, back @ state.seen(rows @ modes.shapes))
    known = [part.name for part in at.model.structure.components if part.recovery is not None]
    raise ConfigError(
        f"no component {component!r} with outputs", where="component", hint=", ".join(known) or "none has any"
    )


class InnerPoint(NamedTuple):
    """A point inside a component: its name, its place [m] and its shift per coordinate, in the own axes."""

    name: str
    place: Float[np.ndarray, "3"]
    shift: Float[np.ndarray, "3 n"]


def inner_points(part: Component) -> tuple[InnerPoint, ...]:
    """Points of which the component's outputs "NAME x", "NAME y" and "NAME z" give the shifts.

    Outputs that do not move with the component as one body are no shifts, and give no point.
    """
    if part.recovery is None:
        return ()
    row = {name: i for i, name in enumerate(part.outputs)}
    size = max(float(np.abs(part.positions).max()), np.finfo(float).tiny)
    found: list[InnerPoint] = []
    for name in (output.removesuffix(" x") for output in part.outputs if output.endswith(" x")):
        if not all(f"{name} {way}" in row for way in WAYS[:3]):
            continue
        shift = part.recovery[[row[f"{name} {way}"] for way in WAYS[:3]]]
        body = shift @ rigid_vectors(part.positions, len(part.stiffness))
        turn = body[:, 3:]
        far = max(size, float(np.abs(turn).max()))
        if np.abs(body[:, :3] - np.eye(3)).max() < APART and np.abs(turn + turn.T).max() < APART * far:
            found.append(InnerPoint(name, np.array([turn[1, 2], turn[2, 0], turn[0, 1]]), shift))
    return tuple(found)


def points_inside(model: Model) -> dict[str, tuple[int, InnerPoint]]:
    """Points inside components by name, each after its component's number; frames' names are frames.

    One of several of a name is "COMPONENT/NAME".
    """
    taken = {*model.frames, *(point.name for point in model.structure.attach_points)}
    parts = enumerate(model.structure.components)
    inside = [(k, part, p) for k, part in parts for p in inner_points(part) if p.name not in taken]
    times = Counter(p.name for *_, p in inside)
    return {p.name if times[p.name] == 1 else f"{part.name}/{p.name}": (k, p) for k, part, p in inside}


def drawn_inside(model: Model, k: int, point: InnerPoint) -> Float[np.ndarray, "3"]:
    """Place [m] of a point inside component ``k``, as drawn."""
    part, drawn = model.structure.components[k], points_in_world(model.points, model.drawn)
    arm = part.axes @ (point.place - part.positions.mean(axis=0))
    return np.asarray(drawn[model.components[k].point].mean(axis=0) + arm)


def motions_inside(
    modes: Modes, asked: Sequence[tuple[int, InnerPoint, int]]
) -> list[Float[np.ndarray, " coordinate"]]:
    """Motion per unit coordinate of points inside components, by component, point and way in W (of six)."""
    at = modes.equilibrium
    found: list[np.ndarray] = []
    for k, point, way in asked:
        part, element, state, rows = at.components[k]
        outputs = [f"{point.name} {w}" for w in WAYS[way - way % 3 :][:3]]
        if part.recovery is None or not set(outputs) <= set(part.outputs):
            what = f"component {part.name!r} has no output {point.name} {WAYS[way]}"
            raise ConfigError(what, where="measured channels", hint="leave the channel out")
        recovery = part.recovery[[part.outputs.index(x) for x in outputs]] @ element.basis
        own = (state.axes @ part.axes)[way % 3] @ recovery
        poses = own[: len(own) - state.modal].reshape(-1, 3) @ state.axes.T  # as by `seen`
        found.append(np.asarray(rows.T @ np.concatenate([poses.ravel(), own[poses.size :]])))
    return found
