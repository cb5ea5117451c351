"""Margins against closed forms and brute force: integrators, delays, light modes, several loops."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.control.analysis.loop.feedback_loop import At, form_loop
from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.margins.neutral import bears_no_delay
from middeck.control.analysis.margins.return_ratio import trace_return_ratio
from middeck.control.analysis.margins.scaling import balance_channels, minimise_scaling, scaled_norms
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from plant_builders import BODY, FORCE, RATE, WAY, gain, sum_of_modes

INTEGRATOR = Plant(dynamics=StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=(FORCE,), outputs=(WAY,))


@pytest.mark.parametrize("k", [1e-3, 1.0, 7.0])
def test_integrator_with_a_delay(k: float) -> None:
    """L = k exp(-s tau) / s: unit gain at k, phases -pi/2 - w tau."""
    tau = 0.1
    one = measure_margins(delay_plant(INTEGRATOR, tau), gain(k)).loops[0]
    # Roots to rounding: 1e-13.
    assert one.phase_limit_rad == pytest.approx(np.pi / 2.0 - k * tau, rel=1e-13)
    assert one.phase_hz * 2.0 * np.pi == pytest.approx([k], rel=1e-13)
    assert one.delay_limit_s == pytest.approx((np.pi / 2.0) / k - tau, rel=1e-13)
    # -180 degrees at every w tau = pi/2 + 2 pi n; the factor there is w/k.
    expected = (np.pi / 2.0 + 2.0 * np.pi * np.arange(10)) / tau / k
    found = one.gain[:10]
    assert found == pytest.approx(expected[: len(found)], rel=1e-12)
    assert len(found) == min(10, np.sum(expected < 1e4))


def test_rigid_body_under_pd() -> None:
    """L = (kp + kd s)/s^2: unit gain at w^2 = (kd^2 + sqrt(kd^4 + 4 kp^2))/2, no finite gain margin."""
    kp, kd = 2.0, 0.7
    one = measure_margins(BODY, gain(kp, kd)).loops[0]
    w = np.sqrt((kd**2 + np.sqrt(kd**4 + 4.0 * kp**2)) / 2.0)
    assert one.phase_hz * 2.0 * np.pi == pytest.approx([w], rel=1e-13)
    assert one.phase_limit_rad == pytest.approx(np.arctan2(kd * w, kp), rel=1e-12)
    assert one.gain_limits == (0.0, np.inf)


def test_delay_margin_is_the_delay_that_it_names() -> None:
    """With the delay margin put in, the loop lies on the limit."""
    one = measure_margins(BODY, gain(2.0, 0.7)).loops[0]
    for change, stable in ((-1e-6, True), (1e-6, False)):
        delayed = delay_plant(BODY, one.delay_limit_s * (1.0 + change))
        assert measure_margins(delayed, gain(2.0, 0.7)).stable is stable


def test_conditional_stability_has_a_gain_margin_downwards() -> None:
    """L = k (s + 1)^2 / s^3: at w = 1, L = -2 k... stable for k > 1/2."""
    k = 3.0
    A = np.diag([1.0, 1.0], 1)
    triple = Plant(
        dynamics=StateSpace(A, [[0.0], [0.0], [1.0]], [[1.0, 2.0, 1.0]], [[0.0]]),
        inputs=(FORCE,),
        outputs=(WAY,),
    )
    margins = measure_margins(triple, gain(k))
    assert margins.stable
    assert margins.loops[0].gain == pytest.approx([0.5 / k], rel=1e-12)
    assert margins.loops[0].gain_hz * 2.0 * np.pi == pytest.approx([1.0], rel=1e-12)
    assert margins.loops[0].gain_limits == (pytest.approx(0.5 / k), np.inf)


@pytest.mark.parametrize("zeta", [3e-3, 1e-5, 1e-7])
def test_no_light_mode_is_missed(zeta: float) -> None:
    """Each of twelve modes crosses unit gain twice: |H| = |g| / |w_n^2 - w^2 + 2 j zeta w_n w| near it."""
    omega = 2.0 * np.pi * np.geomspace(0.3, 60.0, 12)
    # A gain of 3 at each peak: modes far apart do not add to that.
    psi = (6.0 * zeta * omega**2)[:, None]
    modes = sum_of_modes(omega, zeta, psi, np.ones((1, 12)), names=("m",) * 12)
    one = measure_margins(Plant(dynamics=modes, inputs=(FORCE,), outputs=(WAY,)), gain(1.0)).loops[0]
    near = np.abs(one.phase_hz[:, None] * 2.0 * np.pi / omega - 1.0) < 6.0 * zeta
    assert np.array_equal(near.sum(axis=0), np.full(12, 2))
    assert one.sensitivity.gain > 1.0


def test_delayed_modes_agree_with_a_brute_force_grid() -> None:
    modes = sum_of_modes([6.0, 40.0], [0.02, 0.01], [[1.0], [0.7]], [[30.0, 50.0]])
    delayed = delay_plant(Plant(dynamics=modes, inputs=(FORCE,), outputs=(WAY,)), 0.02)
    one = measure_margins(delayed, gain(1.0)).loops[0]
    w = np.linspace(0.01, 400.0, 2_000_001)
    L = trace_return_ratio(delayed, gain(1.0), frequency_hz=w / 2.0 / np.pi).L[:, 0]
    cross = np.flatnonzero((np.diff(np.sign(L.imag)) != 0) & (L[1:].real < 0.0))
    ahead = one.gain_hz < 400.0 / (2.0 * np.pi)
    # A grid of 2e-4 rad/s: phase and gain change by 2e-4 / (zeta w) from line to line, a thousandth.
    assert np.sort(one.gain[ahead]) == pytest.approx(np.sort(-1.0 / L[cross].real), rel=3e-3)
    assert one.sensitivity.gain == pytest.approx(np.abs(1.0 / (1.0 + L)).max(), rel=1e-6)
    assert one.sensitivity.gain >= np.abs(1.0 / (1.0 + L)).max()


def test_a_steady_gain_that_turns_the_sign_counts() -> None:
    """-1/(s + 1) under k: a real pole reaches the origin at the factor that makes k/(s + 1) one."""
    lag = Plant(dynamics=StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=(FORCE,), outputs=(WAY,))
    margins = measure_margins(lag, gain(-0.25))
    assert margins.loops[0].gain == pytest.approx([4.0], rel=1e-14)
    assert margins.loops[0].gain_hz.tolist() == [0.0]


@pytest.mark.parametrize("tau", [0.0, 0.05])
@pytest.mark.parametrize("sampled", [False, True])
def test_a_real_pole_through_rest_counts_though_another_loop_holds_the_integrator(
    tau: float, sampled: bool
) -> None:
    """x' = u1 + u2, u1 = -3 k x, u2 = x: stable for k above a third, whatever the delay."""
    plant = Plant(
        dynamics=StateSpace([[0.0]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]]),
        inputs=(FORCE, Port("more", "N")),
        outputs=(WAY,),
    )
    K = np.array([[-3.0], [1.0]])
    if sampled:
        law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((2, 0)), K, period_s=0.05)
        held = sample_plant(delay_plant(plant, tau), 0.05)
        one = measure_margins(held, Compensator(law, (WAY,), plant.inputs)).loops[0]
    else:
        delayed = delay_plant(plant, tau) if tau else plant
        one = measure_margins(delayed, Compensator(gain_system(K), (WAY,), plant.inputs)).loops[0]
    assert one.gain_limits[0] == pytest.approx(1.0 / 3.0, rel=1e-9)
    assert one.gain_hz[0] == 0.0


