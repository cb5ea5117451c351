"""Friction in promises: sliders against a rig and an exact density, loops against their responses."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import promise_case as case
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag, expm

from middeck.control.law.compensator import Compensator, driven_ports, measured_ports
from middeck.control.robust.verification.monte_carlo import noise_on
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.joints.sliding_loops import PASSES, Sliding, SlidingLoops, held_gain
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Sampler
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.structure.model.environment import Environment
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.statespace import StateSpace
from middeck.updating.promise import slip_run, slip_time
from middeck.updating.promise.plan import Plan, group_loop, weights_of
from middeck.updating.promise.promise import design_ladder, promise
from middeck.updating.promise.slip import DrawnSlips, JointSlip, draw_slips
from middeck.updating.promise.slip_lines import mean_squares, sample_lines
from middeck.updating.promise.slip_loops import (
    SlipPoles,
    SlipPorts,
    around_sliders,
    evaluate_open,
    law_response,
    noise_response,
    pole_form,
)
from middeck.updating.promise.slip_run import Slipped, SlipRun, join_slips, run_slips, set_run
from middeck.updating.refinement.refine import Refined

# Frequencies and damping of a loop's modes.
DECADES = ((1e-3, 0.7), (1.0, 0.01), (1e3, 0.01), (1e5, 0.3))
GIMBAL = JointSlip(name="turn", slip_torque=0.05, slip_angle=1e-3)


def slipped(
    plants: Sequence[Plant], laws: Mapping[str, Compensator], slips: DrawnSlips, plan: Plan
) -> dict[str | None, Slipped]:
    """All draws at once, joined."""
    return join_slips([run_slips(set_run(plants[0], laws, slips, plan), plants)])


def chain() -> Plant:
    """Three inertias in a row on weak springs: joints between first and second, second and third."""
    inertia, drag = np.array([2.0, 1.0, 0.5]), 0.05
    joint = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    stiffness = np.diag([1.0, 0.0, 0.0]) + joint.T @ np.diag([3.0, 2.0]) @ joint
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness / inertia[:, None], -drag * np.eye(3)]])
    B = np.vstack([np.zeros((3, 3)), np.column_stack([[1.0, 0.0, 0.0], *joint]) / inertia[:, None]])
    C = np.hstack([np.vstack([joint, [0.0, 0.0, 1.0]]), np.zeros((3, 3))])
    return make_plant(
        A, B, C, inputs=["push", "near", "far"], outputs=["near", "far", "end"], w=["push"], z=["end"]
    )


def held_noise(samples: int) -> np.ndarray:
    return np.random.default_rng(8).standard_normal(samples)


def test_sliders_are_those_of_a_rig():
    """Two joints that slip and stick, one input that is held: the linear part is exact on both sides."""
    plant, period, u = chain(), 0.01, held_noise(4000)
    one = Friction(slip_torque=0.05, stiffness=40.0), Friction(slip_torque=0.03, stiffness=25.0)
    joints = [JointElements(n, n, (f,)) for n, f in zip(("near", "far"), one, strict=True)]
    motors, sensors = {"push": Motor()}, {p.name: Sampler() for p in plant.outputs}
    runs = [
        run_open_loop(
            build_rig(plant, sample_hz=100.0, delay_s=0.005, motors=motors, sensors=sensors, joints=j),
            u[:, None], periods=1, rng=np.random.default_rng(0), settle=0, rest_s=0.0,
        )
        for j in (joints, [])
    ]  # fmt: skip
    with_friction, without = (run.record.y[0, 0] for run in runs if run.record is not None)
    loop = around_sliders(
        plant, None, SlipPorts(joints=("near", "far"), performance=("end",), disturbances=()), 1
    )
    form = pole_form(loop)
    assert form is not None
    sliders = SlidingLoops(
        poles=[form.poles], drives=[form.drives], reads=[form.reads[:2]],
        stiffness=[[f.stiffness for f in one]], slip_torque=[[f.slip_torque for f in one]],
    )  # fmt: skip
    # The rig samples at the beginning of a step.
    (angle,), (torque,) = Sliding([sliders], period).move(without[1:, :2].T[None])
    found = without[1:] - held_response(loop, torque, period)
    np.testing.assert_allclose(found[:, :2], angle.T, atol=1e-9 * np.abs(angle).max())
    size = np.std(with_friction - without, axis=0)
    assert np.all(size > 0.1 * np.std(without, axis=0))
    np.testing.assert_array_less(np.std(found - with_friction[1:], axis=0), 0.005 * size)


def held_response(loop: StateSpace, torque: np.ndarray, period: float) -> np.ndarray:
    """Outputs at the ends of steps over which torques are held, by the exponential of the loop."""
    n, inputs = loop.B.shape
    both = expm(np.vstack([np.hstack([loop.A, loop.B]), np.zeros((inputs, n + inputs))]) * period)[:n]
    x, made = np.zeros(n), []
    for held in torque.T:
        x = both @ np.concatenate([x, held])
        made.append(loop.C @ x)
    return np.array(made)


def test_a_step_that_is_too_long_is_refused():
    loops = SlidingLoops(
        poles=[[-1.0 + 0.0j, -2.0]], drives=[[[1.0 + 0.0j, 1.0]]], reads=[[[1.0 + 0.0j, -1.0]]],
        stiffness=[[1e3]], slip_torque=[[1.0]],
    )  # fmt: skip
    with pytest.raises(ConfigError, match="shorter step"):
        Sliding([loops], 0.1)


def drawn_loops(rng: np.random.Generator, poles: int, records: int) -> SlidingLoops:
    """Two loops of two joints."""
    values = rng.uniform(1.0, 200.0, (2, poles)) * (-0.02 + 1.0j)
    drives = rng.standard_normal((2, 2, poles)) + 0j
    return SlidingLoops(
        poles=values, drives=drives, reads=drives * (-1j / np.imag(values))[:, None],
        stiffness=rng.uniform(2.0, 4.0, (2, 2)), slip_torque=rng.uniform(0.02, 0.06, (2, 2)), records=records,
    )  # fmt: skip


def slide_alone(loops: SlidingLoops, k: int, free: np.ndarray, period: float) -> np.ndarray:
    """Angles of one run of loop ``k``, all poles moved on by every step."""
    grown, reads = np.exp(loops.poles[k] * period), loops.reads[k]
    gain, limit = held_gain(loops.poles[k], loops.drives[k], period), loops.slip_torque[k]
    at_once = np.real(reads @ gain.T)
    state, torque, mean, before = np.zeros(len(grown), dtype=complex), np.zeros(2), np.zeros(2), np.zeros(2)
    made = []
    for now in free.T:
        state = state * grown
        angle, begun = now - np.real(reads @ state), torque
        for _ in range(PASSES):
            turned = angle - at_once @ mean - before
            torque = np.clip(begun + loops.stiffness[k] * turned, -limit, limit)
            mean = 0.5 * (begun + torque)
        state = state + mean @ gain
        before = angle - at_once @ mean
        made.append(before)
    return np.array(made).T


def test_runs_side_by_side_in_blocks_are_each_alone_step_by_step():
    """Groups of other poles and records, in pieces that no block fits."""
    rng, period = np.random.default_rng(3), 1.0 / 400.0
    groups = [drawn_loops(rng, 5, 3), drawn_loops(rng, 8, 1)]
    free = np.cumsum(rng.standard_normal((8, 2, 301)), axis=2) * 0.01
    sliding = Sliding(groups, period)
    parts = [sliding.move(free[:, :, start:stop]) for start, stop in ((0, 7), (7, 120), (120, 301))]
    angle, torque = (np.concatenate(x, axis=2) for x in zip(*parts, strict=True))
    places = [(g, k) for g in groups for k in range(2) for _ in range(g.records)]
    alone = np.array([slide_alone(g, k, f, period) for (g, k), f in zip(places, free, strict=True)])
    np.testing.assert_allclose(angle, alone, rtol=0.0, atol=1e-12 * np.abs(alone).max())
    limit = np.array([g.slip_torque[k] for g, k in places])[:, :, None]
    slips = np.abs(torque) > 0.999 * limit
    assert 0.1 < np.mean(slips) < 0.9


def test_the_order_of_loops_in_memory_does_not_matter():
    rng, two = np.random.default_rng(3), drawn_loops(np.random.default_rng(3), 5, 1)
    own = {key: getattr(two, key)[:, :1] for key in ("drives", "reads", "stiffness", "slip_torque")}
    columns = {key: np.asfortranarray(values) for key, values in (own | {"poles": two.poles}).items()}
    free = rng.standard_normal((2, 1, 20)) * 0.01
    (angle, _), (same, _) = (
        Sliding([dataclasses.replace(two, **given)], 1.0 / 400.0).move(free) for given in (own, columns)
    )
    np.testing.assert_allclose(same, angle, rtol=1e-12)


def test_a_bearing_alone_leaves_what_it_is_given():
    """One run of one joint: the other order of its axes is the same memory."""
    loops = SlidingLoops(
        poles=[[-1.0 + 9.0j]], drives=[[[1.0 + 0.0j]]], reads=[[[-0.1j]]],
        stiffness=[[1.0]], slip_torque=[[1.0]],
    )  # fmt: skip
    free = np.ones((1, 1, 40))
    angle, _ = Sliding([loops], 0.01).move(free)
    assert np.ptp(angle) > 0.0
    np.testing.assert_array_equal(free, 1.0)


@pytest.mark.parametrize("band_hz", [None, (2.0, 9.0)])
@pytest.mark.parametrize("samples", [240, 243])
def test_mean_squares_by_lines_are_those_of_samples(samples: int, band_hz: tuple[float, float] | None):
    """Performance from held torques, in time and by the lines, behind a settling that leaves its states."""
    rng, joints = np.random.default_rng(5), 2
    time = slip_time.SlipTime(
        record_s=samples / 50.0, settle_s=0.6, band_hz=20.0, sample_hz=50.0, short=False
    )
    poles = rng.uniform(1.0, 60.0, 4) * (-0.05 + 1.0j)
    form = SlipPoles(poles, rng.standard_normal((joints, 4)) + 0j, rng.standard_normal((3, 4)) + 0j)
    noise, lines = time.noise_lines(band_hz), time.record_lines(band_hz)
    assert noise.start == lines.start
    assert noise.stop <= lines.stop
    free = rng.standard_normal((3, 2, noise.stop - noise.start, 2)) @ [1.0, 1.0j]
    torque = 5.0 * rng.standard_normal((2, joints, time.settling + samples))
    gain, grown = held_gain(form.poles, form.drives, 1.0 / 50.0), np.exp(form.poles / 50.0)
    state, states = np.zeros((2, 4), dtype=complex), [np.zeros((2, 4), dtype=complex)]
    for held in torque.transpose(2, 0, 1):
        state = state * grown + held @ gain
        states.append(state)
    record = np.array(states[time.settling + 1 :])
    without = np.array([sample_lines(time, noise, free[:, k]) for k in range(2)])
    both = without - np.real(np.einsum("op,krp->rok", form.reads, record)), without
    ends = states[time.settling] + states[-1]
    found = mean_squares(time, lines, form, free, torque[:, :, time.settling :], ends)
    np.testing.assert_allclose(found, [in_band(z, time, band_hz) for z in both], rtol=1e-11)


def in_band(z: np.ndarray, time: slip_time.SlipTime, band_hz: tuple[float, float] | None) -> np.ndarray:
    """Mean square of all outputs, by all lines of the samples with half a turn over the record taken out."""
    if band_hz is None:
        return np.mean(np.sum(z**2, axis=1), axis=1)
    samples = z.shape[2]
    lines = np.fft.fft(z * np.exp(-1j * np.pi * np.arange(samples) / samples), norm="forward")
    hz = np.abs(np.fft.fftfreq(samples, 1.0 / time.sample_hz) + 0.5 / time.record_s)
    inside = (hz >= band_hz[0]) & (hz <= band_hz[1])
    return np.sum(np.abs(lines[:, :, inside]) ** 2, axis=(1, 2))


def turntable(drag: float = 1.0) -> Plant:
    """A unit inertia with drag on a spring too weak to matter, its angle and its rate."""
    return make_plant(
        [[0.0, 1.0], [-1e-4, -drag]], [[0.0], [1.0]], np.eye(2),
        inputs=["turn"], outputs=["turn", "rate"], w=["turn"], u=["turn"], z=["rate"], y=["turn"],
    )  # fmt: skip


def asked(**changes: object) -> Plan:
    given = {
        "environments": {"orbit": Environment.orbit()}, "performance": ("rate",), "weights": np.ones(1),
        "disturbances": ("turn",), "intensity": np.array([0.3]), "noise": {"rad": 1e-4, "": 1e-4},
        "laws": {"none": None}, "joints": (GIMBAL,), "draws": 1,
    }  # fmt: skip
    return Plan(**(given | changes))


def alike(joints: tuple[JointSlip, ...], draws: int) -> DrawnSlips:
    return draw_slips(joints, draws, np.random.default_rng(0))


def test_a_bearing_under_white_noise_has_its_exact_density(monkeypatch: pytest.MonkeyPatch):
    """v' = -v - T sign v + s w: the density is exp(-(v^2 + 2 T |v|)/s^2) (Caughey and Dienes 1961)."""
    monkeypatch.setattr(slip_run, "TIMES", 1)  # of sixty draws, few records are many
    draws = 60
    joint = dataclasses.replace(GIMBAL, slip_torque=0.3, slip_angle=3e-4)
    plan = asked(joints=(joint,), intensity=np.array([0.3]))
    found = slipped([turntable()] * draws, {}, alike((joint,), draws), plan)
    exact, alone = bearing_db(0.3, 0.3), found[None]
    assert exact < -3.0
    assert np.mean(alone.db) == pytest.approx(exact, abs=0.15)
    # Draws that are one article are so, although their records differ by this.
    error = np.sqrt(np.mean(alone.variance))
    assert 0.1 < error < 0.4
    assert np.std(alone.db) < 0.6 * error


