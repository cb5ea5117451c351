"""Devices that hang an article, against closed forms of a rigid bar."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError, EquilibriumError
from middeck.files.setups import load_setup
from middeck.joints.friction import Friction
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.hanging.device_friction import estimate_rest_band, sweep_device_amplitude
from middeck.structure.model.article import AttachPoint, Damping
from middeck.structure.model.environment import AnchoredSpring, Device, DeviceKind, Environment, Suspension
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.rest.suspension_tuning import environment_loads, tune_suspension
from structure_builders import GRAVITY, TUBE, body, lab, member, node, rigid_bar, structure

ROOT = Path(__file__).parents[2]
G = 9.80665
MASS, HALF, TURN = (
    8.0,
    1.0,
    2.0,
)  # of the bar: kg, m from the middle to each attach point, kg m^2 about y and z
LENGTH, BOUNCE = 4.0, 0.25
K = 0.5 * MASS * (2.0 * np.pi * BOUNCE) ** 2  # of each of two devices that are tuned to the bar
SINK = G / (2.0 * np.pi * BOUNCE) ** 2
SPRING = DeviceKind.SPRING


def bar(*more: AttachPoint):
    """Hung at its centre of mass' own height: tilt and bounce are then apart from the pendulums."""
    parts = rigid_bar(MASS, 2.0 * HALF, (0.3, TURN, TURN))
    return dataclasses.replace(parts, attach_points=(*parts.attach_points, *more))


def tuned(**each) -> Environment:
    suspension = Suspension(
        attach=("left", "right"), held=("xyz", "yz"), cable_length=LENGTH, bounce_hz=BOUNCE, **each
    )
    return Environment(title="lab", gravity=GRAVITY, suspension=suspension)


def hung(*devices: Device, springs: tuple[AnchoredSpring, ...] = ()) -> Environment:
    return Environment(title="lab", gravity=GRAVITY, suspension=None, springs=springs, devices=devices)


def device(name: str, attach: str, **given) -> Device:
    """Tuned unless it is given a force."""
    base = {"bounce_hz": BOUNCE, "cable_length": LENGTH} | given
    return Device(name=name, attach=attach, held=base.pop("held", "" if "force" in base else "xyz"), **base)


def named(environment: Environment, parts=None) -> dict[str, float]:
    modes = solve_modes(solve_equilibrium(bar() if parts is None else parts, environment))
    return dict(zip(modes.name, modes.omega, strict=True))


def test_a_constant_force_has_no_static_deflection():
    """A rigid bar is already at rest where it was drawn."""
    rest = solve_equilibrium(bar(), tuned())
    assert rest.config.x[0] == pytest.approx(np.zeros(3), abs=1e-9)  # rounding of reactions over k
    assert rest.tension == pytest.approx(0.5 * MASS * G, rel=1e-9)
    assert rest.devices == ("left", "right")


def test_a_spring_from_unstretched_sinks_by_its_load_over_its_stiffness():
    environment = tuned(kind=SPRING)
    model = mesh_structure(bar())
    loads = environment_loads(model, environment, tune_suspension(model, environment))
    drawn = assemble(model, model.rest, loads)
    assert drawn.tension == pytest.approx(0.0, abs=1e-12)  # rounding of a length of metres times 10 N/m
    rest = solve_equilibrium(bar(), environment)
    # mg/2k = g/(2 pi f)^2 = 3.97 m; statics stop at 1e-9 of the weight.
    assert rest.config.x[0] == pytest.approx([0.0, -SINK, 0.0], abs=1e-8)
    loaded = rest.loads.anchor[0, 1] - rest.config.x[0, 1]
    assert loaded == pytest.approx(LENGTH, abs=1e-8)  # so that its pendulum is that of the other kind


def test_both_kinds_of_device_have_the_same_modes():
    """The same law about the rest state: bounce as tuned, pendulum of the loaded length."""
    constant, spring = named(tuned()), named(tuned(kind=SPRING))
    assert spring == pytest.approx(constant, rel=1e-8)  # statics to 1e-9 of the weight
    assert spring["bounce"] == pytest.approx(2.0 * np.pi * BOUNCE, rel=1e-8)
    assert spring["pendulum z"] == pytest.approx(np.sqrt(G / LENGTH), rel=1e-8)


