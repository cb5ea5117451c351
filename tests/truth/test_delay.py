import math

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.systems.delay.pade import evaluate_pade, pade
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.resolvent import by_solving


@pytest.mark.parametrize("order", range(1, 11))
def test_is_the_diagonal_pade_quotient(order):
    tau, n = 0.013, order
    omega = np.linspace(0.0, 3.0 * n / tau, 200)
    x = 1j * omega * tau
    weight = [
        math.factorial(2 * n - k)
        * math.factorial(n)
        / (math.factorial(2 * n) * math.factorial(k) * math.factorial(n - k))
        for k in range(n + 1)
    ]
    quotient = sum(c * (-x) ** k for k, c in enumerate(weight)) / sum(c * x**k for k, c in enumerate(weight))
    found = statespace_response(pade(tau, n), omega)[:, 0, 0]
    # Rounding of the quotient itself: its terms reach 1e3 times its value at the largest x.
    np.testing.assert_allclose(found, quotient, atol=1e-11)
    np.testing.assert_allclose(np.abs(found), 1.0, atol=1e-12)  # an all-pass at rounding


@pytest.mark.parametrize("delay_s", [1e-4, 1e-3, 1e-2, 1e-1, 1.0])
@pytest.mark.parametrize("order", range(1, 11))
def test_is_stable_and_well_conditioned(order, delay_s):
    system = pade(delay_s, order)
    assert np.linalg.eigvals(system.A).real.max() < 0.0
    # The level is 1e4; the ladder's own growth is below the square of the order.
    assert np.linalg.cond(system.A) < 4.0 * order**2
    # The whole, in the time unit of the poles near 2 n / tau: 3 + 2 sqrt 2 at order one, where it is known.
    unit = delay_s / (2.0 * order)
    whole = np.block([[system.A * unit, system.B * np.sqrt(unit)], [system.C * np.sqrt(unit), system.D]])
    assert np.linalg.cond(whole) < 6.0 * order**2


@pytest.mark.parametrize("order", range(1, 11))
def test_is_balanced(order):
    """An all-pass in the coordinates in which both Gramians are one: no state is easier to move or to see."""
    system = pade(0.03, order)
    scale = np.abs(system.A).max()
    # Lyapunov's equations with X = 1; rounding.
    for residual in (
        system.A + system.A.T + system.B @ system.B.T,
        system.A + system.A.T + system.C.T @ system.C,
    ):
        assert np.abs(residual).max() < 1e-13 * scale


@pytest.mark.parametrize("order", [1, 2, 3, 5, 8])
def test_phase_error_is_the_first_neglected_term(order):
    tau, n = 0.01, order
    # Small enough that the next term of the series is below a few per cent of this one, not below rounding.
    x = {1: 0.05, 2: 0.3, 3: 0.6, 5: 1.5, 8: 4.0}[n]
    error = np.angle(statespace_response(pade(tau, n), np.array([x / tau]))[0, 0, 0] * np.exp(1j * x))
    leading = math.factorial(n) ** 2 / (math.factorial(2 * n) * math.factorial(2 * n + 1)) * x ** (2 * n + 1)
    # The next term is x^2 / (4 (2 n + 1)) or so of the first: at most 24 % here.
    assert abs(error) == pytest.approx(leading, rel=0.25)


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_phase_error_falls_with_the_order_of_theory(order):
    """(omega tau)^(2 n + 1): halving the frequency divides the error by 2^(2 n + 1)."""
    tau, x = 0.01, np.array([1.0, 0.5]) * {1: 0.05, 2: 0.3, 3: 0.8, 5: 2.0}[order]
    error = np.angle(statespace_response(pade(tau, order), x / tau)[:, 0, 0] * np.exp(1j * x))
    # The next term is some x^2 / (8 n) of the first: at most a tenth here, 0.15 of an octave's exponent.
    assert np.log2(error[0] / error[1]) == pytest.approx(2 * order + 1, abs=0.15)


def test_no_delay_has_no_states():
    system = pade(0.0, 3)
    assert system.A.shape == (0, 0)
    assert system.D[0, 0] == 1.0


@pytest.mark.parametrize(("delay_s", "order"), [(-1e-3, 3), (np.nan, 3), (np.inf, 3), (0.01, 0)])
def test_refuses_what_is_no_delay(delay_s, order):
    with pytest.raises(ConfigError):
        pade(delay_s, order)


@pytest.mark.parametrize("order", [1, 2, 7, 33, 128])
def test_the_continued_fraction_is_the_state_space(order):
    rng = np.random.default_rng(order)
    tau = 0.03
    s = (rng.uniform(-0.2, 0.1, 40) + 1j * 10.0 ** rng.uniform(-2.0, 2.5, 40)) / tau
    # The state space is solved for: a condition of the order squared.
    solved = by_solving(pade(tau, order))(s)[:, 0, 0]
    np.testing.assert_allclose(evaluate_pade(tau, order, s), solved, atol=1e-11)
    np.testing.assert_array_equal(evaluate_pade(0.0, order, s), np.ones(40))
