"""Robust designs with frequency-shaped weights, coloured and correlated noise and integral action.

For one model they must return the LQG law of the same shaping, which tests/truth/test_lqg_shaping.py holds
against covariances by hand; for several, what an integral promises on each.
"""

import dataclasses

import numpy as np
import pytest

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.law_form import LawForm, Station
from middeck.control.law.uncertainty import (
    ModeShift,
    Uncertainty,
    corner_positions,
    draw_positions,
    finished_plants,
)
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.designs.popov import design_popov
from middeck.control.robust.designs.sensitivity_weighted import design_sensitivity_weighted
from middeck.errors import ConfigError, NotStabilisableError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes

NAMES = ("low", "high")
WEIGHTS = LQGWeights(
    output=np.array([1.3]),
    input=np.array([0.7]),
    disturbed=("w",),
    process=np.array([[2.0]]),
    sensor=np.array([1e-2]),
)
AUTHORITY = 10.0


def lag(corner, gain=1.0):
    return StateSpace([[-corner]], [[corner]], [[gain]], [[0.0]])


def lead(zero, pole):
    """(s + zero) / (s + pole)."""
    return StateSpace([[-pole]], [[1.0]], [[zero - pole]], [[1.0]])


FILTERS = Shaping(
    outputs=(("z", lead(8.0, 0.8)),), inputs=(("u", lead(2.0, 40.0)),), colours=(("w", lag(0.5, 3.0)),),
    cross=np.array([[0.02]]),
)  # fmt: skip
INTEGRAL = Shaping(integral=(("y", 0.5),))
ALL = dataclasses.replace(FILTERS, integral=INTEGRAL.integral)


def oscillator():
    """Two modes between (w, u) and (z, y), not collocated."""
    phi, psi = np.array([[1.0, 0.4], [0.8, -1.0]]), np.array([[1.0, 0.7], [0.5, -1.0]])
    modal = sum_of_modes(np.array([1.0, 3.0]), 0.01, psi, phi, names=NAMES)
    ports = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    return Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("w",), u=("u",), z=("z",), y=("y",))


def box(width):
    return Uncertainty(shifts=tuple(ModeShift((name,), width) for name in NAMES))


LOW = Uncertainty(shifts=(ModeShift(("low",), 0.01),))


@pytest.mark.parametrize("shaping", [FILTERS, INTEGRAL, ALL])
def test_cost_of_a_shaped_lqg_law_is_that_of_lqg_and_stationary(shaping):
    plant = oscillator()
    lqg = design_lqg(plant, WEIGHTS, AUTHORITY, shaping=shaping)
    law = Law(lqg.system.A, lqg.system.B, lqg.system.C)
    found = evaluate_cost(generalize(plant, WEIGHTS, AUTHORITY, shaping=shaping), law)
    # Riccati and Lyapunov solutions of some twelve states agree to rounding with some digits lost.
    assert found.cost == pytest.approx(lqg.cost, rel=1e-9)
    n = len(law.A) - len(shaping.integral)
    for gradient in (found.A[:n], found.B[:n], found.C):  # rows of integrals are no one's to choose
        assert np.abs(gradient).max() < 1e-7 * found.cost


@pytest.mark.parametrize("shaping", [FILTERS, INTEGRAL, ALL])
def test_gradient_is_that_of_finite_differences(shaping):
    model = generalize(oscillator(), WEIGHTS, AUTHORITY, shaping=shaping)
    weak = design_lqg(oscillator(), WEIGHTS, 1.0, shaping=shaping).system
    law = Law(weak.A, weak.B, weak.C)
    found, rng = evaluate_cost(model, law), np.random.default_rng(0)
    for name in "ABC":
        matrix = getattr(law, name)
        way = rng.standard_normal(matrix.shape)
        if name != "C":
            way[len(matrix) - len(shaping.integral) :] = 0.0
        ends = [
            evaluate_cost(model, dataclasses.replace(law, **{name: matrix + h * way})).cost
            for h in (1e-6, -1e-6)
        ]
        # Central differences: 1e-12 of truncation times a steep cost, 1e-10 of rounding.
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(np.sum(way * getattr(found, name)), rel=1e-5)


@pytest.mark.parametrize("shaping", [FILTERS, INTEGRAL, ALL])
def test_one_model_at_full_order_returns_the_lqg_cost(shaping):
    plant = oscillator()
    lqg = design_lqg(plant, WEIGHTS, AUTHORITY, shaping=shaping)
    law = design_multimodel(plant, WEIGHTS, AUTHORITY, uncertainty=(), shaping=shaping)
    assert law.cost == pytest.approx(lqg.cost, rel=1e-4)  # the level
    assert law.order == len(lqg.system.A) - len(shaping.integral)
    # From a law of a third of the authority, that costs up to half as much again, the descent ends where it
    # makes no use of some states: as without shaping (test_multimodel.py).
    weak = design_lqg(plant, WEIGHTS, AUTHORITY / 3.0, shaping=shaping)
    law = design_multimodel(
        plant, WEIGHTS, AUTHORITY, uncertainty=(), shaping=shaping, start=weak, tolerance=1e-5
    )
    assert law.cost == pytest.approx(lqg.cost, rel=2e-3)
    assert law.cost > lqg.cost * (1.0 - 1e-10)  # nothing is below the minimum


