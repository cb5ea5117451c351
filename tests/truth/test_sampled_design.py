"""Sampled LQG: closed forms, the loop stepped finely, identities of forms, and the continuous limit."""

import dataclasses
import warnings
from itertools import pairwise

import mace_like
import numpy as np
import pytest
import sampled_cases as cases
import scipy.integrate as si
import scipy.linalg as sla
from hypothesis import given
from hypothesis import strategies as st

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.held_plant import hold_plant
from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.control.sampled.sampled_design import design_sampled_lqg, sample_cost
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.errors import ConfigError, NotStabilisableError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays, subsystem
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.plants.response import statespace_response
from middeck.systems.sampling.delayed_sampling import sample_delayed
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from plant_builders import grouped_plant, sum_of_modes, unit_weights
from repeats import repeats

FORMS = ("predictor", "current")


def walk():
    ports = (Port("push", "N"),), (Port("way", "m"),)
    return grouped_plant(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), ports[0], ports[1])


@pytest.mark.parametrize("T", [1e-4, 0.1, 2.0])
@pytest.mark.parametrize("rho", [1e-3, 1.0])
def test_random_walk_in_closed_form(T, rho):
    # x' = u + w: the mean of x^2 over a period is x^2 + T x u + T^2 u^2 / 3 + T / 2. The regulator's equation
    # becomes X^2 = rho / T^2 + 1/12; the filter's P^2 / (P + 1/T) = T for noise of unit intensities.
    weights = unit_weights(("push",), 1.0)
    X, P = np.sqrt(rho / T**2 + 1.0 / 12.0), (T + np.sqrt(T**2 + 4.0)) / 2.0
    weight = rho + T**2 / 3.0 + T**2 * X
    K = T * (X + 0.5) / weight
    known = {"predictor": P, "current": P / (1.0 + P * T)}
    for form, error in known.items():
        law = design_sampled_lqg(walk(), weights, 1.0 / rho, T, form)
        # A scalar; doubling, a Newton step and a sum.
        assert law.cost == pytest.approx(X * T + error * K**2 * weight + T / 2.0, rel=1e-12)
        assert law.noise_cost == pytest.approx(T / 2.0, rel=1e-14)
        assert law.regulator.poles[0] == pytest.approx(1.0 - T * K, abs=1e-12)


def test_noise_of_a_fast_resonance_in_closed_form():
    # q'' = -w^2 q + n: variances (h -+ sin(2 w h) / (2 w)) / 2 of w q and q'; a thousand turns in one step.
    w, h = 2.0 * np.pi * 200.0, 5.0003
    found = spread_noise(np.array([[0.0, w], [-w, 0.0]]), np.diag([0.0, 1.0]), h)
    swing = np.sin(2.0 * w * h) / (2.0 * w)
    # The phase of 6283 rad is known to its rounding, 1e-12, times the doublings.
    np.testing.assert_allclose(np.diag(found.covariance), [(h - swing) / 2.0, (h + swing) / 2.0], rtol=1e-12)
    np.testing.assert_allclose(np.trace(found.dwell), h**2 / 2.0, rtol=1e-11)


def test_cost_is_the_integral_of_the_response():
    # z' W^2 z under held inputs, by quadrature: the response is that of an exponential, input by input.
    plant, weights, T = cases.tangled(), cases.tangled_weights(), 0.1
    held = hold_plant(plant, weights, T)
    price = sample_cost(held, weights, 10.0)
    s = subsystem(remove_delays(plant), ("u1", "u2"), ("z1", "z2"))
    rng = np.random.default_rng(3)
    start = rng.standard_normal(len(held.system.A))
    u = rng.standard_normal(2)
    delay = np.array([0.13, 0.045])  # and the first measurement is on time
    # Past inputs stand in the order of the states: of the first input two, of the second one.
    past = {0: [u[0], start[4], start[5]], 1: [u[1], start[6]]}

    def force(t):
        return np.array([past[i][int(np.ceil(round(delay[i] / T - t / T, 12)))] for i in range(2)])

    cuts = np.array([0.0, 0.03, 0.045, T])
    x, total = start[:4], 0.0
    for a, b in pairwise(cuts):
        v = force((a + b) / 2.0)
        block = np.block([[s.A, (s.B @ v)[:, None]], [np.zeros((1, 5))]])

        def z(t, block=block, x=x, v=v):
            now = (sla.expm(block * t) @ np.append(x, 1.0))[:4]
            return float(np.sum((weights.output * (s.C @ now + s.D @ v)) ** 2))

        total += si.quad(z, 0.0, b - a, epsabs=0.0, epsrel=1e-12)[0]
        x = (sla.expm(block * (b - a)) @ np.append(x, 1.0))[:4]
    control = float(np.sum(weights.input * u**2)) / 10.0
    quadratic = start @ price.Q @ start + 2.0 * start @ price.S @ u + u @ price.R @ u
    assert quadratic == pytest.approx(total / T + control, rel=1e-11)  # the quadrature's own 1e-12, ten times


