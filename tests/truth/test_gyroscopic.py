"""Spinning wheels: whirl of a rotor, nutation, the gyropendulum, and any structure against dense matrices."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
import scipy.integrate as si
import scipy.linalg as sla

from middeck.errors import ConfigError, UnstableEquilibriumError
from middeck.laboratory.tested_article import solve_rig_article
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.wheel_forces import spinning_wheels
from middeck.structure.elements.frames import frame_poses, move
from middeck.structure.model.article import (
    Actuator,
    Body,
    Damping,
    Joint,
    JointState,
    Section,
    Sensor,
    SensorKind,
    Structure,
    Wheel,
)
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.modes.craig_bampton import reduce_structure
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.residual_flexibility import compare_static_gain
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.structure.plants.whirl_modes import GyroscopicModes, solve_gyroscopic_modes
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.systems.plants.response import evaluate_plant
from repeats import repeats
from structure_builders import GRAVITY, body, member, node, random_configuration, structure
from trusses import truss

X, Y, Z = np.eye(3)
SHAFT = Section(EA=1e8, GJ=400.0, EI_y=700.0, EI_z=700.0, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
UNDAMPED = Damping()
RIM = body(2.0, inertia=(0.05, 0.04, 0.04))


def wheel(frame: str, axis: np.ndarray, inertia: float, name: str = "w") -> Wheel:
    return Wheel(name=name, frame=frame, axis=axis, inertia=inertia)


def spinning(environment: Environment, **speeds: float) -> Environment:
    return dataclasses.replace(environment, wheel_speeds=tuple(speeds.items()))


def standstill(parts: Structure, environment: Environment) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment), standstill=True)


def whirls(parts: Structure, environment: Environment, damping: Damping | None = UNDAMPED) -> GyroscopicModes:
    return solve_gyroscopic_modes(standstill(parts, environment), damping)


# A rotor on a flexible shaft


def overhung(m: float, across: float, polar: float, length: float) -> Structure:
    """A disc at the end of a massless shaft along x, whose free torsion and length are out of the way."""
    disc = node("disc", (length, 0, 0), Body(m, np.zeros(3), np.diag([polar, across, across])))
    parts = structure([node("wall", (0, 0, 0)), disc], [member("wall", "disc", SHAFT, 1)])
    return dataclasses.replace(parts, wheels=(wheel("disc", X, polar),))


def closed_form(m: float, across: float, momentum: float, length: float) -> np.ndarray:
    """Signed whirl speeds: (k11 - m w^2)(k22 - across w^2 + momentum w) = k12^2 (Genta 2005, section 2.6)."""
    EI = SHAFT.EI_y
    k11, k12, k22 = 12.0 * EI / length**3, 6.0 * EI / length**2, 4.0 * EI / length
    P = np.polynomial.Polynomial
    return np.sort(np.real((P([k11, 0, -m]) * P([k22, momentum, -across]) - k12**2).roots()))


@pytest.mark.parametrize("seed", repeats(range(40), 4))
def test_whirl_of_an_overhung_rotor(seed: int):
    rng = np.random.default_rng([21, seed])
    m, across, length = rng.uniform(1.0, 8.0), rng.uniform(0.01, 0.1), rng.uniform(0.2, 0.8)
    polar = across * rng.uniform(0.2, 2.0)
    speed = float(rng.uniform(-1.0, 1.0) * 10 ** rng.uniform(0.0, 3.5))
    found = whirls(
        overhung(m, across, polar, length), spinning(Environment.clamped("wall", gravity=0.0), w=speed)
    )
    bends = np.array([sense != "" for sense in found.sense])
    signed = found.omega * np.where([sense == "backward" for sense in found.sense], -1.0, 1.0)
    # With the spin is positive: the roots are those of the speed's size.
    exact = closed_form(m, across, polar * abs(speed), length)
    assert np.sort(signed[bends]) == pytest.approx(
        exact, rel=1e-9
    )  # the reference's polynomial rounds to that
    assert np.all(found.zeta == 0.0)
    assert found.residual.max() < 1e-12


def test_campbell_diagram_rises_forward_and_falls_backward():
    parts, bench = overhung(4.0, 0.03, 0.05, 0.5), Environment.clamped("wall", gravity=0.0)
    speeds, step = np.geomspace(1.0, 1e4, 4), 1e-4
    before = None
    for speed in speeds:
        here = whirls(parts, spinning(bench, w=float(speed)))
        ahead = whirls(parts, spinning(bench, w=float(speed * (1.0 + step))))
        slope = np.log(ahead.omega / here.omega) / np.log1p(step)
        assert here.whirl == pytest.approx(slope, abs=step)
        assert [s for s in here.sense if s] == ["backward", "forward"] * 2
        way = np.array([{"forward": 1.0, "backward": -1.0, "": 0.0}[s] for s in here.sense])
        signed = np.sort((here.omega * way)[way != 0.0])
        if before is not None:
            assert np.all(signed > before)
        before = signed


def test_opposite_spin_is_the_mirror_image():
    parts, bench = overhung(4.0, 0.03, 0.05, 0.5), Environment.clamped("wall", gravity=0.0)
    one, other = (whirls(parts, spinning(bench, w=speed)) for speed in (300.0, -300.0))
    assert one.omega == pytest.approx(other.omega, rel=1e-12)
    assert one.sense == other.sense
    # Of the first forward whirl: the disc's axis circles with the spin, theta_z a quarter behind theta_y.
    forward = one.sense.index("forward")
    turn = [found.shapes[10:12, forward] for found in (one, other)]
    assert [np.sign(np.imag(np.conj(t[0]) * t[1])) for t in turn] == [-1.0, 1.0]


# Free and hanging bodies


def satellite(rng: np.random.Generator, momentum: np.ndarray) -> tuple[Structure, np.ndarray]:
    """A rigid body with wheels of this momentum in all, at 100 rad/s, and its inertia."""
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    J = turn @ np.diag([3.0, 4.0, 5.0] * rng.uniform(0.9, 1.2, 3)) @ turn.T
    bus = node("bus", (0.3, -1.0, 2.0), Body(7.0, rng.standard_normal(3), 0.5 * (J + J.T)))
    size = float(np.linalg.norm(momentum))
    return dataclasses.replace(
        structure([bus]), wheels=(wheel("bus", momentum / size, size / 100.0),)
    ), 0.5 * (J + J.T)


@pytest.mark.parametrize("seed", repeats(range(30), 3))
def test_free_body_nutates_and_drifts(seed: int):
    rng = np.random.default_rng([22, seed])
    h = rng.standard_normal(3) * 10 ** rng.uniform(-6, 2)
    parts, J = satellite(rng, h)
    found = whirls(parts, spinning(Environment.orbit(), w=100.0))
    # omega' = -J^-1 omega x h: three eigenvalues, 0 and +-j sqrt(h' J h / det J).
    nutation = np.sqrt(h @ J @ h / np.linalg.det(J))
    assert found.omega == pytest.approx([0, 0, 0, 0, 0, nutation], rel=1e-12)
    assert found.kind == ("rigid",) * 5 + ("gyroscopic",)
    assert found.sense[5] == "forward"
    assert found.whirl[5] == pytest.approx(1.0, rel=1e-12)
    assert sum(name.startswith("attitude") for name in found.name) == 1
    # A drift goes on for ever: it needs no torque, so that its rotation is about the momentum.
    turn = np.real(found.shapes[3:6, :4])
    assert np.abs(np.cross(turn.T, h)).max() < 1e-12 * np.linalg.norm(h)


def test_plane_of_symmetric_nutation():
    """h / sqrt(I1 I2) about principal axes."""
    bus = node("bus", (0, 0, 0), Body(2.0, np.zeros(3), np.diag([0.2, 0.3, 0.25])))
    parts = dataclasses.replace(structure([bus]), wheels=(wheel("bus", Z, 0.02),))
    found = whirls(parts, spinning(Environment.orbit(), w=50.0))
    assert found.omega[5] == pytest.approx(1.0 / np.sqrt(0.2 * 0.3), rel=1e-13)


def test_wheels_that_cancel_do_nothing():
    rng = np.random.default_rng(23)
    parts, _ = satellite(rng, np.array([0.0, 3.0, 4.0]))
    twice = dataclasses.replace(
        parts,
        wheels=(*parts.wheels, dataclasses.replace(parts.wheels[0], name="v", axis=-parts.wheels[0].axis)),
    )
    found = whirls(twice, spinning(Environment.orbit(), w=100.0, v=100.0))
    assert found.omega.tolist() == [0.0] * 6
    assert set(found.kind) == {"rigid"}
    # By less than a millionth they do not: that is a slow nutation, and no rounding.
    slow = whirls(twice, spinning(Environment.orbit(), w=100.0, v=100.0 * (1.0 - 1e-7)))
    fast = whirls(parts, spinning(Environment.orbit(), w=100.0))
    assert slow.omega[5] == pytest.approx(1e-7 * fast.omega[5], rel=1e-8)  # of the speeds 1e-16 / 1e-7


@pytest.mark.parametrize("momentum", [0.3, 30.0, 3e5])
def test_gyropendulum(momentum: float):
    """Both are held by m g l and joined by h: (mgl - I1 w^2)(mgl - I2 w^2) = h^2 w^2, over eleven decades."""
    m, arm, (I1, I2) = 6.0, 0.4, (1.5, 1.1)
    inertia = np.diag([I1, 0.6, I2]) - m * arm**2 * np.diag([1.0, 0.0, 1.0])
    pivot = node("pivot", (0, 0, 0), Body(m, -arm * Y, inertia))
    parts = dataclasses.replace(structure([pivot]), wheels=(wheel("pivot", Y, 0.2),))
    held = Environment(title="pivot", gravity=GRAVITY, clamps=(Clamp(node="pivot", about="y"),))
    found = whirls(parts, spinning(held, w=momentum / 0.2))
    k = m * arm * float(np.linalg.norm(GRAVITY))
    total = k * (I1 + I2) + momentum**2
    fast = (total + np.sqrt(total**2 - 4.0 * I1 * I2 * k**2)) / (2.0 * I1 * I2)
    exact = np.sqrt([k**2 / (I1 * I2) / fast, fast])
    assert found.omega == pytest.approx(exact, rel=1e-12)
    assert found.sense == ("backward", "forward")  # what hangs precesses against its spin


def test_linear_motion_is_the_limit_of_the_nonlinear_one():
    """Euler's equations J w' + w x (J w + h) = 0 conserve energy, and end where the plant's states do."""
    rng = np.random.default_rng(24)
    h = np.array([2.0, -1.0, 5.0])
    parts, J = satellite(rng, h)
    sensors = tuple(
        Sensor(name=f"s{a}", frame="bus", axis=v, axis_frame="bus")
        for a, v in zip("xyz", np.eye(3), strict=True)
    )
    torques = tuple(
        Actuator(name=f"t{a}", frame="bus", axis=v) for a, v in zip("xyz", np.eye(3), strict=True)
    )
    parts = dataclasses.replace(parts, sensors=sensors, actuators=torques)
    modes = standstill(parts, spinning(Environment.orbit(), w=100.0))
    plant = build_plant(
        modes, inputs=["tx", "ty", "tz"], outputs=["sx_rate", "sy_rate", "sz_rate"], damping=UNDAMPED
    ).system
    small, time = 1e-5, 3.0
    start = small * np.array([1.0, 0.4, -0.3])
    solved = si.solve_ivp(
        lambda _, w: np.linalg.solve(J, np.cross(J @ w + h, w)), (0.0, time), start, rtol=1e-12, atol=1e-18
    )
    end = solved.y[:, -1]
    assert end @ J @ end == pytest.approx(start @ J @ start, rel=1e-10)
    # An impulse of torque J start makes these rates.
    linear = plant.C @ sla.expm(plant.A * time) @ plant.B @ (J @ start)
    assert np.abs(linear - end).max() < 30.0 * small**2  # second order in the rates
    assert np.abs(linear - start).max() > 0.1 * small


