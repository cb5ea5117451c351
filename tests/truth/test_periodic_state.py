"""The periodic steady state against its closed form, in whatever units states, torques and angles are."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import NumericalError
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import find_periodic_state, simulate
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from plant_builders import sum_of_modes


def steady_outputs(modal, T, delay_s, u):
    """Each mode is a' = lambda a + psi u(t - delay), q = Im a / w_d: held pieces, summed over all periods."""
    y, samples = np.zeros((len(u), len(modal.phi))), np.arange(len(u))
    since = np.mod((samples[:, None] - samples) * T - delay_s, len(u) * T)  # a piece began; [sample, piece]
    for w, z, psi, phi in zip(modal.omega, modal.zeta, modal.psi, modal.phi.T, strict=True):
        pole = w * (-z + 1j * np.sqrt(1.0 - z**2))
        now = np.expm1(pole * np.minimum(since, T)) / pole
        gone = np.expm1(pole * T) / pole / -np.expm1(pole * len(u) * T)
        before = gone * np.exp(pole * np.where(since < T, since - T + len(u) * T, since - T))
        a = np.where(since < T, now + before, before) @ (u @ psi)
        y += np.outer(np.imag(a) / pole.imag, phi)
    return y


def test_it_is_the_closed_form_in_any_units(campaign):
    for seed in campaign(600):
        rng = np.random.default_rng(seed)
        T, n, m = 10.0 ** rng.uniform(-6, 2), int(rng.integers(1, 5)), int(rng.integers(1, 3))
        phi = rng.standard_normal((2, n))
        modal = sum_of_modes(
            10.0 ** rng.uniform(-2, 0.3, n) / T,
            rng.uniform(0.002, 0.3, n),
            rng.standard_normal((n, m)) * 10.0 ** rng.uniform(-10, 10),
            phi,
        )
        delay_s, u = (
            T * rng.choice([0.0, 0.3, 1.0, 3.6]),
            rng.standard_normal((int(10 ** rng.uniform(0, 2.6)), m)),
        )
        s = sample_dynamics(modal, T, delay_s)
        unit = 10.0 ** rng.uniform(-6, 6, len(s.A))
        s = SampledStateSpace(s.A * unit / unit[:, None], s.B / unit[:, None], s.C * unit, s.D, period_s=T)
        y, exact = simulate(s, u, find_periodic_state(s, u))[0], steady_outputs(modal, T, delay_s, u)
        # Rounding of A beside 1 - cos wT, 5e-5 at the slowest, and of a mode that keeps 0.99999 in a period.
        assert np.abs(y - exact).max() < 1e-8 * np.abs(exact).max(), seed


@pytest.mark.parametrize("inertia", [1e-6, 1.0, 1e5, 1e10])
def test_a_driven_body_of_any_inertia_has_none(inertia):
    body = Plant(
        dynamics=StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0 / inertia]], [[1.0, 0.0]], [[0.0]]),
        inputs=(Port("u", "N m"),),
        outputs=(Port("y", "rad"),),
    )
    rig = build_rig(body, sample_hz=1000.0, delay_s=0.003)
    u = np.random.default_rng(1).standard_normal((100, 1))
    u -= u.mean()

    def run(u):
        return run_open_loop(rig, u, periods=3, settle=0, rng=np.random.default_rng(0), steady=True)

    with pytest.raises(NumericalError, match="no periodic steady state"):
        run(u + 0.1)
    # Torques that cancel leave it where it was: a rate is found at which it comes back.
    y = run(u).record.y[0]
    np.testing.assert_allclose(y[2], y[0], rtol=0.0, atol=1e-11 * np.ptp(y[0]))
    assert np.ptp(y[0]) > 0.0


def test_nothing_driven_and_nothing_there_is_at_rest():
    still = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], period_s=1.0)
    assert find_periodic_state(still, np.zeros((3, 1))).tolist() == [0.0]
    gain = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[2.0]], period_s=1.0)
    assert find_periodic_state(gain, np.ones((3, 1))).shape == (0,)