@pytest.mark.parametrize("T", [0.1, 0.04, 0.3])
def test_controlled_path_is_the_delayed_sampling_of_the_plant(T):
    # An independent arrangement of the same states (fewest of them, outputs looked ahead for).
    plant = cases.tangled()
    system = subsystem(remove_delays(plant), ("u1", "u2"), ("y1", "y2"))
    omega = np.array([0.3, 2.0, 6.0, 0.9 * np.pi / T])
    mine = statespace_response(hold_plant(plant, cases.tangled_weights(), T).system, omega)
    theirs = statespace_response(sample_delayed(system, T, plant.delay_s[2:, :2]), omega)
    np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-11 * np.abs(theirs).max())


def step_finely(plant, law, weights, T, step):
    """Covariances of the same loop as steps of ``step``, every delay a chain of steps: nothing of the above.

    The mean squares of z and u: z just after each step begins, over a steady period.
    """
    inside, delay = remove_delays(plant), np.round(plant.delay_s / step).astype(int)
    A, B, C, D = (getattr(inside.system, k) for k in "ABCD")
    n, per = len(A), round(T / step)
    of_u, of_y = delay[0, :2] - delay[0, 2], delay[:, 2]  # input delays beyond that of w, outputs' with it
    depth_u, depth_y = of_u + delay[0, 2] - delay[0, 2], of_y
    shift = -min(depth_u.min(), 0)
    depth_u = depth_u + shift
    exponential = sla.expm(np.block([[A, B[:, :2]], [np.zeros((2, n + 2))]]) * step)
    spread = spread_noise(A, B[:, 2:] @ weights.process @ B[:, 2:].T, step).covariance
    # States: x, the command in force now, past commands of each input, past clean outputs y, the law's.
    sizes = [n, 2, *depth_u, depth_y[2], depth_y[3], len(law.sampled.A)]
    at = np.concatenate([[0], np.cumsum(sizes)])
    N = at[-1]
    command = at[1] + np.arange(2)
    rows = np.zeros((2, N))  # commands that reach the plant now
    for i in range(2):
        rows[i, command[i] if depth_u[i] == 0 else at[3 + i] - 1] = 1.0
    state = np.eye(n, N)
    outputs = C @ state + D[:, :2] @ rows
    move = np.zeros((N, N))
    move[:n] = exponential[:n, :n] @ state + exponential[:n, n:] @ rows
    move[command, command] = 1.0
    for i in range(2):
        for k in range(depth_u[i]):
            move[at[2 + i] + k, command[i] if k == 0 else at[2 + i] + k - 1] = 1.0
    for o in range(2):
        for k in range(depth_y[2 + o]):
            if k == 0:
                move[at[4 + o]] = outputs[2 + o]
            else:
                move[at[4 + o] + k, at[4 + o] + k - 1] = 1.0
    move[at[6] :, at[6] :] = np.eye(N - at[6])
    noise = np.zeros((N, N))
    noise[:n, :n] = spread
    # At a sample: y is read, the law moves, the new command is in force.
    read = np.array([np.eye(N)[at[5 + o] - 1] if depth_y[2 + o] else outputs[2 + o] for o in range(2)])
    tick, into = np.eye(N), np.zeros((N, 2))
    own = np.eye(N)[at[6] :]
    tick[command] = law.sampled.D @ read + law.sampled.C @ own
    tick[at[6] :] = law.sampled.B @ read + law.sampled.A @ own
    into[command], into[at[6] :] = law.sampled.D, law.sampled.B
    sensor = into @ np.diag(weights.sensor / T) @ into.T

    def period(P):
        squares = []
        P = tick @ P @ tick.T + sensor
        control = np.diag(P)[command]
        for _ in range(per):
            # What reached the plant before the tick and after it differ: z is read after.
            squares.append(np.diag(outputs[:2] @ P @ outputs[:2].T))
            P = move @ P @ move.T + noise
        squares.append(np.diag(outputs[:2] @ P @ outputs[:2].T))
        return P, np.array(squares), control

    whole = np.linalg.matrix_power(move, per) @ tick
    per_period, _, _ = period(np.zeros((N, N)))
    P = sla.solve_discrete_lyapunov(whole, per_period, method="direct" if N < 12 else "bilinear")
    _, squares, control = period(P)
    return squares, control