def test_a_rigid_body_held_by_one_sensor_and_pushed_by_another() -> None:
    """PD from the way, 0.4 of the way fed back the wrong way round: k - 0.4 must stay positive."""
    away = Port("encoder", "m")
    twice = Plant(
        dynamics=sum_of_modes(
            [0.0], 0.0, [[1.0]], [[1.0], [0.0], [1.0]], phi_rate=[[0.0], [1.0], [0.0]], names=("body",)
        ),
        inputs=(FORCE,),
        outputs=(WAY, RATE, away),
    )
    law = Compensator(gain_system([[-1.0, -1.0, 0.4]]), (WAY, RATE, away), (FORCE,))
    way, rate, encoder = measure_margins(twice, law, at="outputs").loops
    assert way.gain_limits[0] == pytest.approx(0.4, rel=1e-9)
    assert encoder.gain_limits[1] == pytest.approx(2.5, rel=1e-9)
    assert rate.gain_limits == (0.0, np.inf)


def test_a_real_pole_through_infinity_counts() -> None:
    """1/(s + 1) - 1/2 under u = -k y: the pole is at -1 - k/(1 - k/2)."""
    plant = Plant(dynamics=StateSpace([[-1.0]], [[1.0]], [[1.0]], [[-0.5]]), inputs=(FORCE,), outputs=(WAY,))
    one = measure_margins(plant, gain(1.0)).loops[0]
    assert one.gain_limits == pytest.approx((0.0, 2.0), rel=1e-12)
    assert one.gain_hz.tolist() == [np.inf]