def bearing_db(slip_torque: float, s: float) -> float:
    """Mean square of its rate over that without friction, by the density."""

    def moment(power: int) -> float:
        return quad(lambda v: v**power * np.exp(-(v**2 + 2.0 * slip_torque * v) / s**2), 0.0, 4.0)[0]

    return 10.0 * float(np.log10(moment(2) / moment(0) / (0.5 * s**2)))


def test_draws_differ_as_their_articles_do(monkeypatch: pytest.MonkeyPatch):
    """Bearings of other slip torques differ by less than the error of a record, by which none is wider."""
    monkeypatch.setattr(slip_run, "TIMES", 1)
    draws, s = 200, 0.3
    joint = dataclasses.replace(GIMBAL, slip_torque=0.3, slip_angle=3e-4, slip_torque_tolerance=0.08)
    slips = alike((joint,), draws)
    found = slipped([turntable()] * draws, {}, slips, asked(joints=(joint,), intensity=np.array([s])))
    exact = np.array([bearing_db(T, s) for T in slips.slip_torque[:, 0].tolist()])
    alone = found[None]
    assert np.std(exact) < np.sqrt(np.mean(alone.variance))
    assert np.std(alone.db) == pytest.approx(np.std(exact), rel=0.3)
    assert np.corrcoef(alone.db, exact)[0, 1] > 0.4


