"""The noise of a gyro's samples does not depend on how long they wait for other sensors."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sensor
from middeck.laboratory.rig.rig import Rig, build_rig
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from plant_builders import sum_of_modes

RATE_HZ = 100.0
NOISE = 1e-3  # rad/s/sqrt(Hz), two-sided
ALIAS_HZ = 40.0

# Cut-off of the filter that is waited for: by a small part of a tick up to several, and exactly one and two.
WHOLE = [1.0 / (np.sqrt(2.0) * np.pi * ticks / RATE_HZ + 1.0 / ALIAS_HZ) for ticks in (1.0, 2.0)]
SLOWER = [39.99, 35.0, 20.0, 8.0, *WHOLE]


def _rig(*others: Sensor, alias_hz: float = ALIAS_HZ, steps: int = 1) -> Rig:
    modal = sum_of_modes([2.0 * np.pi], 0.05, [[1.0]], np.ones((3, 1)))
    plant = Plant(dynamics=modal, inputs=(Port("t", "N m"),), outputs=tuple(Port(n, "rad") for n in "abc"))
    sensors = dict(zip("abc", (Gyro(noise=NOISE, anti_alias_hz=alias_hz), *others), strict=False))
    return build_rig(plant, sensors=sensors, sample_hz=RATE_HZ, delay_s=0.1, substeps=steps)


def _butterworth(alias_hz: float) -> np.ndarray:
    """Covariance of samples of white noise behind s^2 + sqrt(2) w s + w^2, 0 to 4 ticks apart.

    N^2 w / (2 sqrt 2) exp(-x) (cos x + sin x), x = w tau / sqrt 2: the residues of N^2 w^4 / (s^4 + w^4).
    """
    w = 2.0 * np.pi * alias_hz
    x = w * np.arange(5) / RATE_HZ / np.sqrt(2.0)
    return NOISE**2 * w / (2.0 * np.sqrt(2.0)) * np.exp(-x) * (np.cos(x) + np.sin(x))


def _sampled(rig: Rig) -> np.ndarray:
    """The same of the first output's samples on the rig, by the covariance of its states."""
    n = rig.plant.angle.shape[1]
    step = np.eye(n)
    for inner in rig.plant.step:
        step = inner[:n] @ step
    X = sla.solve_discrete_lyapunov(step, rig.plant.noise @ rig.plant.noise.T)
    read = rig.plant.read[0]
    return np.array([read @ np.linalg.matrix_power(step, k) @ X @ read for k in range(5)])


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("slower_hz", SLOWER)
def test_samples_that_wait_have_the_spectrum_of_their_filter(slower_hz: float, steps: int) -> None:
    rig = _rig(Gyro(anti_alias_hz=slower_hz), Encoder(1e-6), steps=steps)
    wanted = _butterworth(ALIAS_HZ)
    # Rounding of a Lyapunov equation with samples nearly alike: 1e-12; 1e-9 of a tick counts as whole.
    np.testing.assert_allclose(_sampled(rig), wanted, rtol=0.0, atol=1e-8 * wanted[0])


@pytest.mark.parametrize("alias_hz", [10.0, 3000.0, 1e5])
def test_a_filter_may_be_fast_against_the_tick(alias_hz: float) -> None:
    rig = _rig(Gyro(anti_alias_hz=8.0), alias_hz=alias_hz)
    wanted = _butterworth(alias_hz)
    np.testing.assert_allclose(_sampled(rig), wanted, rtol=0.0, atol=1e-8 * wanted[0])


def test_the_readings_of_a_run_are_as_noisy_beside_a_slower_gyro() -> None:
    ticks = 40_000
    rig = _rig(Gyro(anti_alias_hz=8.0))
    (run,) = simulate_rig(rig, None, [np.zeros((ticks, 1))], np.random.default_rng(3))
    mean_square = np.mean(run.readings[100:, 0] ** 2)
    wanted = _butterworth(ALIAS_HZ)
    # Bartlett (1946): the variance of a mean square of correlated normal numbers; four deviations.
    spread = np.sqrt(2.0 * (wanted[0] ** 2 + 2.0 * np.sum(wanted[1:] ** 2)) / ticks)
    assert abs(mean_square - wanted[0]) < 4.0 * spread