def test_the_sheets_linear_spring_is_the_same_suspension():
    """Its words: unstretched length 4.0 - g/(2 pi 0.25)^2 = 0.0255 m from the same anchor, the same law."""
    files = ROOT / "articles/mace-simple.toml", ROOT / "environments/lab.toml"
    spring = solve_equilibrium(*load_setup(*files, ["suspension.device=spring"]))
    constant = solve_equilibrium(*load_setup(*files))
    assert spring.loads.law.length == pytest.approx(0.0255, abs=5e-5)  # the sheet's digits
    assert spring.tension == pytest.approx(constant.tension, rel=1e-7)
    ours, theirs = (solve_modes(rest).omega[:26] for rest in (spring, constant))
    assert ours == pytest.approx(theirs, rel=1e-8)  # the statics stop at 1e-9 of the weight


def test_unequal_loads_sink_by_the_same_way():
    """Every spring is tuned to its own load: a lopsided flexible article stays level all the way down."""
    nodes = [
        node("a", (0, 0, 0), body(2, (0, -0.1, 0), (0.1,) * 3)),
        node("b", (2, 0, 0), body(9, (0, -0.1, 0), (0.1,) * 3)),
    ]
    attach = [AttachPoint(n, n, np.array([0, 0.02, 0])) for n in "ab"]
    parts = structure(nodes, [member("a", "b", TUBE, 4)], attach=attach)
    environment = Environment(
        title="lab",
        gravity=GRAVITY,
        suspension=Suspension(
            attach=("a", "b"), held=("xyz", "yz"), cable_length=LENGTH, bounce_hz=BOUNCE, kind=SPRING
        ),
    )
    rest = solve_equilibrium(parts, environment)
    assert rest.tension[1] > 2.0 * rest.tension[0]
    sunk = rest.config.x[:2, 1]
    # What differs is the turn of the ends as the beam sags by millimetres, times 2 cm.
    assert sunk == pytest.approx(-SINK, abs=1e-3)


def test_moving_mass_slows_the_bounce_and_no_pendulum():
    m = 0.5
    omega = named(tuned(moving_mass=m))
    still = named(tuned())
    assert omega["bounce"] == pytest.approx(np.sqrt(2 * K / (MASS + 2 * m)), rel=1e-8)
    assert omega["tilt z"] == pytest.approx(np.sqrt(2 * K * HALF**2 / (TURN + 2 * m * HALF**2)), rel=1e-8)
    for name in ("pendulum x", "pendulum z", "yaw"):
        assert omega[name] == pytest.approx(still[name], rel=1e-8)


def test_devices_at_one_point_share_its_load():
    one = named(tuned())
    both = (
        device(f"{side} {i}", side, held="xyz" if side == "left" else "yz")
        for side in ("left", "right")
        for i in (1, 2)
    )
    environment = hung(*both)
    rest = solve_equilibrium(bar(), environment)
    assert rest.tension == pytest.approx(0.25 * MASS * G, rel=1e-9)
    assert rest.devices == ("left 1", "left 2", "right 1", "right 2")
    assert named(environment) == pytest.approx(one, rel=1e-8)


def test_two_slanted_cables_hold_a_point_across_by_their_slope():
    """A V of cables at 30 degrees to the vertical, each with R = mg/(2 cos)."""
    point = structure(
        [node("p", (0, 0, 0), body(5.0, inertia=(0.1,) * 3))], attach=[AttachPoint("p", "p", np.zeros(3))]
    )
    slope, length, k = np.radians(30.0), 2.0, 30.0
    anchors = [length * np.array([s * np.sin(slope), np.cos(slope), 0.0]) for s in (-1.0, 1.0)]
    environment = hung(
        *(
            Device(name=n, attach="p", held="xyz", stiffness=k, anchor=a)
            for n, a in zip("ab", anchors, strict=True)
        )
    )
    rest = solve_equilibrium(point, environment)
    R = 5.0 * G / (2.0 * np.cos(slope))
    assert rest.tension == pytest.approx(R, rel=1e-9)
    assert rest.config.x[0] == pytest.approx(np.zeros(3), abs=1e-9)
    tangent = assemble(rest.model, rest.config, rest.loads).tangent.toarray()
    across = 2 * (k * np.sin(slope) ** 2 + R / length * np.cos(slope) ** 2)
    upward = 2 * (k * np.cos(slope) ** 2 + R / length * np.sin(slope) ** 2)
    assert np.diag(tangent)[:3] == pytest.approx([across, upward, 2 * R / length], rel=1e-9)


