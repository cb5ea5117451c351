"""The descent of robust designs: a saddle on the way to a minimum is no end."""

import numpy as np
import pytest

from middeck.control.robust.search.quasi_newton import descend

CURVATURES = np.geomspace(1.0, 1e8, 40)


def valley(x):
    """1 + sum a x^2 / 2 + (y^2 - 1)^2 / 4: a saddle of value 1.25 at zero, minima of 1 at y = +-1."""
    steep, y = CURVATURES * x[:-1], x[-1]
    return 1.0 + 0.5 * float(steep @ x[:-1]) + 0.25 * (y**2 - 1.0) ** 2, np.append(steep, y**3 - y)


@pytest.mark.parametrize("seed", range(5))
def test_as_many_steps_as_parameters_are_waited_for_at_a_saddle(seed):
    rng = np.random.default_rng(seed)
    begun = np.append(rng.standard_normal(len(CURVATURES)) / np.sqrt(CURVATURES), 1e-4)
    found = descend(valley, begun, tolerance=1e-9, patience=len(begun))
    assert found.value == pytest.approx(1.0, abs=1e-8)
    assert abs(found.x[-1]) == pytest.approx(1.0, abs=1e-3)