def test_records_are_as_many_as_friction_asks_for():
    """Sixteen leave a third of a decibel where the joint hardly slips: more than articles differ by."""
    s, joint = 0.12, dataclasses.replace(GIMBAL, slip_torque=0.3, slip_angle=3e-4, slip_torque_tolerance=0.03)
    slips, plan = alike((joint,), 5), asked(joints=(joint,), intensity=np.array([s]), seed=2)
    exact = np.array([bearing_db(T, s) for T in slips.slip_torque[:, 0].tolist()])
    run = set_run(turntable(), {}, slips, plan)
    alone = run_slips(run, [turntable()] * 5)[None]
    assert run.alone > slip_run.ALONE
    assert np.std(alone.db - exact) < 0.2
    assert np.sqrt(np.mean(alone.variance)) == pytest.approx(np.std(alone.db - exact), rel=0.5)
    little = dataclasses.replace(plan, intensity=np.array([3.0]))
    assert set_run(turntable(), {}, slips, little).alone == slip_run.ALONE


@pytest.mark.parametrize(
    ("articles", "noise", "count"),
    [(0.58, [1e-2] * 99 + [6.3], 1000), (0.16, [0.32] * 39, 2), (0.3, [0.2] * 39, 2)],
)
def test_no_noise_makes_draws_agree(articles, noise, count):
    """One noisy draw of a hundred, and noise told from two records that is twice what articles differ by."""
    rng, noise = np.random.default_rng(7), np.array(noise)
    made = []
    for _ in range(60):
        db = articles * rng.standard_normal(len(noise)) + noise * rng.standard_normal(len(noise))
        reported = noise**2 * rng.chisquare(count - 1, len(noise)) / (count - 1)
        nothing = np.zeros((len(noise), 1))
        one = Slipped(db=db, variance=reported, travel=nothing, sticks=nothing[:, 0] == 0.0)
        made.append(np.std(join_slips([{None: one}])[None].db, ddof=1) / articles)
    assert np.quantile(made, 0.05) > 0.7
    assert 0.9 < np.median(made) < 2.0


