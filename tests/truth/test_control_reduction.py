"""Reduction of systems and plants: closed forms, exact errors, what is kept exactly, what is refused."""

from __future__ import annotations

import dataclasses

import mace_like
import numpy as np
import pytest
import scipy.linalg as sla

from balanced_cut import cut_balanced, hankel_values
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.reduction.gramian import factor_gramians
from middeck.control.reduction.modal import reduce_modes
from middeck.control.reduction.separation import separate_poles, separate_unstable
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.poles.stability import growth_rates
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace, add, gain_system, poles
from plant_builders import grouped_plant


def gain_at(system, omega):
    """Largest singular value line by line, by solving."""
    return np.linalg.norm(by_solving(system)(1j * np.atleast_1d(omega)), 2, axis=(1, 2))


def two_lags(a=1.0, b=2.0, gain=0.3):
    """1/(s + a) + gain/(s + b)."""
    return StateSpace(np.diag([-a, -b]), np.ones((2, 1)), np.array([[1.0, gain]]), np.zeros((1, 1)))


# --- Hankel singular values -----------------------------------------------------------------------------


def test_hankel_values_of_two_lags():
    # Gramians of 1/(s+a) + g/(s+b): P_ij = 1/(p_i + p_j), Q_ij = c_i c_j P_ij; sigma^2 from trace and det.
    a, b, g = 1.0, 2.0, 0.3
    P = np.array([[1 / (2 * a), 1 / (a + b)], [1 / (a + b), 1 / (2 * b)]])
    c = np.array([1.0, g])
    M = P @ (np.outer(c, c) * P)
    half, det = np.trace(M) / 2.0, np.linalg.det(M)
    want = np.sqrt([half + np.sqrt(half**2 - det), half - np.sqrt(half**2 - det)])
    # det = 3e-5 of trace^2 cancels five digits in this form, not in ours.
    np.testing.assert_allclose(hankel_values(two_lags(a, b, g)), want, rtol=1e-10)


def test_hankel_values_of_a_light_mode():
    # q'' + 2 zeta w q' + w^2 q = u, y = q: sigma = (sqrt(1 + zeta^2) +- zeta) / (4 zeta w^2).
    zeta, w = 1e-3, 7.0
    mode = StateSpace([[0.0, w], [-w, -2.0 * zeta * w]], [[0.0], [1.0 / w]], [[1.0, 0.0]], [[0.0]])
    want = (np.sqrt(1.0 + zeta**2) + np.array([zeta, -zeta])) / (4.0 * zeta * w**2)
    # Poles are known to eps/zeta of their damping.
    np.testing.assert_allclose(hankel_values(mode), want, rtol=1e-12)


@pytest.mark.parametrize("small", [1e-3, 1e-6, 1e-9])
def test_small_hankel_values_are_not_lost_in_squares(small):
    # Two blocks that know nothing of each other: 1/(s+1) has 1/2, small/(s+1) has small/2.
    both = StateSpace(-np.eye(2), np.diag([1.0, small]), np.eye(2), np.zeros((2, 2)))
    # A product of Gramians would leave rounding relative to 1/4 under the root: 1e-8, not 1e-9.
    np.testing.assert_allclose(hankel_values(both), [0.5, small / 2.0], rtol=1e-7 if small < 1e-8 else 1e-9)


def test_gramian_factors_solve_both_equations():
    rng = np.random.default_rng(4)
    A = rng.standard_normal((9, 9)) - 5.0 * np.eye(9)
    system = StateSpace(A, rng.standard_normal((9, 2)), rng.standard_normal((11, 9)), np.zeros((11, 2)))
    f = factor_gramians(system)
    P, Q = f.reach @ f.reach.T, f.see @ f.see.T
    # SciPy's Bartels and Stewart: some roundings of a problem of condition ten.
    np.testing.assert_allclose(P, sla.solve_continuous_lyapunov(A, -system.B @ system.B.T), atol=1e-13)
    np.testing.assert_allclose(Q, sla.solve_continuous_lyapunov(A.T, -system.C.T @ system.C), atol=1e-12)
    assert np.all(np.triu(f.reach, 1) == 0.0)