def test_sampled_integrator() -> None:
    """z+ = z - k z: L = k/(z - 1), real at z = -1: factor 2/k; unit gain where 2 sin(w T / 2) = k."""
    T, k = 0.01, 0.5
    plant = make_plant([[1.0]], [[1.0]], [[1.0]], period_s=T)
    law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-k]], period_s=T)
    margins = measure_margins(plant, Compensator(law, plant.outputs, plant.inputs))
    one = margins.loops[0]
    assert margins.stable
    assert one.gain == pytest.approx([2.0 / k], rel=1e-12)
    assert one.gain_hz == pytest.approx([0.5 / T])
    turn = 2.0 * np.arcsin(k / 2.0)
    assert one.phase_hz == pytest.approx([turn / T / 2.0 / np.pi], rel=1e-12)
    assert one.phase_limit_rad == pytest.approx(np.pi / 2.0 - turn / 2.0, rel=1e-12)


def test_sampled_margins_approach_the_continuous_ones() -> None:
    """A hold of T is a delay of T/2 to first order, an error of (w T)^2/24 of it to second."""
    T = 1e-4
    law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[-2.0, -0.7]], period_s=T)
    compensator = Compensator(law, BODY.outputs, BODY.inputs)
    sampled = measure_margins(BODY, compensator, delays=False).loops[0]
    delayed = measure_margins(delay_plant(BODY, T / 2.0), gain(2.0, 0.7)).loops[0]
    assert sampled.phase_limit_rad == pytest.approx(delayed.phase_limit_rad, rel=1e-7)
    assert sampled.sensitivity.gain == pytest.approx(delayed.sensitivity.gain, rel=1e-7)


def satellite(a: float) -> tuple[Plant, Compensator]:
    """A spinning body, (Seiler, Packard and Gahinet 2020): T = 1/(s + 1) [[1, a], [-a, 1]] under u = -y."""
    A, C = np.array([[0.0, a], [-a, 0.0]]), np.array([[1.0, a], [-a, 1.0]])
    ports = (Port("u1", "N m"), Port("u2", "N m")), (Port("y1", "rad/s"), Port("y2", "rad/s"))
    plant = Plant(dynamics=StateSpace(A, np.eye(2), C, np.zeros((2, 2))), inputs=ports[0], outputs=ports[1])
    return plant, Compensator(gain_system(-np.eye(2)), ports[1], ports[0])


def test_one_loop_at_a_time_may_look_good() -> None:
    """L = 1/s in each loop with the other closed: 90 degrees, any gain, the largest disk."""
    for at in ("inputs", "outputs"):
        for one in measure_margins(*satellite(10.0), at=at).loops:
            assert one.gain_limits == (0.0, np.inf)
            assert one.phase_limit_rad == pytest.approx(np.pi / 2.0, rel=1e-10)
            assert one.disk.alpha == pytest.approx(2.0, rel=1e-9)
            assert one.disk.phase_rad == pytest.approx(np.pi / 2.0, rel=1e-9)