@pytest.mark.parametrize("form", FORMS)
def test_rms_is_that_of_the_same_loop_stepped_finely(form):
    plant, weights, T = cases.tangled(), cases.tangled_weights(), 0.1
    # No direct term to z, so that z does not jump and its mean is the trapezoid's to step^2.
    system = remove_delays(plant).system
    D = np.array(system.D)
    D[:2] = 0.0
    smooth = dataclasses.replace(remove_delays(plant), dynamics=StateSpace(system.A, system.B, system.C, D))
    plant = delay_plant(smooth, plant.delay_s)
    law = design_sampled_lqg(plant, weights, 10.0, T, form)
    found = measure_sampled_loop(plant, law, weights, 10.0)
    means = []
    for step in (0.005, 0.0025):
        squares, control = step_finely(plant, law, weights, T, step)
        means.append((squares[:-1].sum(axis=0) + 0.5 * (squares[-1] - squares[0])) / (len(squares) - 1))
        # All else is exact; the bilinear Lyapunov solver keeps ten digits of a loop this slow.
        np.testing.assert_allclose(found.control_rms**2, control, rtol=1e-8)
    refined = (4.0 * means[1] - means[0]) / 3.0
    # Richardson leaves (6 rad/s * 0.0025 s)^4 = 5e-8, some times over.
    np.testing.assert_allclose(found.rms**2, refined, rtol=1e-6)
    assert np.all(np.abs(found.rms**2 / means[0] - 1.0) < 1e-2)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("T", [0.03, 0.1, 0.25])
def test_cost_is_that_of_the_measured_loop(form, T):
    # The trace formula of the two Riccati solutions, against covariances followed through the period.
    plant, weights = cases.tangled(), cases.tangled_weights()
    law = design_sampled_lqg(plant, weights, 10.0, T, form)
    found = measure_sampled_loop(plant, law, weights, 10.0)
    assert found.stable
    assert found.cost == pytest.approx(law.cost, rel=1e-11)
    separate = np.concatenate([law.regulator.poles, law.estimator.poles])
    # Poles at zero, up to twenty of them for the delays, are known to a root of rounding only: the others.
    there = np.abs(found.poles) > 0.3
    apart = np.abs(found.poles[there, None] - separate[None]).min(axis=1)
    assert apart.max() < 1e-8
    assert max(law.regulator.residual, law.estimator.residual) < 1e-14


@pytest.mark.parametrize("form", FORMS)
def test_no_law_near_it_costs_less(form):
    plant, weights, T = cases.late_gimbal(), cases.gimbal_weights(), 0.004
    law = design_sampled_lqg(plant, weights, 100.0, T, form)
    rng = np.random.default_rng(5)
    for size in (1e-3, 1e-2):
        for _ in range(3):
            other = dataclasses.replace(
                law.sampled, C=law.sampled.C * (1.0 + size * rng.standard_normal(law.sampled.C.shape)),
                B=law.sampled.B * (1.0 + size * rng.standard_normal(law.sampled.B.shape)),
            )  # fmt: skip
            changed = Compensator(other, law.inputs, law.outputs, method="changed")
            found = measure_sampled_loop(plant, changed, weights, 100.0)
            assert found.cost > law.cost * (1.0 + 1e-9)


@pytest.mark.parametrize("T", [0.01, 0.004])
def test_predictor_is_the_current_form_a_sample_later(T):
    # To compute for a whole period, or to be measured a period later, is one.
    plant, weights = cases.gimbal(), cases.gimbal_weights()
    delayed = design_sampled_lqg(delay_plant(plant, 0.01 + T), weights, 100.0, T, "current")
    ahead = design_sampled_lqg(delay_plant(plant, 0.01), weights, 100.0, T, "predictor")
    assert ahead.cost == pytest.approx(delayed.cost, rel=1e-11)