# Any structure


def robot(rng: np.random.Generator) -> Structure:
    """Two nodes and a beam; on each a chain of joints with bodies; wheels on nodes, stages and payloads."""

    def heavy(size: float) -> Body:
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        J = turn @ np.diag(size * np.array([2.0, 2.5, 3.0])) @ turn.T
        return Body(float(rng.uniform(1.0, 3.0)), 0.2 * rng.standard_normal(3), 0.5 * (J + J.T))

    def axis() -> np.ndarray:
        v = rng.standard_normal(3)
        return v / np.linalg.norm(v)

    tube = Section(EA=1e5, GJ=80.0, EI_y=100.0, EI_z=60.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=2e-4)
    nodes = [node("a", (0, 0, 0), heavy(0.4)), node("b", (1.0, 0.2, -0.1), heavy(0.3))]
    states = [JointState.FREE, JointState.SPRUNG, JointState.LOCKED]
    joints = [
        Joint(
            name=f"{root}{k}",
            parent=root if k == 0 else f"{root}{k - 1}",
            offset=0.1 * rng.standard_normal(3),
            axis=axis(),
            angle=float(rng.uniform(-1.0, 1.0)),
            body=heavy(0.1),
            state=states[rng.integers(3)],
            stiffness=float(rng.uniform(1.0, 30.0)),
            slides=bool(rng.random() < 0.2),
        )
        for root in "ab"
        for k in range(2)
    ]
    parts = structure(nodes, [member("a", "b", tube, 2)], joints)
    frames = ["a", "b", *(j.name for j in joints)]
    wheels = [
        wheel(str(f), axis(), float(rng.uniform(0.01, 0.05)), f"w{i}")
        for i, f in enumerate(rng.permutation(frames)[:3])
    ]
    ports = [str(f) for f in rng.permutation(frames)[:2]]
    return dataclasses.replace(
        parts,
        wheels=tuple(wheels),
        actuators=tuple(Actuator(name=f"u{f}", frame=f, axis=axis()) for f in ports),
        sensors=(
            *(Sensor(name=f"y{f}", frame=f, axis=axis(), axis_frame=f) for f in ports),
            Sensor(name="acc", frame="b", axis=axis(), kind=SensorKind.ACCELEROMETER, offset=0.1 * axis()),
        ),
        damping=Damping(flexible=0.02, suspension=0.05),
    )