def test_both_loops_together_bear_little() -> None:
    """S - T is normal, its larger eigenvalue squared 1 + 4 a (w + a)/(1 + w^2): most at w^2 + 2 a w = 1."""
    a = 10.0
    w = np.sqrt(a**2 + 1.0) - a
    alpha = 2.0 / np.sqrt(1.0 + 4.0 * a * (w + a) / (1.0 + w**2))
    for at in ("inputs", "outputs"):
        disk = measure_disk_margin(*satellite(a), at=at)
        assert disk.alpha == pytest.approx(alpha, rel=1e-9)
        # A maximum's place is known to the root of its height's rounding.
        assert disk.frequency_hz * 2.0 * np.pi == pytest.approx(w, rel=1e-4)
    both = measure_disk_margin(*satellite(10.0), at="both")
    # Every change at one end is also a change at both; half of it at each end is more than all at one.
    assert alpha / 2.01 < both.alpha < alpha / 1.9


def test_disks_hold_what_they_promise_and_no_more() -> None:
    """Gains inside the disk leave the spinning body stable in every combination; some just outside do not."""
    plant, law = satellite(10.0)
    disk = measure_disk_margin(plant, law, at="inputs")
    low, high = disk.gain

    def growth(gains: np.ndarray) -> float:
        return float(np.linalg.eigvals(plant.system.A - np.diag(gains) @ plant.system.C).real.max())

    inside = [np.array([f, g]) for f in (low, 1.0, high) for g in (low, 1.0, high)]
    assert all(growth(1.0 + (g - 1.0) * 0.999) < 0.0 for g in inside)
    assert any(growth(1.0 + (g - 1.0) * 1.01) > 0.0 for g in inside)


def test_disk_of_one_loop_by_brute_force() -> None:
    delayed = delay_plant(BODY, 0.1)
    one = measure_margins(delayed, gain(2.0, 0.7)).loops[0]
    w = np.geomspace(1e-2, 1e3, 400_001)
    L = trace_return_ratio(delayed, gain(2.0, 0.7), frequency_hz=w / 2.0 / np.pi).L[:, 0]
    peak = np.abs(0.5 * (1.0 - L) / (1.0 + L)).max()
    # A relative grid of 3e-5 misses a peak by its curvature, 1e-8.
    assert one.disk.alpha == pytest.approx(1.0 / peak, rel=1e-7)
    assert one.disk.gain[1] < one.gain_limits[1]
    assert one.disk.phase_rad < one.phase_limit_rad


def test_an_unstable_loop_has_no_disk() -> None:
    margins = measure_margins(delay_plant(INTEGRATOR, 2.0), gain(1.0))
    assert not margins.stable
    one = margins.loops[0]
    assert one.disk.alpha == one.gain_db == one.phase_limit_rad == one.delay_limit_s == 0.0
    assert len(one.gain)
    assert measure_disk_margin(delay_plant(INTEGRATOR, 2.0), gain(1.0)).alpha == 0.0


@pytest.mark.parametrize("plant", [INTEGRATOR, delay_plant(INTEGRATOR, 0.1)])
def test_a_law_without_gain_bears_everything(plant: Plant) -> None:
    """L = 0: no crossing, S = 1, T = 0, and |S - 1/2| = 1/2."""
    for at in ("inputs", "outputs", "both"):
        for one in measure_margins(plant, gain(0.0), at=at).loops:
            assert (one.gain_limits, one.gain_db) == ((0.0, np.inf), np.inf)
            assert (one.phase_limit_rad, one.delay_limit_s) == (np.inf, np.inf)
            assert (one.sensitivity.gain, one.disk.alpha) == (1.0, 2.0)


