"""Popov/H2: the gradient of the bound, that it bounds, that it is H2 for small boxes, what it guarantees."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from multimodel_reference import APART, AUTHORITY, NAMES, TOGETHER, WEIGHTS, grid, reference_plant

from middeck.control.h2.closed_cost import Law, closed_matrices, evaluate_cost
from middeck.control.h2.generalized_plant import generalize
from middeck.control.law.uncertainty import (
    ModeShift,
    Uncertainty,
    corner_positions,
    draw_positions,
    finished_plants,
    without_delays,
)
from middeck.control.lqg.design import design_lqg
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.designs.popov import design_popov
from middeck.control.robust.designs.popov_bound import Multipliers, evaluate_bound, first_multipliers
from middeck.control.robust.problem.directions import shift_directions
from middeck.control.robust.verification.monte_carlo import verify_robustness
from middeck.errors import ConfigError, NumericalError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import name_states
from middeck.systems.state_space.modal_system import ModalSystem
from plant_builders import grouped_plant, unit_weights
from repeats import repeats


def law_of(compensator):
    return Law(compensator.system.A, compensator.system.B, compensator.system.C)


@pytest.fixture(scope="module")
def posed():
    """A model, a law that stabilises it with something to spare, the directions and fitting multipliers."""
    plant = reference_plant()
    model = generalize(without_delays(plant), WEIGHTS, AUTHORITY)
    law = law_of(design_multimodel(plant, WEIGHTS, AUTHORITY, uncertainty=TOGETHER, tolerance=1e-6))
    small = Uncertainty(shifts=(ModeShift(NAMES[3:4], 0.002), ModeShift(NAMES[4:], 0.002)))
    directions = shift_directions(plant, without_delays(plant), small)
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
        for i in range(4):

            def bound(h, name=name, i=i):
                scaled = getattr(multipliers, name) * np.exp(h * np.eye(4)[i])
                moved = dataclasses.replace(multipliers, **{name: scaled})
                return evaluate_bound(model, law, directions, moved).law.cost

            # Central differences at 1e-4: 1e-8 of truncation, 1e-12/1e-4 of rounding in the cost.
            assert slope(bound, 1e-4) == pytest.approx(gradient[i], rel=1e-3, abs=1e-9)


def test_it_bounds_every_cost_of_the_box_whatever_the_multipliers(posed):
    model, law, directions, multipliers = posed
    rng, checked = np.random.default_rng(0), 0
    for _ in range(20):
        other = Multipliers(
            multipliers.H * np.exp(rng.uniform(-1.0, 1.0, 4)),
            multipliers.N * np.exp(rng.uniform(-1.0, 1.0, 4)),
        )
        bound = evaluate_bound(model, law, directions, other).law.cost
        for share in rng.uniform(0.0, 1.0, (10, 4)):
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
    return design_popov(reference_plant(), WEIGHTS, AUTHORITY, uncertainty=APART, tolerance=1e-3)


def costs_in(box, plant, weights, authority, design, rng):
    """Of 200 plants of the box and its corners, by SciPy's Lyapunov solver."""
    places = np.vstack([draw_positions(box, 200, rng), corner_positions(box)])
    found = []
    for each in finished_plants(plant, box, places):
        A, B, C = closed_matrices(generalize(without_delays(each), weights, authority), law_of(design))
        assert np.linalg.eigvals(A).real.max() < 0.0
        found.append(np.trace(C @ sla.solve_continuous_lyapunov(A, -B @ B.T) @ C.T))
    return np.array(found)


def test_the_design_holds_the_box_at_a_cost_below_its_bound(design):
    plant = reference_plant()
    worst = costs_in(APART, plant, WEIGHTS, AUTHORITY, design, np.random.default_rng(5)).max()
    assert worst <= design.cost < 1.1 * worst  # and the bound is not far above
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
    model = generalize(without_delays(plant), WEIGHTS, AUTHORITY)
    law, multipliers = law_of(design), design.multipliers
    assert evaluate_bound(model, law, design.directions, multipliers).law.cost == pytest.approx(design.cost)
    for factor in (0.8, 1.25):
        for name in "HN":
            other = dataclasses.replace(multipliers, **{name: factor * getattr(multipliers, name)})
            assert evaluate_bound(model, law, design.directions, other).law.cost > design.cost
    descents = [stage.cost for stage in design.history[-2:]]
    assert descents[1] <= descents[0]


def two_modes(**outputs):
    """Two modes of 2 %, u beside w; what z and y read is given as rows of the modal form."""
    zero = np.zeros((2, 2))
    rows = {"phi": zero, "phi_rate": zero} | {name: np.array(row) for name, row in outputs.items()}
    modal = ModalSystem(omega=[2.3, 9.0], zeta=[0.02, 0.02], psi=[[0.8], [0.3]], names=("b", "c"), **rows)
    return grouped_plant(modal, (Port("u", "N"),), (Port("z", ""), Port("y", "")), z=("z",), y=("y",))


def as_states(plant):
    return dataclasses.replace(plant, dynamics=plant.system, state_names=name_states(plant))


ANGLES = two_modes(phi=[[0.6, 0.2], [0.6, 0.2]])
RATES = two_modes(phi=[[0.6, 0.2], [0.0, 0.0]], phi_rate=[[0.0, 0.0], [0.6, 0.2]])
PLAIN = unit_weights(("u",), 1.0)


@pytest.mark.parametrize(
    ("plant", "width", "authority"),
    repeats([(ANGLES, 0.15, 0.1), (as_states(RATES), 0.02, 0.1), (RATES, 0.05, 1.0)], 2),
)
def test_the_bound_holds_where_control_leaves_the_damping_to_the_plant(plant, width, authority):
    # A shift takes 2 zeta omega along: at the lower end the cost is higher by half its width for that alone.
    box = Uncertainty(shifts=(ModeShift(("b",), width), ModeShift(("c",), width)))
    found = design_popov(plant, PLAIN, authority, uncertainty=box, tolerance=1e-3)
    worst = costs_in(box, plant, PLAIN, authority, found, np.random.default_rng(0)).max()
    # Damping and stiffness are free of each other in the bound, and dampings may vary with time.
    assert worst <= found.cost < 1.1 * worst


def test_an_acceleration_of_an_uncertain_mode_has_no_bound():
    box = Uncertainty(shifts=(ModeShift(("b",), 0.02),))
    for row in ([[0.0, 0.0], [0.6, 0.2]], [[0.6, 0.2], [0.0, 0.0]]):
        other = np.array(row)[::-1]
        plant = two_modes(phi=other, phi_acceleration=row)
        with pytest.raises(ConfigError, match=r"a shift of b changes [yz] by more than stiffness"):
            design_popov(plant, dataclasses.replace(PLAIN, disturbed=("u",)), 1.0, uncertainty=box)
    # Of the mode that is known it may be read.
    known = two_modes(phi=[[0.6, 0.2], [0.6, 0.0]], phi_acceleration=[[0.0, 0.0], [0.0, 0.1]])
    found = design_popov(known, PLAIN, 1.0, uncertainty=box, tolerance=1e-3)
    assert costs_in(box, known, PLAIN, 1.0, found, np.random.default_rng(1)).max() <= found.cost


def test_bad_input_is_named():
    def popov(box, authority=AUTHORITY):
        return design_popov(reference_plant(), WEIGHTS, authority, uncertainty=box)

    with pytest.raises(ConfigError, match="no mode is uncertain"):
        popov(Uncertainty(shifts=()))
    with pytest.raises(NumericalError, match="covers the box"):
        popov(Uncertainty(shifts=(ModeShift(NAMES[3:], 0.6),)))
