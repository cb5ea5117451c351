"""Joints that slide: exact derivatives in chains with gimbals; a proof mass on a pendulum in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, EquilibriumError
from middeck.files.setups import load_structure
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import Loads, no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model, mesh_structure
from middeck.structure.elements.frames import Configuration, frame_poses, move, points_in_world, pose_jacobian
from middeck.structure.elements.springs_and_cables import SpringLaw
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    Damper,
    DamperPlace,
    Damping,
    Joint,
    JointState,
    Section,
    Sensor,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring
from middeck.structure.modes.solve import solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.state_space.modal_system import modal_response
from structure_builders import (
    GRAVITY,
    NONE,
    body,
    clamped_matrices,
    joint,
    lab,
    member,
    newton,
    node,
    random_configuration,
    structure,
)

TUBE = Section(
    EA=2e4, GJ=30.0, EI_y=50.0, EI_z=80.0, rho_A=0.5, rho_I_y=2e-4, rho_I_z=3e-4, GA_y=4e4, GA_z=3e4
)
UNEQUAL = (0.03, 0.01, 0.02)
X, Z = np.eye(3)[0], np.eye(3)[2]
G = 9.80665
# A pure imaginary step: what it changes is exact to rounding, however small it is (Squire and Trapp 1998).
STEP = 1e-30


def sliding_model() -> Model:
    """A turn on a slide on a turn, and a slide on a slide, under weight and devices."""
    tilted = np.array([0.6, 0.0, 0.8])
    nodes = [
        node("a", (0, 0, 0), body(2.0, (0.02, -0.03, 0.01), UNEQUAL), size=0.1),
        node("b", (1, 0.2, 0), body(1.0, (0.0, -0.05, 0.02), UNEQUAL), size=0.06),
    ]

    def slide(name: str, parent: str, offset, axis, at: float, rest: float) -> Joint:
        mass = body(0.7, (0.01, 0.02, -0.03), UNEQUAL)
        more = {"offset": offset, "angle": at, "stiffness": 30.0, "target": rest, "slides": True}
        return joint(name, parent, axis, mass, **more)

    joints = [
        joint("t1", "a", X, body(0.5, (0, 0.01, 0)), offset=(0.0, -0.1, 0.05), angle=0.5),
        slide("s1", "t1", [0.03, 0.0, 0.02], tilted, 0.2, -0.1),
        joint("t2", "s1", Z, body(1.5, (0.05, -0.2, 0.1), UNEQUAL), offset=(0.0, 0.05, 0.1), angle=-0.4),
        slide("s2", "b", [0.0, 0.1, 0.0], Z, -0.1, 0.0),
        slide("s3", "s2", [0.1, 0.0, 0.0], tilted, 0.3, 0.2),
    ]
    attach = [
        AttachPoint("top", "a", np.array([0, 0.05, 0.02])),
        AttachPoint("arm", "t2", np.array([0.1, 0.0, -0.1])),
        AttachPoint("far", "s3", np.array([0, 0.05, 0])),
    ]
    return mesh_structure(structure(nodes, [member("a", "b", TUBE, 2)], joints, attach=attach))


def loads_of(model: Model) -> Loads:
    anchors = np.array([[0.1, 3.0, 0.2], [1.0, 2.0, -0.3], [0.4, 2.5, 0.3]])
    law = SpringLaw(np.array([20.0, 10.0, 15.0]), np.array([5.0, 4.0, 6.0]), np.array([2.5, 2.0, 2.2]))
    return Loads(
        gravity=GRAVITY + np.array([1.0, 0.0, 2.0]),
        anchor=anchors,
        attach_point=model.attach_point,
        law=law,
        mass=np.zeros(3),
    )


def ahead(model: Model, config: Configuration, direction: np.ndarray) -> Configuration:
    return move(model.tree, config, 1j * STEP * direction)


@pytest.mark.parametrize("seed", range(2))
def test_gradient_is_the_slope_of_the_energy(seed: int):
    model, rng = sliding_model(), np.random.default_rng(seed)
    config, loads = random_configuration(model, rng, 0.15), loads_of(model)
    at = assemble(model, config, loads)
    slopes = [
        np.imag(assemble(model, ahead(model, config, e), loads).energy) / STEP
        for e in np.eye(model.tree.size)
    ]
    # Rounding of a sum of terms a thousand times its largest entry.
    assert np.array(slopes) == pytest.approx(at.gradient, abs=1e-12 * np.abs(at.gradient).max())


@pytest.mark.parametrize("seed", range(2))
def test_tangent_is_the_derivative_of_the_force(seed: int):
    """Along a straight line s d of the chart the slope is g(s).d throughout, so its change is d'K d."""
    model, rng = sliding_model(), np.random.default_rng(10 + seed)
    config, loads = random_configuration(model, rng, 0.15), loads_of(model)
    K = assemble(model, config, loads).tangent.toarray()
    n, joints = model.tree.size, np.arange(6 * model.tree.roots, model.tree.size)
    directions = [*np.eye(n)[joints], *(np.eye(n)[i] + np.eye(n)[j] for i in joints for j in joints if i < j)]
    directions += list(rng.standard_normal((20, n)))
    for d in directions:
        change = np.imag(assemble(model, ahead(model, config, d), loads).gradient @ d) / STEP
        # Rounding of the sum over all entries.
        assert change == pytest.approx(d @ K @ d, abs=1e-13 * np.abs(d) @ np.abs(K) @ np.abs(d))