def test_a_silent_port_gives_empty_gramians():
    dead = StateSpace(-np.eye(2), np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)))
    assert np.all(hankel_values(dead) == 0.0)
    assert cut_balanced(dead, 1).error == 0.0


# --- The peak of the gain -------------------------------------------------------------------------------


@pytest.mark.parametrize("zeta", [0.3, 1e-2, 1e-5])
def test_peak_of_a_mode(zeta):
    mode = StateSpace([[0.0, 3.0], [-3.0, -6.0 * zeta]], [[0.0], [3.0]], [[1.0, 0.0]], [[0.0]])
    found = peak_gain(mode)
    # The damping itself is rounded by eps/zeta.
    assert found.gain == pytest.approx(1.0 / (2.0 * zeta * np.sqrt(1.0 - zeta**2)), rel=1e-8)
    # Flat at the top: sqrt(1e-9) of the half-width.
    assert found.omega == pytest.approx(3.0 * np.sqrt(1.0 - 2.0 * zeta**2), rel=1e-4)


def test_peak_of_an_all_pass_is_one_everywhere():
    delay = StateSpace([[-4.0]], [[1.0]], [[8.0]], [[-1.0]])  # (4 - s)/(4 + s)
    assert peak_gain(delay).gain == pytest.approx(1.0, rel=1e-9)


def test_peak_in_a_band_and_beyond_all_bounds():
    lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    assert peak_gain(lag, (3.0, 9.0)).gain == pytest.approx(1.0 / np.sqrt(10.0), rel=1e-12)
    high = StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])  # s/(s + 1)
    assert peak_gain(high).gain == pytest.approx(1.0, rel=1e-12)
    assert peak_gain(high, (0.0, 1.0)).gain == pytest.approx(np.sqrt(0.5), rel=1e-12)
    integrator = StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]])
    assert peak_gain(integrator).gain == np.inf
    assert peak_gain(integrator, (2.0, 5.0)).gain == pytest.approx(0.5, rel=1e-12)
    assert peak_gain(gain_system(np.diag([1.0, -3.0]))).gain == 3.0


@pytest.mark.parametrize("seed", range(4))
def test_no_line_of_a_dense_grid_is_above_the_peak(seed):
    rng = np.random.default_rng(seed)
    w = np.sort(rng.uniform(0.5, 40.0, 12))
    A = sla.block_diag(*([[0.0, x], [-x, -2.0 * 10.0 ** rng.uniform(-4, -1) * x]] for x in w))
    system = StateSpace(
        A, rng.standard_normal((24, 2)), rng.standard_normal((3, 24)), rng.standard_normal((3, 2))
    )
    found = peak_gain(system)
    lines = np.concatenate(
        [np.geomspace(0.1, 200.0, 2000), found.omega * (1.0 + np.linspace(-1e-3, 1e-3, 401))]
    )
    assert gain_at(system, lines).max() <= found.gain * (1.0 + 1e-9)
    assert gain_at(system, found.omega)[0] == pytest.approx(found.gain, rel=1e-9)


# --- What does not decay --------------------------------------------------------------------------------


def test_separation_is_exact_and_keeps_what_does_not_decay():
    rng = np.random.default_rng(6)
    A = sla.block_diag(
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.3, 5.0], [-5.0, 0.3]],
        *([[-0.01 * x, x], [-x, -0.01 * x]] for x in (1.0, 9.0)),
    )
    T = rng.standard_normal((8, 8)) + 3.0 * np.eye(8)
    back = np.linalg.inv(T)
    B, C = rng.standard_normal((8, 2)), rng.standard_normal((2, 8))
    mixed = StateSpace(T @ A @ back, T @ B, C @ back, np.eye(2))
    parts = separate_unstable(mixed)
    assert len(parts.kept.A) == 4
    assert np.all(np.real(poles(parts.rest)) < -5e-3)
    lines = 1j * np.array([0.3, 1.0, 4.0, 20.0])
    whole = by_solving(mixed)(lines)
    # Condition of the turn (tens) and of the Sylvester equation (1/gap = 100) times rounding, at resonance.
    np.testing.assert_allclose(by_solving(add(parts.kept, parts.rest))(lines), whole, rtol=1e-9)
    pair = separate_poles(mixed, np.array([0.3 + 5.0j, 0.3 - 5.0j])).kept
    np.testing.assert_allclose(np.sort_complex(poles(pair)), [0.3 - 5.0j, 0.3 + 5.0j], rtol=1e-10)


