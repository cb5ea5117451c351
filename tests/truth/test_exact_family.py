"""Verdicts by phase with a bound, rms by quadrature: beside roots, covariances and the path of one plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.h2.closed_cost import Law, closed_matrices
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.noise_rms import integrate_noise
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import without_delays
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.exact_family import family_law, measure_in_family
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.errors import NumericalError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays
from middeck.systems.poles.stability import GROWTH_LIMIT
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes

NEAR = (1e-5, 1e-4, 1e-2, 0.5)


def ports(letter: str, count: int, unit: str) -> tuple[Port, ...]:
    return tuple(Port(f"{letter}{k}", unit) for k in range(count))


def plant_of(rng: np.random.Generator) -> Plant:
    """One to three inputs and outputs, light and heavier modes over a decade, delays of paths or common."""
    modes, nu, ny = (int(rng.integers(*limits)) for limits in ((2, 7), (1, 4), (1, 4)))
    omega, zeta = np.sort(rng.uniform(0.5, 6.0, modes)), 10.0 ** rng.uniform(-3.0, -1.0, modes)
    psi, phi = rng.standard_normal((modes, nu + 1)), rng.standard_normal((ny + 1, modes))
    rate = rng.standard_normal((ny + 1, modes)) if rng.random() < 0.4 else np.zeros((ny + 1, modes))
    modal = sum_of_modes(omega, zeta, psi, phi, phi_rate=rate, names=tuple(f"mode {k}" for k in range(modes)))
    into, out = ports("i", nu + 1, "N"), ports("o", ny + 1, "m")
    names_u, names_y = (tuple(p.name for p in side[1:]) for side in (into, out))
    plant = Plant(dynamics=modal, inputs=into, outputs=out, w=("i0",), u=names_u, z=("o0",), y=names_y)
    delay = rng.uniform(0.0, 3.0, (ny + 1, nu + 1)) / omega[0]
    return delay_plant(plant, delay if rng.random() < 0.5 else np.full(delay.shape, delay[0, 0]))


def weights_of(plant: Plant) -> LQGWeights:
    inside = remove_delays(plant)
    return LQGWeights(
        output=np.ones(1),
        input=np.ones(len(inside.u)),
        disturbed=("i0",),
        process=np.eye(1),
        sensor=np.full(len(inside.y), 1e-4),
    )


def scaled(law: Compensator, gain: float) -> Compensator:
    return dataclasses.replace(law, dynamics=dataclasses.replace(law.system, C=gain * law.system.C))


def verdict(plant: Plant, law: Compensator, weights: LQGWeights) -> bool | None:
    known = family_law(law, weights)
    assert known is not None
    found = measure_in_family(plant, known)
    return None if found is None else found.stable


def critical_gain(plant: Plant, law: Compensator, weights: LQGWeights) -> float:
    """Where the verdict changes, as near as it is decided; one if it never does."""
    gains = np.geomspace(1e-3, 1e2, 11)
    stable = [verdict(plant, scaled(law, g), weights) for g in gains]
    change = next((k for k in range(10) if {stable[k], stable[k + 1]} == {True, False}), None)
    if change is None:
        return 1.0
    low, high = gains[change : change + 2]
    for _ in range(24):
        middle = float(np.sqrt(low * high))
        found = verdict(plant, scaled(law, middle), weights)
        if found is None:
            break
        low, high = (middle, high) if found == stable[change] else (low, middle)
    return float(np.sqrt(low * high))


def test_verdicts_are_those_of_the_single_path_also_near_the_critical_gain(
    campaign: Callable[[int], range],
) -> None:
    decided = 0
    for seed in campaign(40):
        rng = np.random.default_rng(seed)
        plant = plant_of(rng)
        weights = weights_of(plant)
        law = design_lqg(without_delays(plant), weights, 10.0 ** rng.uniform(-1.0, 2.0))
        critical = critical_gain(plant, law, weights)
        for gain in [critical * (1.0 + sign * e) for sign in (-1.0, 1.0) for e in NEAR]:
            found = verdict(plant, scaled(law, gain), weights)
            try:
                alone = decide_stability(plant, scaled(law, gain))
            except NumericalError:  # an unclear count: no reference
                continue
            if found is not None:
                decided += 1
                assert found == (alone.stable and alone.margin > GROWTH_LIMIT)
    assert decided > 4 * len(campaign(40))  # of eight; nearest to the critical gain it may pass


def check_rms(plant: Plant, law: Compensator, order: int, rel: float) -> bool:
    """Whether it was decided; beside the covariance of a loop with approximated delays, and roots."""
    weights = weights_of(plant)
    known = family_law(law, weights)
    assert known is not None
    found = measure_in_family(plant, known)
    if found is None:
        return False
    K = law.system
    model = generalize(approximate_delays(plant, order), weights, 1.0)
    A, B, C = closed_matrices(model, Law(K.A, K.B, K.C))
    stable = np.linalg.eigvals(A).real.max() < 0.0
    assert found.stable is bool(stable)
    if stable:
        power = np.diag(C @ solve_continuous_lyapunov(A, -B @ B.T) @ C.T)
        assert found.rms == pytest.approx(np.sqrt(power[0]), rel=rel)
        assert found.control_rms == pytest.approx(np.sqrt(power[1:].sum()), rel=rel)
        alone = integrate_noise(plant, law, weights)
        assert found.rms == pytest.approx(alone.rms, rel=1e-9)
        assert found.control_rms == pytest.approx(alone.control_rms, rel=1e-9)
    return True


def test_the_rms_is_that_of_a_fine_approximation_near_the_critical_gain_too(
    campaign: Callable[[int], range],
) -> None:
    decided = 0
    for seed in campaign(60):
        rng = np.random.default_rng(seed)
        plant = plant_of(rng)
        plant = dataclasses.replace(plant, delay_s=0.3 * plant.delay_s)
        law = design_lqg(without_delays(plant), weights_of(plant), 10.0 ** rng.uniform(-1.0, 2.0))
        critical = critical_gain(plant, law, weights_of(plant))
        for below in (0.9, 0.1, 1e-2, 1e-4):
            # Eigenvalues near the axis and their covariance are known to rounding over the distance.
            decided += check_rms(plant, scaled(law, critical * (1.0 - below)), 24, 1e-8 + 1e-11 / below)
    assert decided > 3 * len(campaign(60))


@pytest.mark.parametrize("short", [1e-1, 1e-3, 1e-5])
def test_the_rms_beside_a_static_instability(short: float) -> None:
    """A root slower than all poles of plant and law by ``short``: nearly all of the rms lies below them."""
    modal = sum_of_modes(np.array([2.0]), 0.3, np.ones((1, 2)), np.ones((2, 1)))
    into, out = ports("i", 2, "N"), ports("o", 2, "m")
    plant = Plant(dynamics=modal, inputs=into, outputs=out, w=("i0",), u=("i1",), z=("o0",), y=("o1",))
    lag = StateSpace([[-5.0]], [[5.0]], [[4.0 * (1.0 - short)]], [[0.0]])
    assert check_rms(delay_plant(plant, 0.1), Compensator(lag, out[1:], into[1:]), 12, 1e-9 + 1e-13 / short)


def test_others_are_left_to_the_single_path() -> None:
    plant = plant_of(np.random.default_rng(1))
    weights = weights_of(plant)
    law = design_lqg(without_delays(plant), weights, 1.0)
    known = family_law(law, weights)
    assert known is not None
    modal = plant.dynamics
    assert isinstance(modal, ModalSystem)
    free = dataclasses.replace(modal, omega=np.concatenate([[0.0], modal.omega[1:]]))
    resting = dataclasses.replace(plant, dynamics=free)
    assert measure_in_family(resting, known) is None
    through = dataclasses.replace(law.system, D=np.ones_like(law.system.D))
    assert family_law(dataclasses.replace(law, dynamics=through), weights) is None
    # An output late as a whole has the rms that it has on time.
    idle = outcomes_on([plant, without_delays(plant)], scaled(law, 0.0), weights)[0]
    assert idle.db == pytest.approx(0.0, abs=1e-5)
