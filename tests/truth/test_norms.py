"""Band-limited rms against closed forms and against quadrature that knows no eigenvalue."""

import numpy as np
import pytest
import scipy.linalg as sla
from hypothesis import given, settings
from hypothesis import strategies as st

from middeck.errors import ConfigError
from middeck.systems.norms import band_rms as norms
from middeck.systems.norms.band_rms import band_rms, band_rms_by_quadrature
from middeck.systems.state_space.statespace import StateSpace, gain_system

BAND = (0.1, 60.0)


def resonators(n, seed=0, zeta=0.01, outputs=3, inputs=2):
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.geomspace(0.05, 90.0, n)
    A = sla.block_diag(*[np.array([[0.0, w], [-w, -2.0 * zeta * w]]) for w in omega])
    B, C = np.zeros((2 * n, inputs)), np.zeros((outputs, 2 * n))
    B[1::2] = rng.standard_normal((n, inputs)) / omega[:, None]
    C[:, ::2] = rng.standard_normal((outputs, n))
    return StateSpace(A, B, C, np.zeros((outputs, inputs)))


def turned(system, seed=1):
    """The same system in coordinates where every entry of A is filled."""
    T, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal(system.A.shape))
    return StateSpace(T @ system.A @ T.T, T @ system.B, system.C @ T.T, system.D)


def test_first_order_lag():
    # |G|^2 = 1/(1 + w^2): rms^2 = (1/pi) (atan w2 - atan w1) S.
    lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    w1, w2 = 2.0 * np.pi * np.array(BAND)
    expected = np.sqrt(3.0 / np.pi * (np.arctan(w2) - np.arctan(w1)))
    # One subtraction of two logarithms.
    assert band_rms(lag, 3.0 * np.eye(1), BAND)[0] == pytest.approx(expected, rel=1e-14)


def test_double_integrator_in_a_band_without_zero():
    # |G|^2 = w^-4: rms^2 = (1/pi) (w1^-3 - w2^-3) / 3; the pole pair at the origin is defective.
    system = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    w1, w2 = 2.0 * np.pi * np.array(BAND)
    expected = np.sqrt((w1**-3 - w2**-3) / 3.0 / np.pi)
    assert band_rms(system, np.eye(1), BAND)[0] == pytest.approx(expected, rel=1e-13)


def test_single_integrator():
    system = StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])
    w1, w2 = 2.0 * np.pi * np.array(BAND)
    assert band_rms(system, np.eye(1), BAND)[0] == pytest.approx(
        np.sqrt((1 / w1 - 1 / w2) / np.pi), rel=1e-13
    )


def test_whole_axis_limit_is_the_lyapunov_norm():
    system = resonators(8)
    X = sla.solve_continuous_lyapunov(system.A, -system.B @ system.B.T)
    whole = np.sqrt(np.diag(system.C @ X @ system.C.T))
    # What lies above f falls as f^-3 for a displacement: (1e4)^-3 of 90 Hz.
    np.testing.assert_allclose(band_rms(system, np.eye(2), (0.0, 9e5)), whole, rtol=1e-10)


@pytest.mark.parametrize(("modes", "zeta"), [(50, 0.01), (12, 1e-3)])
def test_full_matrices_agree_with_quadrature(modes, zeta):
    system = turned(resonators(modes, zeta=zeta))
    intensity = np.array([[2.0, 0.5], [0.5, 1.0]]) * 1e-6
    exact = band_rms(system, intensity, BAND)
    np.testing.assert_allclose(exact, band_rms_by_quadrature(system, intensity, BAND), rtol=1e-10)


