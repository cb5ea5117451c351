"""Derivatives of an article of which parts swing freely in orbit: by differences of frequencies."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import structure_builders as build
from middeck.structure.model.article import JointState, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.links import Link
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters, scale_parameters

ORBIT = Environment.orbit()
NAMES = ["node.b.mass", "member.a-b.EI_z", "node.c.inertia.zz"]
STEP = 1e-4


def chain(*last: tuple[str, str], **parts) -> Structure:
    """Three bodies, a tube between the first two, and what else is given."""
    bodies = [build.body(m, (0.0, 0.01, 0.0), (0.02, 0.03, 0.015)) for m in (2.0, 1.0, 3.0)]
    places = [(0.0, 0.0, 0.0), (0.7, 0.1, 0.0), (1.2, -0.3, 0.2)]
    nodes = [build.node(name, at, own) for name, at, own in zip("abc", places, bodies, strict=True)]
    members = [build.member(*ends, build.TURNING_TUBE, 2) for ends in (("a", "b"), *last)]
    return dataclasses.replace(build.structure(nodes, members), **parts)


def swinging() -> Structure:
    """The third hangs from the second by a tube, and a pendulum from it by a hinge that settles."""
    own = build.body(0.7, (0.0, -0.1, 0.02), (0.01, 0.004, 0.01))
    pendulum = build.joint("pendulum", "c", (0.0, 0.0, 1.0), own)
    return chain(("b", "c"), joints=(dataclasses.replace(pendulum, state=JointState.SPRUNG),))


def linked() -> Structure:
    """The third on a ball joint."""
    return chain(links=(Link(name="ball", first="b", second="c", about=""),))


def flexible(parts: Structure) -> np.ndarray:
    modes = solve_modes(solve_equilibrium(parts, ORBIT))
    return modes.frequency_hz[modes.kind.count("rigid") :][:5]


@pytest.mark.parametrize("article", [swinging, linked])
def test_derivatives_in_orbit_are_those_of_differences(article: Callable[[], Structure]):
    parts = article()
    modes = solve_modes(solve_equilibrium(parts, ORBIT))
    loose = modes.kind.count("rigid")
    assert loose > 6
    found = differentiate_frequencies(modes, find_parameters(parts, ORBIT, NAMES), loose + 5)
    for parameter, slope in zip(found.parameters, found.d_hz[:, loose:], strict=True):
        up, down = (
            flexible(scale_parameters(parts, {parameter.name: 1.0 + way * STEP})) for way in (1.0, -1.0)
        )
        expected = (up - down) / (2.0 * STEP * (parameter.value or 1.0))
        np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