def test_a_delay_costs_the_same_wherever_it_is():
    weights, T = cases.tangled_weights(), 0.1
    inside = remove_delays(cases.tangled())
    delays = {"inputs": np.zeros((4, 3)), "outputs": np.zeros((4, 3)), "z and w too": np.full((4, 3), 0.037)}
    delays["inputs"][:, :2] = 0.037
    delays["outputs"][2:] = 0.037
    delays["z and w too"][:2] += 0.2
    delays["z and w too"][:, 2] += 0.5
    costs = [design_sampled_lqg(delay_plant(inside, d), weights, 10.0, T).cost for d in delays.values()]
    np.testing.assert_allclose(costs, costs[0], rtol=1e-12)


@pytest.mark.parametrize("more_s", [1e-3, 0.01])
def test_delays_of_single_paths(more_s):
    """No sums of input and output delays: from u to y they cost nothing, elsewhere in proportion.

    What the commands do to the measurements is known, whatever their delay, and does not change the estimate.
    """
    weights, T = cases.tangled_weights(), 0.1
    whole = cases.tangled()
    s = remove_delays(whole).system
    # The channels have states of their own then, and a rigid body has one state only: here it decays.
    plant = dataclasses.replace(
        remove_delays(whole), dynamics=dataclasses.replace(s, A=s.A - 0.2 * np.eye(4))
    )

    def cost(row, column, more):
        delay_s = whole.delay_s.copy()
        delay_s[row, column] += more
        return design_sampled_lqg(delay_plant(plant, delay_s), weights, 10.0, T).cost

    least = cost(0, 0, 0.0)
    for row, column in [(2, 0), (2, 1), (3, 0), (3, 1)]:  # from u to y
        assert cost(row, column, more_s) == pytest.approx(least, rel=1e-9)
    for row, column in [(0, 0), (2, 2)]:  # from u to z, and from w to y
        once, twice = (cost(row, column, k * more_s) - least for k in (1, 2))
        assert 1e-5 * least < once < 0.01 * least
        assert twice == pytest.approx(2.0 * once, rel=0.02)