def speeds_of(parts: Structure, rng: np.random.Generator, decades: tuple[float, float]) -> dict[str, float]:
    return {w.name: float(rng.choice([-1, 1]) * 10 ** rng.uniform(*decades)) for w in parts.wheels}


@pytest.mark.parametrize("seed", repeats(range(9), 2))
def test_matrix_is_the_derivative_of_the_momentum(seed: int):
    """T1 = h n(q) . omega(q, q') = a(q) . q'; Lagrange's equations have G_ij = da_i/dq_j - da_j/dq_i."""
    rng = np.random.default_rng([25, seed])
    parts = robot(rng)
    rest = solve_equilibrium(parts, spinning(Environment.orbit(), **speeds_of(parts, rng, (1.0, 3.0))))
    model, at = rest.model, random_configuration(rest.model, rng, 0.4)
    turning = dict(rest.environment.wheel_speeds)
    frames = [(model.frames.index(w.frame), turning[w.name] * w.inertia * w.axis) for w in parts.wheels]
    unit = np.eye(model.tree.size)
    exact = spinning_wheels(model, at, rest.environment).reduced(unit)
    some = rng.permutation(np.flatnonzero(np.any(exact, axis=0)))[:6]

    def one_form(q: np.ndarray) -> np.ndarray:
        """a(q), by central differences of rotations as `move` makes them."""
        step, here, out = 1e-5, frame_poses(model.tree, move(model.tree, at, q)).R, []
        for e in unit[some]:
            ahead, behind = (
                frame_poses(model.tree, move(model.tree, at, q + t * e)).R for t in (step, -step)
            )
            spin = (ahead - behind) / (2.0 * step) @ np.swapaxes(here, 1, 2)
            rate = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
            out.append(sum((here[f] @ h) @ rate[f] for f, h in frames))
        return np.array(out)

    step = 1e-4
    da = np.array([(one_form(step * unit[i]) - one_form(-step * unit[i])) / (2.0 * step) for i in some]).T
    assert np.array_equal(exact, -exact.T)
    scale = np.abs(exact).max()
    assert np.abs(exact[np.ix_(some, some)] - (da - da.T)).max() < 1e-6 * scale  # of the differences


