"""Stability with exact delay against Lambert's function, known limits, and approximations of high order."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.special import lambertw

from middeck.control.analysis import decide_stability, measure_margins
from middeck.control.closed_loop import close_loop
from middeck.control.compensator import Compensator
from middeck.errors import NumericalError
from middeck.systems.delayed_plant import DelayedPlant, approximate_delays, delay_inputs
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant
from middeck.systems.ports import Port
from middeck.systems.statespace import SampledStateSpace, StateSpace, gain_system

FORCE, WAY, RATE = Port("force", "N"), Port("way", "m"), Port("rate", "m/s")
INTEGRATOR = Plant(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), (FORCE,), (WAY,), u=("force",), y=("way",))
BODY = Plant(
    ModalSystem([0.0], [0.0], [[1.0]], [[1.0], [0.0]], [[0.0], [1.0]], ("body",)), (FORCE,), (WAY, RATE)
)


def gain(*k: float) -> Compensator:
    return Compensator(gain_system(-np.array([k])), (WAY, RATE)[: len(k)], (FORCE,))


@pytest.mark.parametrize("turns", [0.1, 1.0, 1.57, 1.58, 4.0, 7.8, 7.9, 20.0, 60.0])
def test_integrator_by_lambert(turns: float) -> None:
    """s + exp(-s tau) = 0: s = W_j(-tau)/tau; two more roots grow for each further turn beyond pi/2."""
    exact = lambertw(-turns, np.arange(-40, 41)) / turns
    found = decide_stability(delay_inputs(INTEGRATOR, turns), gain(1.0))
    lead = exact[np.argmax(exact.real)]
    assert found.growing == int(np.sum(exact.real > 0.0))
    assert found.stable is (turns < np.pi / 2.0)
    # Newton's method ends at the root of the determinant, whose rounding the gain divides: some 1e-12.
    assert found.pole == pytest.approx(complex(lead.real, abs(lead.imag)), rel=1e-10)
    assert found.margin == -found.pole.real
    assert found.frequency_hz == found.pole.imag / (2.0 * np.pi)


@pytest.mark.parametrize("factor", [0.2, 0.999999, 1.000001, 3.0])
def test_rigid_body_up_to_its_delay_margin(factor: float) -> None:
    """A double pole at the origin, in modal form and as any matrices: neither confuses the count."""
    kp, kd = 2.0, 0.7
    w = np.sqrt((kd**2 + np.sqrt(kd**4 + 4.0 * kp**2)) / 2.0)
    tau = factor * np.arctan2(kd * w, kp) / w
    turned = np.linalg.qr(np.random.default_rng(3).standard_normal((2, 2)))[0]
    system = BODY.system
    mixed = StateSpace(turned.T @ system.A @ turned, turned.T @ system.B, system.C @ turned, system.D)
    for plant in (BODY, dataclasses.replace(BODY, dynamics=mixed)):
        found = decide_stability(delay_inputs(plant, tau), gain(kp, kd))
        assert found.stable is (factor < 1.0)
        assert found.growing in ((0,) if factor < 1.0 else (2,))
        if 0.9 < factor < 1.1:
            assert found.pole.imag == pytest.approx(w, rel=1e-5)


def test_modes_that_the_loop_does_not_move_count() -> None:
    """One that the measurement does not see and that grows makes the whole unstable."""
    for zeta, stable in ((0.01, True), (-0.01, False)):
        modes = ModalSystem(
            [1.0, 3.0], [0.02, zeta], [[1.0], [1.0]], [[0.1, 0.0], [0.0, 1.0]], np.zeros((2, 2)), ("a", "b")
        )
        plant = Plant(modes, (FORCE,), (WAY, Port("other", "m")), w=("force",), z=("other",))
        found = decide_stability(delay_inputs(plant, 0.1), gain(0.05))
        assert found.stable is stable
        if not stable:
            assert found.pole == pytest.approx(0.03 + 3.0j * np.sqrt(1.0 - 1e-4), rel=1e-12)
            assert found.growing == 2


def test_many_modes_agree_with_a_fine_approximation() -> None:
    """Random loops, some unstable; Pade of order 12 is exact to rounding at 3 rad of delay."""
    rng = np.random.default_rng(7)
    unstable = 0
    for _ in range(12):
        n = 6
        omega = 2.0 * np.pi * rng.uniform(0.3, 20.0, n)
        modes = ModalSystem(
            omega, np.full(n, 0.01), rng.standard_normal((n, 2)), rng.standard_normal((2, n)),
            np.zeros((2, n)), tuple("abcdef"),
        )  # fmt: skip
        ports = (Port("u1", "N"), Port("u2", "N")), (Port("y1", "m"), Port("y2", "m"))
        late = DelayedPlant(Plant(modes, *ports), rng.uniform(0.0, 0.02, (2, 2)))
        law = StateSpace(
            [[-20.0]], rng.standard_normal((1, 2)), 300.0 * rng.standard_normal((2, 1)), np.zeros((2, 2))
        )
        K = Compensator(law, ports[1], ports[0])
        found = decide_stability(late, K)
        values = np.linalg.eigvals(_closed(late, K, 12))
        assert found.growing == int(np.sum(values.real > 1e-8))
        assert found.pole.real == pytest.approx(values.real.max(), rel=1e-6, abs=1e-9)
        unstable += not found.stable
    assert 3 <= unstable <= 9


def _closed(late: DelayedPlant, law: Compensator, order: int) -> np.ndarray:
    return close_loop(approximate_delays(late, order), law).system.A


@pytest.mark.parametrize(("k", "stable"), [(0.8, True), (1.2, False)])
def test_direct_terms_with_a_delay(k: float, stable: bool) -> None:
    """1 + k exp(-s tau) = 0 has the chain Re s = log(k)/tau."""
    through = Plant(gain_system(np.ones((1, 1))), (FORCE,), (WAY,))
    assert decide_stability(delay_inputs(through, 0.1), gain(k)).stable is stable


def test_direct_terms_late_by_different_times_are_refused_where_it_matters() -> None:
    through = Plant(gain_system(np.ones((2, 1))), (FORCE,), (WAY, RATE))
    late = DelayedPlant(through, np.array([[0.1], [0.2]]))
    assert decide_stability(late, gain(0.4, 0.4)).stable
    with pytest.raises(NumericalError, match="direct term"):
        decide_stability(late, gain(0.8, 0.8))


def test_without_delay_and_sampled_by_eigenvalues() -> None:
    found = decide_stability(INTEGRATOR, gain(2.0))
    assert (found.pole, found.damping) == (-2.0 + 0.0j, 1.0)
    sampled = SampledStateSpace([[1.0]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-0.5]], 0.1)
    assert decide_stability(sampled, law).margin == pytest.approx(-np.log(0.5) / 0.1, rel=1e-12)


def test_a_gain_margin_is_where_stability_ends() -> None:
    late = delay_inputs(BODY, 0.2)
    limit = measure_margins(late, gain(2.0, 0.7)).loops[0].gain_limits[1]
    for factor, stable in ((limit * (1.0 - 1e-7), True), (limit * (1.0 + 1e-7), False)):
        assert decide_stability(late, gain(2.0 * factor, 0.7 * factor)).stable is stable