def energy_of_responses(delay, gains, T, law, sensor, periods):
    """Mean of z'z + u'u / 10 with z = y of a free body of unit mass, paths late by ``late`` eighths of T.

    Each input moves a copy of its own, so that every path reads the past of one copy; two steps an
    eighth, and the energy of the response to each independent noise of one period, by Simpson's rule.
    """
    per, h, rate = 16, T / 16, law.sampled
    move, gain = np.array([[1.0, h], [0.0, 1.0]]), np.array([h * h / 2.0, h])
    drawn = np.linalg.cholesky([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
    each = 2 * 2 * per
    x, own = np.zeros((2, 2, each + 2)), np.zeros((len(rate.A), each + 2))
    past, energy = [], 0.0
    for k in range(periods * per):
        past.append(x[:, 0])
        y = np.array([
            sum(gains[o] * past[k - 2 * delay[o][i]][i] for i in range(2) if k >= 2 * delay[o][i])
            + np.zeros(each + 2) for o in range(2)
        ])  # fmt: skip
        energy += h / 3.0 * (4.0 if k % 2 else 2.0) * np.sum(y**2)
        if k % per == 0:
            if k == per:
                y[:, each:] += np.eye(2) * np.sqrt(sensor / T)
            u = rate.C @ own + rate.D @ y
            own = rate.A @ own + rate.B @ y
            energy += T * np.sum(u**2) / 10.0
        x = np.einsum("ab,ibk->iak", move, x) + gain[:, None] * (gains[:, None] * u)[:, None]
        if k < per:  # u1 and u2 each carry white noise of intensity one
            for i in range(2):
                first = 2 * (2 * k + i)
                x[i, :, first : first + 2] += gains[i] * drawn
    return energy / T


@pytest.mark.parametrize("delay", repeats([[[20, 18], [21, 2]], [[10, 16], [11, 2]], [[7, 4], [6, 22]]]))
def test_free_body_with_a_delay_of_its_own_in_each_path(delay):
    # Delays that have decayed within the period have entries of A near 1e-16: no output, it was said, saw it.
    T, gains, sensor, ports = 0.5, np.array([1.0, 0.7]), 1e-3, (("u1", "u2"), ("y1", "y2"))
    body = [[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], gains], [[gains[0], 0.0], [gains[1], 0.0]]
    plant = make_plant(
        *body, w=ports[0], u=ports[0], z=ports[1], y=ports[1], delay_s=np.array(delay) * T / 8.0
    )  # fmt: skip
    weights = LQGWeights(
        output=np.ones(2), input=np.ones(2), disturbed=ports[0], process=np.eye(2), sensor=[sensor, sensor]
    )
    law = design_sampled_lqg(plant, weights, 10.0, T)
    # Delays that are no sums are approximated (order 8): 7e-6 and 2e-5 of the cost here.
    assert law.cost == pytest.approx(energy_of_responses(delay, gains, T, law, sensor, 40), rel=1e-4)


@pytest.mark.parametrize(("form", "order"), [("predictor", 1), ("current", 2)])
def test_fast_sampling_is_the_continuous_design(form, order):
    plant, weights = cases.gimbal(), cases.gimbal_weights()
    limit = design_lqg(plant, weights, 100.0)
    laws = [design_sampled_lqg(plant, weights, 100.0, T, form) for T in (4e-4, 2e-4, 1e-4)]
    lost = np.array([law.cost for law in laws]) - limit.cost
    assert np.all(lost > 0.0)
    # A sample to compute in costs by its length, the hold alone by its square (see the page): the next power
    # is 2e-2 of it at 1e-4 s for the predictor, 1e-3 for the current form.
    np.testing.assert_allclose(lost[:-1] / lost[1:], 2.0**order, rtol=0.05)
    # The filter's fastest poles are at 1e3 rad/s: a gain errs by T times that, extrapolated by its square.
    regulator = 2.0 * laws[2].regulator.gain - laws[1].regulator.gain
    filtered = 2.0 * laws[2].estimator.gain.T / 1e-4 - laws[1].estimator.gain.T / 2e-4
    for found, wanted in ((regulator, limit.regulator.gain), (filtered, limit.estimator.gain.T)):
        np.testing.assert_allclose(found.ravel(), wanted.ravel(), atol=0.01 * np.abs(wanted).max())
    omega = 2.0 * np.pi * np.array([0.5, 1.5, 5.0, 9.0])
    fine, coarse = (statespace_response(law.sampled, omega) for law in (laws[2], laws[1]))
    wanted = statespace_response(limit.system, omega)
    np.testing.assert_allclose(2.0 * fine - coarse, wanted, atol=0.01 * np.abs(wanted).max())


def test_with_delay_the_limit_is_that_of_fine_approximation():
    plant, weights = cases.late_gimbal(), cases.gimbal_weights()
    limit = design_lqg(approximate_delays(plant, 8), weights, 100.0).cost
    costs = [design_sampled_lqg(plant, weights, 100.0, T, "current").cost for T in (1e-3, 5e-4)]
    # Pade 8 is exact in the band of the loop; what is lost is quadratic, its rest of fourth order or third.
    assert (4.0 * costs[1] - costs[0]) / 3.0 == pytest.approx(limit, rel=2e-4)


def test_zero_g_plant_with_its_inert_modes():
    plant = close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops())
    weights = mace_like.weights(2e-6, process_ratio=1e-2)
    law = design_sampled_lqg(delay_plant(plant, 0.0035), weights, 10.0, 0.002, "current")
    found = measure_sampled_loop(delay_plant(plant, 0.0035), law, weights, 10.0)
    assert found.stable
    assert found.cost == pytest.approx(law.cost, rel=1e-7)  # poles from 0.01 to 300 rad/s at 500 Hz
    assert max(law.regulator.residual, law.estimator.residual) < 1e-10


def simulate_gimbal(law, weights, T, fine, runs, periods, settle, rng):
    """z^2 and u^2 of the loop, step by step with noise, each averaged over time, run by run."""
    plant = cases.gimbal()
    system = plant.system
    h = T / fine
    delay = round(0.01 / h)
    spread = spread_noise(system.A, weights.process.item() * system.B @ system.B.T, h)
    root = np.linalg.cholesky(spread.covariance + 1e-14 * np.trace(spread.covariance) * np.eye(len(system.A)))
    n, m = system.B.shape
    hold = sla.expm(np.block([[system.A, system.B], [np.zeros((m, n + m))]]) * h)[:n, n:]
    x, xc = np.zeros((n, runs)), np.zeros((len(law.sampled.A), runs))
    waiting = np.zeros((delay + 1, 1, runs))
    sums, count, t = np.zeros((2, runs)), 0, 0
    for k in range(periods):
        y = system.C @ x + np.sqrt(weights.sensor / T) * rng.standard_normal((1, runs))
        u = law.sampled.C @ xc + law.sampled.D @ y
        xc = law.sampled.A @ xc + law.sampled.B @ y
        for _ in range(fine):
            waiting[t % (delay + 1)] = u
            if k >= settle:
                sums += np.vstack([(system.C @ x) ** 2, u**2])
                count += 1
            x = spread.transition @ x + hold @ waiting[(t - delay) % (delay + 1)]
            x = x + root @ rng.standard_normal((n, runs))
            t += 1
    return sums / count


def test_rms_is_that_of_a_monte_carlo_simulation():
    # The delay is in front of the torque motor alone: the disturbance is white, and late or not the same.
    weights, T, runs = cases.gimbal_weights(), 0.01, 400
    law = design_sampled_lqg(cases.late_gimbal(), weights, 100.0, T, "current")
    found = measure_sampled_loop(cases.late_gimbal(), law, weights, 100.0)
    squares = simulate_gimbal(law, weights, T, 5, runs, 500, 200, np.random.default_rng(11))
    expected = np.array([found.rms[0] ** 2, found.control_rms[0] ** 2])
    # Runs are independent: 4 standard errors of their mean, and 5 points in a period for its average (0.3 %).
    error = squares.std(axis=1, ddof=1) / np.sqrt(runs)
    assert np.all(np.abs(squares.mean(axis=1) - expected) < 4.0 * error + 0.003 * expected)
    assert np.all(error < 0.03 * expected)


@pytest.mark.parametrize("seed", repeats(range(12), 4))
def test_a_law_that_moves_nothing_that_is_disturbed_has_no_effort(seed: int) -> None:
    """Noise shakes one body, the force another, in mixed states: S/(4 zeta omega^3). The variance of the
    command is rounding about zero, and its root was not a number for one in two."""
    rng = np.random.default_rng([20, seed])
    omega, zeta = rng.uniform(1.0, 3.0), 0.01
    A = sla.block_diag([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]], [[0.0, 1.0], [-50.0, -0.2]])
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    B, C = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]), np.eye(4)[::2]
    plant = make_plant(
        turn.T @ A @ turn, turn.T @ B, C @ turn,
        inputs=["w", "u"], outputs=["a", "b"], w=["w"], u=["u"], z=["a", "b"], y=["a"],
    )  # fmt: skip
    weights = unit_weights(("w",), np.array([1e-3]), outputs=2)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "law and cost are uncertain")  # a law of zero is rounding alone
        law = design_sampled_lqg(plant, weights, 10.0, 0.03)
    found = measure_sampled_loop(plant, law, weights, 10.0)
    assert found.rms[0] == pytest.approx(np.sqrt(1.0 / (4.0 * zeta * omega**3)), rel=1e-9)
    assert 0.0 <= found.control_rms[0] < 1e-6
    assert found.rms[1] < 1e-6