class Dense:
    """Matrices of all coordinates that move, with the modal damping of the whole."""

    def __init__(self, rest: Equilibrium, modes: Modes) -> None:
        self.free = dynamic_freedom(rest.model, rest.config)
        self.K = self.free.matrix(assemble(rest.model, rest.config, rest.loads).tangent).toarray()
        self.M = self.free.matrix(modes.mass).toarray()
        spin = spinning_wheels(rest.model, rest.config, rest.environment)
        self.G = self.free.part(self.free.part(spin.reduced(np.eye(rest.model.tree.size))).T).T
        P, d = self.M @ self.free.part(modes.shapes), 2.0 * estimate_damping(modes).zeta * modes.omega
        self.C = (P * d) @ P.T

    def correction(self, s: complex, x: np.ndarray) -> float:
        """Newton's step on (s^2 M + s (G + C) + K) x = 0 over s; the residual in extended precision."""
        M, D, K = (np.asarray(matrix, dtype=np.longdouble) for matrix in (self.M, self.G + self.C, self.K))
        x = np.asarray(x, dtype=np.clongdouble)
        left = (s * s * (M @ x) + s * (D @ x) + K @ x).astype(complex)
        x = x.astype(complex)
        Q = s * s * self.M + s * (self.G + self.C) + self.K
        slope = (2.0 * s * self.M + self.G + self.C) @ x
        step = np.linalg.solve(
            np.block([[Q, slope[:, None]], [x.conj()[None], np.zeros((1, 1))]]), [*-left, 0.0]
        )
        return float(abs(step[-1]) / abs(s))

    def response(self, omega: float, B: np.ndarray) -> np.ndarray:
        return np.linalg.solve(-(omega**2) * self.M + 1j * omega * (self.G + self.C) + self.K, B)


