"""The least further delay that loses a sampled loop, modes beyond half the rate included."""

import dataclasses

import numpy as np
import pytest
import sampled_cases as cases
import scipy.linalg
from scipy.optimize import brentq

from middeck.control.analysis.margins import delay_limit
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from plant_builders import sum_of_modes
from repeats import repeats

pytestmark = pytest.mark.kernels

U, Y = (Port("u", "N"),), (Port("y", "m"),)
PERIOD = 0.01
TURN = 2.0 * np.pi


def law(gain, *, waits, period=PERIOD):
    """u[k] = gain y[k], or a period later."""
    parts = (np.zeros((1, 1)), np.ones((1, 1)), [[gain]], np.zeros((1, 1)))
    now = (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[gain]])
    return Compensator(SampledStateSpace(*(parts if waits else now), period_s=period), Y, U, method="gain")


def plant_of(dynamics):
    return Plant(dynamics=dynamics, inputs=U, outputs=Y, w=("u",), u=("u",), z=("y",), y=("y",))


def mode(hz, gain):
    omega = 2.0 * np.pi * hz
    return sum_of_modes([omega], 0.01, [[1.0]], [[gain * 0.02 * omega**2]], names=("panel",))


def limit_of(plant, one, **options):
    return measure_margins(plant, one, **options).loops[0].delay_limit_s


@pytest.mark.parametrize("k", [1.05, 1.25, 1.9])
def test_a_delayed_integrator_has_a_closed_form(k):
    # z (z - 1) + k (1 - theta) z + k theta: by Jury stable for k theta < 1, with k = gain times period.
    integrator = plant_of(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]))
    found = limit_of(integrator, law(-k / PERIOD, waits=False))
    assert found == pytest.approx(PERIOD / k, rel=1e-6)  # the stability limit of 1e-8 rad/s, over a period


def radius(modal, gain, late_s):
    """Largest |z| of the loop, written out with matrix exponentials: no code of the package but the matrices.

    u[k] = gain y[k - 1], late by n whole periods and a part.
    """
    s = modal.as_statespace()
    n, part = divmod(late_s, PERIOD)
    whole = scipy.linalg.expm(np.block([[s.A, s.B], [np.zeros((1, 3))]]) * PERIOD)
    rest = scipy.linalg.expm(np.block([[s.A, s.B], [np.zeros((1, 3))]]) * (PERIOD - part))
    A, newer = whole[:2, :2], rest[:2, 2:]
    older = whole[:2, 2:] - newer
    size = 2 + int(n) + 2  # x, then u[k], u[k-1], ... down to the oldest in force
    loop = np.zeros((size, size))
    loop[:2, :2] = A
    loop[:2, size - 2 : size - 1], loop[:2, size - 1 :] = newer, older
    loop[2, :2] = gain * s.C[0]
    loop[3:, 2:-1] = np.eye(size - 3)
    return float(np.abs(np.linalg.eigvals(loop)).max())


@pytest.mark.parametrize(
    ("hz", "sign", "delay"),
    [(71.2, 1.0, 0.00142), (55.0, -1.0, 0.004), (55.0, 1.0, 0.004), (94.0, -1.0, 0.0)],
)
def test_a_mode_beyond_half_the_rate_turns_at_its_own_frequency(hz, sign, delay):
    modal = mode(hz, 2.0 / np.sinc(hz * PERIOD))  # a loop gain of two behind the hold
    measured = measure_margins(delay_plant(plant_of(modal), delay), law(sign, waits=True))
    found = measured.loops[0].delay_limit_s
    assert measured.stable
    # On the circle as far as a stability limit of 1e-8 rad/s and nine digits of a delay leave it.
    assert radius(modal, sign, delay + found) == pytest.approx(1.0, abs=1e-7)
    before = np.arange(delay, delay + found, 2e-5)  # 0.01 rad of the mode
    assert max(radius(modal, sign, t) for t in before) < 1.0


def test_of_several_loops_each_is_delayed_alone_at_either_end():
    plant, weights = cases.tangled(), cases.tangled_weights()
    one = design_sampled_lqg(plant, weights, 10.0, 0.1)
    limits = {m.channel: m.delay_limit_s for m in measure_margins(plant, one, at="both").loops}
    assert [port for port, limit in limits.items() if np.isfinite(limit)] == ["u1", "y2"]
    for port in ("u1", "y2"):
        for factor, stable in ((0.999, True), (1.001, False)):
            delayed = later(plant, port, factor * limits[port])
            assert measure_margins(delayed, one, delays=False).stable == stable


def later(delayed, port, more_s):
    delay = delayed.delay_s.copy()
    if port.startswith("u"):
        delay[:, delayed.input_indices([port])] += more_s
    else:
        delay[delayed.output_indices([port])] += more_s
    return dataclasses.replace(delayed, delay_s=delay)


def test_a_loop_whose_plant_is_not_known_has_no_delay_margin():
    plant, one = (
        cases.late_gimbal(),
        design_sampled_lqg(cases.late_gimbal(), cases.gimbal_weights(), 100.0, 0.01),
    )
    bare = measure_margins(sample_plant(plant, one.period_s), one)
    with pytest.raises(ConfigError, match="not known without its continuous plant"):
        _ = bare.loops[0].delay_limit_s
    assert "  ?  " in str(bare)
    known = measure_margins(plant, one)
    assert f"{1e3 * known.loops[0].delay_limit_s:.3g}" in str(known)
    assert known.loops[0].gain_limits == bare.loops[0].gain_limits


def test_without_gain_there_is_no_limit():
    assert limit_of(plant_of(mode(71.2, 2.0)), law(0.1, waits=True)) == np.inf


