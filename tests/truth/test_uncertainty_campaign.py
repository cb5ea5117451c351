"""95 % intervals and bounds of the simulated gimbal over noise seeds: do they cover as they say?"""

import gimbal_fits
import gimbal_record
import numpy as np
import pytest
import scipy.stats

from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.identification.uncertainty.response_bounds import response_bounds, simultaneous_bounds

# Peaks, zeros and what lies between, over the band that is scored.
SOME_HZ = np.geomspace(0.3, 30.0, 100)


def truth(names, order, outputs):
    """The true value of each parameter; ``order`` holds the fit's modes in rising frequency."""
    rank = np.argsort(order)
    values = {f"delay_s[{gimbal_record.OUTPUTS[o].name}]": gimbal_record.DELAY_S[o] for o in range(outputs)}
    for m, k in enumerate(rank):
        values[f"natural_hz[{m}]"] = gimbal_record.MODES_HZ[k]
        values[f"damping[{m}]"] = gimbal_record.ZETA
        for o in range(outputs):
            name = f"constant[{m}, {gimbal_record.OUTPUTS[o].name}, gimbal]"
            values[name] = gimbal_record.PHI[o, k] * gimbal_record.PSI[0, k]
    return np.array([values[n] for n in names])


def assert_covers(inside):
    """Shares of 0.90 to 0.99 in each column: that itself on a whole campaign, not to be ruled out on less."""
    hits, runs = np.sum(inside, axis=0), len(inside)
    if runs >= 100:
        assert np.all((hits >= 0.90 * runs) & (hits <= 0.99 * runs)), hits / runs
        return
    # Of some thirty columns one is so low by a chance of 3e-3 if each covers no more than 0.90.
    assert np.all(scipy.stats.binom.cdf(hits, runs, 0.90) > 1e-4), hits / runs
    # All columns together: nor are they so high if each covers no less than 0.99.
    assert scipy.stats.binom.sf(np.sum(hits) - 1, np.size(inside), 0.99) > 1e-3, np.mean(inside)


@pytest.mark.parametrize(("outputs", "whole"), [(1, 200), (2, 100)])
def test_intervals_and_bounds_cover_the_truth(campaign, outputs, whole):
    inside, ellipse, magnitude, phase, together = [], [], [], [], []
    H = gimbal_record.response(SOME_HZ, outputs)
    for seed in campaign(whole, share=whole // 5):  # of five, all missed is still ruled out
        fit = gimbal_fits.fit(seed, outputs)
        assert not fit.covariance.robust
        parameters = parameters_of(fit.covariance)
        true = truth(parameters.names, np.argsort(natural_hz(fit.model)), outputs)
        low, high = parameters.interval(0.95)
        inside.append((low <= true) & (high >= true))
        bounds = response_bounds(fit.covariance, SOME_HZ)
        ellipse.append(np.mean(holds(bounds, H)))
        magnitude.append(np.mean((bounds.magnitude_low <= np.abs(H)) & (np.abs(H) <= bounds.magnitude_high)))
        phase.append(np.mean(np.abs(np.angle(H / bounds.H)) <= bounds.phase_error))
        everywhere = simultaneous_bounds(fit.covariance, SOME_HZ, np.random.default_rng(seed))
        together.append(np.all(holds(everywhere, H)))
        assert np.all(np.abs(everywhere.axes) > np.abs(bounds.axes))
    assert_covers(inside)
    # Lines of one fit go together: some ten independent values in each of the runs.
    for shares in (ellipse, magnitude, phase):
        assert 0.90 - 0.6 / np.sqrt(10.0 * len(shares)) < np.mean(shares) < 0.995
    assert scipy.stats.binom.cdf(np.sum(together), len(together), 0.95) > 1e-3


def holds(bounds, H):
    """Whether H lies in each ellipse."""
    off = (H - bounds.H)[..., None]
    return np.sum((np.real(off * bounds.axes.conj()) / np.abs(bounds.axes) ** 2) ** 2, axis=-1) <= 1.0
