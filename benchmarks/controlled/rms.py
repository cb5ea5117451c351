"""Band-limited rms: rational with poles at the origin, and with a true delay; the truth is written out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from measured.rows import row
from middeck.control.analysis.rms.measure_rms import measure_rms
from middeck.control.loop.performance import Performance
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.norms.band_rms import band_rms
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem

CASE, REPEATS = "rms", 5
UNIT = 2.0 * np.pi * 3.0  # the reference case's time runs in 1/(2 pi 3 Hz)
OMEGA, PHI = np.array([1.1, 1.7, 7.0, 8.8, 9.4]) / 3.0, np.array([1.0, 0.6, 0.6, 0.8, 0.7])
ZETA, DELAY = 0.01, 0.010 * UNIT
BAND_HZ = (0.1 / UNIT, 60.0 / UNIT)  # 0.1 to 60 Hz


def rows(options: Any) -> list[dict]:
    rational_s, rational = _median(lambda: band_rms(_free_body(), np.eye(1), BAND_HZ))
    plant, law = _reference()
    performance = Performance(np.ones(1), np.eye(1), BAND_HZ)
    delayed_s, delayed = _median(lambda: measure_rms(plant, law, performance))
    free, closed = _true_free_body(), _true_closed(law)
    return [
        row(
            CASE, "error, rational, double pole at the origin", "relative", abs(rational[0] / free - 1), 1e-10
        ),
        row(
            CASE, "error, LQG loop with a true delay of 10 ms", "relative", abs(delayed[0] / closed - 1), 1e-8
        ),
        row(CASE, "time, rational, 12 states", "CPU s", rational_s),
        row(CASE, "time with delay, stability decided first", "CPU s", delayed_s),
    ]


def _free_body() -> Any:
    omega, ones = np.append(0.0, OMEGA), np.ones((6, 1))
    shape = np.append(0.5, PHI)[None]
    zeta = np.append(0.0, np.full(5, ZETA))
    return ModalSystem(
        omega=omega, zeta=zeta, psi=ones, phi=shape, phi_rate=0.0 * shape, names=("rigid", *"abcde")
    ).as_statespace()


def _reference() -> tuple[Plant, Any]:
    """The nominal LQG of the multi-model reference case."""
    modes = ModalSystem(
        omega=OMEGA,
        zeta=np.full(5, ZETA),
        psi=np.ones((5, 1)),
        phi=np.vstack([PHI, PHI]),
        phi_rate=np.zeros((2, 5)),
        names=tuple("abcde"),
    )
    ports = (Port("u", "N"),), (Port("z", "m"), Port("y", "m"))
    plant = delay_plant(
        Plant(dynamics=modes, inputs=ports[0], outputs=ports[1], w=("u",), u=("u",), z=("z",), y=("y",)),
        np.array([[0.0], [DELAY]]),
    )
    weights = LQGWeights(
        output=np.ones(1), input=np.ones(1), disturbed=("u",), process=np.eye(1), sensor=np.array([1e-6])
    )
    return plant, design_lqg(approximate_delays(plant, 3), weights, 100.0)


def _modes_at(w: np.ndarray) -> np.ndarray:
    return np.sum(PHI / (OMEGA**2 - w[:, None] ** 2 + 2j * ZETA * OMEGA * w[:, None]), axis=1)


def _true_free_body() -> float:
    return _integral(lambda w: np.abs(_modes_at(w) - 0.5 / w**2) ** 2)


def _true_closed(law: Any) -> float:
    def power(w: np.ndarray) -> np.ndarray:
        s = 1j * w[:, None, None]
        states = np.linalg.solve(s * np.eye(len(law.system.A)) - law.system.A, law.system.B.astype(complex))
        K = (law.system.C @ states)[:, 0, 0]
        G = _modes_at(w)
        return np.abs(G / (1.0 - K * G * np.exp(-1j * w * DELAY))) ** 2

    return _integral(power)


def _integral(power: Callable[[np.ndarray], np.ndarray]) -> float:
    """Gauss's rule of 10 points on 20,000 logarithmic panels, a thirtieth of a resonance's width each."""
    nodes, weights = np.polynomial.legendre.leggauss(10)
    edges = 2.0 * np.pi * np.geomspace(*BAND_HZ, 20_001)
    total = 0.0
    for part in np.array_split(np.arange(20_000), 40):
        low, width = edges[part], np.diff(edges)[part]
        w = low[:, None] + 0.5 * (nodes + 1.0) * width[:, None]
        total += float(np.sum(power(w.ravel()).reshape(w.shape) * weights * 0.5 * width[:, None]))
    return float(np.sqrt(total / np.pi))


def _median(work: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    times: list[float] = []
    answer = work()
    for _ in range(REPEATS):
        start = time.process_time()
        answer = work()
        times.append(time.process_time() - start)
    return float(np.median(times)), answer