def test_given_forces_act_while_the_others_are_tuned():
    """A third device takes 30 N off the two that are tuned; the bar still does not move."""
    middle = AttachPoint("middle", "bar", np.zeros(3))
    ends = (device("l", "left"), device("r", "right", held="yz"))
    rest = solve_equilibrium(bar(middle), hung(*ends, device("m", "middle", force=30.0)))
    assert rest.tension == pytest.approx([0.5 * (MASS * G - 30.0)] * 2 + [30.0], rel=1e-9)
    assert rest.config.x[0] == pytest.approx(np.zeros(3), abs=1e-9)
    with pytest.raises(EquilibriumError, match="cable at 'left' would be slack"):
        solve_equilibrium(bar(middle), hung(*ends, device("m", "middle", force=MASS * G + 1.0)))


def test_springs_act_while_devices_are_tuned():
    """A weak tie that pulls down by 3 N is borne by the devices, which leave the bar where it was drawn."""
    middle = AttachPoint("middle", "bar", np.zeros(3))
    tie = AnchoredSpring(
        name="tie", attach="middle", anchor=np.array([0.0, -2.0, 0.0]), stiffness=3.0, free_length=1.0
    )
    ends = (device("l", "left"), device("r", "right", held="yz"))
    rest = solve_equilibrium(bar(middle), hung(*ends, springs=(tie,)))
    assert rest.tension == pytest.approx([0.5 * (MASS * G + 3.0)] * 2 + [3.0], abs=1e-9 * MASS * G)
    # Pinning stops at 1e-9 of the weight, over 2 k.
    assert rest.config.x[0] == pytest.approx(np.zeros(3), abs=1e-9 * MASS * G / (2 * K))


def test_a_slack_device_is_named_and_a_spring_may_push():
    """On a stiff and a soft spring the bar tips, and its far end rises towards the device there."""
    points = {"far": -1.0, "mid": 0.0, "right": 1.0}
    parts = structure(
        [node("bar", (0, 0, 0), body(2.0, (0.5, 0, 0), (0.1, 0.2, 0.2)))],
        attach=[AttachPoint(n, "bar", np.array([x, 0.0, 0.0])) for n, x in points.items()],
    )
    springs = tuple(
        AnchoredSpring(name=n, attach=n, anchor=np.array([points[n], 2.0, 0.0]), stiffness=k, free_length=1.9)
        for n, k in (("mid", 1000.0), ("right", 100.0))
    )
    far = Device(
        name="far device",
        attach="far",
        kind=SPRING,
        force=5.0,
        stiffness=1.0,
        anchor=np.array([-1.0, 2.0, 0.0]),
    )
    with pytest.raises(EquilibriumError, match="slack at equilibrium: the cable of 'far device'") as error:
        solve_equilibrium(parts, hung(far, springs=springs))
    assert error.value.data["tension_n"]["far device"] < 0.0
    pushed = AnchoredSpring(
        name="far spring", attach="far", anchor=np.array([-1.0, 2.0, 0.0]), stiffness=1.0, free_length=2.0
    )
    assert solve_equilibrium(parts, lab(*springs, pushed)).tension[2] < 0.0


