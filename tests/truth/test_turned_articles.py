"""An article that was drawn turned falls back to how it hangs: what gravity does to its modes is the same."""

from __future__ import annotations

import dataclasses
import functools
import re

import numpy as np
import pytest

from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.budget import build_budget
from middeck.structure.gravity.compare_modes import ModeComparison, compare_modes
from middeck.structure.gravity.path import follow_gravity
from middeck.structure.model.article import AttachPoint, Body, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import TUBE, TURNING_TUBE, body, lab, member, node, springs_above, structure

PLACES = {"a": (0.0, 0.0, 0.0), "b": (0.7, 0.3, 0.0), "c": (1.5, 0.1, 0.4), "d": (0.6, -0.5, -0.3)}
MEMBERS = ("ab", "bc", "bd")
# Rotation vectors [rad] of the drawing; last an article that was drawn upside down.
TURNS = [(0.0, 0.0, 0.2), (0.0, 1.2, 0.0), (0.9, 0.4, -0.7), (0.3, -0.5, 2.9)]


def drawn(turn: tuple[float, float, float]) -> tuple[Structure, Environment]:
    """Four bodies on three tubes, hung on one spring at the second."""
    R = rotation_exp(np.array(turn))
    cg, inertia = R @ [0.02, -0.03, 0.01], R @ np.diag([0.02, 0.05, 0.04]) @ R.T
    bodies = [Body(mass, cg, (inertia + inertia.T) / 2.0) for mass in (2.0, 1.0, 3.0, 4.0)]
    parts = structure(
        [node(name, R @ at, body) for (name, at), body in zip(PLACES.items(), bodies, strict=True)],
        [member(*ends, TURNING_TUBE, 2, up=R @ [0.1, 0.2, 0.97]) for ends in MEMBERS],
        attach=[AttachPoint("b", "b", R @ np.array([0.1, 0.25, 0.0]))],
    )
    above = springs_above({"b": R @ np.array(PLACES["b"])}, 3.0, stiffness=100.0, free_length=2.0)
    return parts, lab(*above)


# Names of modes are of the axes as drawn.
DIRECTION = re.compile(r"\b[xyz](-[xyz])?\b")


@functools.cache
def solved(turn: tuple[float, float, float]) -> tuple[Modes, Modes]:
    """In orbit and in the laboratory."""
    parts, hung = drawn(turn)
    orbit, rest = (solve_equilibrium(parts, e) for e in (Environment.orbit(), hung))
    return solve_modes(orbit), solve_modes(rest)


def compared(turn: tuple[float, float, float]) -> ModeComparison:
    return compare_modes(*solved(turn))


@pytest.mark.parametrize("turn", TURNS)
def test_a_comparison_is_that_of_the_article_drawn_as_it_hangs(turn):
    level, turned = compared((0.0, 0.0, 0.0)), compared(turn)
    assert turned.pairs.tolist() == level.pairs.tolist()
    assert turned.ratio == pytest.approx(level.ratio, rel=1e-6)
    flexible = [i for i, kind in enumerate(level.orbit.kind[: level.count]) if kind == "flexible"]
    np.testing.assert_allclose(
        turned.cross_orthogonality[flexible], level.cross_orthogonality[flexible], atol=1e-4
    )
    np.testing.assert_allclose(turned.mac[flexible], level.mac[flexible], atol=1e-4)
    np.testing.assert_allclose(turned.subspace_angle, level.subspace_angle, atol=1e-4)
    unnamed, unturned = ([DIRECTION.sub("", text) for text in of.warnings] for of in (turned, level))
    assert unnamed == unturned


@pytest.mark.parametrize("turn", TURNS)
def test_a_budget_follows_each_mode_to_its_own(turn):
    """A tilt is part of the deformation: shares differ, the modes and their whole shifts do not."""
    level, turned = (build_budget(*solved(t)) for t in ((0.0, 0.0, 0.0), turn))
    flexible = [k for k, (i, _) in enumerate(level.pairs) if level.orbit.kind[i] == "flexible"]
    assert turned.pairs[flexible].tolist() == level.pairs[flexible].tolist()
    assert turned.shift_hz[flexible] == pytest.approx(level.shift_hz[flexible], rel=1e-5, abs=1e-7)
    assert turned.match[flexible, 1, 1, 1] == pytest.approx(level.match[flexible, 1, 1, 1], abs=1e-4)


@pytest.mark.parametrize("turn", repeats(TURNS[::-1]))
def test_a_path_ends_in_orbit_at_the_partners_of_a_comparison(turn):
    found, path = compared(turn), follow_gravity(*drawn(turn), count=16)
    partner = {j: i for i, j in found.pairs.tolist()}
    for j, name in enumerate(path.name):
        if j in partner and path.kind[j] == "flexible":
            expected = found.orbit.frequency_hz[partner[j]]
            assert np.sqrt(path.omega2[-1, j]) / (2.0 * np.pi) == pytest.approx(expected, rel=1e-6), name


def rolled(roll: float) -> ModeComparison:
    """Lumped masses on a thin beam, without inertia about it, drawn rolled from how it hangs on springs."""
    R, places = (
        rotation_exp(np.array([roll, 0.0, 0.0])),
        {n: (0.6 * k, 0.0, 0.0) for k, n in enumerate("abcd")},
    )
    blade = dataclasses.replace(TUBE, EI_z=60.0)
    parts = structure(
        [node(n, places[n], body(mass)) for n, mass in zip(places, (2.0, 1.0, 1.0, 3.0), strict=True)],
        [member(*ends, blade, 2, up=R @ [0.0, 1.0, 0.0]) for ends in ("ab", "bc", "cd")],
        attach=[AttachPoint(n, n, R @ np.array([0.0, 0.15, 0.0])) for n in "ad"],
    )
    above = springs_above({n: places[n] for n in "ad"}, 2.0, stiffness=150.0, free_length=1.8)
    orbit, rest = (solve_equilibrium(parts, e) for e in (Environment.orbit(), lab(*above)))
    return compare_modes(solve_modes(orbit), solve_modes(rest))


def test_masses_in_one_line_roll_as_their_frames_do():
    """Their inertia says nothing of the roll, which swaps bendings: 1.29 and 0.82 for 1.06 and 1.00."""
    level, turned = rolled(0.0), rolled(0.8)
    assert turned.pairs.tolist() == level.pairs.tolist()
    assert turned.ratio == pytest.approx(level.ratio, rel=1e-6)
    assert level.ratio[:2] == pytest.approx([1.06, 1.0], abs=0.01)
    cross = [c.cross_orthogonality[tuple(c.pairs.T)] for c in (turned, level)]
    assert cross[0] == pytest.approx(cross[1], abs=1e-4)


def test_turned_articles_have_turned_far():
    """Without the turn of its axes a shape has next to nothing in common with its own."""
    orbit, hung = solved(TURNS[-1])
    first = orbit.kind.index("flexible")
    cross = np.abs(orbit.shapes[:, first] @ (orbit.mass @ hung.shapes))
    assert cross.max() < 0.9
