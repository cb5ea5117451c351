"""What holds for every reduction: the bound, stability, coordinates that do not matter, and small gains."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_plants import random_plant

from balanced_cut import cut_balanced, hankel_values
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.reduction.modal import reduce_modes
from middeck.control.reduction.reduced_compensators import reduce_compensator
from middeck.systems.poles.stability import growth_rates
from middeck.systems.state_space.statespace import StateSpace, poles
from plant_builders import unit_weights

SEEDS = st.integers(0, 10_000)
WEIGHTS = unit_weights(("a", "b"), np.full(2, 1e-4), outputs=2, inputs=2)


def random_system(seed, modes=5):
    """Light modes over two decades and a real pole, in turned coordinates, with a direct term."""
    rng = np.random.default_rng(seed)
    omega, zeta = 10.0 ** rng.uniform(-1, 1, modes), 10.0 ** rng.uniform(-3, -0.5, modes)
    blocks = [np.array([[0.0, w], [-w, -2.0 * z * w]]) for w, z in zip(omega, zeta, strict=True)]
    A = sla.block_diag(*blocks, [[-rng.uniform(0.1, 10.0)]])
    T, _ = np.linalg.qr(rng.standard_normal(A.shape))
    n = len(A)
    B, C = rng.standard_normal((n, 2)), rng.standard_normal((3, n))
    return StateSpace(T @ A @ T.T, T @ B, C @ T.T, rng.standard_normal((3, 2)))


@settings(deadline=None)
@given(seed=SEEDS, order=st.integers(0, 10))
def test_the_error_lies_between_the_next_value_and_the_bound(seed, order):
    found = cut_balanced(random_system(seed), order)
    assert np.all(np.real(growth_rates(found.system)) < 0.0)
    # No system of that order comes nearer than the first value left out (Glover 1984); rounding of the gain.
    slack = 1e-9 * found.hankel[0]
    assert found.hankel[found.order] - slack <= found.error <= found.bound + slack


@settings(deadline=None)
@given(seed=SEEDS)
@example(seed=1032)  # a light mode beside a matrix that the turn made large
def test_coordinates_do_not_matter(seed):
    system = random_system(seed)
    rng = np.random.default_rng(seed)
    T = sla.expm(0.3 * rng.standard_normal(system.A.shape)) * 10.0 ** rng.uniform(-2, 2, len(system.A))
    other = StateSpace(T @ system.A @ np.linalg.inv(T), T @ system.B, system.C @ np.linalg.inv(T), system.D)
    # Rounding of the turned matrix moves a pole by so much at most (Bauer and Fike 1960, Numer. Math. 2); the
    # largest value goes by the least decay.
    decay = -np.real(growth_rates(system)).max()
    slack = 1e-6 + np.finfo(float).eps * np.linalg.cond(T) * np.linalg.norm(other.A, 2) / decay
    here = hankel_values(system)
    np.testing.assert_allclose(hankel_values(other), here, rtol=0, atol=slack * here[0])


@settings(deadline=None)
@given(seed=SEEDS)
def test_nothing_left_out_is_nothing_changed(seed):
    plant = random_plant(seed)
    same = cut_balanced(plant.system, len(plant.system.A))
    # An error that is rounding of the gain at resonance: 1 % of damping, squares of the shapes.
    assert same.error <= 1e-9 * same.hankel[0]
    modal = reduce_modes(plant, 5, band_hz=(0.1, 20.0))
    assert modal.error == 0.0
    assert modal.kept == plant.dynamics.names


@settings(deadline=None, max_examples=10)
@given(seed=SEEDS, order=st.integers(4, 9), method=st.sampled_from(["performance", "stability", "balanced"]))
def test_a_loop_error_below_one_proves_stability(seed, order, method):
    plant = random_plant(seed)
    law = design_lqg(plant, WEIGHTS, 1.0)
    found = reduce_compensator(law, plant, order, method=method, weights=WEIGHTS, homotopy=False)
    unstable = [np.count_nonzero(np.real(poles(k.system)) > 0.0) for k in (law, found)]
    if found.loop_error[0] < 1.0 and unstable[0] == unstable[1]:
        assert found.stable[0]
    assert found.stable[0] == close_loop(plant, found).stable == np.isfinite(found.cost_ratio[0])


@settings(deadline=None, max_examples=8)
@given(seed=SEEDS, order=st.integers(5, 8))
def test_a_reduced_compensator_holds_its_plant_or_says_that_it_does_not(seed, order):
    plant = random_plant(seed)
    law = design_lqg(plant, WEIGHTS, 1.0)
    found = reduce_compensator(law, plant, order, weights=WEIGHTS)
    assert found.order <= order
    assert found.stable[0] == close_loop(plant, found).stable
    if not found.stable[0]:
        assert all("blocked" in step or "unstable" in step for step in found.steps if ": homotopy" in step)
