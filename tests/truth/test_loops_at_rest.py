"""Free bodies in any coordinates, late by unlike times: verdicts, designs, rms and shifts in agreement."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.control.analysis.rms.measure_rms import measure_rms
from middeck.control.analysis.shifts.shifts import find_allowed_shifts
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance, loop_rms
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays
from middeck.systems.poles.integrators import part_integrators, realise_residues
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.verdict import is_stable
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from plant_builders import grouped_plant, sum_of_modes, unit_weights
from repeats import LONG, repeats

pytestmark = pytest.mark.kernels

FORCE, WAY, SEEN = Port("force", "N"), Port("way", "m"), Port("seen", "m")


def free_body(rng: np.random.Generator) -> Plant:
    """One to three rigid modes, none to two that bend, pairs of a force and a sensor, paths late unlike."""
    rigid, bending, ports = int(rng.integers(1, 4)), int(rng.integers(0, 3)), int(rng.integers(1, 3 + LONG))
    # As many rigid modes as forces at most: a body that nothing holds is no design.
    rigid = min(rigid, ports)
    omega = np.append(np.zeros(rigid), 10.0 ** rng.uniform(0.0, 1.3, bending))
    zeta = np.append(np.zeros(rigid), 10.0 ** rng.uniform(-2.5, -1.0, bending))
    psi = rng.standard_normal((rigid + bending, ports))
    names = tuple(f"mode {k}" for k in range(rigid + bending))
    modal = ModalSystem(
        omega=omega, zeta=zeta, psi=psi, phi=psi.T, phi_rate=np.zeros_like(psi.T), names=names
    )
    forces, ways = (tuple(Port(f"{name}{i}", "1") for i in range(ports)) for name in "fw")
    u, y = (tuple(p.name for p in side) for side in (forces, ways))
    delay = rng.uniform(0.0, 10.0 ** rng.uniform(-2.5, -0.5), (ports, ports))
    return delay_plant(Plant(dynamics=modal, inputs=forces, outputs=ways, w=u, u=u, z=y, y=y), delay)


def mixed(delayed: Plant, rng: np.random.Generator) -> Plant:
    """The same in states of which none is a mode's own."""
    system = remove_delays(delayed).system
    turn = rng.standard_normal(system.A.shape) * 10.0 ** rng.uniform(-1.0, 1.0, len(system.A))
    A, B = np.linalg.solve(turn, system.A @ turn), np.linalg.solve(turn, system.B)
    plant = dataclasses.replace(remove_delays(delayed), dynamics=StateSpace(A, B, system.C @ turn, system.D))
    return delay_plant(plant, delayed.delay_s)


def weigh(delayed: Plant) -> LQGWeights:
    ports = len(delayed.u)
    return LQGWeights(
        output=np.ones(ports),
        input=np.ones(ports),
        disturbed=delayed.u,
        process=np.eye(ports),
        sensor=np.full(ports, 1e-2),
    )


@pytest.mark.parametrize("seed", repeats(range(200), 3))
def test_a_free_body_in_mixed_states_is_the_body(seed: int) -> None:
    """Its design, its verdict and its rms from zero: those of the modal form."""
    rng = np.random.default_rng([11, seed])
    modal = free_body(rng)
    turned = mixed(modal, rng)
    first, second = (design_lqg(approximate_delays(one, 3), weigh(modal), 1.0) for one in (modal, turned))
    # Riccati equations of some tens of states, one of them in coordinates of condition 1e3.
    assert second.cost == pytest.approx(first.cost, rel=1e-5)
    for factor in (1.0, 4.0):
        law = dataclasses.replace(
            first, dynamics=dataclasses.replace(first.system, C=factor * first.system.C)
        )
        found, same = decide_stability(modal, law), decide_stability(turned, law)
        assert (found.stable, found.growing) == (same.stable, same.growing)
        assert found.pole == pytest.approx(same.pole, rel=1e-5, abs=1e-9)
        # Delays in a fine approximation, by eigenvalues: an account that counts no roots.
        values = close_loop(approximate_delays(modal, 12), law).poles
        assert found.growing == int(np.sum(values.real > 1e-8))
    ports = len(modal.u)
    wide = Performance(np.ones(ports), np.eye(ports), (0.0, 3.0))
    rms = measure_rms(modal, first, wide)
    assert measure_rms(turned, first, wide) == pytest.approx(rms, rel=1e-6)
    # The closed form begins at a poorly conditioned zero: a hundred-millionth of the band is left out.
    fine = close_loop(approximate_delays(modal, 12), first)
    above = dataclasses.replace(wide, band_hz=(1e-8, 3.0))
    assert rms == pytest.approx(loop_rms(fine, above), rel=1e-5)


