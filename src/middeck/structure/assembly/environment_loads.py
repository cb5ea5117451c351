"""Loads of an environment on a model, and the forces inside it that balance them."""

from __future__ import annotations

from dataclasses import field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Inexact, Int

from middeck.structure.elements.springs_and_cables import SpringLaw
from middeck.values import record


@record(kw_only=True)
class Ground:
    """Bushings from attach points to the ground: poses, stiffness and, as columns, axes in W."""

    point: Int[np.ndarray, " ground"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    stiffness: Inexact[np.ndarray, "ground 6 6"] = field(default_factory=lambda: np.zeros((0, 6, 6)))
    axes: Inexact[np.ndarray, "ground 3 3"] = field(default_factory=lambda: np.zeros((0, 3, 3)))


@record(kw_only=True)
class Loads:
    """Loads of the environment: gravity [m/s^2], and springs from anchors (in W) to attach points.

    ``mass`` [kg] of each device moves with its attach point along the device only. ``push`` is the force [N]
    and moment [N m] in W of each load of the article, none of them where it is empty. ``tension`` is the part
    of the members' tension as drawn that acts.
    """

    gravity: Inexact[np.ndarray, "3"]
    anchor: Inexact[np.ndarray, "device 3"]
    attach_point: Int[np.ndarray, " device"]
    law: SpringLaw
    mass: Inexact[np.ndarray, " device"]
    push: Inexact[np.ndarray, "load 6"] = field(default_factory=lambda: np.zeros((0, 6)))
    ground: Ground = field(default_factory=Ground)
    tension: float = 1.0


class Inner(NamedTuple):
    """Internal forces: on the six deformations of each beam and bushing, and the tension of each spring."""

    beam: np.ndarray
    spring: np.ndarray
    device: np.ndarray
    bushing: np.ndarray
    ground: np.ndarray


def no_loads() -> Loads:
    """Loads in orbit: no gravity, no devices."""
    none = np.zeros(0)
    return Loads(
        gravity=np.zeros(3),
        anchor=np.zeros((0, 3)),
        attach_point=none.astype(int),
        law=SpringLaw(none, none, none),
        mass=none,
    )


def scale_loads(loads: Loads, factor: float) -> Loads:
    """Loads with gravity, preloads, tensions and applied loads times ``factor``; stiffnesses unchanged."""
    law = SpringLaw(loads.law.preload * factor, loads.law.stiffness, loads.law.length)
    return replace(
        loads,
        gravity=loads.gravity * factor,
        law=law,
        push=loads.push * factor,
        tension=loads.tension * factor,
    )
