"""Blows too short for the rate are folded back: said where that moves what is fitted, and only there."""

import numpy as np
from exact_blows import deviations_off, exact_blows

from middeck.identification.fit.unneeded_modes import mode_significance
from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.record_fit.folded_blows import warnings_on_folding

RATE, HZ, ZETA, PHI = 200.0, np.array([11.0, 23.0]), np.array([0.03, 0.02]), np.array([1.0, -0.7])


def half_sines(samples, kind, noise, *, apart):
    """Three blows in the test, and its fit: errors of gains in deviations, too."""
    rng = np.random.default_rng(1)
    width = samples / RATE
    blows = [[(0.3 + apart * rng.uniform(0.0, 1.0) / RATE, width * (1.0 + 0.02 * k), 50.0)] for k in range(3)]
    modes = HZ, ZETA, PHI[None] * (2.0 * np.pi * HZ) ** (2.0 if kind == "d" else 0.0)
    test = average_blows(exact_blows(modes, blows, 300, RATE, shape="half sine", kind=kind, noise=noise))
    fit = fit_impact(test, states=4)
    order = np.argsort(natural_hz(fit.model))[:2]
    found = np.abs(fit.model.shapes[0, order] * fit.model.participation[order, 0])
    true = np.abs(PHI) * np.pi * HZ / np.sqrt(1.0 - ZETA**2)
    return test, fit, np.abs(found / true - 1.0) * mode_significance(fit.covariance)[order]


def test_blows_that_move_no_gain_by_its_deviations_are_not_warned_of():
    """Of half a per cent at half the rate little lies in the band."""
    test, fit, off = half_sines(14.0, "a", 1e-2, apart=1.0)
    assert any("folded back" in text for text in warnings_on_folding(test.blocks))
    assert fit.warnings == ()
    assert off.max() < 4.0
    assert np.abs(deviations_off(fit, HZ, ZETA)).max() < 4.0


def test_blows_that_move_gains_are_warned_of():
    """Alike in all blows, which come at the same time after a sample."""
    _, fit, off = half_sines(7.0, "a", 1e-3, apart=0.0)
    assert off.max() > 4.0
    assert any("folded back" in text for text in fit.warnings)