def test_joint_rows_of_the_tangent_are_the_derivative_of_the_joint_forces():
    model, rng = sliding_model(), np.random.default_rng(4)
    config, loads = random_configuration(model, rng, 0.1), loads_of(model)
    K = assemble(model, config, loads).tangent.toarray()
    joints = np.arange(6 * model.tree.roots, model.tree.size)
    for column in joints:
        moved = assemble(model, ahead(model, config, np.eye(model.tree.size)[column]), loads)
        # Rounding.
        assert np.imag(moved.gradient[joints]) / STEP == pytest.approx(
            K[joints, column], abs=1e-13 * np.abs(K).max()
        )


def test_jacobian_is_the_derivative_of_the_poses():
    model, rng = sliding_model(), np.random.default_rng(5)
    config = random_configuration(model, rng, 0.3)
    poses = frame_poses(model.tree, config)
    J = pose_jacobian(model.tree, model.points, poses).toarray().reshape(-1, 6, model.tree.size)
    for column, q in enumerate(np.eye(model.tree.size)):
        new = frame_poses(model.tree, ahead(model, config, q))
        shift = np.imag(points_in_world(model.points, new)) / STEP
        spin = np.imag(new.R[model.points.frame]) @ np.swapaxes(poses.R[model.points.frame], 1, 2) / STEP
        turn = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        # Rounding.
        assert np.hstack([shift, turn]) == pytest.approx(J[:, :, column], abs=1e-13)


def test_mass_matrix_is_the_kinetic_energy_of_moving_points():
    model, rng = sliding_model(), np.random.default_rng(6)
    bodies = structure(model.structure.nodes, (), model.structure.joints)
    model = mesh_structure(dataclasses.replace(bodies, nodes=bodies.nodes[:1], joints=bodies.joints[:3]))
    config, rate = random_configuration(model, rng, 0.3), rng.standard_normal(model.tree.size)
    at, new = frame_poses(model.tree, config), frame_poses(model.tree, ahead(model, config, rate))
    energy = 0.0
    for i, part in enumerate((*model.structure.nodes, *model.structure.joints)):
        v = np.imag(new.p[i] + new.R[i] @ part.body.cg) / STEP
        spin = np.imag(new.R[i]) @ at.R[i].T / STEP
        w = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        inertia = at.R[i] @ part.body.inertia @ at.R[i].T
        energy += 0.5 * part.body.mass * v @ v + 0.5 * w @ inertia @ w
    # Rounding.
    assert 0.5 * rate @ mass_matrix(model, config).toarray() @ rate == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.4, np.pi / 2, -1.0])
def test_a_mass_on_a_tilted_slide_slides_by_its_weight_over_its_spring(tilt: float):
    """x = rest + m g sin(tilt) / k down the slope."""
    m, k, rest = 0.8, 120.0, 0.01
    axis = np.array([np.cos(tilt), -np.sin(tilt), 0.0])
    slide = joint("pm", "n", axis, body(m), offset=(0.1, 0.2, 0.3), stiffness=k, target=rest, slides=True)
    model = mesh_structure(structure([node("n", (0, 0, 0), body(1.0))], joints=[slide]))
    loads = dataclasses.replace(no_loads(), gravity=GRAVITY)
    config = newton(model, np.zeros((len(model.points.frame), 6)), loads=loads)
    # Rounding.
    assert config.angle[0] == pytest.approx(rest + m * G * np.sin(tilt) / k, rel=1e-12, abs=1e-15)


# A body hung by a point, with a proof mass on a level slide at depth h: masses, depths, inertia, stiffnesses.
HUNG, DEPTH, INERTIA, MOVING, HEIGHT, SPRING, HOLD = 6.0, 0.3, 0.4, 0.5, 0.45, 80.0, 2e3