@pytest.mark.parametrize("crossover", [1.0, 0.02, 1e-4])
def test_a_slow_loop_delayed_by_thousands_of_periods_has_a_closed_form(crossover):
    """Of u[k] = -c y[k], y' = u late by n + theta periods: z - 1 = -c T ((1 - theta) + theta / z) z^-n."""
    period = 0.02
    integrator = plant_of(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]))
    found = limit_of(integrator, law(-crossover, waits=False, period=period)) / period
    whole, theta = divmod(found, 1.0)
    hold = lambda a: abs((1.0 - theta) + theta * np.exp(-1j * a)) * crossover * period  # noqa: E731
    angle = brentq(lambda a: 2.0 * np.sin(a / 2.0) - hold(a), 1e-9, 1.0, xtol=1e-18, rtol=1e-14)
    lag = np.angle(np.exp(1j * angle) - 1.0) - np.angle(-((1.0 - theta) + theta * np.exp(-1j * angle)))
    assert np.mod(lag + whole * angle + 1e-6, 2.0 * np.pi) - 1e-6 == pytest.approx(0.0, abs=1e-8)


def drawn(seed):
    """One or two channels, modes up to twice half the rate, paths late by up to two periods."""
    rng = np.random.default_rng([31, seed])
    n, modes = int(rng.integers(1, 3)), int(rng.integers(1, 4))
    omega = np.pi / PERIOD * 10.0 ** rng.uniform(-1.5, 0.3, modes)
    zeta = 10.0 ** rng.uniform(-2.0, -0.3, modes)
    shape = rng.standard_normal((2, n, modes))
    names = tuple(f"mode {k}" for k in range(modes))
    modal = sum_of_modes(omega, zeta, omega[:, None] * shape[0].T, shape[1], names=names)
    u, y = (tuple(Port(f"{side}{i}", "") for i in range(n)) for side in "uy")
    gain = 10.0 ** rng.uniform(-1.0, 0.7) * zeta.mean() * omega.mean() * rng.standard_normal((n, n))
    now = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, n)), np.zeros((n, 0)), gain, period_s=PERIOD)
    plant = Plant(dynamics=modal, inputs=u, outputs=y, u=tuple(p.name for p in u), y=tuple(p.name for p in y))
    return delay_plant(plant, rng.uniform(0.0, 2.0 * PERIOD, (n, n))), Compensator(now, y, u, method="gain")


@pytest.mark.parametrize("seed", repeats(range(400), 4))
def test_roots_counted_by_unit_gain_are_the_eigenvalues(seed):
    """Up to the limit no delay is unstable, beyond it one is; past inputs are states."""
    plant, one = drawn(seed)

    def margin(port, more_s):
        return decide_stability(later(plant, port, more_s), one).margin

    for loop in measure_margins(plant, one, at="both").loops:
        limit = loop.delay_limit_s
        if limit == 0.0:
            assert margin(loop.channel, 0.0) < 0.0
            continue
        end = min(limit, 20.0 * PERIOD)
        assert all(margin(loop.channel, t) > 0.0 for t in np.linspace(0.0, end, 20)[:-1])
        if limit < 40.0 * PERIOD:
            assert margin(loop.channel, limit) == pytest.approx(0.0, abs=1e-6 / PERIOD)
            assert (
                margin(loop.channel, limit * (1.0 - 1e-4)) > 0.0 > margin(loop.channel, limit * (1.0 + 1e-4))
            )


def test_loops_that_share_a_slow_free_body_are_those_of_continuous_laws():
    """What the sampling takes of the delay is less than a period, though beside the body's poles each loop
    is unbounded and all channels' ratios are not."""
    slow, names = 1e-4, ("x", "v", "p", "q")
    body = ModalSystem(
        omega=[0.0],
        zeta=[0.0],
        psi=[[1.0, 0.7]],
        phi=[[1.0], [0.0], [0.8], [0.0]],
        phi_rate=[[0.0], [1.0], [0.0], [0.8]],
        names=("body",),
    )
    u, y = (Port("f", "N"), Port("g", "N")), tuple(Port(name, "m") for name in names)
    plant = Plant(dynamics=body, inputs=u, outputs=y, u=("f", "g"), y=names)
    gain = -np.array([[slow**2, 1.4 * slow, 0.0, 0.0], [0.0, 0.0, slow**2, 1.1 * slow]])
    held = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((2, 0)), gain, period_s=PERIOD)
    sampled, continuous = (
        [m.delay_limit_s for m in measure_margins(plant, Compensator(one, y, u)).loops]
        for one in (held, gain_system(gain))
    )
    assert continuous[1] == sampled[1] == np.inf
    assert continuous[0] - PERIOD < sampled[0] < continuous[0]


@pytest.mark.parametrize("crossings", repeats([1, 2, 3, 5, 6]))
def test_long_delays_are_searched_where_roots_begin_to_grow_only(crossings, monkeypatch):
    # The definition, each number of periods by itself; narrow windows make a short search a long one.
    monkeypatch.setattr(delay_limit, "AT_ONCE", 16)
    rng = np.random.default_rng(crossings)
    for above in (True, False) * 10:
        angle, lag = np.sort(10.0 ** rng.uniform(-3.0, -0.5, crossings)), rng.uniform(0.0, TURN, crossings)
        falling = (np.arange(crossings) % 2 == 0) == above
        gain = delay_limit.UnitGain(growing=0, angle=angle, lag=lag, falling=falling, open_end=False)
        slowest = angle[falling].min(initial=np.inf)
        each = np.arange(int(TURN / slowest) + delay_limit.LOOKED)
        turned = np.ceil((np.outer(each, angle) - lag) / TURN)
        grows = each[turned @ np.where(falling, 1, -1) > 0]
        assert delay_limit._first_unstable(gain) == (grows[0] if len(grows) else np.inf)