def test_unstable_loop_is_a_value():
    weights = cases.gimbal_weights()
    law = design_sampled_lqg(cases.late_gimbal(), weights, 100.0, 0.01)
    found = measure_sampled_loop(delay_plant(cases.gimbal(), 0.02), law, weights, 100.0)
    assert not found.stable
    assert found.rms.tolist() == found.control_rms.tolist() == [np.inf]
    assert found.cost == found.metric == np.inf


def test_a_walk_that_nothing_holds_has_no_rms():
    weights = unit_weights(("push",), 1.0)
    law = design_sampled_lqg(walk(), weights, 1.0, 0.1)
    still = dataclasses.replace(law.sampled, C=0.0 * law.sampled.C)
    idle = Compensator(still, law.inputs, law.outputs, method="none")
    with pytest.warns(UserWarning, match="the pole at 0 Hz neither decays"):
        found = measure_sampled_loop(walk(), idle, weights, 1.0)
    assert found.stable
    assert found.rms[0] == np.inf


@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_a_mode_that_sampling_hides_is_named(turns):
    # An undamped mode of whole half turns from sample to sample.
    T = 0.01
    modal = dataclasses.replace(
        cases.gimbal(more_hz=(turns / T,), more_shape=(1.0,)).dynamics, zeta=np.array([0.01] * 5 + [0.0])
    )
    plant = dataclasses.replace(cases.gimbal(), dynamics=modal)
    with pytest.raises(NotStabilisableError, match=f"{turns / T:g} Hz"):
        design_sampled_lqg(plant, cases.gimbal_weights(), 100.0, T)