def delayed_brake() -> tuple[Plant, Compensator]:
    """An oscillator of 1 rad/s, braked by a filtered rate 0.3 s late: at 10 rad/s the brake drives."""
    plant = delay_plant(
        make_plant(
            [[0.0, 1.0], [-1.0, -0.2]], [[0.0], [1.0]], [[1.0, 0.0]],
            inputs=["turn"], outputs=["turn"], w=["turn"], u=["turn"], z=["turn"], y=["turn"],
        ),
        0.3,
    )  # fmt: skip
    lag = 40.0
    law = StateSpace([[-2.0 * lag, -(lag**2)], [1.0, 0.0]], [[1.0], [0.0]], [[-0.5 * lag**2, 0.0]], [[0.0]])
    return plant, Compensator(law, measured_ports(plant), driven_ports(plant))


def test_a_loop_that_hunts_is_bounded_and_reported():
    """Stable while it slips, unstable while it sticks: under next to no noise it moves by its slip angle."""
    plant, law = delayed_brake()
    joint = JointSlip(name="turn", slip_torque=0.1, slip_angle=1e-3)
    plan = asked(performance=("turn",), joints=(joint,), intensity=np.array([1e-6]), noise={"": 1e-8})
    found = slipped([plant], {"brake": law}, alike((joint,), 1), plan)
    assert found[None].sticks.all()
    assert not found["brake"].sticks.any()
    assert np.isfinite(found["brake"].db).all()
    assert 0.3 < found["brake"].travel[0, 0] / joint.slip_angle < 10.0
    # Without it the joint sticks for good, a spring a hundred times as stiff as its own.
    assert found[None].travel[0, 0] < 1e-3 * joint.slip_angle
    assert found[None].db[0] == pytest.approx(-20.0, abs=1.5)
    easy = dataclasses.replace(joint, slip_torque=1e-7)
    slips = slipped([plant], {"brake": law}, alike((easy,), 1), dataclasses.replace(plan, joints=(easy,)))
    assert slips["brake"].sticks.all()