def test_a_root_on_a_line_is_minus_one_where_it_is_seen() -> None:
    """1/(s + 1) under -2, and beside it -1 at rest by itself: only the loop that has the root tells."""
    A, law = -np.eye(2), np.diag([0.5, 1.0])
    ports = (Port("u1", "N"), Port("u2", "N")), (Port("y1", "m"), Port("y2", "m"))
    lags = Plant(
        dynamics=StateSpace(A, np.eye(2), np.eye(2), np.zeros((2, 2))), inputs=ports[0], outputs=ports[1]
    )
    held = Compensator(gain_system(law), ports[1], ports[0])
    at_rest = trace_return_ratio(lags, held, frequency_hz=np.array([0.0])).L[0]
    # With the second loop on its limit, the first one's ratio is that of a difference without meaning.
    assert at_rest[1] == -1.0
    assert not np.isfinite(at_rest[0])
    assert measure_margins(lags, held).loops[1].gain == pytest.approx([1.0], rel=1e-14)


@pytest.mark.parametrize("at", ["inputs", "outputs", "both"])
def test_ratio_of_one_loop_is_the_return_difference_of_all_over_that_of_the_others(at: At) -> None:
    rng = np.random.default_rng(5)
    n, ny = 6, 3
    A = rng.standard_normal((n, n)) - 4.0 * np.eye(n)
    system = StateSpace(A, rng.standard_normal((n, ny)), rng.standard_normal((ny, n)), np.zeros((ny, ny)))
    u = tuple(Port(f"u{i}", "N") for i in range(ny))
    y = tuple(Port(f"y{i}", "m") for i in range(ny))
    delay = rng.uniform(0.0, 0.1, (ny, ny))
    law = Compensator(gain_system(rng.standard_normal((ny, ny))), y, u)
    f = np.array([0.0, 0.1, 1.0, 10.0])
    L = trace_return_ratio(
        delay_plant(Plant(dynamics=system, inputs=u, outputs=y), delay), law, at=at, frequency_hz=f
    ).L
    for k, s in enumerate(2j * np.pi * f):
        G = (system.C @ np.linalg.solve(s * np.eye(n) - A, system.B)) * np.exp(-s * delay)
        round_all = {"inputs": [law.system.D @ G], "outputs": [G @ law.system.D]}
        round_all["both"] = round_all["inputs"] + round_all["outputs"]
        expected: list[complex] = []
        for P in round_all[at]:
            rest = [np.delete(np.delete(np.eye(ny) - P, i, 0), i, 1) for i in range(ny)]
            expected += [np.linalg.det(np.eye(ny) - P) / np.linalg.det(each) for each in rest]
        assert 1.0 + L[k] == pytest.approx(np.array(expected), rel=1e-11)


def test_bad_pairs_are_refused() -> None:
    with pytest.raises(ConfigError, match="a continuous compensator on a sampled plant"):
        measure_margins(sample_plant(INTEGRATOR, 0.1), gain(1.0))
    slower = Compensator(
        SampledStateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]], period_s=0.2), (WAY,), (FORCE,)
    )
    with pytest.raises(ConfigError, match=r"period is 0\.2 s, the plant's 0\.1 s"):
        measure_margins(sample_plant(INTEGRATOR, 0.1), slower)
    with pytest.raises(ConfigError, match="broken at"):
        measure_margins(INTEGRATOR, gain(1.0), at="input")