def test_friction_leaves_a_band_of_rest_states():
    """Each end may rest F/k off, the whole F/k up or down; askew by 2 F a over 2 k a^2 + m g h."""
    F, h = 0.2, 0.1
    low = rigid_bar(MASS, 2.0 * HALF, (0.3, TURN, TURN), attach_y=h)
    band = estimate_rest_band(solve_equilibrium(low, tuned(friction=Friction(F, 1e4))))
    askew = 2 * F * HALF / (2 * K * HALF**2 + MASS * G * h)
    assert band.device == ("left", "right")
    # Statics stop at 1e-9 of the weight.
    assert band.travel == pytest.approx(F / K, rel=1e-8)
    assert band.shift == pytest.approx([h * askew, F / K, 0.0], rel=1e-8, abs=1e-12)
    assert band.turn == pytest.approx([0.0, 0.0, askew], rel=1e-8, abs=1e-12)
    load = 0.5 * MASS * G
    stuck = hung(*(device(n, n, force=load - F, stiffness=K, bounce_hz=None) for n in ("left", "right")))
    assert solve_equilibrium(low, stuck).config.x[0, 1] == pytest.approx(-band.shift[1], rel=1e-6)  # 1e-8 m
    assert estimate_rest_band(solve_equilibrium(low, tuned())).travel.tolist() == [0.0, 0.0]


AMPLITUDES = np.array([1e-4, 2e-2, 1e-1])


def test_friction_stiffens_and_damps_the_bounce_by_its_describing_function():
    """By symmetry the shape stays: M s^2 + 2 (k + k_eq + j k_loss) = 0, whatever the amplitude."""
    law, m = Friction(0.3, 3000.0), 0.25
    modes = solve_modes(solve_equilibrium(bar(), tuned(friction=law, moving_mass=m)))
    curve = sweep_device_amplitude(modes, mode="bounce", amplitudes=AMPLITUDES, damping=Damping())
    equal = law.describing_function(AMPLITUDES)
    mass = MASS + 2 * m
    omega = np.sqrt(2 * (K + equal.stiffness) / mass)
    s = np.sqrt(-2 * (K + equal.stiffness + 1j * equal.loss) / mass + 0j)
    assert curve.omega == pytest.approx(omega, rel=1e-8)  # statics to 1e-9 of the weight
    assert curve.zeta == pytest.approx(np.abs(s.real) / np.abs(s), rel=1e-7, abs=1e-12)
    assert curve.travel == pytest.approx(np.tile(AMPLITUDES[:, None], 2), rel=1e-8)
    assert np.abs(curve.shape_change).max() < 1e-6
    # Stuck at 0.1 mm, the slip distance, without loss; ever freer from there.
    assert curve.frequency_hz[0] == pytest.approx(np.sqrt(2 * (K + 3000.0) / mass) / (2 * np.pi), rel=1e-8)
    assert np.all(np.diff(curve.omega) < 0.0)


def test_friction_decays_the_bounce_as_a_simulation_does():
    """One free swing of the bar on the time-domain law: its log decrement is 2 pi zeta/sqrt(1 - zeta^2).

    The amplitude falls by a tenth in the swing, which harmonic balance takes at its middle: an error of the
    square of it, and half a percent from the harmonics.
    """
    law, start = Friction(0.05, 5000.0), 0.1
    x, v, state, step = start, 0.0, 0.0, 1e-4
    _, state = law.resist(x, state)
    peaks, time = [start], 0.0
    while len(peaks) < 3:
        before, v_before = x, v
        force, state = law.resist(x, state)
        v -= step * 2.0 * (K * x + force) / MASS
        x += step * v
        time += step
        if v * v_before < 0.0:
            peaks.append(abs(before))
    modes = solve_modes(solve_equilibrium(bar(), tuned(friction=law)))
    middle = np.array([np.sqrt(peaks[0] * peaks[2])])
    curve = sweep_device_amplitude(modes, mode="bounce", amplitudes=middle, damping=Damping())
    zeta = float(curve.zeta[0])
    assert np.log(peaks[0] / peaks[2]) == pytest.approx(2 * np.pi * zeta / np.sqrt(1 - zeta**2), rel=0.01)
    assert time == pytest.approx(2 * np.pi / (curve.omega[0] * np.sqrt(1 - zeta**2)), rel=0.01)


def test_modal_and_viscous_damping_add():
    law, c = Friction(0.0, 1.0, viscous=0.4), 0.02
    modes = solve_modes(solve_equilibrium(bar(), tuned(friction=law)))
    curve = sweep_device_amplitude(modes, mode="bounce", amplitudes=AMPLITUDES, damping=Damping(suspension=c))
    # Friction that slips at once: only its drag, 2 c/(2 M omega), beside the mode's own ratio.
    assert curve.zeta == pytest.approx(c + 0.4 / (MASS * curve.omega), rel=1e-6)