def test_loops_around_sliders_are_the_linear_loops():
    """Noise to performance against the exact rms; sliders to angle and performance against the response."""
    plant, law = delayed_brake()
    plan = asked(performance=("turn",), noise={"": 1e-2})
    wiring = SlipPorts(joints=("turn",), performance=("turn",), disturbances=("turn",))
    hz = (np.arange(40000) + 0.5) / 400.0
    G = evaluate_open(plant, hz)
    H = noise_response(plant, G, law, law_response(law, hz), wiring, hz)
    square = 2.0 / 400.0 * np.sum(np.abs(H[:, 1] * slip_time.noise_intensity(plan, law)) ** 2)
    weights = weights_of(plan, law.outputs, law.inputs)
    exact = noise_on([group_loop(plan, plant, ["turn"], ["turn"])], law, weights)[1]
    assert np.sqrt(square) == pytest.approx(float(exact[0]), rel=1e-4)
    loop = around_sliders(plant, law, wiring, 8)
    form = pole_form(loop)
    assert form is not None
    omega = np.array([0.1, 1.0, 3.0])
    pairs = np.where(np.imag(form.poles) > 0.0, 0.5, 1.0)
    by_poles = sum(
        np.einsum("op,jp,fp->foj", pairs * c, b, 1.0 / (1j * omega[:, None] - p))
        for p, b, c in [
            (form.poles, form.drives, form.reads),
            (np.conj(form.poles), np.conj(form.drives), np.conj(form.reads) * (np.imag(form.poles) > 0.0)),
        ]
    )
    np.testing.assert_allclose(by_poles, statespace_response(loop, omega), rtol=1e-5)
    delayed = G[:1, :, :] * np.exp(-0.3j * 2.0 * np.pi * hz[0])
    K = statespace_response(law.system, 2.0 * np.pi * hz[:1])
    np.testing.assert_allclose(H[0, 1, 0], (G[0, 0, 0] / (1.0 - K[0, 0, 0] * delayed[0, 0, 0])), rtol=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("rate", [1e-3, 1.0, 1e3])
def test_poles_that_coincide_answer_as_the_loop_does(size: int, rate: float):
    """One that is damped critically, a chain of equal ones, and both beside a mode that rings."""
    double, chain = np.array([[0.0, 1.0], [-0.25, -1.0]]), np.diag([-1.0] * size) + np.eye(size, k=1)
    ringing = np.array([[-0.02, 3.0], [-3.0, -0.02]])
    A = block_diag(double, chain, ringing) * rate
    rng = np.random.default_rng(size)
    B, C = rng.standard_normal((len(A), 2)), rng.standard_normal((3, len(A)))
    form = pole_form(StateSpace(A, B, C, np.zeros((3, 2))))
    assert form is not None
    for t in np.linspace(0.0, 20.0, 21) / rate:
        found = np.real((form.reads * np.exp(form.poles * t)) @ form.drives.T)
        assert found == pytest.approx(C @ expm(A * t) @ B, abs=3e-6)


def test_poles_of_little_damping_that_coincide_answer_as_the_loop_does():
    """A change of 1e-8 moved the peak by half a percent."""
    swing = np.array([[-1e-3, 1.0], [-1.0, -1e-3]])
    A = np.block([[swing, np.eye(2)], [np.zeros((2, 2)), swing]])
    loop = StateSpace(A, np.eye(4)[:, 3:], np.eye(4)[:1], np.zeros((1, 1)))
    form = pole_form(loop)
    assert form is not None
    assert answer_of(form, 1j) == pytest.approx(
        loop.C @ np.linalg.solve(1j * np.eye(4) - A, loop.B), rel=1e-5
    )


def test_a_loop_without_states_has_no_poles():
    form = pole_form(StateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((3, 0)), np.zeros((3, 2))))
    assert form is not None
    assert answer_of(form, 1j) == pytest.approx(np.zeros((3, 2)))