def test_an_unstable_part_passes_untouched():
    unstable = StateSpace([[0.5]], [[2.0]], [[3.0]], [[0.0]])
    found = cut_balanced(add(unstable, two_lags(1.0, 30.0, 0.01)), 2)
    assert found.order == 2
    assert np.max(np.real(poles(found.system))) == pytest.approx(0.5, rel=1e-14)
    # The difference has no pole at 0.5: its gain beside it is what it is anywhere else, below the bound.
    assert found.error <= found.bound * (1.0 + 1e-9)
    with pytest.raises(ConfigError, match="1 states do not decay"):
        cut_balanced(unstable, 0)


# --- Balanced -------------------------------------------------------------------------------------------


def test_one_of_two_lags_has_the_error_of_the_bound():
    # Collocated (C = B'): all signs equal, the error at zero frequency is the bound (Glover 1984).
    found = cut_balanced(two_lags(1.0, 9.0, 1.0), 1)
    assert found.error == pytest.approx(found.bound, rel=1e-9)


def test_truncation_keeps_the_direct_term_and_stability():
    plant = close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops()).system
    found = cut_balanced(plant, 30)
    assert np.array_equal(found.system.D, plant.D)
    assert found.error <= found.bound
    assert np.all(np.real(growth_rates(found.system)) < 0.0)


def test_sizes_of_ports_are_units():
    # The same plant in other units, sizes given in them: the same reduced plant, the same relative error.
    system = close_inner_loop(mace_like.build("orbit"), mace_like.pd_loops()).system
    inputs, outputs = np.full(7, 1e3), np.where(np.arange(18) < 9, 1e-3, 1.0)
    scaled = StateSpace(system.A, system.B * inputs, system.C / outputs[:, None], system.D)
    here = cut_balanced(system, 30, input_size=inputs, output_size=outputs)
    there = cut_balanced(scaled, 30)
    assert here.error == pytest.approx(there.error, rel=1e-8)
    np.testing.assert_allclose(here.hankel, there.hankel, rtol=0, atol=1e-12 * there.hankel[0])


def test_equal_singular_values_are_not_parted():
    # (s^2 - ...)/(s^2 + ...) all-pass of second order: both Hankel singular values are one.
    pair = StateSpace(
        [[-1.0, 2.0], [-2.0, -1.0]], np.sqrt(2.0) * np.eye(2), -np.sqrt(2.0) * np.eye(2), np.eye(2)
    )
    np.testing.assert_allclose(hankel_values(pair), [1.0, 1.0], rtol=1e-14)
    assert cut_balanced(pair, 1).order == 0


# --- Plants ---------------------------------------------------------------------------------------------


def modal_plant():
    """A rigid mode and three others; x reads position, a acceleration."""
    omega, psi = np.array([0.0, 2.0, 20.0, 200.0]), np.array([[1.0], [0.5], [0.8], [2.0]])
    phi = np.array([[1.0, 0.5, 0.8, 2.0], [0.0, 0.0, 0.0, 0.0]])
    modal = ModalSystem(
        omega=omega,
        zeta=np.array([0.0, 0.01, 0.01, 0.01]),
        psi=psi,
        phi=phi,
        phi_rate=0.0 * phi,
        names=("rigid", "low", "middle", "high"),
        phi_acceleration=phi[::-1],
    )
    ports = (Port("u", "N"),), (Port("x", "m"), Port("a", "m/s^2"))
    return grouped_plant(modal, ports[0], ports[1], z=("x",))


