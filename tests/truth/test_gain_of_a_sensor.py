"""Sensors whose gain is not the same at all frequencies: no linear model of the article has that."""

import numpy as np
import pytest
from sine_record import RATE, record_of, sines, summed
from struck_plant import response
from test_forces_that_are_not_linear import article

from middeck.identification.record_fit.fit_record import fit_record
from repeats import repeats


# Frequencies, damping ratios and constants (with the gain at their mode) were 4 to 10 of their deviations
# off, 3 of 24 in silence; four of them where the ripple is as large as the noise are told of by no other sum.
@pytest.mark.parametrize(("ripple", "noise"), repeats([(3e-3, 1e-3), (3e-3, 1e-4), (3e-2, 1e-2)]))
def test_ripple_of_a_sensor_s_gain_is_reported(ripple, noise, campaign):
    for seed in campaign(24):
        rng = np.random.default_rng([431, seed])
        plant = article(rng)
        t = np.arange(3000) / RATE
        hz, a = sines(rng, (0.5, 40.0), 1500)
        gain = 1.0 + ripple * np.cos(2.0 * np.pi * hz / rng.uniform(4.0, 20.0) + rng.uniform(0.0, 6.0))
        y = summed(hz, a * gain * response(*plant, 2j * np.pi * hz), t)
        y = y + noise * y.std() * rng.standard_normal(len(t))
        fit = fit_record(record_of(summed(hz, a, t), y), states=2 * len(plant[0]))
        assert any("correlated with the inputs" in line for line in fit.warnings)