@pytest.mark.parametrize("chain", [1, 2, 3])
@pytest.mark.parametrize("tau", [0.0, 1e-3, 0.1])
def test_rms_from_zero_of_integrators_of_any_order(chain: int, tau: float) -> None:
    """A band from zero, beside one from a millionth of a hertz: what lies below is nothing."""
    A, B = np.diag(np.ones(chain - 1), 1), np.eye(chain)[:, [-1]]
    C = np.eye(1, chain)
    system = StateSpace(A, B, np.vstack([C, C]), np.zeros((2, 1)))
    plant = grouped_plant(system, (FORCE,), (WAY, SEEN), z=("way",), y=("seen",))
    law = design_lqg(
        plant,
        unit_weights(("force",), 1e-2),
        1.0,
    )
    rms = [
        measure_rms(delay_plant(plant, tau), law, Performance(np.ones(1), np.eye(1), (low, 10.0)))
        for low in (0.0, 1e-6)
    ]
    assert rms[0] == pytest.approx(rms[1], rel=1e-4)
    assert rms[0] >= rms[1]


@pytest.mark.parametrize("seed", repeats(range(300), 20))
def test_a_body_that_drifts_is_stable_in_whatever_coordinates(seed: int) -> None:
    """Rounding parts a double pole to both sides of the axis by 1e-8; that is no verdict."""
    rng = np.random.default_rng([5, seed])
    body = remove_delays(mixed(free_body(rng), rng)).system
    # What only exists: no port, no law.
    assert is_stable(body)
    assert is_stable(sample_dynamics(body, 0.01))
    still = growth_rates(body)
    assert np.sum(np.abs(still) < 1e-6) % 2 == 0


def test_a_pole_that_grows_slowly_still_grows() -> None:
    """Beside a double pole at rest, and a thousand times above what rounding makes of it."""
    A = np.zeros((4, 4))
    A[0, 1], A[2, 2], A[3, 3] = 1.0, 1e-4, -1.0
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((4, 4)))[0]
    system = StateSpace(turn.T @ A @ turn, np.zeros((4, 1)), np.zeros((1, 4)), np.zeros((1, 1)))
    assert not is_stable(system)
    E = np.eye(4) + 0.01 * A + 0.5e-4 * A @ A
    E[2, 2] = np.exp(1e-6)
    assert not is_stable(SampledStateSpace(turn.T @ E @ turn, system.B, system.C, system.D, period_s=0.01))


def test_an_integrator_pair_that_no_sensor_sees_drifts_and_no_more() -> None:
    """Mixed with others, its part in the measurement is rounding: of either sign, and no spring."""
    for seed in range(12):
        rng = np.random.default_rng([9, seed])
        modes = sum_of_modes([0.0, 3.0], [0.0, 0.02], [[1.0], [1.0]], [[0.0, 1.0]], names=("x", "b"))
        plant = grouped_plant(modes, (FORCE,), (SEEN,))
        law = Compensator(StateSpace([[-2.0]], [[1.0]], [[1.0]], [[0.0]]), (SEEN,), (FORCE,))
        for tau in (0.0, 0.05):
            found = decide_stability(mixed(delay_plant(plant, tau), rng), law)
            assert found.stable
            assert found.margin == pytest.approx(0.0, abs=1e-9)