@pytest.mark.parametrize(
    ("torque", "angle", "message"),
    [(1.0, 0.0, "no measurement in y sees it"), (0.0, 1.0, "no control input in u")],
)
def test_modes_that_nothing_sees_or_reaches_are_named(torque, angle, message):
    # A rigid turn beside the modes, in a draught.
    modal = cases.gimbal().dynamics
    more = ModalSystem(
        omega=np.append(modal.omega, 0.0),
        zeta=np.append(modal.zeta, 0.0),
        psi=np.block([[modal.psi, np.zeros((5, 1))], [np.array([[torque, 1.0]])]]),
        phi=np.hstack([modal.phi, [[angle]]]),
        phi_rate=np.zeros((1, 6)),
        names=(*modal.names, "turn"),
    )
    ports = (Port("torque", "N m"), Port("draught", "N m")), (Port("angle", "rad"),)
    plant = grouped_plant(more, ports[0], ports[1], w=("torque",), u=("torque",))
    weights = dataclasses.replace(cases.gimbal_weights(), disturbed=("torque", "draught"), process=np.eye(2))
    with pytest.raises(NotStabilisableError, match=f"{message}.*turn"):
        design_sampled_lqg(plant, weights, 100.0, 0.01)


@given(
    seed=st.integers(0, 10_000),
    late_in=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2),
    late_out=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2),
    form=st.sampled_from(FORMS),
)
def test_any_plant_with_any_delays(seed, late_in, late_out, form):
    # The path is that of another arrangement, and the trace formula is the measured cost.
    rng, T = np.random.default_rng(seed), 0.2
    A = rng.standard_normal((4, 4)) - 1.0 * np.eye(4)
    inputs, outputs = (tuple(Port(name, "N") for name in side.split()) for side in ("u1 u2 w1", "y1 y2"))
    system = StateSpace(A, rng.standard_normal((4, 3)), rng.standard_normal((2, 4)), np.zeros((2, 3)))
    plant = Plant(
        dynamics=system,
        inputs=inputs,
        outputs=outputs,
        w=("w1",),
        u=("u1", "u2"),
        z=("y1", "y2"),
        y=("y1", "y2"),
    )
    delay_s = T * (np.array([*late_in, 0.0]) + np.array(late_out)[:, None])
    delayed = delay_plant(plant, delay_s)
    weights = unit_weights(("w1",), [0.1, 0.1], outputs=2, inputs=2)
    omega = np.array([0.1, 1.0, 10.0])
    mine = statespace_response(hold_plant(delayed, weights, T).system, omega)
    control = StateSpace(A, system.B[:, :2], system.C, np.zeros((2, 2)))
    theirs = statespace_response(sample_delayed(control, T, delay_s[:, :2]), omega)
    # Instants within 1e-9 of a sample count as on it: the response differs by as much.
    np.testing.assert_allclose(mine, theirs, atol=1e-8 * np.abs(theirs).max())
    law = design_sampled_lqg(delayed, weights, 10.0, T, form)
    assert measure_sampled_loop(delayed, law, weights, 10.0).cost == pytest.approx(law.cost, rel=1e-8)


def test_a_walk_under_a_gain_is_a_closed_form_at_the_samples_and_between_them():
    # x+ = (1 - k T) x - k T v + w; after t within a period (1 - k t) x - k t v and noise of variance t.
    T, k, r = 0.4, 1.5, 0.3
    law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-k]], period_s=T)
    plant = walk()
    weights = unit_weights(("push",), r)
    held = Compensator(law, plant.outputs, plant.inputs, method="gain")
    found = measure_sampled_loop(plant, held, weights, 1.0)
    at_samples = (T + k**2 * T * r) / (1.0 - (1.0 - k * T) ** 2)
    between = at_samples * (1.0 - k * T + (k * T) ** 2 / 3.0) + T / 2.0 + k**2 * T * r / 3.0
    assert found.rms_at_samples**2 == pytest.approx([at_samples], rel=1e-12)
    assert found.rms**2 == pytest.approx([between], rel=1e-12)
    assert found.control_rms**2 == pytest.approx([k**2 * (at_samples + r / T)], rel=1e-12)


