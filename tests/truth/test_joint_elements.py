"""Friction and deadband: describing functions against quadrature and energy, and their limits."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from joint_reference import stored_energy
from middeck.errors import ConfigError
from middeck.joints.deadband import Deadband
from middeck.joints.element import sum_equivalents
from middeck.joints.friction import Friction

BEARING = Friction(slip_torque=0.002, stiffness=2.0)  # slips at 1 mrad
GEAR = Deadband(gap=0.001, stiffness=50.0)
PRESSED = Deadband(gap=0.001, stiffness=50.0, preload=-0.04)
NODES, WEIGHTS = leggauss(30)  # exact to rounding for the smooth pieces below


def cycle_torque(element, amplitude, phase):
    """Torque of the time-domain law along A cos(phase), from a start at +A after whole cycles."""
    state = 0.0
    for turn in (amplitude, -amplitude, amplitude, -amplitude, amplitude):
        _, state = element.resist(turn, state)
    torque = []
    for x in phase:
        if x > np.pi and len(torque) and phase[len(torque) - 1] < np.pi:
            _, state = element.resist(-amplitude, state)  # no point of Gauss's rule is the turning point
        value, state = element.resist(float(amplitude * np.cos(x)), state)
        torque.append(value)
    return np.array(torque)


def breaks(element, amplitude):
    """Phases of a cycle at which the torque has a corner."""
    if isinstance(element, Friction):
        # 1e-12: rounding puts a swing at the slip angle on either side of it.
        if amplitude <= element.slip_angle * (1.0 + 1e-12):
            return np.array([0.0, np.pi, 2.0 * np.pi])
        slip = np.arccos(1.0 - 2.0 * element.slip_angle / amplitude)
        return np.array([0.0, slip, np.pi, np.pi + slip, 2.0 * np.pi])
    mean = element.mean_angle(amplitude)
    corner = [np.arccos(c) for c in (np.array([-1, 1]) * element.gap - mean) / amplitude if abs(c) < 1.0]
    return np.unique([0.0, np.pi, 2.0 * np.pi, *corner, *(2.0 * np.pi - np.array(corner))])


def quadrature(element, amplitude, order):
    """(1/pi) times the integral of torque exp(-j order phase), by Gauss's rule between corners."""
    edges = breaks(element, amplitude)
    half, middle = 0.5 * np.diff(edges)[:, None], 0.5 * (edges[:-1] + edges[1:])[:, None]
    phase = (middle + half * NODES).ravel()
    weight = (half * WEIGHTS).ravel()
    if isinstance(element, Deadband):  # about its mean angle, which is not its rest angle
        shift = element.mean_angle(amplitude) - element.rest
        torque = np.array([element.resist(float(a + shift), 0.0)[0] for a in amplitude * np.cos(phase)])
    else:
        torque = cycle_torque(element, amplitude, phase)
    return weight @ (torque * np.exp(-1j * order * phase)) / np.pi


@pytest.mark.parametrize("element", [BEARING, GEAR, PRESSED], ids=["friction", "deadband", "pressed"])
@pytest.mark.parametrize("amplitude", [2e-4, 9.99e-4, 1e-3, 1.3e-3, 2.5e-3, 1e-2, 0.3])
def test_describing_function_and_harmonics_equal_quadrature(element, amplitude):
    A = np.array([amplitude])
    found = element.describing_function(A)
    exact = quadrature(element, amplitude, 1) / amplitude
    # Thirty Gauss points leave rounding; the mean angle under a preload is found to 1e-14.
    tolerance = 1e-12 * element.stiffness
    assert found.stiffness[0] + 1j * found.loss[0] == pytest.approx(exact, abs=tolerance)
    for order in (1, 2, 3, 5):
        exact = quadrature(element, amplitude, order)
        assert element.harmonic(A, order)[0] == pytest.approx(exact, abs=tolerance * amplitude)


@pytest.mark.parametrize("amplitude", [2e-4, 1.3e-3, 1e-2, 0.3])
def test_loss_is_the_energy_of_a_cycle(amplitude):
    """By parts of the path, each with its mean torque: work on the element in one steady cycle."""
    state, at, work = 0.0, 0.0, []
    for turn in (amplitude, *(-amplitude, amplitude) * 2):
        mean, _ = BEARING.mean_torque(at, turn, state)
        work.append(mean * (turn - at))
        _, state = BEARING.resist(turn, state)
        at = turn
    loss = BEARING.describing_function(np.array([amplitude])).loss[0]
    exact = 4.0 * BEARING.slip_torque * max(amplitude - BEARING.slip_angle, 0.0)
    # Rounding of the largest part.
    assert sum(work[-2:]) == pytest.approx(exact, abs=1e-14 * max(np.abs(work)))
    assert np.pi * amplitude**2 * loss == pytest.approx(exact, abs=1e-14 * max(np.abs(work)))


def test_friction_sticks_at_small_amplitude_and_vanishes_at_large():
    a = BEARING.slip_angle
    small = BEARING.describing_function(np.array([1e-12, 0.5 * a, a]))
    # One rounding of pi.
    assert small.stiffness == pytest.approx(BEARING.stiffness, rel=1e-15)
    assert not small.loss.any()
    A = a * np.array([1e4, 1e6])
    large = BEARING.describing_function(A)
    # The next terms are a/A of the loss and 1.2 a/A of the stiffness (16/(3 pi) (a/A)^1.5 k_s).
    assert large.loss == pytest.approx(4.0 * BEARING.slip_torque / (np.pi * A), rel=1.1e-4)
    assert large.stiffness == pytest.approx(16 / (3 * np.pi) * BEARING.stiffness * (a / A) ** 1.5, rel=1e-3)


