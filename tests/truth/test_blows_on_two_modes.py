"""Two modes that a fit of blows takes for one are told, as those of any other record."""

import numpy as np
import pytest
from exact_blows import exact_blows

from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.identification.model.measurement_model import natural_hz

RATE = 250.0


@pytest.mark.parametrize("apart", [0.005, 0.0])
def test_one_mode_in_the_place_of_two_is_reported(apart: float):
    """It was tens of deviations off in silence, as noise of the force may leave a residual at a peak, too."""
    hz, zeta = (
        12.0 * np.array([1.0 - 0.5 * apart, 1.0 + 0.5 * apart]),
        np.array([0.006 - 0.2 * apart, 0.006 + 0.4 * apart]),
    )
    blows = [[(0.3, 0.1, 50.0)], [(0.3013, 0.102, 60.0)]]
    phi = np.array([[1.0, 0.7]]) * (2.0 * np.pi * hz) ** 2
    fit = fit_impact(average_blows(exact_blows((hz, zeta, phi), blows, 700, RATE, noise=3e-4)), states=2)
    off = np.abs(natural_hz(fit.model)[0] - hz) / fit.uncertainty.natural_hz[0]
    assert any("two" in text for text in fit.warnings) == (apart > 0.0)
    assert (off.max() > 4.0) == (apart > 0.0)
