import math

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.systems.delay import pade
from middeck.systems.response import statespace_response


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


@pytest.mark.parametrize("order", range(1, 11))
def test_is_stable_and_well_conditioned(order):
    A = pade(0.01, order).A
    assert np.linalg.eigvals(A).real.max() < 0.0
    # The level is 1e4; the ladder's own growth is below the square of the order.
    assert np.linalg.cond(A) < 4.0 * order**2


@pytest.mark.parametrize("order", [1, 2, 3, 5, 8])
def test_phase_error_is_the_first_neglected_term(order):
    tau, n = 0.01, order
    # Small enough that the next term of the series is below a few per cent of this one, not below rounding.
    x = {1: 0.05, 2: 0.3, 3: 0.6, 5: 1.5, 8: 4.0}[n]
    error = np.angle(statespace_response(pade(tau, n), np.array([x / tau]))[0, 0, 0] * np.exp(1j * x))
    leading = math.factorial(n) ** 2 / (math.factorial(2 * n) * math.factorial(2 * n + 1)) * x ** (2 * n + 1)
    # The next term is x^2 / (4 (2 n + 1)) or so of the first: at most 24 % here.
    assert abs(error) == pytest.approx(leading, rel=0.25)


def test_no_delay_has_no_states():
    system = pade(0.0, 3)
    assert system.A.shape == (0, 0)
    assert system.D[0, 0] == 1.0


@pytest.mark.parametrize(("delay_s", "order"), [(-1e-3, 3), (np.nan, 3), (np.inf, 3), (0.01, 0)])
def test_refuses_what_is_no_delay(delay_s, order):
    with pytest.raises(ConfigError):
        pade(delay_s, order)
