"""Rms of loops with exact delay: closed form, a fine fixed grid, the limit of no delay, instability."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg as sla

from middeck.control.analysis.rms.measure_rms import measure_rms
from middeck.control.law.compensator import Compensator
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance, loop_rms
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.norms import quadrature
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import sum_of_modes

FORCE, WAY, SEEN = Port("force", "N"), Port("way", "m"), Port("seen", "m")
GROUPS = {"w": ("force",), "u": ("force",), "z": ("way",), "y": ("seen",)}
INTEGRATOR = Plant(
    dynamics=StateSpace([[0.0]], [[1.0]], [[1.0], [1.0]], [[0.0], [0.0]]),
    inputs=(FORCE,),
    outputs=(WAY, SEEN),
    **GROUPS,
)
MODES = sum_of_modes([6.0, 25.0], [0.01, 0.02], [[1.0], [1.0]], [[1.0, 0.6]] * 2)
STRUCTURE = Plant(dynamics=MODES, inputs=(FORCE,), outputs=(WAY, SEEN), **GROUPS)
LAG = Compensator(StateSpace([[-8.0]], [[1.0]], [[30.0]], [[0.0]]), (SEEN,), (FORCE,))
WHITE = np.array([[0.5]])


def delayed(plant: Plant, tau: float) -> Plant:
    return delay_plant(plant, np.array([[0.0], [tau]]))


def gain(k: float) -> Compensator:
    return Compensator(gain_system(np.array([[-k]])), (SEEN,), (FORCE,))


@pytest.mark.parametrize("turns", np.linspace(0.05, 1.4, 8))
def test_integrator_by_its_closed_form(turns: float) -> None:
    """z' = -k z(t - tau) + w: the variance is cos(k tau)/(2 k (1 - sin(k tau))) times the intensity.

    Kuchler and Mensch 1992 (Stochastics 40, 23-42): the stationary variance of the delayed Langevin equation.
    """
    k = 2.0
    tau = turns / k
    wide = Performance(np.ones(1), WHITE, (0.0, 4e4))
    found = measure_rms(delayed(INTEGRATOR, tau), gain(k), wide)
    # Beyond 40 kHz |T|^2 is 1/w^2: what is left of the integral is S/(pi w2).
    rest = 0.5 / (np.pi * 2.0 * np.pi * 4e4)
    exact = 0.5 * np.cos(k * tau) / (2.0 * k * (1.0 - np.sin(k * tau))) - rest
    assert found[0] ** 2 == pytest.approx(exact, rel=1e-9)


def test_structure_by_another_quadrature() -> None:
    """The level asked for is 1e-8: SciPy's rule at 1e-11, given the resonances."""
    tau, band = 0.03, (0.05, 30.0)
    performance = Performance(np.ones(1), WHITE, band)
    found = measure_rms(delayed(STRUCTURE, tau), LAG, performance)

    def power(w: float) -> float:
        s = 1j * w
        q = 1.0 / (s**2 + 2.0 * MODES.zeta * MODES.omega * s + MODES.omega**2)
        G = complex(q @ (MODES.phi[0] * MODES.psi[:, 0]))
        K = 30.0 / (s + 8.0) * np.exp(-s * tau)
        return abs(G / (1.0 - K * G)) ** 2

    w1, w2 = (2.0 * np.pi * f for f in band)
    edges = np.concatenate([[w1], [5.0, 5.9, 6.0, 6.1, 7.0, 20.0, 24.9, 25.0, 25.1, 26.0, 40.0], [w2]])
    total = sum(
        scipy.integrate.quad(power, a, b, epsabs=0.0, epsrel=1e-12, limit=500)[0]
        for a, b in itertools.pairwise(edges)
    )
    assert found[0] == pytest.approx(np.sqrt(0.5 * total / np.pi), rel=1e-10)


def test_no_delay_is_the_closed_form_and_a_short_one_is_its_approximation() -> None:
    performance = Performance(np.ones(1), WHITE, (0.05, 30.0))
    rational = loop_rms(close_loop(STRUCTURE, LAG), performance)
    assert measure_rms(STRUCTURE, LAG, performance) == pytest.approx(rational, rel=1e-15)
    assert measure_rms(delayed(STRUCTURE, 0.0), LAG, performance) == pytest.approx(rational, rel=1e-15)
    # At 0.01 s and 30 Hz, two radians: Pade of order 8 is exact to rounding.
    fine = close_loop(approximate_delays(delayed(STRUCTURE, 0.01), 8), LAG)
    found = measure_rms(delayed(STRUCTURE, 0.01), LAG, performance)
    assert found == pytest.approx(loop_rms(fine, performance), rel=1e-10)


def test_an_unstable_loop_is_infinite_however_finite_its_integral() -> None:
    performance = Performance(np.ones(1), WHITE, (0.05, 30.0))
    assert measure_rms(delayed(INTEGRATOR, 0.8), gain(2.0), performance).tolist() == [np.inf]
    assert np.isfinite(measure_rms(delayed(INTEGRATOR, 0.78), gain(2.0), performance)).all()


def test_delays_outside_the_loop_do_not_change_stability_nor_rms() -> None:
    """z late by itself: the same rms; the path from w to z alone."""
    performance = Performance(np.ones(1), WHITE, (0.05, 30.0))
    plain = delayed(STRUCTURE, 0.03)
    apart = dataclasses.replace(plain, delay_s=np.array([[0.2], [0.03]]))
    first, second = (measure_rms(p, LAG, performance) for p in (plain, apart))
    assert second == pytest.approx(first, rel=1e-12)


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("low", [0.0, 0.05])
def test_two_equal_bodies_that_cancel_end_behind_delays(mixed: bool, low: float, monkeypatch) -> None:
    """Their difference is zero but for rounding, and halving had no end; their sum is twice one of them."""
    one, drive = np.array([[0.0, 1.0], [-9.0, -0.06]]), np.array([[0.0], [1.0]])
    seen, rest = np.array([[1.0, 0.0, -1.0, 0.0], [1.0, 0.0, 1.0, 0.0]]), np.zeros((2, 1))
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0] if mixed else np.eye(4)
    A, B = turn.T @ sla.block_diag(one, one) @ turn, turn.T @ np.vstack([drive, drive])
    two = StateSpace(A, B, seen @ turn, rest)
    groups = {"w": ("force",), "u": ("force",), "z": ("way", "seen"), "y": ("seen",)}
    both = Plant(dynamics=two, inputs=(FORCE,), outputs=(WAY, SEEN), **groups)
    lines, powers = 0, quadrature._powers

    def counted(power, at: np.ndarray) -> np.ndarray:
        nonlocal lines
        lines += at.size
        assert lines < 300_000
        return powers(power, at)

    monkeypatch.setattr(quadrature, "_powers", counted)
    found = measure_rms(delay_plant(both, 0.02), None, Performance(np.ones(2), WHITE, (low, 30.0)))
    alone = dataclasses.replace(both, dynamics=StateSpace(one, drive, [[2.0, 0.0]] * 2, rest))
    true = measure_rms(alone, None, Performance(np.ones(2), WHITE, (low, 30.0)))[0]
    assert found[1] == pytest.approx(true, rel=1e-9)
    assert found[0] < 1e-12 * found[1]