def test_scaling_is_the_structured_singular_value_for_three_channels() -> None:
    """mu = max over phases of the spectral radius of diag(exp(j t)) M (Doyle 1982), met by scaling."""
    rng = np.random.default_rng(11)
    M = rng.standard_normal((4, 3, 3)) + 1j * rng.standard_normal((4, 3, 3))

    def radius(t: np.ndarray, one: np.ndarray) -> np.ndarray:
        turned = np.exp(1j * np.append(t, np.zeros((len(t), 1)), axis=1))[:, :, None] * one
        return np.abs(np.linalg.eigvals(turned)).max(axis=1)

    for one in M:
        centre, reach = np.zeros(2), np.pi
        for _ in range(12):  # ever finer grids around the best; the first is fine enough not to miss the top
            axis = reach * np.linspace(-1.0, 1.0, 41)
            grid = centre + np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
            value = radius(grid, one)
            centre, reach = grid[np.argmax(value)], 0.3 * reach
        # A corner of the largest singular value is turned to 1e-6 by the simplex.
        bound = scaled_norms(one[None])[0]
        assert bound == pytest.approx(value.max(), rel=1e-5)
        assert bound >= value.max() * (1.0 - 1e-9)
        assert bound <= np.linalg.norm(one, 2) * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("system", "k", "limit"),
    [
        # Unit modal mass and an accelerometer: L = 1.5 at every frequency, or above the mode's.
        (StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]]), 1.5, 0.0),
        (sum_of_modes([6.0], 0.01, [[1.0]], [[0.0]], phi_acceleration=[[1.0]]), 1.5, 0.0),
        # L = 1.5 (s + 1)/(s + 0.1) and 1.5 (s + 0.1)/(s + 1): never below one, and below one up to a point.
        (StateSpace([[-0.1]], [[1.0]], [[0.9]], [[1.0]]), 1.5, 0.0),
        (StateSpace([[-1.0]], [[1.0]], [[-0.9]], [[1.0]]), 1.5, 0.0),
        (StateSpace([[-1.0]], [[1.0]], [[-0.9]], [[1.0]]), 0.9, np.inf),
    ],
)
def test_a_loop_that_keeps_its_gain_at_infinite_frequency_bears_no_delay(system, k, limit) -> None:
    """A delay makes it neutral: a chain of roots at log(gain)/delay (Hale and Verduyn Lunel 1993)."""
    plant = Plant(dynamics=system, inputs=(FORCE,), outputs=(WAY,))
    law = Compensator(gain_system(np.array([[-k]])), (WAY,), (FORCE,))
    for at in ("inputs", "outputs"):
        loop = measure_margins(plant, law, at=at).loops[0]
        assert loop.delay_limit_s == limit
    assert decide_stability(plant, law).stable
    # And so it is: however short the delay, by the root of the equation with it.
    for tau in (1e-3, 1e-6):
        assert decide_stability(delay_plant(plant, tau), law).stable is (limit > 0.0)


def test_two_loops_whose_direct_terms_turn_against_each_other() -> None:
    """Alike both return 0.6 of a wave; a quarter turn later in one, more than all of it."""
    through = np.array([[0.9, 0.9], [-0.9, -0.9]]) + 0.3 * np.eye(2)
    ports = (Port("a", "N"), Port("b", "N")), (Port("c", "m"), Port("d", "m"))
    law = Compensator(gain_system(np.eye(2)), ports[1], ports[0])
    delayed = delay_plant(Plant(dynamics=gain_system(through), inputs=ports[0], outputs=ports[1]), 0.1)
    assert decide_stability(delayed, law).stable
    # The margins would list crossings that repeat without end: asked for here is the rule alone.
    assert bears_no_delay(form_loop(delayed, law), "inputs").tolist() == [True, True]


def test_lines_that_cannot_hold_the_largest_value_are_bounded_and_no_more() -> None:
    """Of many lines at once the largest is that of each alone, and no bound is below what it bounds."""
    rng = np.random.default_rng(12)
    unit = 10.0 ** rng.uniform(-4.0, 4.0, 4)
    size = 10.0 ** rng.uniform(-1.0, 1.0, (8, 1, 1))
    M = size * (rng.standard_normal((8, 4, 4)) + 1j * rng.standard_normal((8, 4, 4)))
    M = unit[:, None] * M / unit
    together, alone = scaled_norms(M), np.array([scaled_norms(one[None])[0] for one in M])
    assert together.max() == pytest.approx(alone.max(), rel=1e-8)
    assert np.argmax(together) == np.argmax(alone)
    assert np.all(together >= alone * (1.0 - 1e-6))
    assert np.all(together[together > 0.9 * together.max()] <= 1.3 * alone[together > 0.9 * together.max()])