def test_allowed_shifts_of_a_plant_whose_states_have_no_names() -> None:
    modes = ModalSystem(
        omega=[0.0, 3.0, 8.0],
        zeta=[0.0, 0.01, 0.01],
        psi=[[1.0], [1.0], [1.0]],
        phi=[[1.0, 1.0, -1.0]],
        phi_rate=np.zeros((1, 3)),
        names=("body", "first", "second"),
    )
    plant = delay_plant(
        grouped_plant(modes, (FORCE,), (SEEN,)),
        0.01,
    )
    law = design_lqg(approximate_delays(plant, 3), weigh(plant), 30.0)
    named = find_allowed_shifts(plant, law, most=0.04)
    found = find_allowed_shifts(mixed(plant, np.random.default_rng(1)), law, most=0.04)
    assert [one.mode for one in found] == ["mode 1, 0.4775 Hz", "mode 2, 1.273 Hz"]
    for one, other in zip(named, found, strict=True):
        assert (other.down, other.up) == pytest.approx((one.down, one.up), abs=1e-5)


def test_integrators_are_realised_as_few_as_they_are() -> None:
    """Residues of chains of one to three integrators come back, all eigenvalues zero to the last bit."""
    rng = np.random.default_rng(4)
    for order in (1, 2, 3):
        turn = rng.standard_normal((order + 2, order + 2))
        A = np.zeros_like(turn)
        A[:order, :order] = np.diag(np.ones(order - 1), 1)
        A[order:, order:] = [[-0.1, 2.0], [-2.0, -0.1]]
        B, C = rng.standard_normal((order + 2, 2)), rng.standard_normal((2, order + 2))
        system = StateSpace(
            np.linalg.solve(turn, A @ turn), np.linalg.solve(turn, B), C @ turn, np.zeros((2, 2))
        )
        parted = part_integrators(system)
        exact = [
            C[:, :order] @ np.linalg.matrix_power(A[:order, :order], k) @ B[:order] for k in range(order)
        ]
        assert parted.residues == pytest.approx(np.array(exact), rel=1e-9, abs=1e-10)
        chain = realise_residues(parted.residues)
        assert len(chain.A) == order
        assert not np.any(np.linalg.eigvals(chain.A))


@pytest.mark.parametrize("turns", [0.0, 0.1, 0.7])
@pytest.mark.parametrize("swings", [False, True])
def test_a_body_held_by_its_rate_drifts_and_its_rate_does_not(turns: float, swings: bool) -> None:
    """v' = -k v(t - tau) + w: the place has no rms from zero on, the rate that of Kuchler and Mensch (1992).

    So it is beside a mode without damping which ``swings`` within the band, and which the place alone sees.
    """
    k, top = 2.0, 4e4
    omega = np.array([0.0, 5.0]) if swings else np.array([0.0])
    few = slice(0, len(omega))
    modes = ModalSystem(
        omega=omega,
        zeta=0.0 * omega,
        psi=np.ones((2, 1))[few],
        phi=np.array([[1.0, 0.3], [0.0, 0.0]])[:, few],
        phi_rate=np.array([[0.0, 0.0], [1.0, 0.0]])[:, few],
        names=("body", "mode")[few],
    )
    plant = grouped_plant(modes, (FORCE,), (WAY, SEEN), y=("seen",))
    law = Compensator(gain_system(np.array([[-k]])), (SEEN,), (FORCE,))
    delayed = delay_plant(plant, turns / k)
    place, rate = measure_rms(delayed, law, Performance(np.ones(2), np.eye(1), (0.0, top)))
    assert place == np.inf
    beyond = 1.0 / (np.pi * 2.0 * np.pi * top)
    assert rate**2 == pytest.approx(np.cos(turns) / (2.0 * k * (1.0 - np.sin(turns))) - beyond, rel=1e-8)
    above = measure_rms(delayed, law, Performance(np.ones(2), np.eye(1), (1e-3, top)))
    assert np.isfinite(above).tolist() == [not swings, True]
