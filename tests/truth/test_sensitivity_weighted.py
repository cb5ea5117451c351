"""Sensitivity-weighted LQG: what it is without a weight, what it weighs, and what it buys."""

import numpy as np
import pytest
from multimodel_reference import APART, AUTHORITY, NAMES, TOGETHER, WEIGHTS, grid, reference_plant

from middeck.control.h2.generalized_plant import generalize
from middeck.control.law.uncertainty import ModeShift, Uncertainty, without_delays
from middeck.control.lqg.design import design_lqg
from middeck.control.robust.designs.sensitivity_weighted import (
    _changes,
    _weighted,
    design_sensitivity_weighted,
)
from middeck.control.robust.problem.directions import stiffness_directions
from middeck.control.robust.verification.monte_carlo import outcomes_on, verify_robustness
from middeck.errors import ConfigError, NumericalError
from middeck.systems.plants.mode_shift import shift_modes


def reference_model(plant=None):
    return generalize(without_delays(plant or reference_plant()), WEIGHTS, AUTHORITY)


def test_without_strength_it_is_lqg():
    plant = reference_plant()
    lqg = design_lqg(without_delays(plant), WEIGHTS, AUTHORITY)
    law = design_sensitivity_weighted(plant, WEIGHTS, AUTHORITY, uncertainty=TOGETHER, strength=0.0)
    assert law.cost == pytest.approx(lqg.cost, rel=1e-12)
    assert law.costs[0] == pytest.approx(lqg.cost, rel=1e-10)
    assert law.costs[-1] == np.inf  # unstable at +2 %: an outcome


def test_directions_move_a_frequency_by_its_stiffness():
    plant = reference_plant()
    nominal = without_delays(plant)
    found = stiffness_directions(plant, nominal, APART)
    np.testing.assert_array_equal(found.out @ found.into, np.zeros((2, 2)))
    np.testing.assert_allclose(found.high, np.full(2, 1.02**2 - 1.0))
    A = nominal.system.A
    for i, name in enumerate(NAMES[3:]):
        moved = A + found.high[i] * np.outer(found.into[:, i], found.out[i])
        sizes = np.sort(np.abs(np.linalg.eigvals(moved)))
        shifted = without_delays(shift_modes(plant, {name: 1.02}))
        np.testing.assert_allclose(sizes, np.sort(np.abs(np.linalg.eigvals(shifted.system.A))), rtol=1e-10)


def test_added_outputs_are_static_sensitivities():
    """At frequency zero the quasi-static sensitivity is the sensitivity: of z to the disturbance, twice."""
    plant, model = reference_plant(), reference_model()
    directions = stiffness_directions(plant, without_delays(plant), TOGETHER)
    worse = _weighted(model, directions, 1.0)
    response = np.linalg.solve(model.A, model.B1)
    added = -worse.C1[len(model.C1) :] @ response
    change = _changes(directions, len(model.A))[0]
    h = 1e-5
    moved = [-model.C1 @ np.linalg.solve(model.A + s * h * change, model.B1) for s in (1.0, -1.0)]
    # Central differences at h = 1e-5: 1e-10 of truncation, 1e-11 of rounding.
    slope = (moved[0] - moved[1]) / (2.0 * h)
    np.testing.assert_allclose(-added, slope, atol=1e-8 * np.abs(slope).max())
    # And dually for the noise inputs.
    noises = -model.C1 @ np.linalg.solve(model.A, worse.B1[:, model.B1.shape[1] :])
    np.testing.assert_allclose(-noises, slope, atol=1e-8 * np.abs(slope).max())


def test_it_holds_what_lqg_does_not():
    plant = reference_plant()
    lqg = design_lqg(without_delays(plant), WEIGHTS, AUTHORITY)
    law = design_sensitivity_weighted(plant, WEIGHTS, AUTHORITY, uncertainty=TOGETHER)
    assert law.order == len(law.system.A) == 13
    assert np.isfinite(law.costs).all()
    assert law.strength > 0.0
    found = [
        verify_robustness(plant, k, WEIGHTS, uncertainty=APART, positions=np.vstack([np.zeros(2), grid()]))
        for k in (lqg, law)
    ]
    assert not found[0].outcomes[0].stable.all()
    assert found[1].outcomes[0].stable.all()
    assert found[1].outcomes[0].db[0] < found[0].outcomes[0].db[0] + 0.2
    # The strength is the best of those tried, by the mean of the plain costs.
    assert law.costs.mean() == pytest.approx(min(stage.cost for stage in law.history))


def test_a_plant_that_lqg_holds_needs_no_strength():
    small = Uncertainty(shifts=(ModeShift(NAMES[3:], 1e-6),))
    law = design_sensitivity_weighted(reference_plant(), WEIGHTS, AUTHORITY, uncertainty=small)
    lqg = design_lqg(without_delays(reference_plant()), WEIGHTS, AUTHORITY)
    assert law.costs[0] == pytest.approx(lqg.cost, rel=1e-6)
    assert outcomes_on([reference_plant()], law, WEIGHTS)[0].stable[0]


def test_bad_input_is_named():
    def design(box, **more):
        return design_sensitivity_weighted(reference_plant(), WEIGHTS, AUTHORITY, uncertainty=box, **more)

    with pytest.raises(ConfigError, match="no mode is uncertain"):
        design(Uncertainty(shifts=()))
    with pytest.raises(ConfigError, match="strength = -1"):
        design(TOGETHER, strength=-1.0)
    with pytest.raises(NumericalError, match="at no strength"):
        design_sensitivity_weighted(
            reference_plant(), WEIGHTS, 1e8, uncertainty=Uncertainty(shifts=(ModeShift(NAMES, 0.5),))
        )
