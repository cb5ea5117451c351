"""Popov/H2: the gradient of the bound, that it bounds, that it is H2 for small boxes, what it guarantees."""

import dataclasses

import numpy as np
import pytest
from multimodel_reference import APART, AUTHORITY, NAMES, TOGETHER, WEIGHTS, grid, reference_plant

from middeck.control.lqg import design_lqg
from middeck.control.robust import (
    ModeShift,
    Uncertainty,
    design_multimodel,
    design_popov,
    verify_robustness,
    without_delays,
)
from middeck.control.robust.closed_cost import Law, evaluate_cost
from middeck.control.robust.design_model import build_model
from middeck.control.robust.directions import stiffness_directions
from middeck.control.robust.popov_bound import Multipliers, evaluate_bound, first_multipliers
from middeck.errors import ConfigError, NumericalError


def law_of(compensator):
    return Law(compensator.system.A, compensator.system.B, compensator.system.C)


@pytest.fixture(scope="module")
def posed():
    """A model, a law that stabilises it with something to spare, the directions and fitting multipliers."""
    plant = reference_plant()
    model = build_model(without_delays(plant), WEIGHTS, AUTHORITY)
    law = law_of(design_multimodel(plant, WEIGHTS, AUTHORITY, uncertainty=TOGETHER, tolerance=1e-6))
    small = Uncertainty((ModeShift(NAMES[3:4], 0.002), ModeShift(NAMES[4:], 0.002)))
    directions = stiffness_directions(plant, without_delays(plant), small)
    return model, law, directions, first_multipliers(model, law, directions)


def test_gradient_is_that_of_finite_differences(posed):
    model, law, directions, multipliers = posed
    found = evaluate_bound(model, law, directions, multipliers)
    rng = np.random.default_rng(3)

    def slope(make, h):
        return (make(h) - make(-h)) / (2.0 * h)

    for name in "ABC":
        matrix = getattr(law, name)
        way = rng.standard_normal(matrix.shape) * np.abs(matrix)

        def bound(h, name=name, matrix=matrix, way=way):
            moved = dataclasses.replace(law, **{name: matrix + h * way})
            return evaluate_bound(model, moved, directions, multipliers).law.cost

        # The bound is steep at LQG-like laws: 1e-8 leaves 1e-5 of curvature, and 1e-8 of rounding.
        assert slope(bound, 1e-8) == pytest.approx(np.sum(way * getattr(found.law, name)), rel=1e-3)
    for name, gradient in (("H", found.log_H), ("N", found.log_N)):
        for i in range(2):

            def bound(h, name=name, i=i):
                scaled = getattr(multipliers, name) * np.exp(h * np.eye(2)[i])
                moved = dataclasses.replace(multipliers, **{name: scaled})
                return evaluate_bound(model, law, directions, moved).law.cost

            # Central differences at 1e-4: 1e-8 of truncation, 1e-12/1e-4 of rounding in the cost.
            assert slope(bound, 1e-4) == pytest.approx(gradient[i], rel=1e-3, abs=1e-9)


def test_it_bounds_every_cost_of_the_box_whatever_the_multipliers(posed):
    model, law, directions, multipliers = posed
    rng, checked = np.random.default_rng(0), 0
    for _ in range(20):
        other = Multipliers(
            multipliers.H * np.exp(rng.uniform(-1.0, 1.0, 2)),
            multipliers.N * np.exp(rng.uniform(-1.0, 1.0, 2)),
        )
        bound = evaluate_bound(model, law, directions, other).law.cost
        for share in rng.uniform(0.0, 1.0, (10, 2)):
            delta = directions.low + share * (directions.high - directions.low)
            A = model.A + directions.into @ (delta[:, None] * directions.out)
            assert evaluate_cost(dataclasses.replace(model, A=A), law).cost <= bound
        checked += np.isfinite(bound)
    assert checked > 5  # an infinite bound says nothing


def test_bound_of_a_small_box_is_the_cost(posed):
    model, law, directions, _ = posed
    cost = evaluate_cost(model, law).cost
    above = []
    for size in (1e-3, 1e-4):
        small = dataclasses.replace(directions, low=size * directions.low, high=size * directions.high)
        multipliers = first_multipliers(model, law, small)
        above.append(evaluate_bound(model, law, small, multipliers).law.cost / cost - 1.0)
    assert 0.0 < above[1] < above[0] < 1e-3
    assert above[0] / above[1] == pytest.approx(10.0, rel=0.05)  # proportional to the size


@pytest.fixture(scope="module")
def design():
    return design_popov(reference_plant(), WEIGHTS, AUTHORITY, uncertainty=APART, tolerance=1e-5)


def test_the_design_holds_the_box_at_a_cost_below_its_bound(design):
    plant = reference_plant()
    model = build_model(without_delays(plant), WEIGHTS, AUTHORITY)
    law, rng = law_of(design), np.random.default_rng(5)
    worst = 0.0
    for share in np.vstack([rng.uniform(0.0, 1.0, (100, 2)), [[0, 0], [0, 1], [1, 0], [1, 1]]]):
        delta = design.directions.low + share * (design.directions.high - design.directions.low)
        A = model.A + design.directions.into @ (delta[:, None] * design.directions.out)
        worst = max(worst, evaluate_cost(dataclasses.replace(model, A=A), law).cost)
    assert worst <= design.cost < 1.05 * worst  # and the bound is not far above
    places = np.vstack([np.zeros(2), grid()])
    found = verify_robustness(plant, design, WEIGHTS, uncertainty=APART, positions=places).outcomes[0]
    lqg = design_lqg(without_delays(plant), WEIGHTS, AUTHORITY)
    nominal = verify_robustness(plant, lqg, WEIGHTS, uncertainty=APART, positions=places[:1]).outcomes[0]
    assert found.stable.all()
    assert found.db[0] < nominal.db[0] + 0.2
    assert np.all(design.costs <= design.cost)
    assert design.order == 13


def test_the_bound_was_minimised(design):
    plant = reference_plant()
    model = build_model(without_delays(plant), WEIGHTS, AUTHORITY)
    law, multipliers = law_of(design), design.multipliers
    assert evaluate_bound(model, law, design.directions, multipliers).law.cost == pytest.approx(design.cost)
    for factor in (0.8, 1.25):
        for name in "HN":
            other = dataclasses.replace(multipliers, **{name: factor * getattr(multipliers, name)})
            assert evaluate_bound(model, law, design.directions, other).law.cost > design.cost
    descents = [stage.cost for stage in design.history[-2:]]
    assert descents[1] <= descents[0]


def test_bad_input_is_named():
    def popov(box, authority=AUTHORITY):
        return design_popov(reference_plant(), WEIGHTS, authority, uncertainty=box)

    with pytest.raises(ConfigError, match="no mode is uncertain"):
        popov(Uncertainty(()))
    with pytest.raises(NumericalError, match="covers the box"):
        popov(Uncertainty((ModeShift(NAMES[3:], 0.6),)))
