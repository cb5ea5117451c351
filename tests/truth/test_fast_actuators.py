"""Free bodies behind actuators a million times faster than their loops: the bodies stay what they are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.poles.integrators import part_integrators, rest_once
from middeck.systems.state_space.statespace import StateSpace
from repeats import repeats

pytestmark = pytest.mark.kernels

K, LEAD, ROLL, MODE, ZETA = 0.5, 0.4, 6.0, 30.0, 0.02
"""u = -K (1 + s/LEAD) / (1 + s/ROLL)^2 y, and y = (1/s^2 + 1/(s^2 + 2 ZETA MODE s + MODE^2)) of the force."""


def loop_gain(s: complex, lag: float, tau: float) -> complex:
    body = 1.0 / s**2 + 1.0 / (s**2 + 2.0 * ZETA * MODE * s + MODE**2)
    return K * (1.0 + s / LEAD) / (1.0 + s / ROLL) ** 2 * body * np.exp(-s * tau) / (1.0 + s / lag)


def body_behind_lags(lag: float, rng: np.random.Generator, kind: str) -> tuple[np.ndarray, ...]:
    """States of a body, its mode and the force; mixed by an orthogonal matrix, or in units of their own."""
    A, B, C = np.zeros((5, 5)), np.zeros((5, 1)), np.array([[1.0, 0.0, 1.0, 0.0, 0.0]])
    A[0, 1] = A[2, 3] = A[1, 4] = A[3, 4] = 1.0
    A[3, 2:4] = -(MODE**2), -2.0 * ZETA * MODE
    A[4, 4], B[4, 0] = -lag, lag
    turn = np.linalg.qr(rng.standard_normal((5, 5)))[0] if kind == "mixed" else np.eye(5)
    unit = 10.0 ** rng.uniform(-6.0, 6.0, 5)
    A, B, C = turn @ A @ turn.T, turn @ B, C @ turn.T
    return A * unit / unit[:, None], B / unit[:, None], C * unit


def lead() -> tuple[np.ndarray, ...]:
    A, B = np.array([[-ROLL, ROLL], [0.0, -ROLL]]), np.array([[0.0], [ROLL]])
    return A, B, -K * np.array([[1.0 - ROLL / LEAD, ROLL / LEAD]]), np.zeros((1, 1))


@pytest.mark.parametrize("kind", ["mixed", "in units"])
@pytest.mark.parametrize("seed", repeats(range(12), 2))
def test_margins_of_a_body_behind_a_fast_actuator(seed: int, kind: str) -> None:
    """They are those of L itself. In mixed states they were those of the loop without the body's place."""
    rng = np.random.default_rng([241, seed])
    lag, tau = 10.0 ** rng.uniform(4.5, 6.5), 10.0 ** rng.uniform(-6.0, -2.5)
    plant = make_plant(*body_behind_lags(lag, rng, kind), delay_s=tau)
    one = measure_margins(plant, Compensator(StateSpace(*lead()), plant.outputs, plant.inputs)).loops[0]
    turn = brentq(lambda w: loop_gain(1j * w, lag, tau).imag, 1.5, 15.0)
    unit = brentq(lambda w: abs(loop_gain(1j * w, lag, tau)) - 1.0, 0.6, 5.0)
    phase = np.angle(loop_gain(1j * unit, lag, tau)) + np.pi
    assert one.gain_limits == pytest.approx((0.0, -1.0 / loop_gain(1j * turn, lag, tau).real), rel=1e-6)
    assert one.phase_limit_rad == pytest.approx(phase, rel=1e-6)
    assert one.delay_limit_s == pytest.approx(phase / unit, rel=1e-6)


def two_forces(rng: np.random.Generator, kind: str) -> tuple[StateSpace, np.ndarray, float]:
    """A body and three modes between two forces, one behind a fast lag, and their places; the body's
    residues, and the lag."""
    lag, count = 10.0 ** rng.uniform(3.0, 6.0), 4
    psi, omega = rng.standard_normal((count, 2)), np.append(0.0, rng.uniform(1.0, 50.0, 3))
    A, B, C = np.zeros((9, 9)), np.zeros((9, 2)), np.zeros((2, 9))
    A[:4, 4:8], C[:, :4] = np.eye(4), psi.T
    A[4:8, :4], A[4:8, 4:8] = -np.diag(omega**2), -0.01 * np.diag(omega)
    A[4:8, 8], B[4:8, 0], A[8, 8], B[8, 1] = psi[:, 1], psi[:, 0], -lag, lag
    turn = np.linalg.qr(rng.standard_normal((9, 9)))[0] if kind == "mixed" else np.eye(9)
    unit = np.ones(9) if kind == "plain" else 10.0 ** rng.uniform(-6.0, 6.0, 9)
    A, B, C = turn @ A @ turn.T, turn @ B, C @ turn.T
    whole = StateSpace(A * unit / unit[:, None], B / unit[:, None], C * unit, np.zeros((2, 2)))
    return whole, np.outer(psi[0], psi[0]), lag


@pytest.mark.parametrize("kind", ["mixed", "in units"])
@pytest.mark.parametrize("seed", repeats(range(20), 4))
def test_residues_of_a_body_that_a_fast_lag_drives(seed: int, kind: str) -> None:
    """R_2 is that of the body, R_1 what the lag leaves behind: -R_2 / lag. A weak force beside a fast lag was
    taken for rounding, and of a body of two states three were realised (its verdict ended in an error)."""
    rng = np.random.default_rng([242, seed])
    system, body, lag = two_forces(rng, kind)
    parted = part_integrators(system)
    delay = np.stack([np.zeros(2), -body[:, 1] / lag], axis=1)
    assert parted.residues[1] == pytest.approx(body, rel=1e-6)
    assert parted.residues[0] == pytest.approx(delay, abs=1e-6 * np.abs(body).max())
    again, dropped = rest_once(system)
    assert dropped == 0
    assert isinstance(again, StateSpace)
    assert part_integrators(again).residues[1] == pytest.approx(body, rel=1e-6)


@pytest.mark.parametrize("seed", repeats(range(20), 4))
def test_verdict_of_a_body_between_a_fast_and_a_direct_force(seed: int) -> None:
    """Positions of two ends fed back with rates: without delays eigenvalues of matrices in their own units
    tell, and delays of a microsecond change nothing."""
    rng = np.random.default_rng([242, seed])
    system, _, _ = two_forces(rng, "in units")
    gain, corner = 10.0 ** rng.uniform(-1.0, 1.0), 10.0 ** rng.uniform(0.0, 2.0)
    A, B = -corner * np.eye(2), np.eye(2) * corner
    C, D = gain * corner * np.eye(2), -gain * (1.0 + corner) * np.eye(2)  # -gain (1 + s / (1 + s / corner))
    plant = make_plant(
        system.A, system.B, system.C, delay_s=1e-6 * rng.uniform(0.1, 1.0, (2, 1)) * np.ones((1, 2))
    )
    found = decide_stability(plant, Compensator(StateSpace(A, B, C, D), plant.outputs, plant.inputs))
    rng = np.random.default_rng([242, seed])
    plain, _, _ = two_forces(rng, "plain")
    closed = np.block([[plain.A + plain.B @ D @ plain.C, plain.B @ C], [B @ plain.C, A]])
    growth = np.linalg.eigvals(closed).real.max()
    assert abs(growth) > 1e-6
    assert found.stable == (growth < 0.0)
    assert -found.margin == pytest.approx(growth, rel=2e-2)