def turning_robot(seed: int, fastest: float = 3.5) -> tuple[Structure, Modes, Dense]:
    rng = np.random.default_rng([26, seed])
    parts = robot(rng)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    hinge = Clamp(node="a", about="xy", axes=axes * np.linalg.det(axes))
    bench = Environment(title="bench", gravity=np.zeros(3), clamps=(hinge,) if seed % 2 else ())
    rest = solve_equilibrium(parts, spinning(bench, **speeds_of(parts, rng, (1.0, fastest))))
    modes = solve_modes(rest, standstill=True)
    return parts, modes, Dense(rest, modes)


@pytest.mark.parametrize("seed", repeats(range(60), 3))
def test_modes_of_any_structure(seed: int):
    _, modes, dense = turning_robot(seed)
    found = solve_gyroscopic_modes(modes)
    shapes = dense.free.part(found.shapes)
    # A rigid turn about a slanting hinge may come out at 1e-7 rad/s: rounding of the clamp's axes.
    moves = np.flatnonzero(found.omega > 1e-5)
    # Rigid motions strain these matrices by rounding; the modes have none of that.
    rounding = 1e-13 * np.abs(dense.K).max() / found.omega[moves] ** 2
    steps = np.array([dense.correction(found.s[m], shapes[:, m]) for m in moves])
    assert np.all(steps < 1e-10 + rounding)
    # None is missing, none there twice: with attitudes at zero as many as at standstill, and independent.
    assert len(found.omega) == len(modes.omega)
    pairs = np.vstack([shapes[:, moves], shapes[:, moves] * found.s[moves]])
    both = np.hstack([pairs, pairs.conj()])
    size = np.linalg.norm(both, axis=0)
    assert np.linalg.matrix_rank(both / size, tol=1e-6) == both.shape[1]
    # What is at zero moves without strain, or is held against momentum by strain alone.
    still = dense.K @ shapes[:, found.omega <= 1e-5]
    assert np.abs(still).max(initial=0.0) < 1e-9 * np.abs(dense.K).max()


@pytest.mark.parametrize("seed", repeats(range(60), 3))
def test_plant_of_any_structure(seed: int):
    """All modes kept: the response is that of the dense matrices, accelerometers included."""
    parts, modes, dense = turning_robot(seed, 3.0)
    u, y = [a.name for a in parts.actuators], [*(f"{s.name}_rate" for s in parts.sensors[:2]), "acc"]
    plant = build_plant(modes, inputs=u, outputs=y, count=len(modes.omega))
    hz = np.array([0.2, 0.7, 3.0, 11.0])  # lower, rounding of K is felt beside rigid motions
    B = dense.free.part(input_rows(modes.equilibrium, u).force.T)
    rows = output_rows(modes.equilibrium, y)
    read = [dense.free.part(part.T).T for part in (rows.position, rows.rate, rows.acceleration)]
    for f, H in zip(hz, evaluate_plant(plant, hz).H, strict=True):
        s = 2j * np.pi * f
        exact = (read[0] + s * read[1] + s**2 * read[2]) @ dense.response(abs(s), B)
        assert np.abs(H - exact).max() < 1e-7 * np.abs(exact).max()