def test_a_loop_of_many_decades_does_not_grow_by_what_tells_its_poles_apart():
    """Poles of 1e-3 to 1e5 rad/s in states turned at random: changed by 1e-8, one that decays grew."""
    rng = np.random.default_rng(0)
    A = block_diag(*[np.array([[0.0, 1.0], [-w * w, -2.0 * z * w]]) for w, z in DECADES])
    turn = np.linalg.qr(rng.standard_normal(A.shape))[0]
    loop = StateSpace(turn.T @ A @ turn, turn.T[:, 1::2], turn[::2], np.zeros((4, 4)))
    form = pole_form(loop)
    assert form is not None
    assert np.all(form.poles.real < 0.0)
    for s in (1j, 1e3j, 1e5j):
        whole = loop.C @ np.linalg.solve(s * np.eye(len(A)) - loop.A, loop.B)
        assert answer_of(form, s) == pytest.approx(whole, abs=1e-4 * np.abs(whole).max())


def answer_of(form: SlipPoles, s: complex) -> np.ndarray:
    """Half of each part and of its mirror's, as the real part is the half of both."""
    one = (form.reads / (s - form.poles)) @ form.drives.T
    return 0.5 * (one + (form.reads.conj() / (s - form.poles.conj())) @ form.drives.conj().T)


def test_what_laws_answer_is_kept_up_to_a_size(monkeypatch: pytest.MonkeyPatch):
    law, joint = delayed_brake()[1], JointSlip(name="turn", slip_torque=0.1, slip_angle=1e-3)
    plan = asked(performance=("turn",), joints=(joint,))
    time = slip_time.SlipTime(record_s=4.0, settle_s=1.0, band_hz=25.0, sample_hz=100.0, short=False)
    wiring = SlipPorts(joints=("turn",), performance=("turn",), disturbances=("turn",))
    laws = {None: None, **dict.fromkeys("abc", law)}
    run = SlipRun(plan=plan, laws=laws, slips=alike((joint,), 1), wiring=wiring, time=time, order=1)
    size = law_response(law, time.lines_hz).size
    monkeypatch.setattr(slip_run, "MOST", 2 * size + 1)
    found = [run.answer_of(name) for name in (*laws, *laws)]
    assert found[0] is None
    assert all(np.array_equal(one, found[1]) for name, one in zip((*laws, *laws), found, strict=True) if name)
    assert list(run.answers) == ["a", "b"]
    assert found[5] is found[1]