def test_deadband_is_nothing_inside_and_the_flank_far_outside():
    inside = GEAR.describing_function(np.array([1e-9, 0.999e-3, 1e-3]))
    assert not inside.stiffness.any()
    A = GEAR.gap * 1e4
    # k (1 - (4/pi) gap/A + ...); the next term is (gap/A)^3.
    far = GEAR.describing_function(np.array([A])).stiffness[0]
    assert far == pytest.approx(GEAR.stiffness * (1.0 - 4.0 / np.pi * 1e-4), rel=1e-11)
    assert not GEAR.describing_function(np.array([A])).loss.any()


def test_a_preload_closes_the_gap_until_the_swing_leaves_the_flank():
    leaves = abs(PRESSED.preload) / PRESSED.stiffness  # 0.8 mrad
    k = PRESSED.describing_function(np.array([1e-6, leaves, 1.1 * leaves, 2e-3, 0.5])).stiffness
    assert k[:2] == pytest.approx(PRESSED.stiffness, rel=1e-14)  # rounding
    assert k[2] < k[1]
    assert k[3] < k[2]
    assert k[4] > k[3]  # both stops: stiff again
    for A in (1.1 * leaves, 2e-3, 0.5):
        # Mean torque beyond the preload, by quadrature; 1e-12 is the root's and the sum's rounding.
        assert abs(quadrature(PRESSED, A, 0)) < 1e-12 * PRESSED.stiffness * A


def test_path_mean_is_the_integral_of_the_law():
    """Against the law itself, walked along the path in small steps; also its slope, by differences."""
    rng = np.random.default_rng(5)
    for element in (BEARING, GEAR, PRESSED):
        for _ in range(40):
            state = element.resist(float(rng.normal(0.0, 2e-3)), 0.0)[1]
            start, end = (float(v) for v in rng.normal(0.0, 2e-3, 2))
            start, state = start, element.resist(start, state)[1]
            steps = 4000
            edges = np.linspace(start, end, steps + 1)
            walked, inner = 0.0, state
            for angle in 0.5 * (edges[1:] + edges[:-1]):
                torque, inner = element.resist(float(angle), inner)
                walked += torque / steps
            mean, slope = element.mean_torque(start, end, state)
            # Midpoint rule with two corners at most: k step^2 / way each.
            assert mean == pytest.approx(walked, abs=2.0 * element.stiffness * abs(end - start) / steps**2)
            d = 1e-4 * (end - start)
            up, down = (element.mean_torque(start, end + s, state)[0] for s in (d, -d))
            # Second order in d, or first where a corner lies within it.
            assert slope == pytest.approx((up - down) / (2.0 * d), abs=1e-3 * element.stiffness)


def test_work_is_stored_or_dissipated_never_gained():
    """Rounding apart, for any path: dissipation of friction is not negative, of a gap exactly zero."""
    rng = np.random.default_rng(6)
    for element, dissipates in ((BEARING, True), (GEAR, False), (PRESSED, False)):
        state, at, lost = 0.0, 0.0, []
        for turn in rng.normal(0.0, 2e-3, 2000):
            before = stored_energy(element, at, state)
            mean, _ = element.mean_torque(at, float(turn), state)
            _, state = element.resist(float(turn), state)
            lost.append(mean * (turn - at) - (stored_energy(element, float(turn), state) - before))
            at = float(turn)
        scale = element.stiffness * 1e-2**2
        assert min(lost) > -1e-14 * scale
        assert max(lost) > 1e-3 * scale if dissipates else max(np.abs(lost)) < 1e-14 * scale


def test_elements_side_by_side_add():
    A = np.array([5e-4, 5e-3])
    both = sum_equivalents([BEARING, GEAR], A)
    parts = [e.describing_function(A) for e in (BEARING, GEAR)]
    assert np.array_equal(both.stiffness, parts[0].stiffness + parts[1].stiffness)
    assert np.array_equal(both.loss, parts[0].loss)


@pytest.mark.parametrize("values", [(-1.0, 1.0), (1.0, 0.0), (1.0, np.inf), (np.nan, 1.0), (1.0, 1.0, -1.0)])
def test_impossible_friction_is_refused(values):
    with pytest.raises(ConfigError, match="friction of"):
        Friction(*values)


@pytest.mark.parametrize(
    "values", [(-1.0, 1.0), (1.0, 0.0), (1.0, np.inf), (np.nan, 1.0), (1.0, 1.0, np.nan)]
)
def test_impossible_deadbands_are_refused(values):
    with pytest.raises(ConfigError, match="a gap of"):
        Deadband(*values)


@pytest.mark.parametrize("amplitude", [[0.0], [-1.0], [np.nan], [np.inf]])
def test_amplitudes_that_are_none_are_refused(amplitude):
    for element in (BEARING, GEAR):
        with pytest.raises(ConfigError, match="amplitudes"):
            element.describing_function(np.array(amplitude))
