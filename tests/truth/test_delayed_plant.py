"""Late paths: exact in the response, converging by Pade, and the same as the measured model's."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays, evaluate_approximation
from middeck.systems.plants.plant import Plant, delay_plant, name_states
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import gain_system

HZ = np.array([0.3, 1.0, 3.0, 9.0])
MODES = ModalSystem(
    omega=[6.0, 40.0],
    zeta=[0.01, 0.02],
    psi=[[1.0, 0.4], [0.7, -1.0]],
    phi=[[1.0, 0.5], [0.2, -0.8], [0.3, 0.9]],
    phi_rate=np.zeros((3, 2)),
    names=("one", "two"),
)
PLANT = Plant(
    dynamics=MODES,
    inputs=(Port("a", "N"), Port("b", "N")),
    outputs=(Port("p", "m"), Port("q", "m"), Port("r", "m")),
)
SUM = np.array([[0.010, 0.013], [0.012, 0.015], [0.011, 0.014]])
NO_SUM = np.array([[0.010, 0.013], [0.012, 0.010], [0.011, 0.014]])


@pytest.mark.parametrize("delay_s", [SUM, NO_SUM])
def test_response_is_the_plant_times_each_delay(delay_s: np.ndarray) -> None:
    delayed = evaluate_plant(delay_plant(PLANT, delay_s), HZ).H
    expected = evaluate_plant(PLANT, HZ).H * np.exp(-2j * np.pi * HZ[:, None, None] * delay_s)
    np.testing.assert_allclose(delayed, expected, rtol=1e-13)


@pytest.mark.parametrize("delay_s", [SUM, NO_SUM, np.zeros((3, 2))])
def test_pade_converges_to_the_exact_response(delay_s: np.ndarray) -> None:
    delayed = delay_plant(PLANT, delay_s)
    exact = evaluate_plant(delayed, HZ).H
    error = [
        np.abs(evaluate_plant(approximate_delays(delayed, n), HZ).H / exact - 1.0).max() for n in (2, 4, 6)
    ]
    # Pade of order n errs by (w tau)^(2n+1) n!^2 / (2n)! (2n+1)!: w tau is 0.85 at most.
    assert error[0] < 1e-3
    assert error[1] < 1e-7
    assert error[2] < 1e-11


def test_states_are_as_many_as_the_delays_ask_for_and_named() -> None:
    """2 modes; sums: 2 inputs late in front, 3 outputs late behind, the least of them on time."""
    plant = approximate_delays(delay_plant(PLANT, SUM), 3)
    names = name_states(plant)
    assert len(plant.system.A) == 4 + 3 * 4
    assert names.count("delay") == 12
    assert names[6:10] == ("one", "one", "two", "two")
    twice = approximate_delays(delay_plant(PLANT, NO_SUM), 3)
    assert name_states(twice).count("one") == 4


def test_one_delay_for_all_goes_to_the_smaller_side() -> None:
    assert len(approximate_delays(delay_plant(PLANT, 0.01), 3).system.A) == 4 + 2 * 3


@pytest.mark.parametrize("delay_s", [-1e-3, np.nan, np.inf])
def test_impossible_delays_are_refused(delay_s: float) -> None:
    with pytest.raises(ConfigError, match="one is negative"):
        delay_plant(PLANT, delay_s)


@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (2, 3), (3, 3)])
@pytest.mark.parametrize("sums", [True, False])
def test_what_stands_for_a_delay_is_evaluated_as_it_is_built(shape: tuple[int, int], sums: bool) -> None:
    """Of a plant of ones the approximation is nothing but its delays; one of them is on time."""
    rng = np.random.default_rng(5)
    rows, columns = shape
    delay = rng.uniform(0.0, 0.1, (rows, 1)) + rng.uniform(0.0, 0.1, (1, columns))
    delay = delay if sums else rng.uniform(0.0, 0.1, shape)
    delay[0, 0] = 0.0 if not sums else delay[0, 0]
    inputs = tuple(Port(f"u{i}", "N") for i in range(columns))
    ones = Plant(
        dynamics=gain_system(np.ones(shape)),
        inputs=inputs,
        outputs=tuple(Port(f"y{i}", "m") for i in range(rows)),
    )
    s = rng.uniform(-1.0, 1.0, 12) + 1j * rng.uniform(0.1, 200.0, 12)
    built = by_solving(approximate_delays(delay_plant(ones, delay), 9).system)(s)
    np.testing.assert_allclose(evaluate_approximation(delay, 9, s), built, atol=1e-11)
