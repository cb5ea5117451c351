"""Loops with delays or of many channels: exact answers that are costly, beside another way to them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import brentq

from measured.rows import row
from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.h2.closed_cost import Law, closed_matrices
from middeck.control.h2.generalized_plant import generalize
from middeck.control.law.compensator import Compensator
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

CASE = "delayed loops"
REPEATS = 5
T = TypeVar("T")


def rows(options: Any) -> list[dict]:
    del options
    return [*_slow_sampled(), *_nine_delays(), *_many_plants(), *_nine_channels()]


def _timed(answer: Callable[[], T]) -> tuple[T, float]:
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        found = answer()
        times.append(time.process_time() - start)
    return found, float(np.median(times))


def _slow_sampled() -> list[dict]:
    """0.02 rad/s at 50 Hz: an integrator whose delay margin, thousands of periods, has a closed form."""
    crossover, period = 0.02, 0.02
    u, y = (Port("u", "N"),), (Port("y", "m"),)
    plant = Plant(
        dynamics=StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), inputs=u, outputs=y, u=("u",), y=("y",)
    )
    gain = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-crossover]], period_s=period
    )
    law = Compensator(gain, y, u, method="gain")
    margins, taken = _timed(lambda: measure_margins(plant, law))
    found = margins.loops[0].delay_limit_s / period

    def phase_left(periods: float) -> float:
        whole, part = divmod(periods, 1.0)
        # |2 sin(a / 2)| = c T |(1 - part) + part exp(-j a)|, by a few steps to its fixed point.
        angle = crossover * period
        for _ in range(30):
            angle = 2.0 * np.arcsin(0.5 * crossover * period * abs(1.0 - part + part * np.exp(-1j * angle)))
        turned = np.angle(1.0 - part + part * np.exp(-1j * angle)) - whole * angle
        return float(turned + np.pi - np.angle(np.exp(1j * angle) - 1.0))

    true = brentq(phase_left, found - 0.4, found + 0.4, xtol=1e-9)
    return [
        row(
            CASE, "0.02 rad/s at 50 Hz: error of the delay margin", "relative", abs(found / true - 1.0), 1e-8
        ),
        row(CASE, "0.02 rad/s at 50 Hz: margins", "CPU s", taken, 2.0),
    ]


def _nine_delays() -> list[dict]:
    """Nine inputs, each delayed by its own 0.3 to 1 s, 20 modes up to 20 Hz: beside a finer approximation."""
    plant, law = _many_channels(20, 2, 1.0)
    delayed = delay_plant(plant, np.tile(np.random.default_rng(3).uniform(0.3, 1.0, 9), (9, 1)))
    found, taken = _timed(lambda: decide_stability(delayed, law))
    values = close_loop(approximate_delays(delayed, 90), law).poles
    lead = values[np.argmax(np.real(values))]
    error = abs(complex(lead.real, abs(lead.imag)) - found.pole) / abs(lead)
    return [
        row(CASE, "nine delays: pole beside an approximation of order 90", "relative", error, 1e-8),
        row(CASE, "nine delays: stability", "CPU s", taken, 2.0),
    ]


def _many_plants() -> list[dict]:
    """A plant of a Monte Carlo whose delay turns its fastest mode by 75 rad: beside a finer approximation."""
    rng = np.random.default_rng(0)
    omega = 2.0 * np.pi * np.geomspace(1.0, 600.0, 10)
    names = tuple(f"mode {k}" for k in range(10))
    shape = rng.standard_normal((2, 2, 10))
    modal = ModalSystem(
        omega=omega,
        zeta=np.full(10, 0.01),
        psi=shape[0].T,
        phi=shape[1],
        phi_rate=0.0 * shape[1],
        names=names,
    )
    inputs, outputs = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    plant = Plant(dynamics=modal, inputs=inputs, outputs=outputs, w=("w",), u=("u",), z=("z",), y=("y",))
    law = Compensator(StateSpace([[-20.0]], [[20.0]], [[-0.05]], [[0.0]]), outputs[1:], inputs[1:])
    weights = LQGWeights(
        output=np.ones(1), input=np.ones(1), disturbed=("w",), process=np.eye(1), sensor=np.array([1e-6])
    )
    delayed = delay_plant(plant, np.array([[0.0, 0.0], [0.02, 0.02]]))
    found, taken = _timed(lambda: measure_noise_rms(delayed, law, weights))
    K = law.system
    A, B, C = closed_matrices(generalize(approximate_delays(delayed, 60), weights, 1.0), Law(K.A, K.B, K.C))
    X = solve_continuous_lyapunov(A, -B @ B.T)
    true = float(np.sqrt(C[0] @ X @ C[0]))
    return [
        row(
            CASE,
            "many plants: rms beside an approximation of order 60",
            "relative",
            abs(found.rms / true - 1.0),
            1e-8,
        ),
        row(CASE, "many plants: stability and rms of one", "CPU s", taken, 0.01),
    ]


def _nine_channels() -> list[dict]:
    """Nine inputs and nine outputs at once, 40 modes, 2 ms: no more than the least margin of one channel."""
    plant, law = _many_channels(40, 6, 0.02)
    delayed = delay_plant(plant, 0.002)
    found, taken = _timed(lambda: measure_disk_margin(delayed, law))
    alone = min(loop.disk.alpha for loop in measure_margins(delayed, law, at="both").loops)
    return [
        row(
            CASE,
            "nine channels: disk margin over the least of one channel",
            "ratio",
            found.alpha / alone,
            1.0,
        ),
        row(CASE, "nine channels: disk margin at both ends", "CPU s", taken, 2.0),
    ]


def _many_channels(modes: int, states: int, gain: float) -> tuple[Plant, Compensator]:
    rng = np.random.default_rng(1)
    omega = 2.0 * np.pi * np.exp(rng.uniform(np.log(0.3), np.log(20.0), modes))
    psi, phi = rng.standard_normal((modes, 9)), rng.standard_normal((9, modes))
    names = tuple(f"mode {k}" for k in range(modes))
    modal = ModalSystem(
        omega=omega, zeta=np.full(modes, 0.01), psi=psi, phi=phi, phi_rate=0.0 * phi, names=names
    )
    inputs, outputs = (tuple(Port(f"{side}{k}", "") for k in range(9)) for side in "uy")
    system = StateSpace(
        -np.diag(rng.uniform(5.0, 60.0, states)),
        rng.standard_normal((states, 9)),
        gain * rng.standard_normal((9, states)),
        np.zeros((9, 9)),
    )
    return Plant(dynamics=modal, inputs=inputs, outputs=outputs), Compensator(system, outputs, inputs)
