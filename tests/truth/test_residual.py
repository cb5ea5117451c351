"""What truncation takes from static gains, and that the residual flexibility gives it back."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import ConfigError, NumericalError
from middeck.structure.model.article import (
    Actuator,
    ActuatorKind,
    AttachPoint,
    Damping,
    Section,
    Sensor,
    SensorKind,
)
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.residual_flexibility import (
    compare_static_gain,
    complete_response,
    left_out_gain,
)
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.state_space.modal_system import modal_response, output_rows
from structure_builders import TURNING_TUBE, body, member, node, on_cables, spin, structure, tube_bus

BARE = Section(
    EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0
)  # no rotary inertia: Bernoulli's closed forms
X, Y, Z = np.eye(3)
PORTS = ("wheel", "tilted", "motor")
ALL = 10**6
UNDAMPED = Damping()


def article():
    """A bus with a payload on a free axis; torques and angles in pairs, a force and accelerometers."""
    slanted, tip = np.array([0.6, 0.0, 0.8]), np.array([0.02, -0.1, 0.03])
    actuators = [
        Actuator(name="wheel", frame="a", axis=Z),
        Actuator(name="tilted", frame="b", axis=slanted),
        Actuator(name="motor", frame="p", axis=None),
        Actuator(name="push", frame="b", axis=slanted, kind=ActuatorKind.FORCE, offset=tip),
    ]
    sensors = [
        Sensor(name="wheel", frame="a", axis=Z, axis_frame="a"),
        Sensor(name="tilted", frame="b", axis=slanted, axis_frame="b"),
        Sensor(name="motor", frame="p", axis=None),
        Sensor(
            name="feel", frame="b", axis=slanted, axis_frame="", kind=SensorKind.ACCELEROMETER, offset=tip
        ),
    ]
    payload = body(2.0, (0, -0.2, 0), (0.1,) * 3)
    more = {"parent": "b", "angle": 0.7, "elements": 4, "actuators": actuators, "sensors": sensors}
    return tube_bus((4.0, 4.0), (0, -0.05, 0.01), (0.1, 0.2, 0.3), payload, **more)


def lab_modes() -> Modes:
    return solve_modes(solve_equilibrium(article(), on_cables(4.0, 0.25, ("xyz", "yz"))))


def orbit_modes() -> Modes:
    return solve_modes(solve_equilibrium(article(), Environment.orbit()))


def response(modes: Modes, hz: float, outputs=PORTS, inputs=PORTS, **kw) -> np.ndarray:
    plant = build_plant(modes, inputs=inputs, outputs=outputs, damping=UNDAMPED, **kw)
    return modal_response(plant.dynamics, np.array([2.0 * np.pi * hz]))[0]


@pytest.mark.parametrize("count", [0, 6, 9, 20])
def test_truncated_and_residual_are_the_full_static_gain(count: int):
    modes = lab_modes()
    full, some = response(modes, 0.0, count=ALL), response(modes, 0.0, count=count, static=True)
    scale = np.abs(full).max()
    # Rounding of K^-1, of condition 1e8 (stiff bar, soft pendulum), on either side.
    np.testing.assert_allclose(some, full, atol=1e-10 * scale)
    # The modes alone are short of it, by a thousand times more.
    short = np.abs(response(modes, 0.0, count=count) - full).max()
    assert short > 1e3 * np.abs(some - full).max()


@pytest.mark.parametrize("count", [7, 9, 20])
def test_a_free_structure_keeps_the_flexibility_of_its_elastic_part(count: int):
    modes = orbit_modes()
    got = build_plant(modes, inputs=PORTS, outputs=PORTS, count=count, static=True).dynamics.direct
    all_of_them = build_plant(modes, inputs=PORTS, outputs=PORTS, count=ALL).dynamics
    rest = slice(count, None)
    flexible = slice(7, None)
    expected, elastic = (
        all_of_them.phi[:, m] / all_of_them.omega[m] ** 2 @ all_of_them.psi[m] for m in (rest, flexible)
    )
    # What is left is the difference of two flexibilities: rounding of the whole, of condition 1e4.
    np.testing.assert_allclose(got, expected, atol=1e-12 * np.abs(elastic).max())


@pytest.mark.parametrize("modes", [lab_modes(), orbit_modes()], ids=["lab", "orbit"])
def test_the_error_falls_with_the_square_of_frequency(modes: Modes):
    """What is left is -omega^2 / omega_k^4 of each mode left out: a quarter at half the frequency."""
    count = 9
    low = 0.03 * modes.frequency_hz[count]
    error = [
        np.abs(response(modes, hz, count=count, static=True) - response(modes, hz, count=ALL)).max()
        for hz in (low, 2.0 * low)
    ]
    # The next term is (0.06)^2 of this one.
    assert error[1] / error[0] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("modes", [lab_modes(), orbit_modes()], ids=["lab", "orbit"])
def test_reciprocity(modes: Modes):
    """Angle and torque at one place and axis: the residual is symmetric (Maxwell) and not negative."""
    direct = build_plant(modes, inputs=PORTS, outputs=PORTS, count=9, static=True).dynamics.direct
    np.testing.assert_allclose(direct, direct.T, atol=1e-10 * np.abs(direct).max())  # rounding of K^-1
    assert np.linalg.eigvalsh(0.5 * (direct + direct.T)).min() > -1e-10 * np.abs(direct).max()


def on_springs(k: float, d: float):
    """A massless-ended cantilever whose root is held by six springs at rest: stiffness known exactly."""
    places = {"y1": d * X, "y2": -d * X, "x1": d * Z, "x2": -d * Z, "z1": d * Y, "z2": -d * Y}
    attach = [AttachPoint(n, "root", p) for n, p in places.items()]
    along = {"x": X, "y": Y, "z": Z}
    springs = tuple(
        AnchoredSpring(name=n, attach=n, anchor=p + along[n[0]], stiffness=k, free_length=1.0)
        for n, p in places.items()
    )
    nodes = [node("root", (0, 0, 0), body(3.0, inertia=(0.1, 0.1, 0.1))), node("tip", (2.0, 0, 0))]
    ports = (
        [Actuator(name="moment", frame="tip", axis=Z)],
        [
            Sensor(name="turn", frame="tip", axis=Z, axis_frame="tip"),
            Sensor(name="root", frame="root", axis=Z, axis_frame="root"),
        ],
    )
    beam = structure(nodes, [member("root", "tip", BARE, 3)], (), (), attach, *ports)
    return beam, Environment(title="springs", gravity=np.zeros(3), suspension=None, springs=springs)


@pytest.mark.parametrize("count", [0, 6, 10])
def test_tip_moment_on_a_cantilever(count: int):
    # theta = M (L / EI + 1 / (2 k d^2)): a beam under constant moment on a root of known stiffness.
    k, d, L, EI = 5e3, 0.3, 2.0, 100.0
    modes = solve_modes(solve_equilibrium(*on_springs(k, d)))
    H = response(modes, 0.0, ("turn", "root"), ("moment",), count=count, static=True)[:, 0]
    root = 1.0 / (2.0 * k * d**2)
    np.testing.assert_allclose(H, [L / EI + root, root], rtol=1e-9)  # rounding of K^-1, condition 1e6


def free_beam_gain(elements: int) -> np.ndarray:
    """Residual turns of both ends per unit moment at one, all flexible modes left out; L / EI = 0.02."""
    nodes = [node("a", (0, 0, 0)), node("b", (2.0, 0, 0))]
    # A bare line has no inertia about itself: give it some, it does not take part.
    nodes[0] = node("a", (0, 0, 0), spin(0.0, (1e-3, 0.0, 0.0)))
    ports = (
        [Actuator(name="m", frame="b", axis=Z)],
        [
            Sensor(name="b", frame="b", axis=Z, axis_frame="b"),
            Sensor(name="a", frame="a", axis=Z, axis_frame="a"),
        ],
    )
    beam = structure(nodes, [member("a", "b", BARE, elements)], (), (), (), *ports)
    modes = solve_modes(solve_equilibrium(beam, Environment.orbit()))
    return build_plant(modes, inputs=["m"], outputs=["b", "a"], count=6, static=True).dynamics.direct[:, 0]


def test_end_moment_on_a_free_beam():
    """Balanced by its inertia, a uniform free beam turns at its ends by 13/35 and -9/70 of M L / EI.

    EI w^iv = -12 M (x - L/2) / L^3, moments 0 and M at the ends, w orthogonal to both rigid motions.
    """
    exact = 0.02 * np.array([13.0 / 35.0, -9.0 / 70.0])
    for n in (4, 8):
        # Nodes are exact; cubics between them miss w^iv h^4/720 on average: a rotation, the same at both
        # ends. The next order is a part 1/n^2 of it.
        missed = -12.0 / 720.0 / n**4 * 0.02
        np.testing.assert_allclose(free_beam_gain(n) - exact, missed, rtol=1.0 / n**2)


def test_rates_and_accelerations_get_none():
    modes = lab_modes()
    outputs = ["wheel_rate", "feel"]
    plant = build_plant(modes, inputs=["push"], outputs=outputs, count=9, static=True)
    assert plant.dynamics.direct[0, 0] == 0.0
    # The accelerometer's static part is g times the tilt that the force leaves, of which modes are a part.
    full = response(modes, 0.0, ("feel",), ("push",), count=ALL)
    some = response(modes, 0.0, ("feel",), ("push",), count=9, static=True)
    np.testing.assert_allclose(some, full, rtol=1e-8)
    free = build_plant(orbit_modes(), inputs=["push"], outputs=outputs, count=9, static=True)
    np.testing.assert_allclose(free.dynamics.direct, 0.0, atol=0.0)  # no gravity to tilt against
    assert np.abs(output_rows(free.dynamics).direct[1, 0]) > 0.0  # but an acceleration at once


def test_off_by_default():
    plant = build_plant(lab_modes(), inputs=PORTS, outputs=PORTS)
    assert plant.dynamics.direct is None
    assert not plant.system.D.any()


def test_the_effect_on_low_frequency_gain_is_stated():
    modes = lab_modes()
    found = compare_static_gain(modes, inputs=PORTS, outputs=PORTS, count=9)
    assert found.frequency_hz == 0.0
    full, cut = response(modes, 0.0, count=ALL).real, response(modes, 0.0, count=9).real
    np.testing.assert_allclose(found.full, full, atol=1e-8 * np.abs(full).max())
    np.testing.assert_allclose(found.truncated, cut, atol=1e-12 * np.abs(cut).max())
    np.testing.assert_allclose(found.truncated_error, np.abs(cut - full) / np.abs(full), atol=1e-7)
    assert found.completed_error.max() < 1e-8
    assert found.truncated_error.max() > 1e-3


def test_the_effect_on_a_free_structure_is_stated_at_a_frequency():
    modes = orbit_modes()
    found = compare_static_gain(modes, inputs=PORTS, outputs=[*PORTS, "wheel_rate", "feel"], count=9)
    flexible = modes.frequency_hz[modes.omega > 0.0].min()
    assert found.frequency_hz == pytest.approx(0.1 * flexible)
    everything = [*PORTS, "wheel_rate", "feel"]
    full = response(modes, found.frequency_hz, everything, count=ALL)
    # The direct solution against the sum over modes: both cancel by the rigid part, 1e2 of rounding.
    np.testing.assert_allclose(np.abs(found.full), np.abs(full), rtol=1e-8)
    angles = slice(0, 3)
    # What is left is (0.1 f1 / f10)^2 of what was missing; far below 1 % of it.
    assert found.completed_error[angles].max() < 0.01 * found.truncated_error[angles].max()


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("modes", [lab_modes(), orbit_modes()], ids=["lab", "orbit"])
def test_what_modes_left_out_would_add_below_and_beyond_them(modes: Modes, static: bool):
    count, outputs = 9, [*PORTS, "wheel_rate", "feel"]
    hz = modes.frequency_hz[count] * np.array([0.05, 0.9, 7.0])
    found = left_out_gain(modes, inputs=PORTS, outputs=outputs, count=count, frequency_hz=hz, static=static)
    whole = np.array([response(modes, f, outputs, count=ALL) for f in hz])
    plant = build_plant(modes, inputs=PORTS, outputs=outputs, count=count, damping=UNDAMPED, static=static)
    kept = evaluate_plant(plant, hz)
    if static:
        kept = complete_response(modes, kept, inputs=PORTS, outputs=outputs, count=count)
    # Rounding of the sum over modes, next to the largest gain of each output.
    scale = np.abs(whole).max(axis=(0, 2))[:, None]
    np.testing.assert_allclose(np.abs(found) / scale, np.abs(whole - kept.H) / scale, atol=1e-9)


def test_an_uncoupled_pair_has_no_relative_error():
    nodes = [node(n, (x, 0, 0), body(1.0, inertia=(0.1, 0.1, 0.1))) for n, x in (("a", 0.0), ("b", 1.0))]
    ports = (
        [Actuator(name="t", frame="a", axis=Z)],
        [
            Sensor(name="z", frame="b", axis=Z, axis_frame="b"),
            Sensor(name="x", frame="b", axis=X, axis_frame="b"),
        ],
    )
    beam = structure(nodes, [member("a", "b", TURNING_TUBE, 2)], (), (), (), *ports)
    modes = solve_modes(solve_equilibrium(beam, Environment.orbit()))
    found = compare_static_gain(modes, inputs=["t"], outputs=["z", "x"], count=8)
    assert np.isfinite(found.truncated_error[0, 0])
    assert np.isnan(found.truncated_error[1, 0])  # bending in the plane of symmetry does not twist
    left_out = left_out_gain(modes, inputs=["t"], outputs=["z", "x"], count=8, frequency_hz=np.array([50.0]))
    assert left_out[0, 0, 0] != 0.0
    assert left_out[0, 1, 0] == 0.0


def test_what_has_no_static_answer_is_refused():
    modes = orbit_modes()
    with pytest.raises(ConfigError, match="rigid") as refused:
        build_plant(modes, inputs=PORTS, outputs=PORTS, count=3, static=True)
    assert "7 modes or more" in refused.value.hint
    with pytest.raises(ConfigError, match="0 Hz"):
        compare_static_gain(modes, inputs=PORTS, outputs=PORTS, frequency_hz=0.0)


def test_a_resonance_and_a_rigid_body_are_refused():
    modes = orbit_modes()
    resonance = float(modes.frequency_hz[8])
    with pytest.raises(NumericalError, match=f"frequency of mode {modes.name[8]!r}"):
        compare_static_gain(modes, inputs=PORTS, outputs=PORTS, count=7, frequency_hz=resonance)
    bar = structure(
        [node("a", (0, 0, 0), body(1.0, inertia=(0.1, 0.1, 0.1)))],
        sensors=[Sensor(name="z", frame="a", axis=Z, axis_frame="a")],
    )
    alone = solve_modes(solve_equilibrium(bar, Environment.orbit()))
    with pytest.raises(ConfigError, match="0 Hz"):
        compare_static_gain(alone, inputs=[], outputs=["z"])


@pytest.mark.parametrize("output", ["feel", "tilted_rate"])
def test_accelerations_and_rates_get_what_is_left_out(output: str):
    """Below the first mode left out: against a plant of all modes."""
    modes = lab_modes()
    kept = modes.kind.index("flexible") + 2
    hz = modes.frequency_hz[kept] * np.array([0.2, 0.35])
    ports = {"inputs": ["push"], "outputs": [output]}
    full = evaluate_plant(build_plant(modes, count=len(modes.omega), **ports), hz).H
    cut = evaluate_plant(build_plant(modes, count=kept, static=True, **ports), hz)
    completed = complete_response(modes, cut, count=kept, **ports).H
    np.testing.assert_array_less(np.abs(completed - full), 0.2 * np.abs(cut.H - full))
