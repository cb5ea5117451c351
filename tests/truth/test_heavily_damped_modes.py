"""Responses that a heavily damped mode rules, as a loop about an article makes one: fitted, not refused."""

import numpy as np
import pytest
from struck_plant import FORCE, TIP, response

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.systems.plants.response import FrequencyResponse
from repeats import repeats


# The heavy mode was no start; without it the phase asked for an output that leads by seconds: refused.
@pytest.mark.parametrize("states", repeats([6, None]))
def test_a_response_that_a_heavily_damped_mode_rules_is_fitted(states, campaign):
    for seed in campaign(20):
        rng = np.random.default_rng([441, seed])
        hz = np.array([rng.uniform(0.15, 0.3), rng.uniform(1.0, 2.0), rng.uniform(5.0, 9.0)])
        zeta = np.array([rng.uniform(0.5, 0.7), *rng.uniform(0.005, 0.03, 2)])
        phi, delay_s = np.array([1.0, *rng.uniform(0.1, 0.5, 2)]), 0.01
        f = np.arange(0.1, 20.0, 0.02)
        H = response(hz, zeta, phi, delay_s, 2j * np.pi * f)
        noise = 1e-3 * np.abs(H) + 1e-6
        e = noise * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / np.sqrt(2.0)
        variance = noise**2 * rng.gamma(6.0, 1.0 / 6.0, len(f))
        measured = FrequencyResponse(
            frequency_hz=f,
            H=(H + e)[:, None, None],
            inputs=(FORCE,),
            outputs=(TIP,),
            variance=variance[:, None, None],
            hold_s=0.0,
        )
        fit = fit_response(measured, states=states)
        found, of = natural_hz(fit.model), fit.uncertainty
        at = [int(np.argmin(np.abs(found - own))) for own in hz]
        z = [
            *((found[at] - hz) / of.natural_hz[at]),
            *((damping_ratio(fit.model)[at] - zeta) / of.damping[at]),
            *((fit.model.delay_s - delay_s) / of.delay_s),
        ]
        assert np.abs(z).max() < 4.5