def test_hundred_states_with_rigid_modes_agree_with_quadrature():
    flexible = resonators(47)
    rigid = np.zeros((6, 6))
    rigid[0, 1] = rigid[2, 3] = rigid[4, 5] = 1.0
    rng = np.random.default_rng(2)
    B = np.vstack([np.zeros((6, 2)), flexible.B])
    B[1:6:2] = 0.1 * rng.standard_normal((3, 2))
    C = np.hstack([np.zeros((3, 6)), flexible.C])
    C[:, 0:6:2] = rng.standard_normal((3, 3))
    system = turned(StateSpace(sla.block_diag(rigid, flexible.A), B, C, flexible.D))
    exact = band_rms(system, np.eye(2), BAND)
    np.testing.assert_allclose(exact, band_rms_by_quadrature(system, np.eye(2), BAND), rtol=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_rounding_of_a_double_pole_at_the_origin_is_no_growth(seed):
    """In turned coordinates the double zero comes out as +-1e-7: no instability, and the same rms."""
    rng = np.random.default_rng(seed)
    A = sla.block_diag([[0.0, 1.0], [0.0, 0.0]], 300.0 * np.array([[-0.01, 1.0], [-1.0, -0.01]]))
    plain = StateSpace(A, rng.standard_normal((4, 1)), rng.standard_normal((1, 4)), [[0.0]])
    Q, _ = np.linalg.qr(rng.standard_normal((4, 4)))
    turned_system = StateSpace(Q @ A @ Q.T, Q @ plain.B, plain.C @ Q.T, plain.D)
    # The double pole itself carries rounding of 1e-16 * 300 / 0.6 into the band, squared by its second order.
    np.testing.assert_allclose(
        band_rms(turned_system, np.eye(1), BAND), band_rms_by_quadrature(plain, np.eye(1), BAND), rtol=1e-9
    )


def test_both_routes_agree(monkeypatch):
    system = turned(resonators(20))
    by_poles = band_rms(system, np.eye(2), BAND)
    monkeypatch.setattr(norms, "AGREEMENT", 0.0)  # no pole sum is good enough: quadrature in Schur form
    np.testing.assert_allclose(band_rms(system, np.eye(2), BAND), by_poles, rtol=1e-10)


def test_the_random_state_is_left_alone():
    chain = StateSpace(np.diag(np.ones(3), 1) - np.eye(4), np.eye(4)[:, 3:], np.eye(4)[:1], [[0.0]])
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - it must not move
    band_rms(chain, np.eye(1), BAND)
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_defective_chain_of_equal_lags():
    # 1/(s + a)^4 has one eigenvector: |G|^2 = (w^2 + a^2)^-4, checked by quadrature.
    a = 5.0
    A = -a * np.eye(4) + np.diag(np.ones(3), 1)
    system = StateSpace(A, np.eye(4)[:, 3:], np.eye(4)[:1], [[0.0]])
    exact = band_rms(system, np.eye(1), BAND)
    np.testing.assert_allclose(exact, band_rms_by_quadrature(system, np.eye(1), BAND), rtol=1e-10)


def test_undamped_mode_outside_the_band():
    # |G| = 1/(w0^2 - w^2), w0 below the band: no resonance inside, a stable quadrature.
    w0 = 2.0 * np.pi * 0.05
    system = StateSpace([[0.0, w0], [-w0, 0.0]], [[0.0], [1.0 / w0]], [[1.0, 0.0]], [[0.0]])
    exact = band_rms(system, np.eye(1), BAND)
    np.testing.assert_allclose(exact, band_rms_by_quadrature(system, np.eye(1), BAND), rtol=1e-10)


def test_direct_term():
    gain = gain_system([[3.0]])
    assert band_rms(gain, np.eye(1), (1.0, 3.0))[0] == pytest.approx(3.0 * np.sqrt(2.0 * 2.0), rel=1e-14)
    washout = StateSpace([[-50.0]], [[50.0]], [[-1.0]], [[1.0]])
    exact = band_rms(washout, np.eye(1), BAND)
    np.testing.assert_allclose(exact, band_rms_by_quadrature(washout, np.eye(1), BAND), rtol=1e-10)


@settings(max_examples=25, deadline=None)
@given(split=st.floats(0.11, 59.0), seed=st.integers(0, 1000))
def test_squares_add_over_bands(split, seed):
    system = resonators(6, seed=seed)
    parts = [band_rms(system, np.eye(2), band) ** 2 for band in ((0.1, split), (split, 60.0))]
    # The sum of positive numbers, each to 1e-12.
    np.testing.assert_allclose(sum(parts), band_rms(system, np.eye(2), BAND) ** 2, rtol=1e-11)


def test_an_unstable_system_is_infinite_although_its_integral_is_not():
    system = StateSpace([[0.1]], [[1.0]], [[1.0]], [[0.0]])
    assert np.isfinite(band_rms_by_quadrature(system, np.eye(1), BAND)[0])
    assert band_rms(system, np.eye(1), BAND)[0] == np.inf


def test_slow_growth_beside_a_fast_pole_is_growth():
    # No double pole: nothing stands opposite it.
    apart = StateSpace(np.diag([0.01, -1e7]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    assert band_rms(apart, np.eye(1), (1.0, 10.0))[0] == np.inf


def test_an_undamped_mode_inside_the_band_is_infinite():
    system = StateSpace([[0.0, 9.0], [-9.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    assert band_rms(system, np.eye(1), BAND)[0] == np.inf


def test_a_band_the_wrong_way_round_is_refused():
    with pytest.raises(ConfigError, match="ordered"):
        band_rms(resonators(1), np.eye(2), (3.0, 1.0))


@pytest.mark.parametrize(("omega", "zeta"), [(0.11, 1e-6), (100.0, 3e-6)])
def test_three_equal_light_modes_in_cascade_beside_a_fast_one(omega, zeta):
    mode = np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])
    A = sla.block_diag(mode, mode, mode, [[0.0, 1.0], [-1600.0, -0.8]])
    A[3, 0] = A[5, 2] = omega**2
    system = StateSpace(A, np.eye(8)[:, 1:2], np.eye(8)[4:5], [[0.0]])
    f = omega / 2.0 / np.pi
    # |G|^2 dw = w^-3 dx / (64 (x^2 + zeta^2)^3) about the resonance, x = w / omega - 1.
    square = omega**-3 / np.pi * (3.0 * np.pi / 8.0) / 64.0 / zeta**5
    assert band_rms(system, np.eye(1), (0.2 * f, 5.0 * f))[0] == pytest.approx(np.sqrt(square), rel=1e-6)


@pytest.mark.parametrize("order", [3, 4])
def test_chain_of_integrators_in_mixed_coordinates(order):
    Q, _ = np.linalg.qr(np.random.default_rng(order).standard_normal((order, order)))
    A = Q @ np.diag(np.ones(order - 1), -1) @ Q.T
    system = StateSpace(A, Q[:, :1], Q[:, -1:].T, [[0.0]])
    w1, w2 = 2.0 * np.pi * np.array(BAND)
    p = 2 * order - 1
    expected = np.sqrt((w1**-p - w2**-p) / p / np.pi)
    assert band_rms(system, np.eye(1), BAND)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("apart", [1e-5, 1e-8])
def test_two_modes_that_cancel_but_for_their_damping(apart):
    # 1 / d1 - 1 / d2 = (d2 - d1) / (d1 d2), where d2 - d1 = 2 w0 (z2 - z1) s loses no digit.
    w0, z1 = 2.0 * np.pi * 3.0, 0.01
    z2 = z1 * (1.0 + apart)
    pair = [np.array([[0.0, 1.0], [-(w0**2), -2.0 * z * w0]]) for z in (z1, z2)]
    B, C = np.array([[0.0], [1.0], [0.0], [1.0]]), np.array([[1.0, 0.0, -1.0, 0.0]])
    w = np.linspace(2.0 * np.pi * 0.5, 2.0 * np.pi * 10.0, 200_001)
    first, second = (w0**2 - w**2 + 2.0j * z * w0 * w for z in (z1, z2))
    square = np.trapezoid(np.abs(2.0j * w0 * (z2 - z1) * w / (first * second)) ** 2, w) / np.pi
    found = band_rms(StateSpace(sla.block_diag(*pair), B, C, np.zeros((1, 1))), np.eye(1), (0.5, 10.0))
    # Each response is rounded to 1e-16 of itself, their difference is `apart` of it.
    assert found[0] == pytest.approx(np.sqrt(square), rel=1e-6)