def pendulum(
    height: float = HEIGHT, c: float = 0.0, travel=(-np.inf, np.inf), rest: float = 0.0
) -> Structure:
    spring = {"stiffness": SPRING, "target": rest, "slides": True, "travel": travel}
    slide = joint("pm", "bus", X, body(MOVING), offset=(0.0, -height, 0.0), **spring)
    parts = structure(
        [node("bus", (0, 0, 0), body(HUNG, (0, -DEPTH, 0), (0.5, 0.2, INERTIA)))],
        joints=[slide],
        attach=[AttachPoint("hook", "bus", np.zeros(3))],
        actuators=[Actuator(name="drive", frame="pm", axis=None)],
        sensors=[
            Sensor(name="tilt", frame="bus", axis=Z, axis_frame="bus"),
            Sensor(name="stroke", frame="pm", axis=None),
        ],
    )
    dampers = (Damper(DamperPlace.JOINT, "pm", c),) if c else ()
    return dataclasses.replace(parts, damping=Damping(dampers=dampers))


def hung_from_a_point(gravity: float, hold: float = HOLD):
    """A spring of no free length pulls its point back alike in all directions."""
    above = (HUNG + MOVING) * gravity / hold
    return lab(
        AnchoredSpring(
            name="hold", attach="hook", anchor=np.array([0.0, above, 0.0]), stiffness=hold, free_length=0.0
        ),
        gravity=np.array([0.0, -gravity, 0.0]),
    )


def closed_form(omega: np.ndarray, gravity: float, height: float = HEIGHT) -> np.ndarray:
    """(shift, tilt, stroke) per force on the mass: T and V to second order, written out by hand.

    T = M (X' + d a')^2/2 + I a'^2/2 + m (X' + h a' + s')^2/2,
    V = kc X^2/2 + g (M d + m h) a^2/2 + m g a s + k s^2/2; the force is between mass and carrier: (0, 0, u).
    """
    body_row, mass_row = np.array([1.0, DEPTH, 0.0]), np.array([1.0, height, 1.0])
    inertia = HUNG * np.outer(body_row, body_row) + MOVING * np.outer(mass_row, mass_row)
    inertia[1, 1] += INERTIA
    weight = MOVING * gravity
    stiffness = np.array(
        [[HOLD, 0, 0], [0, gravity * (HUNG * DEPTH + MOVING * height), weight], [0, weight, SPRING]]
    )
    return np.array([np.linalg.solve(stiffness - w**2 * inertia, [0.0, 0.0, 1.0]) for w in omega])


@pytest.mark.parametrize("gravity", [0.0, 1.62, G])
@pytest.mark.parametrize("height", [HEIGHT, -0.2])
def test_a_proof_mass_on_a_pendulum_has_the_transfer_derived_by_hand(gravity: float, height: float):
    rest = solve_equilibrium(pendulum(height), hung_from_a_point(gravity))
    modes = solve_modes(rest)
    plant = build_plant(modes, inputs=["drive"], outputs=["tilt", "stroke", "stroke_rate"])
    assert [p.unit for p in (*plant.inputs, *plant.outputs)] == ["N", "rad", "m", "m/s"]
    omega = np.array([0.3, 1.0, 3.0, 9.0, 20.0, 60.0])
    H = modal_response(plant.dynamics, omega)[:, :, 0]
    by_hand = closed_form(omega, gravity, height)
    # Modes at rounding level 1e-14 of the largest omega^2, met again where terms cancel.
    assert H[:, 0] == pytest.approx(by_hand[:, 1], rel=1e-9)
    assert H[:, 1] == pytest.approx(by_hand[:, 2], rel=1e-9)
    assert H[:, 2] == pytest.approx(1j * omega * by_hand[:, 2], rel=1e-9)


def test_no_reaction_at_zero_frequency_in_orbit_and_the_weight_of_the_mass_on_the_ground():
    """In 0-g tilt/force = -m h w^2/det dies with w^2; in 1-g what is left is the weight beside the axis.

    A stroke s puts the moment m g s on the hung body, whose pendulum gives (M d + m h) g a = -m g s.
    """
    w = np.array([1e-3])
    responses = {}
    for gravity in (0.0, G):
        modes = solve_modes(solve_equilibrium(pendulum(), hung_from_a_point(gravity)))
        plant = build_plant(modes, inputs=["drive"], outputs=["tilt", "stroke"])
        responses[gravity] = modal_response(plant.dynamics, w)[0, :, 0]
    tilt, stroke = responses[0.0]
    # Free of restraint in 0-g, the body turns against the mass: finite though w is a thousandth.
    inner = INERTIA + HUNG * DEPTH**2
    assert stroke == pytest.approx(1.0 / SPRING, rel=1e-6)  # w^2 over the slide's own
    assert tilt == pytest.approx(-MOVING * HEIGHT / (SPRING * (inner + MOVING * HEIGHT**2)), rel=1e-5)
    tilt, stroke = responses[G]
    assert tilt / stroke == pytest.approx(-MOVING / (HUNG * DEPTH + MOVING * HEIGHT), rel=1e-6)  # w^2