@pytest.mark.parametrize("seed", [151, 703])
def test_a_search_for_scales_does_not_run_away(seed: int) -> None:
    """Weak coupling against strong: a step of the search overflowed, and the margin was a traceback."""
    rng = np.random.default_rng(seed)
    K, G = rng.standard_normal((3, 1)) * rng.standard_normal((1, 3)), rng.standard_normal((3, 3))
    round_once = 0.5 * np.eye(6)
    round_once[:3, 3:], round_once[3:, :3] = K * 10.0 ** rng.uniform(2, 4), G * 10.0 ** rng.uniform(-7, -5)
    round_once += 1e-2 * rng.standard_normal((6, 6)) * np.kron(np.eye(2), np.ones((3, 3)))
    start = balance_channels(round_once[None] ** 2)[0] + 0.5 * rng.standard_normal(6)
    value, _ = minimise_scaling(round_once, start)
    assert np.abs(np.linalg.eigvals(round_once)).max() <= value <= np.linalg.norm(round_once, 2)


@pytest.mark.parametrize(
    ("A", "B", "C", "gain", "delay_s"),
    [
        ([[-1.0]], [[1.0]], [[1.0]], 1.0, 0.0),  # closed: 1/s
        ([[-1.0]], [[1.0]], [[1.0]], 1.0, 0.1),
        ([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], 4.0, 0.0),  # closed: 1/s^2
    ],
)
def test_a_loop_that_closes_to_an_integrator_has_no_disk(A, B, C, gain: float, delay_s: float):
    plant = make_plant(A, B, C, delay_s=delay_s)
    law = Compensator(gain_system(np.array([[gain]])), plant.outputs, plant.inputs)
    assert measure_disk_margin(plant, law).alpha == 0.0


@pytest.mark.parametrize("at", ["inputs", "outputs", "both"])
def test_one_loop_of_two_that_closes_to_an_integrator_leaves_no_disk(at: At) -> None:
    """Beside a loop that is sound: the other loops alone have a pole at rest, where none was looked for."""
    plant = make_plant(np.diag([-1.0, -2.0]), np.eye(2), np.eye(2))
    law = Compensator(gain_system(np.diag([1.0, 0.5])), plant.outputs, plant.inputs)
    assert measure_disk_margin(plant, law, at=at).alpha == 0.0


def test_nearest_of_crossings_that_repeat() -> None:
    """Direct terms and a delay: of thousands of crossings alike the nearest to one is at the first turns."""
    A, B = np.diag([-14.3, -10.32]), np.array([[-0.11, -0.14, 0.02], [-0.2, 0.03, -0.11]])
    C = np.array([[0.0, -0.02], [0.1, 0.07], [-0.03, 0.14]])
    D = np.array([[0.57, 2.43, 0.64], [0.84, 0.84, -0.61], [-0.07, 1.35, -0.4]])
    K = np.array([[0.13, -0.01, 0.41], [-0.24, -0.1, 0.16], [0.07, -0.58, 0.6]])
    plant = make_plant(A, B, C, D, delay_s=0.07)
    found = measure_margins(plant, Compensator(gain_system(K), plant.outputs, plant.inputs)).loops
    s = 1j * np.linspace(1e-3, 120.0, 60001)
    round_trip = K @ (C / (s[:, None, None] - np.diag(A)) @ B + D) * np.exp(-0.07 * s)[:, None, None]
    for i, one in enumerate(found[:2]):
        # The loop at one channel, the others closed: a Schur complement.
        rest = [j for j in range(3) if j != i]
        closed = np.linalg.solve(np.eye(2) - round_trip[:, rest][:, :, rest], round_trip[:, rest, i, None])
        L = -(round_trip[:, i, i] + np.einsum("wk,wk->w", round_trip[:, i, rest], closed[:, :, 0]))
        step = np.flatnonzero((np.imag(L[1:]) * np.imag(L[:-1]) < 0.0) & (np.real(L[1:]) < 0.0))
        # Linear from line to line: the chord of a hundredth of a degree.
        share = np.imag(L[step]) / (np.imag(L[step]) - np.imag(L[step + 1]))
        limits = -1.0 / np.real(L[step] + share * (L[step + 1] - L[step]))
        assert one.gain_limits[1] == pytest.approx(limits[limits > 1.0].min(), rel=1e-6)
