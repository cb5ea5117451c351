"""Viscous dampers of an article and of its components, as rates per coordinate at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Inexact

from middeck.errors import ConfigError
from middeck.structure.elements.frames import points_in_world, pose_jacobian
from middeck.structure.model.article import Damper, DamperPlace, Damping, JointState
from middeck.structure.rest.equilibrium import Equilibrium


def damper_matrix(
    equilibrium: Equilibrium, damping: Damping, shapes: Inexact[np.ndarray, "coordinate mode"]
) -> Inexact[np.ndarray, "mode mode"]:
    """phi' C phi of all dampers and of components [1/s]; analytic."""
    none = np.zeros((0, shapes.shape[1]))
    rates = [np.sqrt(d.c) * (_damper_rows(equilibrium, d) @ shapes) for d in damping.dampers]
    rows = np.vstack([none, *rates])
    return rows.T @ rows + _component_dampers(equilibrium, shapes)


def _component_dampers(equilibrium: Equilibrium, shapes: np.ndarray) -> np.ndarray:
    total = np.zeros((shapes.shape[1],) * 2)
    for part, element, state, rows in equilibrium.components:
        if part.damping is not None:
            rate = element.basis @ state.seen(rows @ shapes)
            total = total + rate.T @ part.damping @ rate
    return total


def _damper_rows(equilibrium: Equilibrium, damper: Damper) -> Float[np.ndarray, "line coordinate"]:
    """Rate of a damper per unit rate of the coordinates; one row for each device at an attach point."""
    model, structure = equilibrium.model, equilibrium.model.structure
    if damper.place is DamperPlace.JOINT:
        index = number_of(damper.at, "joint", [j.name for j in structure.joints])
        state = structure.joints[index].state
        if state in (JointState.LOCKED, JointState.DRIVEN):
            raise ConfigError(
                f"a damper at joint {damper.at!r}, which is {state.value}",
                where="damping",
                hint="a damper at a joint that moves: remove it, or free the joint",
            )
        return np.eye(1, model.tree.size, 6 * model.tree.roots + index)
    if damper.place is DamperPlace.SPRING:
        ends = model.spring_ends[number_of(damper.at, "spring", [s.name for s in structure.springs])]
        (start, end), rows = _placed(equilibrium, ends)
        return (_direction(end - start, damper) @ (rows[1] - rows[0]))[None]
    point = model.attach_point[[number_of(damper.at, "attach point", model.attach_names)]]
    anchors = equilibrium.loads.anchor[equilibrium.loads.attach_point == point[0]]
    place, rows = _placed(equilibrium, point)
    lines = [_direction(place[0] - anchor, damper) for anchor in anchors]
    return np.array(lines).reshape(-1, 3) @ rows[0]


def _placed(
    equilibrium: Equilibrium, points: np.ndarray
) -> tuple[np.ndarray, Float[np.ndarray, "point 3 coordinate"]]:
    """Positions of points, and their translations per coordinate."""
    model, some = equilibrium.model, equilibrium.model.points.of(points)
    J = pose_jacobian(model.tree, some, equilibrium.poses)
    return points_in_world(some, equilibrium.poses), J.toarray().reshape(len(points), 6, -1)[:, :3]


def _direction(span: np.ndarray, damper: Damper) -> np.ndarray:
    length = np.sqrt(span @ span)
    if np.real(length) == 0.0:
        raise ConfigError(
            f"the ends of the damper at {damper.place.value} {damper.at!r} coincide: it has no direction",
            where="damping",
            hint="give the spring a length at rest, or damp by mode",
        )
    return span / length


def number_of(name: str, what: str, known: Sequence[str]) -> int:
    """Place of a name among those ``known``; raises `ConfigError` for another."""
    if name not in known:
        some = ", ".join(known[:20])
        raise ConfigError(f"no {what} {name!r}", where="damping", hint=f"one of {some or 'none'}")
    return known.index(name)