def test_held_the_slide_hands_the_weight_component_of_its_mass_to_the_structure():
    """Static: the spring's force k x on the carrier per unit of tilt is the weight m g along the slide."""
    slide = pendulum().joints[0]
    pivot = joint("pivot", "fixed", Z, body(HUNG, (0, -DEPTH, 0), (0.5, 0.2, INERTIA)))
    parts = structure(
        [node("fixed", (0, 0, 0), NONE)], joints=[pivot, dataclasses.replace(slide, parent="pivot")]
    )
    model = mesh_structure(parts)
    for gravity in (0.0, G):
        loads = dataclasses.replace(no_loads(), gravity=np.array([0.0, -gravity, 0.0]))
        K, M, _ = clamped_matrices(model, loads=loads)
        stroke = -K[1, 0] / K[1, 1]  # per unit of tilt, the actuator at rest
        assert SPRING * stroke == pytest.approx(-MOVING * gravity, rel=1e-12)  # rounding
        # Two degrees: tilt/force = m (h w^2 - g)/det, of either sign about the zero at w^2 = g/h.
        for w in (0.5, np.sqrt(G / HEIGHT), 20.0):
            A = K - w**2 * M
            tilt = np.linalg.solve(A, [0.0, 1.0])[0]
            expected = MOVING * (HEIGHT * w**2 - gravity) / np.linalg.det(A)
            assert tilt == pytest.approx(expected, rel=1e-10, abs=1e-14)  # rounding


def test_in_one_g_the_transfer_to_tilt_has_a_zero_at_g_over_h_and_the_other_sign_below():
    """With the hook free to shift, the zero follows from the same cofactor; above the hook there is none."""
    low, high = np.array([0.2]), np.array([80.0])
    signs = {}
    for height in (HEIGHT, -0.2):
        H = [closed_form(w, G, height)[0, 1] for w in (low, high)]
        modes = solve_modes(solve_equilibrium(pendulum(height), hung_from_a_point(G)))
        plant = build_plant(modes, inputs=["drive"], outputs=["tilt"])
        ours = [modal_response(plant.dynamics, w)[0, 0, 0].real for w in (low, high)]
        assert np.array(ours) == pytest.approx(np.array(H), rel=1e-9)  # rounding, as above
        # Above all resonances det has the sign of (-1)^3; what is left is that of the numerator.
        signs[height] = (np.sign(-ours[0]), np.sign(ours[1]))
    assert signs[HEIGHT][0] == signs[-0.2][0]  # on the ground and slow, the weight decides, not the height
    assert signs[HEIGHT][1] != signs[-0.2][1]  # fast, the lever arm does


def test_tilt_per_force_has_the_other_sign_in_0_g_between_the_pendulum_and_the_zero_alone():
    """Below the slide's resonance; the same hook holds the body in both."""
    moment, inertia = HUNG * DEPTH + MOVING * HEIGHT, INERTIA + HUNG * DEPTH**2 + MOVING * HEIGHT**2
    zero, swing = np.sqrt(G / HEIGHT), np.sqrt(G * moment / inertia)
    omega = np.array([0.5, 3.0, 0.5 * (zero + swing), 6.0, 9.0])
    tilt = {}
    for gravity in (0.0, G):
        modes = solve_modes(solve_equilibrium(pendulum(), hung_from_a_point(gravity, hold=1e3 * HOLD)))
        plant = build_plant(modes, inputs=["drive"], outputs=["tilt"])
        tilt[gravity] = modal_response(plant.dynamics, omega)[:, 0, 0].real
    assert (np.sign(tilt[G]) == np.sign(tilt[0.0])).tolist() == [True, True, False, True, True]


