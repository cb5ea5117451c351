"""How articles hang and how they are levelled, against closed forms of rigid bodies."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError, EquilibriumError
from middeck.files.setups import load_setup
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.hanging.attitude import estimate_attitude
from middeck.structure.hanging.levelling import LEVEL, level
from middeck.structure.hanging.support_warnings import sag, warnings_on_attitude
from middeck.structure.model.article import AttachPoint
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Device, Environment, GroundBushing
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.rest.motion_as_a_whole import fit_rotation, split_rotation
from repeats import repeats
from structure_builders import GRAVITY, TUBE, body, lab, member, node, on_cables, springs_above, structure

ROOT = Path(__file__).parents[2]
UP = np.array([0.0, 1.0, 0.0])
OFF, DEPTH = 0.05, 0.2  # of the centre of mass [m]: beside the line of the cables, and below it


def lopsided():
    """A rigid bar on two cables, its weight beside and below their line."""
    ends = (("left", -1.0), ("right", 1.0))
    return structure(
        [node("bar", (0, 0, 0), body(8.0, (0.0, -DEPTH, OFF), (0.3, 2.0, 2.0)))],
        attach=[AttachPoint(n, "bar", np.array([x, 0.0, 0.0])) for n, x in ends],
    )


def cables(attach=("left", "right"), held=("xyz", "yz")) -> Environment:
    return on_cables(4.0, 0.25, held, attach=attach)


def pendant():
    """A rigid body on one cable, its weight to all sides of it."""
    return structure(
        [node("body", (0, 0, 0), body(2.0, (0.3, -0.1, 0.2), (0.1, 0.2, 0.3)))],
        attach=[AttachPoint("hook", "body", np.array([0.0, 0.1, 0.0]))],
    )


def one_cable() -> Environment:
    carried = Device(name="d", attach="hook", force=2.0 * 9.80665, stiffness=20.0, cable_length=3.0)
    return Environment(title="lab", gravity=GRAVITY, suspension=None, springs=(), devices=(carried,))


# What the statics' 1e-9 of the weight does to a tilt: over a centre of mass 0.1 m or more below.
ROUNDING = 2e-8


# ---- how it hangs ------------------------------------------------------------------------------------------


def test_on_one_cable_the_centre_of_mass_comes_under_it():
    """By the angle between what lies off and the vertical, whatever way it then faces."""
    hangs = estimate_attitude(solve_equilibrium(pendant(), one_cable()))
    off = np.array([0.3, -0.2, 0.2])
    assert hangs.hangs_from == "point"
    assert hangs.lies_off == pytest.approx(off, abs=1e-15)
    assert np.linalg.norm(hangs.tilt) == pytest.approx(np.arctan2(np.hypot(0.3, 0.2), 0.2), abs=ROUNDING)
    under = rotation_exp(hangs.heading * UP) @ rotation_exp(hangs.tilt) @ off
    assert under[[0, 2]] == pytest.approx(np.zeros(2), abs=ROUNDING)
    # About the level axis across the drawn `off`, whatever way the body then faces.
    across = np.cross(off, -UP) / np.hypot(0.3, 0.2)
    assert hangs.tilt == pytest.approx(across * np.arctan2(np.hypot(0.3, 0.2), 0.2), abs=ROUNDING)


def test_what_bushings_to_the_ground_and_clamps_hold_hangs_from_them():
    """As from cables: they are no devices, and a span of no points had no numbers."""
    stiff = np.diag([3e4, 3e4, 3e4, 0.0, 0.0, 0.0])
    soft = tuple(GroundBushing(name=n, attach=n, stiffness=stiff) for n in ("left", "right"))
    sprung = Environment(title="springs", gravity=GRAVITY, suspension=None, bushings=soft)
    hangs = estimate_attitude(solve_equilibrium(lopsided(), sprung))
    assert hangs.hangs_from == "line"
    assert hangs.lies_off == pytest.approx([0.0, -DEPTH, OFF], abs=1e-15)
    held = Environment(title="wall", gravity=GRAVITY, suspension=None, clamps=(Clamp(node="bar"),))
    built_in = estimate_attitude(solve_equilibrium(lopsided(), held))
    assert built_in.hangs_from == "point"
    assert built_in.lies_off == pytest.approx([0.0, -DEPTH, OFF], abs=1e-15)


def test_on_two_cables_it_rolls_until_its_weight_is_under_their_line():
    hangs = estimate_attitude(solve_equilibrium(lopsided(), cables()))
    roll = np.arctan2(OFF, DEPTH)  # by the right hand about x: from z down to -y
    assert hangs.tilt == pytest.approx([roll, 0.0, 0.0], abs=ROUNDING)
    assert hangs.node_tilt == pytest.approx(np.array([[roll, 0.0, 0.0]]), abs=ROUNDING)
    assert (hangs.hangs_from, hangs.device) == ("line", ("left", "right"))
    assert hangs.lies_off == pytest.approx([0.0, -DEPTH, OFF], abs=1e-15)
    assert hangs.tension == pytest.approx(4.0 * 9.80665, rel=1e-8)


@pytest.mark.parametrize(("off", "size"), [(0.01, 1.0), (0.25, 1.0), (0.25, 0.02), (0.12, 20.0)])
def test_hooks_above_a_body_on_its_node_let_it_roll_until_its_weight_is_under_them(off: float, size: float):
    """Drawn so, weight gives a roll no stiffness at all: only supports that carry it do."""
    inertia = (0.3 * size**2, 2.0 * size**2, 2.0 * size**2)
    above = structure(
        [node("bar", (0, 0, 0), body(8.0, (0.0, 0.0, off * size), inertia))],
        attach=[
            AttachPoint(n, "bar", size * np.array([x, 0.3, 0.0])) for n, x in (("left", -1.0), ("right", 1.0))
        ],
    )
    hangs = estimate_attitude(solve_equilibrium(above, cables()))
    assert hangs.tilt == pytest.approx([np.arctan2(off, 0.3), 0.0, 0.0], abs=ROUNDING)
    assert hangs.tension == pytest.approx(4.0 * 9.80665, rel=1e-8)


def dumbbell():
    """Two equal bodies on a beam, hung at both."""
    nodes = [node(n, (x, 0, 0), body(5, (0, -0.1, 0), (0.1,) * 3)) for n, x in (("a", 0.0), ("b", 2.0))]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in "ab"]
    return structure(nodes, [member("a", "b", TUBE, 4)], attach=attach)


def test_an_article_that_moved_without_strain_is_fitted_exactly():
    """By whatever rotation, far from the origin too."""
    rest = solve_equilibrium(dumbbell(), cables("ab"))
    drawn = rest.model.rest
    turned = rotation_exp(np.array([0.3, -1.1, 0.5]))
    moved = Configuration(drawn.x @ turned.T + [30.0, -4.0, 2.0], turned @ drawn.R, drawn.angle)
    found = fit_rotation(rest.model, rest.model.rest, moved)
    assert found == pytest.approx(turned, abs=1e-13)  # rounding of positions of 30 m


def test_a_twisted_article_that_turned_over_is_fitted_as_one():
    """Frames short of half a turn and beyond it are turned alike, not by opposite angles."""
    model = solve_equilibrium(dumbbell(), cables("ab")).model
    drawn, about = model.rest, np.array([1.0, 0.0, 0.0])
    over, twists = rotation_exp(np.pi * about), 0.02 * (drawn.x[:, 0] - 1.0)
    twisted = np.array([rotation_exp(twist * about) for twist in twists]) @ drawn.R
    fit = fit_rotation(model, drawn, Configuration(drawn.x, twisted, drawn.angle))
    found = fit_rotation(model, drawn, Configuration(drawn.x @ over.T, over @ twisted, drawn.angle))
    assert found == pytest.approx(over @ fit, abs=1e-12)  # rounding of logarithms


def test_a_beam_that_sags_evenly_is_level():
    """Its ends turn by opposite angles, which the fit takes the mean of."""
    hangs = estimate_attitude(solve_equilibrium(dumbbell(), cables("ab")))
    assert hangs.node_tilt[0, 2] == pytest.approx(-hangs.node_tilt[1, 2], rel=1e-6)  # statics
    assert abs(hangs.node_tilt[0, 2]) > 1e-3
    assert hangs.tilt == pytest.approx(np.zeros(3), abs=ROUNDING)


def test_a_rotation_is_a_tilt_and_then_a_turn_about_the_vertical():
    tilt = np.array([0.4, 0.0, -0.7])
    found, heading = split_rotation(rotation_exp(2.5 * UP) @ rotation_exp(tilt), UP)
    assert found == pytest.approx(tilt, abs=1e-14)  # rounding
    assert heading == pytest.approx(2.5, abs=1e-14)
    assert split_rotation(np.eye(3), UP)[0].tolist() == [0.0, 0.0, 0.0]


def test_nothing_is_level_in_orbit():
    with pytest.raises(ConfigError, match="level is undefined without gravity"):
        estimate_attitude(solve_equilibrium(pendant(), Environment.orbit()))


# ---- levelling ---------------------------------------------------------------------------------------------

# A tilt that counts as none, times the depth of the centre of mass.
NEAR = LEVEL * DEPTH


def test_one_hook_goes_over_the_centre_of_mass():
    """Both tilts, two offsets; the centre of mass is 0.3 m along x and 0.2 m along z from the hook."""
    found = level(pendant(), one_cable(), free=[("hook", "x"), ("hook", "z")], limit=0.5)
    assert found.change == pytest.approx([0.3, 0.2], abs=NEAR)
    assert found.structure.attach_points[0].offset == pytest.approx([0.3, 0.1, 0.2], abs=NEAR)
    assert np.abs(found.after.tilt).max() <= LEVEL
    assert np.linalg.norm(found.before.tilt) > 0.5
    assert found.history[-1] <= LEVEL
    assert found.equilibrium.model.structure == found.structure


def test_the_line_of_two_cables_goes_over_the_centre_of_mass():
    one = level(lopsided(), cables(), free=[("left", "z")], about="x", limit=0.2)
    assert one.change == pytest.approx([2 * OFF], abs=2 * NEAR)
    both = level(lopsided(), cables(), free=[("left", "z"), ("right", "z")], about="x")
    # The least change moves both alike.
    assert both.change == pytest.approx([OFF, OFF], abs=2 * NEAR)
    assert both.moved == (("left", "z"), ("right", "z"))


def test_a_level_article_stays_as_it_is():
    first = level(lopsided(), cables(), free=[("left", "z"), ("right", "z")], about="x")
    again = level(first.structure, cables(), free=[("left", "z")], about="x")
    assert again.change.tolist() == [0.0]
    assert again.structure == first.structure


@pytest.fixture(scope="module")
def simple():
    """The project's article without the offset that levels it."""
    return load_setup(
        ROOT / "articles/mace-simple.toml", ROOT / "environments/lab.toml", ["suspension.offsets.0.2=0"]
    )


