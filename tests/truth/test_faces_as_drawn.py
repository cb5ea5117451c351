"""Where nothing fixes how an article lies, it is nearest to its drawing, in any units and axes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.budget import build_budget
from middeck.structure.model.article import AttachPoint, Body, Spring, Structure
from middeck.structure.model.environment import Device, Environment
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, node_rotations, node_shifts, solve_equilibrium
from repeats import repeats
from structure_builders import member, node, structure

PLACES = {"a": (0.0, 0.0, 0.0), "b": (0.6, 0.1, 0.0), "c": (0.9, -0.4, 0.3), "d": (0.2, -0.5, -0.2)}
G = np.array([0.0, -9.81, 0.0])
# Rotation vector [rad] and shift [m] of the drawing, then by what a second and a metre are multiplied.
AS_DRAWN = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 1.0)
OTHERS = [
    ((2.4, 0.2, 1.7), (30.0, -80.0, 5.0), 1.0, 1.0),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1, 0.01),
    ((0.3, 1.0, -0.5), (0.0, 0.0, 0.0), 1.0, 1.0),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 7.0, 1.0),
]


def drawn(turn, shift, second: float, metre: float) -> tuple[Structure, Environment]:
    """Four bodies on soft tubes with a spring that is far too short, and one cable to hang it on."""
    R, force = rotation_exp(np.array(turn)), metre / second**2
    at = {name: R @ (metre * np.array(p)) + shift for name, p in PLACES.items()}
    bend, inertia = force * metre**2, metre**2 * R @ np.diag([0.02, 0.05, 0.04]) @ R.T
    tube = Section(
        EA=5e4 * force, GJ=9.0 * bend, EI_y=12.0 * bend, EI_z=20.0 * bend, GA_y=np.inf, GA_z=np.inf,
        rho_A=0.2 / metre, rho_I_y=1e-5 * metre, rho_I_z=2e-5 * metre,
    )  # fmt: skip
    bodies = [
        Body(m, R @ [0.02 * metre, 0.0, 0.0], (inertia + inertia.T) / 2.0) for m in (2.0, 1.0, 3.0, 0.5)
    ]
    parts = structure(
        [node(name, at[name], body) for name, body in zip(PLACES, bodies, strict=True)],
        [member(*ends, tube, 2, up=R @ [0.1, 0.2, 0.97]) for ends in ("ab", "bc", "bd")],
        attach=[AttachPoint(name, name, R @ [0.0, 0.1 * metre, 0.0]) for name in PLACES],
    )
    tight = Spring(name="tight", start="c", end="d", stiffness=100.0 * force / metre, free_length=0.2 * metre)
    hook = Device(
        name="hook", attach="b", force=60.0 * force, stiffness=300.0 * force / metre,
        anchor=at["b"] + R @ [0.0, 2.0 * metre, 0.0],
    )  # fmt: skip
    return dataclasses.replace(parts, springs=(tight,)), Environment(
        title="hook", gravity=R @ G * force, devices=(hook,)
    )


def rests(*how) -> tuple[Equilibrium, Equilibrium]:
    parts, hung = drawn(*how)
    return solve_equilibrium(parts, Environment.orbit()), solve_equilibrium(parts, hung)


@pytest.mark.parametrize("how", repeats(OTHERS, 2))
def test_how_it_floats_and_hangs_is_the_same_in_other_axes_and_units(how):
    R = rotation_exp(np.array(how[0]))
    for one, other in zip(rests(*AS_DRAWN), rests(*how), strict=True):
        assert max(np.linalg.norm(v) for v in node_rotations(one).values()) > 0.05
        for name, turned in node_rotations(one).items():
            np.testing.assert_allclose(R.T @ node_rotations(other)[name], turned, atol=1e-6)


@pytest.mark.parametrize(
    ("metre", "shift"),
    repeats([(1e-3, (1e3, 0.0, 0.0)), (0.01, (120.0, -150.0, 60.0)), (0.1, (0.0, 200.0, 0.0))]),
)
def test_a_small_article_far_away_lies_as_it_does_near(metre: float, shift: tuple[float, ...]):
    """To what its coordinates round by, 1e-16 of the distance over its size."""
    rounding = np.linalg.norm(shift) / metre * 1e-16
    ways = [((0.0, 0.0, 0.0), at, 1.0, metre) for at in ((0.0, 0.0, 0.0), shift)]
    for near, far in zip(*(rests(*how) for how in ways), strict=True):
        turns, others = (np.array(list(node_rotations(one).values())) for one in (near, far))
        np.testing.assert_allclose(others, turns, atol=20.0 * rounding)
        moved = [np.array(list(node_shifts(one).values())) / metre for one in (near, far)]
        np.testing.assert_allclose(*moved, atol=20.0 * rounding)


@pytest.mark.parametrize("how", repeats(OTHERS, 2))
def test_shares_of_gravity_are_the_same_in_other_axes_and_units(how):
    one, other = (build_budget(*map(solve_modes, rests(*h)), 12) for h in (AS_DRAWN, how))
    np.testing.assert_allclose(how[2] * other.share_hz, one.share_hz, rtol=1e-5, atol=1e-6)


def away(rest: Equilibrium, heading: float) -> float:
    """Mean square by mass of how far the nodes lie from the drawing, turned about the hook once more."""
    up, anchor = -rest.loads.gravity / 9.81, rest.loads.anchor[0]
    turn = Rotation.from_rotvec(heading * up)
    nodes = rest.model.structure.nodes
    off = [
        n.body.mass * np.sum((turn.apply(x - anchor) + anchor - n.position) ** 2)
        for n, x in zip(nodes, rest.poses.p, strict=False)
    ]
    return float(np.sum(off))


def test_no_other_heading_is_nearer_to_the_drawing():
    """By the bodies' places alone, without their turns and the tubes: to some hundredths of a radian."""
    hung = rests(*AS_DRAWN)[1]
    nearest = minimize_scalar(lambda angle: away(hung, angle), bounds=(-1.0, 1.0), method="bounded").x
    assert abs(nearest) < 0.1
