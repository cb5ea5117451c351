"""A hammer's force in kilonewtons, newtons or volts tells the same of the article, and as surely."""

import dataclasses

import numpy as np
import pytest
from exact_blows import deviations_off, exact_blows

from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact
from middeck.signals.record import Record

HZ, ZETA = np.array([9.0, 17.0]), np.array([0.03, 0.02])


def struck(unit: float) -> Record:
    """Four blows that decay within their blocks; the force is recorded in ``unit`` a newton."""
    phi = np.array([[1.0, -0.7], [0.6, 0.8]]) * (2.0 * np.pi * HZ) ** 2
    blows = [[(0.4 + 4.0 * k, 0.06, 50.0 + 5.0 * k) for k in range(4)]]
    record = exact_blows((HZ, ZETA, phi), blows, 3280, 200.0, noise=1e-3, seed=3)
    return dataclasses.replace(record, u=unit * record.u)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_variance_of_a_response_goes_with_the_unit_of_the_force(unit: float) -> None:
    """Of the level at rest, 1e6 times too much counted in kilonewtons, and nothing in millinewtons."""
    one, other = (average_blows(struck(u)).response for u in (1.0, unit))
    assert one.variance is not None
    assert other.variance is not None
    np.testing.assert_allclose(other.H, one.H / unit, rtol=1e-9)
    np.testing.assert_allclose(other.variance, one.variance / unit**2, rtol=1e-7)


def test_modes_are_known_as_well_from_a_force_in_kilonewtons() -> None:
    """Deviations were 30 to 50 times those of the same force in newtons."""
    one, other = (fit_impact(average_blows(struck(u)), of="response", states=4) for u in (1.0, 1e-3))
    assert other.uncertainty.natural_hz == pytest.approx(one.uncertainty.natural_hz, rel=1e-3)
    assert other.standing == one.standing
    assert np.abs(deviations_off(other, HZ, ZETA)).max() < 4.0
