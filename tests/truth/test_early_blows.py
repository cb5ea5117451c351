"""A blow that comes as a record begins takes no lead from the others."""

import numpy as np
import pytest
from exact_blows import deviations_off, exact_blows

from middeck.identification.impact.averaged_blows import average_blows
from middeck.identification.impact.fit_of_blows import fit_impact

RATE, HZ, ZETA = 200.0, np.array([6.0, 14.0]), np.array([0.03, 0.02])
MODES = HZ, ZETA, np.array([[1.0, -0.7]]) * (2.0 * np.pi * HZ) ** 2


@pytest.mark.parametrize(("count", "together"), [(2, False), (3, True)])
def test_a_blow_as_the_record_begins_is_left_out_and_said_once(count: int, *, together: bool):
    """The leads of all blows were the shortest one, none: five warnings, and residues of no use."""
    each = [(0.3 + 1.503 * k, 0.06, 50.0 + 7.0 * k) for k in range(count)]
    each[0] = (0.004, *each[0][1:])
    blows = [each] if together else [[(0.3 if k else 0.004, *blow[1:])] for k, blow in enumerate(each)]
    record = exact_blows(MODES, blows, int(RATE * (1.6 * count if together else 1.6)), RATE)
    test = average_blows(record)
    assert test.led == tuple(range(1, count))
    assert test.before.shape == (count - 1, test.blocks.u.shape[2] // 4, 1)
    assert len(test.blocks.u) == count
    assert [text.split(":")[0] for text in test.warnings] == [
        "struck too soon to tell their response from free motion before it"
    ]
    fit = fit_impact(test, states=4)
    assert fit.warnings == ()
    assert np.abs(deviations_off(fit, HZ, ZETA)).max() < 4.0