def test_records_of_a_loop_come_in_parts_that_fit(monkeypatch: pytest.MonkeyPatch):
    """Five records of each of two draws, with room for two."""
    time = slip_time.SlipTime(record_s=4.0, settle_s=1.0, band_hz=25.0, sample_hz=100.0, short=False)
    wiring = SlipPorts(joints=("turn",), performance=("rate",), disturbances=("turn",))
    run = SlipRun(
        plan=asked(), laws={None: None}, slips=alike((GIMBAL,), 2), wiring=wiring, time=time, order=1, alone=5
    )
    whole, together = run_slips(run, [turntable()] * 2)[None], []

    class Counted(Sliding):
        def __init__(self, groups: Sequence[SlidingLoops], period_s: float) -> None:
            together.append(sum(len(g.poles) * g.records for g in groups))
            super().__init__(groups, period_s)

    monkeypatch.setattr(slip_run, "Sliding", Counted)
    # Samples of one angle; lines of it and of the rate, of two numbers each.
    monkeypatch.setattr(slip_run, "HELD", 2 * (400 + 2 * 100 * 2))
    parts = run_slips(run, [turntable()] * 2)[None]
    assert together == [2, 2, 1, 2, 2, 1]
    for key in ("db", "variance", "travel"):
        np.testing.assert_allclose(getattr(parts, key), getattr(whole, key), rtol=1e-9)


def test_joints_answer_their_sliders_beside_a_long_delay(refined: Refined, monkeypatch: pytest.MonkeyPatch):
    """At the end of a step, against the exponential of the loop; the laws were designed with such a delay."""
    monkeypatch.setattr(case, "DELAY_S", 0.03)
    plan = case.with_slips(case.plan([1.0, 1e3], 4), 0.3)
    laws, truth = design_ladder(case.modes_in_orbit(refined), plan), case.true_plant(0, plan)
    run = set_run(truth, laws, draw_slips(plan.joints, 4, np.random.default_rng(0)), plan)
    step_s = 1.0 / run.time.sample_hz
    for law in laws.values():
        loop = around_sliders(truth, law, run.wiring, run.order)
        n, torques = loop.B.shape
        both = np.zeros((n + torques, n + torques))
        both[:n] = np.hstack([loop.A, loop.B]) * step_s
        exact = (loop.C @ expm(both)[:n, n:])[:torques]
        form = pole_form(loop)
        assert form is not None
        gain = form.drives * np.expm1(form.poles * step_s) / form.poles
        by_poles = np.real(np.einsum("op,jp->oj", form.reads, gain))[:torques]
        np.testing.assert_allclose(by_poles, exact, atol=2e-3 * np.abs(exact).max())


def test_the_result_does_not_hang_on_the_sampling(monkeypatch: pytest.MonkeyPatch):
    """Of one noise; a record twice as long is another noise, and so are more records."""
    monkeypatch.setattr(slip_run, "TIMES", 1)
    plan, slips = asked(intensity=np.array([0.1])), alike((GIMBAL,), 4)
    chosen = slip_time.choose_time(
        turntable(),
        [None],
        slips,
        plan,
        SlipPorts(joints=("turn",), performance=("rate",), disturbances=("turn",)),
    )

    def db(**changes: float) -> np.ndarray:
        altered = dataclasses.replace(chosen, **changes)
        monkeypatch.setattr(slip_run, "choose_time", lambda *_: altered)
        return slipped([turntable()] * 4, {}, slips, plan)[None].db

    with monkeypatch.context() as little:
        little.setattr(slip_run, "ALONE", 2)
        few = db()
        little.setattr(slip_run, "HELD", 1)
        np.testing.assert_allclose(db(), few, rtol=1e-9)
        little.setattr(slip_run, "MOST", 1)
        np.testing.assert_allclose(db(), few, rtol=1e-9)
    coarse = db()
    assert np.mean(coarse) < -1.0
    np.testing.assert_allclose(db(sample_hz=4.0 * chosen.sample_hz), coarse, atol=0.02)
    np.testing.assert_allclose(db(settle_s=2.0 * chosen.settle_s), coarse, atol=0.02)
    assert np.mean(db(record_s=8.0 * chosen.record_s)) == pytest.approx(np.mean(coarse), abs=0.4)