def test_the_damper_of_a_proof_mass_gives_its_ratio_on_a_heavy_carrier():
    zeta, k, m = 0.2, SPRING, MOVING
    parts = pendulum(height=DEPTH, c=2.0 * zeta * np.sqrt(k * m))
    heavy = dataclasses.replace(
        parts, nodes=(dataclasses.replace(parts.nodes[0], body=body(1e7, (0, -DEPTH, 0), (1e6, 1e6, 1e6))),)
    )
    modes = solve_modes(solve_equilibrium(heavy, lab(*hung_from_a_point(0.0).springs, gravity=np.zeros(3))))
    i = int(np.argmin(np.abs(modes.omega - np.sqrt(k / m))))
    assert modes.omega[i] == pytest.approx(np.sqrt(k / m), rel=1e-6)  # mass ratio 5e-8
    assert estimate_damping(modes).zeta[i] == pytest.approx(zeta, rel=1e-6)
    assert modes.name[i] == "first slide"


def test_a_slide_comes_to_rest_where_spring_and_weight_balance():
    """Hung askew: along the axis as it then stands, k (s - rest) is the mass's weight."""
    parts = pendulum(rest=0.03)
    rest = solve_equilibrium(parts, hung_from_a_point(G))
    axis = frame_poses(rest.model.tree, rest.config).axis[0]
    pull = MOVING * GRAVITY @ axis
    # Residual 1e-9 of the weight of 64 N, over the mass's 0.1 N along the slide.
    assert SPRING * (rest.config.angle[0] - 0.03) == pytest.approx(pull, abs=1e-7)
    assert rest.holding_torque[0] == pytest.approx(-pull, abs=1e-7)
    assert abs(pull) > 0.01  # it does hang askew


def test_a_slide_that_would_rest_beyond_its_travel_is_refused():
    with pytest.raises(EquilibriumError, match=r"'pm' would rest at .* beyond its travel -0.01 to 0.01") as e:
        solve_equilibrium(pendulum(travel=(-0.01, 0.01), rest=0.03), hung_from_a_point(G))
    assert e.value.where == "joint 'pm'"
    assert e.value.data["angle"] > 0.01


ARTICLE = """
schema = 1
name = "one"
[[node]]
name = "n"
x_m = 0.0
mass_kg = 5.0
inertia_kg_m2 = [0.1, 0.1, 0.1]
[damping]
flexible = 0.0
[[proof_mass]]
name = "pm"
node = "n"
offset_m = [0.0, -0.1, 0.0]
axis = [2.0, 0.0, 0.0]
mass_kg = 0.4
damping = 0.3
travel_m = [-0.01, 0.02]
"""


def article(tmp_path, more: str) -> Structure:
    file = tmp_path / "one.toml"
    file.write_text(ARTICLE + more)
    return load_structure(file)


@pytest.mark.parametrize("spring", ["natural_hz = 2.0", f"stiffness_n_per_m = {0.4 * (4 * np.pi) ** 2!r}"])
def test_a_file_says_what_a_proof_mass_is(tmp_path, spring: str):
    parts = article(tmp_path, spring)
    joint = parts.joints[0]
    assert joint.slides
    assert joint.state is JointState.SPRUNG
    assert joint.axis.tolist() == [1.0, 0.0, 0.0]
    assert joint.stiffness == pytest.approx(0.4 * (2 * np.pi * 2.0) ** 2, rel=1e-12)  # rounding
    assert joint.travel == (-0.01, 0.02)
    assert parts.damping.dampers == (
        Damper(DamperPlace.JOINT, "pm", pytest.approx(2 * 0.3 * 0.4 * 2 * np.pi * 2.0)),
    )
    assert parts.actuators[-1] == Actuator(name="pm_rel", frame="pm", axis=None)
    assert parts.sensors[-1] == Sensor(name="pm_rel", frame="pm", axis=None)


BROKEN = {
    "missing; a proof mass needs it, or natural_hz": "",
    "beside stiffness_n_per_m": "natural_hz = 2.0\nstiffness_n_per_m = 3.0",
    "must not be the zero vector": "natural_hz = 2.0",
    "must rise from the least to the largest": "natural_hz = 2.0",
    "must hold 0, where the mass begins": "natural_hz = 2.0",
    "no frame of this name": "natural_hz = 2.0",
}


@pytest.mark.parametrize("message", BROKEN)
def test_a_broken_proof_mass_is_refused_with_its_line(tmp_path, message: str):
    changes = {
        "zero vector": ("[2.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]"),
        "must rise": ("[-0.01, 0.02]", "[0.02, -0.01]"),
        "must hold": ("[-0.01, 0.02]", "[0.01, 0.02]"),
        "no frame": ('node = "n"', 'node = "m"'),
    }
    text = ARTICLE + BROKEN[message]
    for part, (old, new) in changes.items():
        text = text.replace(old, new) if part in message else text
    file = tmp_path / "one.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_structure(file)
    assert message in str(error.value)
    assert "proof_mass" in str(error.value)
    assert f"{file}:" in str(error.value)