def test_a_small_box_is_one_model():
    plant, tiny = oscillator(), box(1e-6)
    lqg = design_lqg(plant, WEIGHTS, AUTHORITY, shaping=ALL)
    popov = design_popov(plant, WEIGHTS, AUTHORITY, uncertainty=tiny, shaping=ALL, tolerance=1e-5)
    assert popov.cost == pytest.approx(lqg.cost, rel=1e-4)
    weighted = design_sensitivity_weighted(
        plant, WEIGHTS, AUTHORITY, uncertainty=tiny, shaping=ALL, strength=0.0
    )
    assert weighted.cost == pytest.approx(lqg.cost, rel=1e-9)
    assert weighted.costs[0] == pytest.approx(lqg.cost, rel=1e-9)


@pytest.fixture(scope="module")
def bounded():
    """At a lower authority and for one mode, which leaves the bound more room and takes less time."""
    return design_popov(oscillator(), WEIGHTS, 1.0, uncertainty=LOW, shaping=ALL, tolerance=1e-3)


@pytest.fixture(scope="module")
def integral_designs(bounded):
    wide, given = box(0.01), (oscillator(), WEIGHTS, AUTHORITY)
    return (
        design_multimodel(*given, uncertainty=wide, shaping=ALL, tolerance=1e-5),
        design_multimodel(*given, uncertainty=wide, shaping=INTEGRAL, tolerance=1e-5, form=LawForm(3)),
        design_sensitivity_weighted(*given, uncertainty=wide, shaping=ALL),
        bounded,
    )


def test_integral_action_leaves_no_error_at_rest_on_any_model(integral_designs):
    plant = oscillator()
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for law in integral_designs:
        assert not law.system.A[-1].any()  # the pole at zero is exact
        assert law.system.B[-1].tolist() == [1.0]
        assert len(law.system.A) == law.order + 1
        known = positions[:3] if law is integral_designs[-1] else positions  # bounded in LOW alone
        for each in finished_plants(plant, box(0.01), known):
            loop = close_loop(dataclasses.replace(each, z=("y",)), law)
            assert loop.stable
            rest = loop.system.C @ np.linalg.solve(-loop.system.A, loop.system.B) + loop.system.D
            free = np.abs(each.system.C[1] @ np.linalg.solve(-each.system.A, each.system.B[:, 0]))
            # Rounding of a solution with some twelve states.
            assert np.abs(rest).max() < 1e-11 * free


def test_a_shaped_bound_holds_in_its_box(bounded):
    system, rng = bounded.system, np.random.default_rng(2)
    closed = Law(system.A, system.B, system.C)
    places = np.vstack([draw_positions(LOW, 30, rng), corner_positions(LOW)])
    costs = [
        evaluate_cost(generalize(plant, WEIGHTS, 1.0, shaping=ALL), closed).cost
        for plant in finished_plants(oscillator(), LOW, places)
    ]
    assert max(costs) <= bounded.cost < 1.2 * max(costs)  # and the bound is not far above


def test_what_makes_no_sense_is_refused():
    def design(shaping=INTEGRAL, **more):
        return design_multimodel(oscillator(), WEIGHTS, AUTHORITY, uncertainty=(), shaping=shaping, **more)

    with pytest.raises(ConfigError, match="cannot be combined with stations or fixed filters"):
        design(form=LawForm(stations=(Station(("y",), ("u",), 4),)))
    plain = design_lqg(oscillator(), WEIGHTS, AUTHORITY)
    with pytest.raises(ConfigError, match="not the required integrals"):
        design(start=plain, form=LawForm(3))
    with pytest.raises(ConfigError, match="no port 'nothing'"):
        design(Shaping(colours=(("nothing", lag(1.0)),)))
    with pytest.raises(ConfigError, match="no port 'z'"):
        design(Shaping(integral=(("z", 1.0),)))  # not measured
    # A law cannot hold the integral of what no command moves at rest.
    rigid = oscillator()
    rate = np.array([[1.0, 0.4], [0.0, 0.0]]), np.array([[0.0, 0.0], [0.8, -1.0]])
    modal = dataclasses.replace(rigid.dynamics, phi=rate[0], phi_rate=rate[1])
    with pytest.raises(NotStabilisableError) as error:
        design_multimodel(
            dataclasses.replace(rigid, dynamics=modal), WEIGHTS, AUTHORITY, uncertainty=(), shaping=INTEGRAL
        )
    assert "integral of y" in error.value.data["modes"]