def test_a_wheel_on_a_component_is_that_on_the_structure():
    """Reduced with its boundary at the wheel; the component's inertia is in its matrices, not in a body."""
    nodes = [node("a", (0, 0, 0), body(3.0, inertia=(0.2, 0.2, 0.2))), node("b", (1.0, 0, 0), RIM)]
    tube = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=60.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=2e-4)
    whole = structure(nodes, [member("a", "b", tube, 3)])
    made = reduce_structure(whole, ["a", "b"], count=8, name="boom").component
    host = structure([node("a", (0, 0, 0)), node("b", (1.0, 0, 0))])
    found = [
        whirls(
            dataclasses.replace(parts, wheels=(wheel("b", X, 0.05),)), spinning(Environment.orbit(), w=300.0)
        )
        for parts in (whole, dataclasses.replace(host, components=(made,)))
    ]
    assert found[1].omega[:10] == pytest.approx(found[0].omega[:10], rel=1e-5)  # by the modes left out
    assert found[1].sense[:10] == found[0].sense[:10]


# What is left out


def masts(rng: np.random.Generator) -> Structure:
    """A truss with a wheel on one of its nodes."""
    parts = truss(3, 0.5, 0.4, 0.4, rng)
    heavy = [dataclasses.replace(n, body=body(2.0, inertia=(0.02, 0.02, 0.02))) for n in parts.nodes[:1]]
    return dataclasses.replace(
        parts, nodes=(*heavy, *parts.nodes[1:]), wheels=(wheel(heavy[0].name, Y, 0.01),)
    )


def test_a_plant_warns_of_too_few_modes():
    """Where nothing is said, every pole is one of the whole article to 1e-3."""
    parts = masts(np.random.default_rng(32))
    warned: list[float] = []
    for speed in (100.0, 1000.0, 3000.0):
        modes = standstill(parts, spinning(Environment.orbit(), w=speed))
        whole = solve_gyroscopic_modes(modes, UNDAMPED).omega
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            plant = build_plant(modes, inputs=[], outputs=[], count=26, damping=UNDAMPED)
        if caught:
            assert "lower; take more modes" in str(caught[0].message)
            warned.append(speed)
            continue
        poles = np.abs(np.linalg.eigvals(plant.system.A))
        poles = poles[poles > 1e-3]
        nearest = np.abs(poles[:, None] / np.maximum(whole, 1e-9) - 1.0).min(axis=1)
        assert nearest.max() < 1e-3
    assert warned == [3000.0]


def test_few_modes_of_a_large_article_warn_too():
    """Of modes that are not all solved for, the flexibility of the rest comes from a factorisation."""
    parts = masts(np.random.default_rng(32))
    rest = solve_equilibrium(parts, spinning(Environment.orbit(), w=3000.0))
    some, every = solve_modes(rest, 26, standstill=True), solve_modes(rest, standstill=True)
    texts = [_plant_warning(modes) for modes in (some, every)]
    assert texts[0].split("by what")[1] == texts[1].split("by what")[1]
    assert solve_gyroscopic_modes(some, UNDAMPED).warnings
    assert not solve_gyroscopic_modes(every, UNDAMPED, count=26).warnings  # all of them enter


def test_no_rigid_mode_is_left_out():
    parts, _ = satellite(np.random.default_rng(34), X)
    modes = standstill(parts, spinning(Environment.orbit(), w=100.0))
    with pytest.raises(ConfigError, match="5 modes kept of 6 rigid ones"):
        build_plant(modes, inputs=[], outputs=[], count=5)


def _plant_warning(modes: Modes) -> str:
    with pytest.warns(UserWarning, match="take more modes") as caught:
        build_plant(modes, inputs=[], outputs=[], count=26, damping=UNDAMPED)
    return str(caught[0].message)


# Standstill and rest


def test_at_speed_zero_nothing_changes():
    """Bit for bit: modes, plant and rest state of an environment without speeds."""
    rng = np.random.default_rng(33)
    parts = robot(rng)
    plain, zero = (
        solve_modes(solve_equilibrium(parts, environment))
        for environment in (Environment.orbit(), spinning(Environment.orbit(), w0=0.0))
    )
    found = solve_gyroscopic_modes(zero, count=9)
    assert np.array_equal(found.omega, plain.omega[:9])
    assert np.array_equal(found.zeta, estimate_damping(plain, count=9).zeta)
    assert np.array_equal(np.abs(found.shapes), np.abs(plain.shapes[:, :9]))
    assert found.name == plain.name[:9]
    assert set(found.sense) == {""}
    ports = {"inputs": [a.name for a in parts.actuators], "outputs": ["acc"]}
    one, other = (build_plant(modes, **ports).modal for modes in (plain, zero))
    assert one is not None
    assert other is not None
    for name in ("omega", "zeta", "psi", "phi", "phi_rate", "phi_acceleration"):
        assert np.array_equal(getattr(one, name), getattr(other, name))


