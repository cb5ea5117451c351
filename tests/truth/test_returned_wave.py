"""Margins of delayed loops with direct terms, against their ratios written down on dense lines of frequency.

At infinite frequency the ratio turns with the delay at a constant size: crossings and peaks repeat without
end and tend to limits, which were looked for up to a thousand times the fastest one.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla

from cpu_limit import cpu_limit
from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.analysis.loop.frequency_lines import place_lines, refine_lines
from middeck.control.analysis.loop.returned_wave import repeating_loop
from middeck.control.analysis.margins.crossings import circle_crossings
from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.margins.return_ratio import broken_ratio
from middeck.control.law.compensator import Compensator
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import FORCE, WAY


def _loop(direct: float, delay_s: float, omega: tuple[float, ...], rates: float) -> tuple[Plant, Compensator]:
    """Modes of 2 % whose rate is read beside the force itself, and a gain: L = direct (1 + rates sum)."""
    A = sla.block_diag(*([[0.0, 1.0], [-w * w, -0.04 * w]] for w in omega))
    B = np.tile([[0.0], [1.0]], (len(omega), 1))
    plant = Plant(dynamics=StateSpace(A, B, rates * B.T, [[1.0]]), inputs=(FORCE,), outputs=(WAY,))
    return delay_plant(plant, delay_s), Compensator(gain_system(np.array([[-direct]])), (WAY,), (FORCE,))


def _ratio(
    direct: float, delay_s: float, omega: tuple[float, ...], rates: float, w: np.ndarray
) -> np.ndarray:
    modes = sum(1j * w / (o**2 - w**2 + 0.04j * o * w) for o in omega)
    return direct * (1.0 + rates * modes) * np.exp(-1j * w * delay_s)


@pytest.mark.parametrize(
    "case",
    [
        (0.98, 0.05, (2.0, 9.0, 400.0), 0.05),  # took 74 s
        (-0.98, 0.05, (2.0, 9.0, 40.0), 1e-3),
        (0.9, 0.2, (3.0,), 0.1),
        (0.5, 0.01, (20.0, 21.0), -0.3),
        (-0.7, 0.1, (5.0, 30.0), 0.05),
        (0.99, 0.03, (50.0,), 1e-3),
        (0.8, 0.02, (1.0, 60.0), 0.02),
        (0.3, 0.5, (0.5, 4.0), 0.02),
    ],
)
def test_margins_are_those_of_the_ratio_on_dense_lines(
    case: tuple[float, float, tuple[float, ...], float],
) -> None:
    plant, law = _loop(*case)
    with cpu_limit(2.0):
        found, disk = measure_margins(plant, law).loops[0], measure_disk_margin(plant, law, at="inputs")
    direct, delay_s, omega, _ = abs(case[0]), *case[1:]
    beside = [o * (1.0 + 0.04 * np.linspace(-20.0, 20.0, 10_001)) for o in omega]
    w = np.sort(
        np.abs(np.concatenate([np.linspace(1e-3, 3.0 * max(omega) + 99.0 / delay_s, 100_001), *beside]))
    )
    L = _ratio(*case, w)
    # At infinite frequency the size of L is that of the direct term, and its phase any.
    peak = max(np.abs(1.0 / (1.0 + L)).max(), 1.0 / (1.0 - direct))
    skewed = max(0.5 * np.abs((1.0 - L) / (1.0 + L)).max(), 0.5 * (1.0 + direct) / (1.0 - direct))
    assert found.sensitivity.gain == pytest.approx(peak, rel=1e-4)
    assert [1.0 / found.disk.alpha, 1.0 / disk.alpha] == pytest.approx([skewed, skewed], rel=1e-4)
    real = np.flatnonzero((np.imag(L[1:]) < 0.0) != (np.imag(L[:-1]) < 0.0))
    real = real[(np.real(L[real]) < 0.0) & (np.real(L[real + 1]) < 0.0)]
    gains = np.append(-1.0 / np.real(L[real]), 1.0 / direct)
    assert found.gain_limits[0] == pytest.approx(gains[gains < 1.0].max(initial=0.0), rel=1e-3)
    assert found.gain_limits[1] == pytest.approx(gains[gains > 1.0].min(), rel=1e-3)
    unit = np.flatnonzero((np.abs(L[1:]) > 1.0) != (np.abs(L[:-1]) > 1.0))
    lag = np.mod(np.angle(L[unit]) + np.pi, 2.0 * np.pi)
    lags = np.minimum(lag, 2.0 * np.pi - lag)
    assert found.phase_limit_rad == pytest.approx(lags.min(initial=np.inf), rel=1e-2)
    assert found.delay_limit_s == pytest.approx((lag / w[unit]).min(initial=np.inf), rel=1e-2)


def test_two_channels_turn_together_at_infinite_frequency() -> None:
    """Direct terms alone: one turn of the delay is the whole truth."""
    through = np.array([[0.5, 0.6], [-0.3, 0.4]])
    ports = (FORCE, Port("torque", "N m")), (WAY, Port("turn", "rad"))
    system = StateSpace(-np.eye(1), 1e-6 * np.ones((1, 2)), 1e-6 * np.ones((2, 1)), through)
    plant = delay_plant(Plant(dynamics=system, inputs=ports[0], outputs=ports[1]), 0.1)
    law = Compensator(gain_system(-np.eye(2)), ports[1], ports[0])
    turn = np.exp(-1j * np.linspace(0.0, 2.0 * np.pi, 100_001))[:, None, None]
    L = 1.0 / np.diagonal(np.linalg.inv(np.eye(2) + turn * through), axis1=1, axis2=2) - 1.0
    assert np.abs(np.linalg.eigvals(through)).max() < 1.0
    loops = measure_margins(plant, law).loops
    for one, own in zip(loops, L.T, strict=True):
        assert one.sensitivity.gain == pytest.approx(np.abs(1.0 / (1.0 + own)).max(), rel=1e-6)
        k = np.flatnonzero((np.imag(own[1:]) < 0.0) != (np.imag(own[:-1]) < 0.0))
        gains = -1.0 / np.real(own[k][np.real(own[k]) < 0.0])
        assert one.gain_limits[1] == pytest.approx(gains[gains > 1.0].min(initial=np.inf), rel=1e-3)


def _lag(zero: float, direct: float) -> tuple[Plant, Compensator]:
    """L = direct (s + zero)/(s + 1) exp(-2 s)."""
    system = StateSpace([[-1.0]], [[1.0]], [[zero - 1.0]], [[1.0]])
    plant = delay_plant(Plant(dynamics=system, inputs=(FORCE,), outputs=(WAY,)), 2.0)
    return plant, Compensator(gain_system(np.array([[-direct]])), (WAY,), (FORCE,))


def test_a_gain_that_rises_to_its_limit_has_it_in_closed_form() -> None:
    plant, law = _lag(0.2, 0.98)
    found = measure_margins(plant, law)
    one = found.loops[0]
    assert found.stable
    assert not len(one.phase_hz)
    assert one.sensitivity.gain == pytest.approx(50.0, rel=1e-9)
    assert one.sensitivity.frequency_hz == np.inf
    assert one.gain_limits == pytest.approx((0.0, 1.0 / 0.98), rel=1e-9)
    # Of both ends at once: f^2 0.98 = 1.
    share = np.sqrt(1.0 / 0.98)
    disks = measure_disk_margin(plant, law, at="inputs"), measure_disk_margin(plant, law)
    assert [disk.alpha for disk in disks] == pytest.approx(
        [0.04 / 1.98, 2.0 * (share - 1.0) / (share + 1.0)], rel=1e-9
    )


def test_lines_reach_a_gain_that_falls_through_one_far_above_all_poles() -> None:
    direct = 0.9999
    loop = form_loop(*_lag(3.0, direct))
    ratio = broken_ratio(loop, "inputs")
    found = circle_crossings(ratio, *refine_lines(ratio, place_lines(loop, "inputs", ratio)))
    at = np.sqrt(((3.0 * direct) ** 2 - 1.0) / (1.0 - direct**2))
    assert found.omega == pytest.approx([at])


def _two_loops(seed: int, delay_s: np.ndarray) -> tuple[Plant, Compensator]:
    """Three modes whose rates two loops read beside direct terms, of spectral radius 0.7 in moduli."""
    rng = np.random.default_rng(seed)
    A = sla.block_diag(*([[0.0, 1.0], [-w * w, -0.02 * w]] for w in (6.0, 25.0, 57.0)))
    B = np.zeros((6, 2))
    B[1::2] = 0.3 * rng.standard_normal((3, 2))
    through = rng.standard_normal((2, 2))
    through *= 0.7 / np.abs(np.linalg.eigvals(np.abs(through))).max()
    ports = (FORCE, Port("torque", "N m")), (WAY, Port("turn", "rad"))
    plant = Plant(dynamics=StateSpace(A, B, B.T, through), inputs=ports[0], outputs=ports[1])
    return delay_plant(plant, delay_s), Compensator(gain_system(-np.eye(2)), ports[1], ports[0])


def _scaled_norms(P: np.ndarray) -> np.ndarray:
    """Least norm of D (S - 1/2) D^-1, D = diag(d, 1), over a grid of d."""
    skewed = 0.5 * np.linalg.solve(np.eye(2) + P, np.eye(2) - P)
    d = np.geomspace(0.1, 10.0, 61)[:, None, None, None] ** np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.linalg.norm(d * skewed, 2, axis=(2, 3)).min(axis=0)


@pytest.mark.parametrize(
    "delay_s",
    [
        [[0.010, 0.017], [0.010, 0.017]],
        [[0.010, 0.013], [0.013, 0.016]],
        [[0.01, 0.01 * np.sqrt(3.0)], [0.01, 0.01 * np.sqrt(3.0)]],  # no common time
    ],
)
@pytest.mark.parametrize("seed", [0, 4])
def test_unlike_delays_turn_together_as_far_as_they_have_a_common_time(
    seed: int, delay_s: list[list[float]]
) -> None:
    """Took 27 to 50 s; and where delays have no common time, phases that no line met were left out."""
    plant, law = _two_loops(seed, np.array(delay_s))
    with cpu_limit(2.0):
        alpha = measure_disk_margin(plant, law, at="inputs").alpha
    through, system = plant.continuous.D, plant.continuous
    if delay_s[0][1] in (0.017, 0.013):
        lag = np.linspace(0.0, 2.0 * np.pi, 1001)[:, None, None] * np.round(1e3 * np.array(delay_s))
    else:
        first, second = np.meshgrid(*[np.linspace(0.0, 2.0 * np.pi, 41)] * 2)
        lag = np.stack([first.ravel(), second.ravel()], axis=1)[:, None, :]
    at_infinity = _scaled_norms(np.exp(-1j * lag) * through).max()
    s = 1j * np.linspace(0.5, 600.0, 1201)
    G = system.C @ np.linalg.solve(s[:, None, None] * np.eye(6) - system.A, system.B.astype(complex)[None])
    below = _scaled_norms((G + through) * np.exp(-s[:, None, None] * np.array(delay_s))).max()
    assert 1.0 / alpha == pytest.approx(max(at_infinity, below), rel=3e-3)
    assert 1.0 / alpha > at_infinity * (1.0 - 1e-3)


@pytest.mark.parametrize("second_s", [0.01 * np.sqrt(3.0), 0.01001 * np.sqrt(1.0001)])
@pytest.mark.parametrize("seed", [0, 4])
def test_margins_of_delays_without_a_common_time_are_those_of_all_phases(seed: int, second_s: float) -> None:
    """Took 17 to 44 s. Two delays of nearly one size count as two: far above they are any phase apart."""
    plant, law = _two_loops(seed, np.tile([0.01, second_s], (2, 1)))
    with cpu_limit(2.0):
        margins = measure_margins(plant, law)
    disk = measure_disk_margin(plant, law, at="inputs")
    D = plant.continuous.D
    second = np.exp(-1j * np.linspace(0.0, 2.0 * np.pi, 2001))
    worst = []
    for i, found in enumerate(margins.loops):
        # L = D_ii + D_ij D_ji e / (...) times the phase of its own delay, which is any: its size decides.
        size = np.abs(D[i, i] - D[i, 1 - i] * D[1 - i, i] * second / (1.0 + D[1 - i, 1 - i] * second)).max()
        assert found.gain_limits == (0.0, pytest.approx(1.0 / size, rel=1e-6))
        assert found.sensitivity.gain == pytest.approx(1.0 / (1.0 - size), rel=1e-6)
        assert found.disk.alpha == pytest.approx(2.0 * (1.0 - size) / (1.0 + size), rel=1e-6)
        worst.append(found.disk.alpha)
    assert disk.alpha <= min(worst)


@pytest.mark.parametrize("seed", [0, 7])
def test_a_direct_path_without_delay_keeps_its_phase(seed: int) -> None:
    """Turned too, it would take the margin of the first loop from 0.67 to 0.35."""
    delay_s = np.array([[0.0, 0.01], [0.01, 0.01 * np.sqrt(3.0)]])
    plant, law = _two_loops(seed, delay_s)
    alpha = measure_disk_margin(plant, law, at="inputs").alpha
    system = plant.continuous
    first, second = np.meshgrid(*[np.linspace(0.0, 2.0 * np.pi, 49)] * 2)
    lag = np.stack([0.0 * first, first, first, second], axis=-1).reshape(-1, 2, 2)
    at_infinity = _scaled_norms(np.exp(-1j * lag) * system.D).max()
    s = 1j * np.linspace(0.5, 600.0, 601)
    G = system.C @ np.linalg.solve(s[:, None, None] * np.eye(6) - system.A, system.B.astype(complex)[None])
    below = _scaled_norms((G + system.D) * np.exp(-s[:, None, None] * delay_s)).max()
    assert 1.0 / alpha == pytest.approx(max(at_infinity, below), rel=1e-3)


@pytest.mark.parametrize("apart", [np.sqrt(3.0), 1.0001 * np.sqrt(1.0001)])
def test_delays_of_direct_terms_far_below_the_longest_return_too(apart: float) -> None:
    """Rounded to a 40th of the longest, which is of a path without a direct term, they were no delays."""
    short_s = 5e-4
    plant, law = _two_loops(0, np.array([[0.1, short_s], [0.0, short_s * apart]]))
    given = plant.continuous
    D = given.D.copy()
    D[0, 0] = 0.0
    plant = dataclasses.replace(plant, dynamics=StateSpace(given.A, given.B, given.C, D))
    round_trip, own = abs(D[0, 1] * D[1, 0]), abs(D[1, 1])
    margins = measure_margins(plant, law)
    assert margins.stable
    for found, size in zip(margins.loops, (round_trip / (1.0 - own), own + round_trip), strict=True):
        assert found.gain_limits == (0.0, pytest.approx(1.0 / size, rel=1e-6))
        assert found.disk.alpha == pytest.approx(2.0 * (1.0 - size) / (1.0 + size), rel=1e-6)
        assert found.disk.frequency_hz == np.inf
    # Of both at once, the phases being free: the factor f with det(1 - f |D|) = 0.
    share = 1.0 / np.abs(np.linalg.eigvals(np.abs(D))).max()
    both = measure_disk_margin(plant, law, at="inputs").alpha
    assert both == pytest.approx(2.0 * (share - 1.0) / (share + 1.0), rel=1e-6)


def test_lines_are_those_of_the_loop_itself_where_nothing_returns() -> None:
    plant, law = _two_loops(0, np.array([[0.0, 0.01], [0.01, 0.01 * np.sqrt(3.0)]]))
    given = plant.continuous
    strictly = dataclasses.replace(plant, dynamics=StateSpace(given.A, given.B, given.C, np.zeros((2, 2))))
    loop = form_loop(strictly, law)
    placed_on, wave = repeating_loop(loop)
    assert placed_on is loop
    assert wave is None