def test_single_delayed_paths_keep_the_phase_of_a_fast_mode():
    # 12.5 radians late on one path alone: order 8 is wrong there by a tenth, order 16 right to 1e-9.
    ports = (Port("u1", "N"), Port("u2", "N")), (Port("y1", "m"), Port("y2", "m"))
    modal = sum_of_modes([250.0], 0.01, [[1.0, 0.5]], [[1.0], [0.7]], names=("fast",))
    plant = grouped_plant(modal, ports[0], ports[1], w=("u1",), z=("y1",))
    delay_s, T = np.array([[0.0, 0.0], [0.0, 0.05]]), 0.002
    weights = unit_weights(("u1",), [1.0, 1.0], inputs=2)
    omega = np.array([240.0, 250.0, 260.0])
    mine = statespace_response(hold_plant(delay_plant(plant, delay_s), weights, T).system, omega)
    theirs = statespace_response(sample_delayed(plant.system, T, delay_s), omega)
    # What is left are harmonics of the hold: at 2900 rad/s, of the peak (250/2900)^3 / 50 = 1e-5.
    np.testing.assert_allclose(mine, theirs, atol=3e-5 * np.abs(theirs).max())


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_period_must_be_one(period):
    with pytest.raises(ConfigError, match="period"):
        design_sampled_lqg(cases.late_gimbal(), cases.gimbal_weights(), 100.0, period)


@pytest.mark.parametrize("authority", [0.0, -1.0, np.nan, np.inf])
def test_authority_must_be_positive(authority):
    with pytest.raises(ConfigError, match="authority"):
        design_sampled_lqg(cases.late_gimbal(), cases.gimbal_weights(), authority, 0.01)


def test_weights_must_fit():
    weights = cases.gimbal_weights()
    for change in ({"output": [1.0, 1.0]}, {"input": [1.0, 1.0]}, {"sensor": [1.0, 1.0]}):
        with pytest.raises(ConfigError, match=r"2 .* for 1 ports"):
            hold_plant(cases.late_gimbal(), dataclasses.replace(weights, **change), 0.01)
    with pytest.raises(ConfigError, match="no input named 'wind'"):
        hold_plant(cases.late_gimbal(), dataclasses.replace(weights, disturbed=("wind",)), 0.01)


def test_direct_paths_without_a_sample_are_refused():
    plant, weights = remove_delays(cases.tangled()), cases.tangled_weights()
    with pytest.raises(ConfigError, match="the plant responds within the sample"):
        design_sampled_lqg(plant, weights, 10.0, 0.1, "current")
    law = design_sampled_lqg(plant, weights, 10.0, 0.1, "predictor")
    assert measure_sampled_loop(plant, law, weights, 10.0).cost == pytest.approx(law.cost, rel=1e-11)
    direct = dataclasses.replace(law.sampled, D=np.ones((2, 2)))
    with pytest.raises(ConfigError, match="both respond within the sample"):
        measure_sampled_loop(plant, Compensator(direct, law.inputs, law.outputs), weights, 10.0)
    with pytest.raises(ConfigError, match="no form"):
        design_sampled_lqg(plant, weights, 10.0, 0.1, "filtered")


@pytest.mark.parametrize(("row", "what"), [(0, "performance"), (2, "measurement")])
def test_white_noise_is_not_sampled(row, what):
    plant = remove_delays(cases.tangled())
    D = np.array(plant.system.D)
    D[row, 2] = 1.0
    system = dataclasses.replace(plant.system, D=D)
    with pytest.raises(ConfigError, match=f"reaches a {what}"):
        hold_plant(dataclasses.replace(plant, dynamics=system), cases.tangled_weights(), 0.1)


def test_disturbances_that_belong_together_must_be_delayed_together():
    plant = dataclasses.replace(remove_delays(cases.tangled()), w=("w1", "u1"))
    weights = dataclasses.replace(
        cases.tangled_weights(), disturbed=("w1", "u1"), process=[[1.0, 0.5], [0.5, 1.0]]
    )
    with pytest.raises(ConfigError, match="correlated disturbances"):
        hold_plant(delay_plant(plant, cases.tangled().delay_s), weights, 0.1)


def test_other_ports_are_named():
    law = design_sampled_lqg(cases.late_gimbal(), cases.gimbal_weights(), 100.0, 0.01)
    other = dataclasses.replace(law, inputs=(Port("rate", "rad/s"),))
    with pytest.raises(ConfigError, match="reads rate and drives torque"):
        measure_sampled_loop(cases.late_gimbal(), other, cases.gimbal_weights(), 100.0)