def test_a_joint_that_slips_at_nothing_adds_nothing():
    joint = dataclasses.replace(GIMBAL, slip_torque=0.0, slip_angle_tolerance=0.5)
    slips = draw_slips((joint,), 200, np.random.default_rng(0))
    found = slipped([turntable()] * 2, {}, draw_slips((joint,), 2, np.random.default_rng(0)), asked())
    np.testing.assert_allclose(found[None].db, 0.0, atol=1e-9)
    assert 0.0005 <= slips.slip_angle.min() < 0.00052
    assert 0.00148 < slips.slip_angle.max() <= 0.0015


def test_joints_that_cannot_be_are_refused():
    for change in (
        {"slip_angle": 0.0},
        {"slip_torque": -1.0},
        {"slip_torque_tolerance": 1.0},
        {"viscous": np.nan},
    ):
        with pytest.raises(ConfigError, match="turn"):
            dataclasses.replace(GIMBAL, **change)
    plant = make_plant(
        [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [-1.0]], np.eye(2),
        inputs=["turn"], outputs=["turn", "rate"], w=["turn"], z=["rate"],
    )  # fmt: skip
    with pytest.raises(ConfigError, match="relative angle"):
        slipped([plant], {}, alike((GIMBAL,), 1), asked())


def test_bearings_on_one_shaft_that_slip_at_nothing_add_nothing():
    names = ("turn", "left", "right")
    shaft = make_plant(
        [[0.0, 1.0], [-1e-4, -1.0]], [[0.0] * 3, [1.0] * 3], [[1.0, 0.0]] * 3 + [[0.0, 1.0]],
        inputs=names, outputs=(*names, "rate"), w=["turn"], z=["rate"],
    )  # fmt: skip
    idle = [dataclasses.replace(GIMBAL, name=name, slip_torque=0.0) for name in names[1:]]

    def db(plant: Plant, joints: tuple[JointSlip, ...]) -> np.ndarray:
        run = set_run(plant, {}, alike(joints, 1), asked(joints=joints, intensity=np.array([0.1])))
        return run_slips(dataclasses.replace(run, alone=2), [plant])[None].db

    alone = db(turntable(), (GIMBAL,))
    assert alone[0] < -1.0
    np.testing.assert_allclose(db(shaft, (GIMBAL, *idle)), alone, rtol=1e-9)


def test_a_band_in_which_nothing_moves_is_refused():
    plan = asked(band_hz=(5e3, 6e3))
    with pytest.raises(ConfigError, match="no line in the band of 5000 to 6000 Hz"):
        set_run(turntable(), {}, alike((GIMBAL,), 1), plan)


def test_draws_simulated_apart_are_those_of_a_run_of_all():
    joint = dataclasses.replace(GIMBAL, slip_torque=0.3, slip_angle=3e-4, slip_torque_tolerance=0.2)
    plan, slips = asked(joints=(joint,), draws=3), draw_slips((joint,), 3, np.random.default_rng(0))
    run = set_run(turntable(), {}, slips, plan)
    whole = slipped([turntable()] * 3, {}, slips, plan)[None]
    parts = join_slips([run_slips(run, [turntable()] * 2), run_slips(run, [turntable()], 2)])[None]
    assert np.ptp(whole.travel) > 1e-3 * whole.travel.max()
    for key in ("db", "variance", "travel"):
        np.testing.assert_allclose(getattr(parts, key), getattr(whole, key), rtol=1e-9)


@pytest.fixture(scope="module")
def refined() -> Refined:
    return case.refined(0)


def test_what_is_promised_with_friction_comes(refined: Refined):
    """On the rig, in time, with friction that the plan knows within tolerances, at a small disturbance."""
    plan = case.with_slips(case.plan([1e2], 10), 0.03)
    (found,) = promise(refined, plan).values()
    (outlook,) = found.outlooks
    (law,) = design_ladder(case.modes_in_orbit(refined), plan).values()
    truth = case.true_plant(0, plan)
    rigs = case.true_rigs(0, truth, plan)
    added = case.friction_db(0, rigs, plan, law, 20.0) - case.friction_db(0, rigs, plan, None, 60.0)
    came = case.true_db(truth, law, plan) + added
    assert outlook.friction is not None
    # A minute on the rig is sure to a decibel.
    assert abs(outlook.level_db(0.5) - came) < 2.0
    # What friction costs; without it the promise is one of too much.
    assert 2.0 < outlook.level_db(0.5) - np.median(outlook.friction.without_db) < 5.0
    assert came - np.median(outlook.friction.without_db) > 2.0
    assert outlook.friction.sticks.all()
    assert outlook.friction.travel[1] > 1.0