# ---- what cannot be ----------------------------------------------------------------------------------------


def test_a_mode_that_moves_no_device_has_no_friction():
    modes = solve_modes(solve_equilibrium(bar(), tuned(friction=Friction(0.1, 1e3))))
    for mode, warning in (
        ("pendulum z", "moves no device"),
        ("bounze", "no mode 'bounze'"),
        (99, "no mode 99"),
    ):
        with pytest.raises(ConfigError, match=warning):
            sweep_device_amplitude(modes, mode=mode, amplitudes=AMPLITUDES)
    with pytest.raises(ConfigError, match="moves no device"):
        sweep_device_amplitude(
            solve_modes(solve_equilibrium(bar(), tuned())), mode="bounce", amplitudes=AMPLITUDES
        )


def test_friction_holds_a_free_motion_anywhere():
    parts = structure(
        [node("p", (0, 0, 0), body(5.0, inertia=(0.1,) * 3))], attach=[AttachPoint("p", "p", np.zeros(3))]
    )
    rest = solve_equilibrium(parts, hung(device("d", "p", friction=Friction(0.1, 1e3))))
    with pytest.raises(EquilibriumError, match="rest anywhere"):
        estimate_rest_band(rest)


IMPOSSIBLE = {
    "two stiffnesses": {"stiffness": 1.0},
    "two places": {"anchor": np.array([0.0, 4.0, 0.0])},
    "no stiffness": {"bounce_hz": None},
    "no place": {"cable_length": None},
    "pins of a force": {"force": 1.0, "held": "yz"},
    "no pins": {"held": ""},
    "a push": {"force": -1.0},
    "a nothing": {"force": float("nan")},
    "a lift": {"moving_mass": -1.0},
    "an endless mass": {"moving_mass": float("inf")},
    "no length": {"cable_length": 0.0},
}


@pytest.mark.parametrize("given", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_devices_that_cannot_be(given: dict):
    with pytest.raises(ConfigError, match="device 'd'"):
        device("d", "left", **given)


def test_a_spring_longer_than_its_cable_is_refused():
    short = Suspension(
        attach=("left", "right"), held=("xyz", "yz"), cable_length=3.9, bounce_hz=BOUNCE, kind=SPRING
    )
    with pytest.raises(
        ConfigError, match=r"is 3.974 m longer than free, more than its loaded length of 3.9 m"
    ):
        solve_equilibrium(bar(), Environment(title="lab", gravity=GRAVITY, suspension=short))


def test_an_anchor_below_cannot_be_tuned_and_one_at_the_article_has_no_direction():
    low = device("d", "left", cable_length=None, anchor=np.array([-1.0, -1.0, 0.0]))
    with pytest.raises(ConfigError, match=r"device 'd': its anchor lies -1 m above"):
        solve_equilibrium(bar(), hung(low))
    here = device("d", "left", cable_length=None, anchor=np.array([-1.0, 0.0, 0.0]))
    with pytest.raises(ConfigError, match="its anchor is its attach point"):
        solve_equilibrium(bar(), hung(here))
    with pytest.raises(ConfigError, match="two devices are called 'left'"):
        dataclasses.replace(tuned(), devices=(device("left", "left"),))


def test_without_gravity_only_given_devices_can_be():
    still = np.zeros(3)
    with pytest.raises(EquilibriumError, match="device 'd', tuned to its load, needs gravity"):
        solve_equilibrium(
            bar(),
            Environment(
                title="orbit", gravity=still, suspension=None, springs=(), devices=(device("d", "left"),)
            ),
        )
    pull = [
        Device(name=n, attach=n, force=2.0, stiffness=5.0, anchor=np.array([s * 3.0, 0.0, 0.0]))
        for n, s in (("left", -1.0), ("right", 1.0))
    ]
    rest = solve_equilibrium(
        bar(), Environment(title="tethered", gravity=still, suspension=None, springs=(), devices=tuple(pull))
    )
    assert rest.tension == pytest.approx(2.0)