def test_simple_is_levelled_by_the_offset_of_its_sheet(simple):
    """Unlevelled each node rolls by 5.5 to 8.3 degrees, as the sheet says; it levels by -0.0291 m."""
    found = level(*simple, free=[("n1", "z")], about="x")
    rolls = np.degrees(found.before.node_tilt[:, 0])
    assert np.abs([rolls.min(), rolls.max()]) == pytest.approx([8.3, 5.5], abs=0.05)  # the sheet's digits
    assert abs(np.degrees(found.before.tilt[0])) > 5.0
    assert found.change == pytest.approx([-0.0291], abs=5e-5)  # the sheet's digits
    assert np.abs(np.degrees(found.after.node_tilt[:, 0])).max() < 1e-3
    # Newton's method with an exact derivative squares its error, down to what statics leave.
    history = np.array(found.history)
    assert np.all(history[1:] < history[:-1] ** 2 + ROUNDING)
    assert found.before.hangs_from == "line"
    assert found.before.lies_off[2] == pytest.approx(-5.0 * 0.08 * np.sin(np.pi / 4) / 29.3, rel=0.01)


def test_a_chosen_node_may_be_level_instead(simple):
    found = level(*simple, free=[("n1", "z")], about="x", node="n5")
    assert abs(found.after.node_tilt[found.after.node.index("n5"), 0]) <= LEVEL
    assert found.change == pytest.approx([-0.0291], abs=5e-5)  # the article is stiff in torsion