def test_rest_feels_no_momentum():
    arm, tip = node("a", (0, 0, 0)), node("b", (1.0, 0, 0), body(2.0, (0.0, 0.1, 0.0), (0.1, 0.1, 0.1)))
    beam = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0)
    parts = structure([arm, tip], [member("a", "b", beam, 3)])
    parts = dataclasses.replace(parts, wheels=(wheel("b", Z, 0.05),))
    bench = Environment.clamped("a")
    still, spun = (solve_equilibrium(parts, e) for e in (bench, spinning(bench, w=1e4)))
    assert np.array_equal(still.config.x, spun.config.x)
    assert np.array_equal(still.config.R, spun.config.R)
    assert np.array_equal(still.reactions[0].moment, spun.reactions[0].moment)


# Refusals


def test_what_asks_for_real_modes_refuses():
    parts, bench = overhung(4.0, 0.03, 0.05, 0.5), spinning(Environment.clamped("wall", gravity=0.0), w=9.0)
    rest = solve_equilibrium(parts, bench)
    with pytest.raises(ConfigError, match=r"wheels spin \(w\): the modes are complex"):
        solve_modes(rest)
    with pytest.raises(ConfigError, match="wheels spin"):
        solve_rig_article(parts, bench)
    with pytest.raises(ConfigError, match="comparison of static gains leaves out"):
        compare_static_gain(solve_modes(rest, standstill=True), inputs=[], outputs=[])
    with pytest.raises(ConfigError, match="a component keeps no momentum"):
        reduce_structure(parts, ["wall"], count=2)


def test_an_unstable_rest_state_is_no_sleeping_top():
    """The top m g l < h^2 / 4 I sleeps without damping, and falls with any: refused, and said why."""
    top = node("top", (0, 0, 0), Body(1.0, 0.1 * Y, np.diag([0.01, 0.01, 0.01])))
    parts = dataclasses.replace(structure([top]), wheels=(wheel("top", Y, 0.01),))
    held = Environment(title="pivot", gravity=GRAVITY, clamps=(Clamp(node="top", about="y"),))
    with pytest.raises(UnstableEquilibriumError, match="not stable") as raised:
        standstill(parts, spinning(held, w=1e4))
    assert "the least damping lets go" in str(raised.value.hint)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"frame": "nowhere"}, "wheel 'w' names frame 'nowhere'"),
        ({"axis": 2.0 * X}, "no unit vector"),
        ({"inertia": -0.1}, "positive and finite"),
        ({"inertia": 0.2}, "less inertia than its rotors have across"),
    ],
)
def test_impossible_wheels(change: dict[str, object], text: str):
    parts = overhung(4.0, 0.03, 0.05, 0.5)
    wrong = dataclasses.replace(parts, wheels=(dataclasses.replace(parts.wheels[0], **change),))
    with pytest.raises(ConfigError, match=text):
        solve_equilibrium(wrong, Environment.orbit())


@pytest.mark.parametrize("speeds", [{"v": 1.0}, {"w": np.inf}])
def test_impossible_speeds(speeds: dict[str, float]):
    with pytest.raises(ConfigError, match="a speed of"):
        solve_equilibrium(overhung(4.0, 0.03, 0.05, 0.5), spinning(Environment.orbit(), **speeds))


def test_one_wheel_has_one_speed():
    with pytest.raises(ConfigError, match="two speeds of wheel 'w'"):
        Environment(title="e", gravity=np.zeros(3), wheel_speeds=(("w", 1.0), ("w", 2.0)))


def test_a_whirl_is_drawn_by_both_parts_of_its_shape_with_names_of_its_own():
    parts, bench = overhung(4.0, 0.03, 0.05, 0.5), Environment.clamped("wall", gravity=0.0)
    found = whirls(parts, spinning(bench, w=300.0))
    drawn, count = found.parts, len(found.name)
    assert {"forward", "backward"} <= set(found.sense)
    np.testing.assert_array_equal(drawn.shapes[:, :count] + 1j * drawn.shapes[:, count:], found.shapes)
    for name, sense, real, later in zip(
        found.name, found.sense, drawn.name[:count], drawn.name[count:], strict=True
    ):
        assert real == (f"{name}, {sense}" if sense else name)
        assert later == f"{real}, a quarter of a period before"
