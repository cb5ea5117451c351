"""What holds for every plant: shifts compose, coordinates and units do not matter, more models cost more."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from random_plants import modal_plant

from middeck.control.h2.closed_cost import Law, evaluate_cost, solve_gramian
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.law_form import arrange
from middeck.control.lqg.design import design_lqg
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.search.smooth_maximum import blend
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import unit_weights

WEIGHTS = unit_weights(("a", "b"), np.full(2, 1e-3), outputs=2, inputs=2)


def random_plant(seed, modes=3):
    rng = np.random.default_rng(seed)
    return modal_plant(rng, np.sort(rng.uniform(1.0, 10.0, modes)), 0.02)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), factor=st.floats(0.5, 2.0), damping=st.floats(0.5, 2.0))
def test_a_shift_there_and_back_is_none(seed, factor, damping):
    plant = random_plant(seed)
    blocks = dataclasses.replace(
        plant, dynamics=plant.system, state_names=tuple(n for n in plant.dynamics.names for _ in range(2))
    )
    there = shift_modes(blocks, {"mode 1": factor}, {"mode 1": damping})
    back = shift_modes(there, {"mode 1": 1.0 / factor}, {"mode 1": 1.0 / damping})
    for name in "ABC":
        np.testing.assert_allclose(getattr(back.system, name), getattr(blocks.system, name), atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_coordinates_of_a_law_do_not_matter(seed):
    plant, rng = random_plant(seed), np.random.default_rng(seed)
    lqg, model = design_lqg(plant, WEIGHTS, 1.0), generalize(plant, WEIGHTS, 1.0)
    T = rng.standard_normal(lqg.system.A.shape) + 3.0 * np.eye(len(lqg.system.A))
    into = np.linalg.inv(T)
    turned = Law(into @ lqg.system.A @ T, into @ lqg.system.B, lqg.system.C @ T)
    # Rounding times the condition of T and of the law's eigenvectors.
    for law in (turned, arrange(turned, [])[0]):
        assert abs(evaluate_cost(model, law).cost / lqg.cost - 1.0) < 1e-8


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_descent_begins_in_states_that_do_not_depend_on_those_given(seed):
    lqg, rng = design_lqg(random_plant(seed), WEIGHTS, 1.0).system, np.random.default_rng(seed)
    T = rng.standard_normal(lqg.A.shape) + 3.0 * np.eye(len(lqg.A))
    into = np.linalg.inv(T)
    laws = Law(lqg.A, lqg.B, lqg.C), Law(into @ lqg.A @ T, into @ lqg.B, lqg.C @ T)
    # The path through each state alone has no sign and no unit of the state in it.
    first, second = (
        law.B[:, :, None] * law.C.T[:, None, :] for law in (arrange(each, [])[0] for each in laws)
    )
    np.testing.assert_allclose(second, first, atol=1e-7 * np.abs(first).max())


def test_a_mode_whose_inputs_and_outputs_are_opposed_has_one_phase():
    """k / (s^2 + 2 z w s + w^2), as of positive position feedback: its residue is imaginary."""
    law = Law(np.array([[0.0, 1.0], [-9.0, -1.8]]), np.array([[0.0], [1.0]]), np.array([[2.0, 0.0]]))
    for seed in range(5):
        T = np.random.default_rng(seed).standard_normal((2, 2)) + 2.0 * np.eye(2)
        into = np.linalg.inv(T)
        found = arrange(Law(into @ law.A @ T, into @ law.B, law.C @ T), [])[0]
        assert np.abs(found.B[:, 0] * found.C[0]).max() < 1e-8 * np.abs(found.B).max() * np.abs(found.C).max()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_units_of_states_do_not_matter(seed):
    rng, n = np.random.default_rng(seed), 6
    A = rng.standard_normal((n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.05) * np.eye(n)
    B, unit = rng.standard_normal((n, 2)), 10.0 ** rng.uniform(-6.0, 6.0, n)
    plain, scaled = solve_gramian(A, B), solve_gramian(A * unit / unit[:, None], B / unit[:, None])
    rms = np.sqrt(np.diag(plain))
    # Rounding times the condition of a random A, whose slowest pole decays with 0.05.
    np.testing.assert_allclose(np.sqrt(np.diag(scaled)) * unit, rms, rtol=1e-9)


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_one_more_model_never_pays_and_each_law_is_best_at_home(seed):
    plant = random_plant(seed)
    other = shift_modes(plant, {"mode 2": 1.05})
    alone = [design_lqg(p, WEIGHTS, 1.0).cost for p in (plant, other)]
    both = design_multimodel(plant, WEIGHTS, 1.0, uncertainty=[other], tolerance=1e-5)
    assert np.all(both.costs >= np.array(alone) * (1.0 - 1e-9))
    assert outcomes_on([plant, other], both, WEIGHTS)[0].stable.all()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), unit=st.floats(1e-3, 1e3))
def test_units_of_a_port_do_not_matter(seed, unit):
    plant = random_plant(seed)
    lqg = design_lqg(plant, WEIGHTS, 1.0)
    system = plant.system
    scaled = dataclasses.replace(
        plant,
        dynamics=StateSpace(system.A, system.B, unit * system.C, system.D),
        state_names=tuple(n for n in plant.dynamics.names for _ in range(2)),
    )
    weights = dataclasses.replace(WEIGHTS, output=np.ones(2) / unit, sensor=WEIGHTS.sensor * unit**2)
    law = dataclasses.replace(
        lqg, dynamics=StateSpace(lqg.system.A, lqg.system.B / unit, lqg.system.C, lqg.system.D)
    )
    before, after = outcomes_on([plant], lqg, WEIGHTS)[0], outcomes_on([scaled], law, weights)[0]
    np.testing.assert_allclose(after.db, before.db, atol=1e-7)
    np.testing.assert_allclose(after.control_rms, before.control_rms, rtol=1e-7)


@given(
    costs=st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=8),
    power=st.sampled_from([1.0, 4.0, 16.0, 64.0]),
)
def test_a_blend_lies_between_mean_and_maximum(costs, power):
    values = np.array(costs)
    blended, weights = blend(values, power)
    assert values.mean() * (1.0 - 1e-12) <= blended <= values.max() * (1.0 + 1e-12)
    assert values.max() <= blended * len(values) ** (1.0 / power) * (1.0 + 1e-12)
    # Homogeneous of degree one: Euler's theorem.
    np.testing.assert_allclose(weights @ values, blended, rtol=1e-10)