# ---- refusals ----------------------------------------------------------------------------------------------


def test_fewer_offsets_than_tilts():
    with pytest.raises(ConfigError, match="1 offsets cannot remove 2 tilts, about x and z"):
        level(lopsided(), cables(), free=[("left", "z")])
    with pytest.raises(ConfigError, match="1 offsets cannot"):
        level(lopsided(), cables(), free=[("left", "z"), ("left", "z")])


def test_offsets_that_tilt_nothing():
    """Tuned to their loads, two devices hold a rigid bar's pitch wherever they are along it."""
    with pytest.raises(EquilibriumError, match="cannot be tilted about z") as error:
        level(lopsided(), cables(), free=[("left", "z"), ("right", "x")])
    assert error.value.data["change_m"] == {"left z": 0.0, "right x": 0.0}


def test_more_than_the_limit():
    with pytest.raises(EquilibriumError, match=r"more than the limit of 0.04 m") as error:
        level(lopsided(), cables(), free=[("left", "z")], about="x", limit=0.04)
    assert error.value.data["change_m"]["left z"] == pytest.approx(0.04)
    assert len(error.value.data["history"]) > 1


BAD = {
    "no such point": ({"free": [("middle", "z")]}, "no offset 'z' of an attach point 'middle'"),
    "no such axis": ({"free": [("left", "zz")]}, "no offset 'zz'"),
    "no axis": ({"free": [("left", "")]}, "no offset ''"),
    "the vertical": ({"about": "y"}, "no tilts about 'y'"),
    "an axis twice": ({"about": "xx"}, "no tilts about 'xx'"),
    "no tilt at all": ({"about": ""}, "no tilts about ''"),
    "no such node": ({"node": "bus"}, "no node 'bus'"),
    "a limit below zero": ({"limit": -1.0}, "a limit of -1.0 m"),
    "no limit": ({"limit": float("nan")}, "a limit of nan m"),
}