def test_modes_of_a_modal_plant_stay_modal_and_leave_their_limits():
    plant = modal_plant()
    found = reduce_modes(plant, 2, band_hz=(1.0, 10.0))
    modal = found.plant.dynamics
    assert isinstance(modal, ModalSystem)
    assert (found.kept, found.dropped) == (("rigid", "middle"), ("low", "high"))
    assert modal.direct is not None
    # Below the band a mode is a mass (its acceleration), above it a spring (its static gain).
    np.testing.assert_allclose(modal.direct[:, 0], [2.0 * 2.0 / 200.0**2, 0.5 * 0.5], rtol=1e-14)
    hz = np.linspace(1.0, 10.0, 2000)
    change = evaluate_plant(found.plant, hz).H - evaluate_plant(plant, hz).H
    gains = np.linalg.norm(change, 2, axis=(1, 2))
    assert gains.max() <= found.error * (1.0 + 1e-9)
    assert gains.max() == pytest.approx(found.error, rel=1e-3)  # the grid is that dense
    still, plain = (
        reduce_modes(plant, 3, band_hz=(1.0, 10.0), outputs=("x",), static=static) for static in (True, False)
    )
    assert isinstance(plain.plant.dynamics, ModalSystem)
    assert plain.plant.dynamics.direct is None
    # 1/(1 - r^2 + 2j zeta r) without its limit of one, r = 20 pi / 200 at the end of the band; over itself.
    r = 20.0 * np.pi / 200.0
    assert still.error / plain.error == pytest.approx(abs(r**2 - 0.02j * r), rel=1e-9)


def test_modes_of_any_plant_are_those_of_the_modal_one():
    plant = mace_like.build("lab", "flexible")  # two suspension modes coincide: which shapes is a choice
    ports = {"inputs": ("pri_rel_x",), "outputs": ("pri_in_x", "bus_x")}
    modal = reduce_modes(plant, 7, band_hz=(2.0, 12.0), **ports)
    turn, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((32, 32)))
    s = plant.system
    mixed = dataclasses.replace(
        plant, dynamics=StateSpace(turn @ s.A @ turn.T, turn @ s.B, s.C @ turn.T, s.D)
    )
    found = reduce_modes(mixed, 7, band_hz=(2.0, 12.0), **ports)
    hz = np.geomspace(0.1, 40.0, 60)
    # The same modes by their poles; eigenvectors of 1 % damping lose two digits or three.
    want = evaluate_plant(modal.plant, hz).H
    np.testing.assert_allclose(evaluate_plant(found.plant, hz).H, want, atol=1e-9 * np.abs(want).max())
    assert found.error == pytest.approx(modal.error, rel=1e-7)
    assert len(found.kept) == 7


@pytest.mark.parametrize("form", ["modal", "state space"])
def test_a_mode_without_damping_is_kept_and_leaves_the_order_of_the_others(form):
    # Its response is infinite within the band; of the others the larger share is kept, the lightest too.
    omega, zeta = np.array([0.1, 6.0, 20.0, 1000.0]), np.array([1e-5, 0.0, 0.01, 0.01])
    modal = ModalSystem(
        omega=omega,
        zeta=zeta,
        psi=np.array([[1e-13], [1.0], [1.0], [1.0]]),
        phi=np.ones((1, 4)),
        phi_rate=np.zeros((1, 4)),
        names=("slow", "free", "middle", "high"),
    )
    plant = grouped_plant(modal, (Port("u", "N"),), (Port("x", "m"),))
    if form == "state space":
        plant = dataclasses.replace(plant, dynamics=plant.system)
    found = reduce_modes(plant, 2, band_hz=(0.5, 6.0 / (2.0 * np.pi)))
    assert found.kept == (("free", "middle") if form == "modal" else ("0.9549 Hz", "3.183 Hz"))
    # Of the high one its static gain is left: (r^2 - 2j zeta r) / w0^2 at the end of the band, r = 6/1000.
    assert found.error == pytest.approx(abs(0.006**2 - 0.02j * 0.006) / 1000.0**2, rel=1e-3)


def test_modes_that_do_not_decay_are_kept_or_refused():
    with pytest.raises(ConfigError, match="1 do not decay"):
        reduce_modes(modal_plant(), 0, band_hz=(1.0, 2.0))
    with pytest.raises(ConfigError, match="band"):
        reduce_modes(modal_plant(), 2, band_hz=(2.0, 1.0))
    with pytest.raises(ConfigError, match="no input named 'v'"):
        reduce_modes(modal_plant(), 2, band_hz=(1.0, 2.0), inputs=("v",))