@pytest.mark.parametrize(("given", "message"), BAD.values(), ids=BAD)
def test_what_cannot_be_asked(given: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        level(lopsided(), cables(), **({"free": [("left", "z")], "about": "x"} | given))


def test_orbit_is_refused():
    with pytest.raises(ConfigError, match="without gravity"):
        level(lopsided(), Environment.orbit(), free=[("left", "z")], about="x")


def test_an_article_that_does_not_hang_is_reported():
    parts = dataclasses.replace(lopsided(), attach_points=lopsided().attach_points[:1])
    with pytest.raises(EquilibriumError, match="mechanism that moves under its weight"):
        level(parts, cables(("left",), ("yz",)), free=[("left", "z")], about="x")


@pytest.mark.parametrize("limit", repeats([0.05, 0.5, 0.1, 0.2]))
@pytest.mark.parametrize("shift", repeats([-0.01, 0.01, 0.005], 2))
def test_levelled_from_many_starts_whatever_the_limit(shift: float, limit: float):
    """The last step is tiny, and no sign of a lack of room."""
    article, environment = load_setup(
        ROOT / "articles" / "mace-simple.toml", ROOT / "environments" / "lab.toml"
    )
    moved = tuple(
        dataclasses.replace(a, offset=a.offset + np.array([0.0, 0.0, shift])) if a.name == "n3" else a
        for a in article.attach_points
    )
    started = dataclasses.replace(article, attach_points=moved)
    found = level(started, environment, free=[("n1", "z"), ("n3", "z"), ("n5", "z")], about="x", limit=limit)
    assert abs(found.after.tilt[0]) < 1e-7
    assert np.abs(found.change).max() <= limit


def test_an_offset_at_its_limit_leaves_the_rest_to_the_others():
    """The shortest change shares unequally; a limit a tenth below its largest part binds that one."""
    article, environment = load_setup(
        ROOT / "articles" / "mace-simple.toml",
        ROOT / "environments" / "lab.toml",
        ("suspension.offsets.0.2=0", "node.2.mass=30"),  # n3 bears most: its offset does most
    )
    free = [("n1", "z"), ("n3", "z"), ("n5", "z")]
    shared = level(article, environment, free=free, about="x", limit=0.1)
    tight = 0.9 * float(np.abs(shared.change).max())
    bound = level(article, environment, free=free, about="x", limit=tight)
    assert abs(bound.after.tilt[0]) < 1e-7
    assert 0.9 * tight < float(np.abs(bound.change).max()) <= tight * (1.0 + 1e-12)


def boom(section):
    """Hung by two points near one end, with two metres beyond them."""
    nodes = [
        node(name, (x, 0, 0), body(m)) for name, x, m in (("a", 0.0, 6.0), ("m", 0.5, 0.0), ("z", 2.5, 0.3))
    ]
    members = [member("a", "m", section, 2), member("m", "z", section, 4)]
    points = [AttachPoint(n, n, np.array([0.0, 0.02, 0.0])) for n in ("a", "m")]
    return structure(nodes, members, attach=points)


def test_what_turns_over_is_reported():
    """A bar that was drawn above its two points falls over; it bends by nothing."""
    section = dataclasses.replace(TUBE, rho_A=0.1)
    high = node("top", (0.3, 0.5, 0.01), body(5.0, inertia=(0.1, 0.1, 0.1)))
    nodes = [node("a", (0, 0, 0), body(0.1)), node("m", (0.5, 0, 0), body(0.1)), high]
    points = [AttachPoint(n, n, np.array([0.0, 0.02, 0.0])) for n in ("a", "m")]
    parts = structure(nodes, [member("a", "top", section, 2), member("m", "top", section, 2)], attach=points)
    environment = lab(*springs_above({"a": (0, 0, 0), "m": (0.5, 0, 0)}, 3.0, 100.0, 2.5))
    hung = estimate_attitude(solve_equilibrium(parts, environment))
    assert np.linalg.norm(hung.tilt) > np.radians(170.0)
    assert not sag(hung)
    (doubt,) = warnings_on_attitude(hung, environment)
    assert "turned over" in doubt.what
    assert "above its centre of mass" in doubt.hint


def test_what_sags_is_not_said_to_hang_tilted():
    """Beyond the last cable the boom bends by P L^2 / 2 EI + q L^3 / 6 EI; no attach point changes that."""
    soft = dataclasses.replace(TUBE, rho_A=0.1)
    hung = estimate_attitude(solve_equilibrium(boom(soft), cables(("a", "m"))))
    slope = np.linalg.norm(GRAVITY) * (0.3 * 2.0**2 / 2.0 + 0.1 * 2.0**3 / 6.0) / soft.EI_z
    by = dict(zip(hung.node, hung.node_tilt[:, 2], strict=True))
    assert by["m"] - by["z"] == pytest.approx(slope, rel=0.01)  # it hangs a few degrees down: cos is not 1
    message = sag(hung)
    assert "the article sags: its nodes tilt by" in message
    assert f"{np.degrees(abs(by['z'])):.1f} deg (z)" in message
    (doubt,) = warnings_on_attitude(hung, cables(("a", "m")))
    assert "--free" not in doubt.hint
    assert "hang it at more points" in doubt.hint
    with pytest.raises(EquilibriumError, match="the article sags") as error:
        level(boom(soft), cables(("a", "m")), free=[("a", "x")], about="z")
    assert "hang it at more points" in error.value.hint
    stiff = estimate_attitude(solve_equilibrium(lopsided(), cables()))
    assert not sag(stiff)
    (doubt,) = warnings_on_attitude(stiff, cables())
    assert "hangs tilted" in doubt.what
    assert "--free left.z --about x" in doubt.hint
