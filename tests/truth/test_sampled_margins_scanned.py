"""Margins of sampled loops with delays against a program of its own: the held plant by exponentials, its loop
gain scanned over frequency, and eigenvalues of a loop that remembers past states for the delay margin."""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.optimize import brentq, minimize_scalar

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace


class Loop(NamedTuple):
    """A plant, delays of its paths, and a law u = K y issued each period."""

    plant: StateSpace
    late_s: np.ndarray
    law: SampledStateSpace

    @property
    def T(self) -> float:
        return self.law.period_s


def _held(plant: StateSpace, t: float) -> tuple[np.ndarray, np.ndarray]:
    n, m = plant.B.shape
    E = sla.expm(np.block([[plant.A, plant.B], [np.zeros((m, n + m))]]) * t)
    return E[:n, :n], E[:n, n:]


def _paths(loop: Loop, o: int, i: int) -> tuple[int, np.ndarray, float]:
    """Whole periods m of a path, and what it reads then of the state and of the input in force."""
    m = math.ceil(loop.late_s[o, i] / loop.T - 1e-9)
    A, B = _held(loop.plant, max(m * loop.T - loop.late_s[o, i], 0.0))
    return m, loop.plant.C[o] @ A, float((loop.plant.C[o] @ B)[i] + loop.plant.D[o, i])


def _ratio(loop: Loop, omega: np.ndarray, at: str, k: int) -> np.ndarray:
    """L of channel k at one end, the other channels closed."""
    z, K = np.exp(1j * omega * loop.T), loop.law
    A, B = _held(loop.plant, loop.T)
    X = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))
    G = np.empty((len(z), *loop.plant.D.shape), complex)
    for o, i in np.ndindex(*loop.plant.D.shape):
        m, row, direct = _paths(loop, o, i)
        G[:, o, i] = (X[:, :, i] @ row + direct) * z**-m
    Y = np.linalg.solve(z[:, None, None] * np.eye(len(K.A)) - K.A, np.broadcast_to(K.B, (len(z), *K.B.shape)))
    P = (K.C @ Y + K.D) @ G if at == "inputs" else G @ (K.C @ Y + K.D)
    rest = [j for j in range(P.shape[1]) if j != k]
    around = np.linalg.solve(np.eye(len(rest)) - P[:, rest][:, :, rest], P[:, rest][:, :, [k]])
    return -(P[:, k, k] + (P[:, [k]][:, :, rest] @ around)[:, 0, 0])


def _radius(loop: Loop, more: np.ndarray) -> float:
    """Largest pole with delays ``more`` [s]: a copy of the plant for each input, with all its past states."""
    loop = loop._replace(late_s=loop.late_s + more)
    (ny, nu), n, K = loop.plant.D.shape, len(loop.plant.A), loop.law
    A, B = _held(loop.plant, loop.T)
    past = [max(_paths(loop, o, i)[0] for o in range(ny)) for i in range(nu)]
    starts = np.concatenate([[0], np.cumsum([n * (m + 1) + m for m in past])])
    size = int(starts[-1])
    F, into = np.zeros((size, size)), np.zeros((size, nu))
    C, D = np.zeros((ny, size)), np.zeros((ny, nu))
    for i, m in enumerate(past):
        s = starts[i]
        u = s + n * (m + 1)  # past inputs, the latest first
        F[s : s + n, s : s + n], into[s : s + n, i] = A, B[:, i]
        F[s + n : u, s : u - n] = np.eye(n * m)
        F[u + 1 : u + m, u : u + m - 1], into[u : u + min(m, 1), i] = np.eye(max(m - 1, 0)), 1.0
        for o in range(ny):
            whole, row, direct = _paths(loop, o, i)
            C[o, s + n * whole : s + n * (whole + 1)] += row
            if whole:
                C[o, u + whole - 1] += direct
            else:
                D[o, i] += direct
    solved = np.linalg.inv(np.eye(nu) - K.D @ D)
    U = solved @ np.hstack([K.D @ C, K.C])
    Y = np.hstack([C, np.zeros((ny, len(K.A)))]) + D @ U
    closed = np.vstack([np.hstack([F, np.zeros((size, len(K.A)))]) + into @ U, K.B @ Y])
    closed[size:, size:] += K.A
    return float(np.abs(np.linalg.eigvals(closed)).max())


def _lines(loop: Loop) -> np.ndarray:
    top = np.pi / loop.T
    found = [np.geomspace(1e-10, 1.0, 3000) * top, np.linspace(1e-4, 1.0, 3000) * top]
    rates = np.append(
        np.linalg.eigvals(loop.plant.A) * loop.T, np.log(np.linalg.eigvals(loop.law.A) + 1e-300j)
    )
    for rate in rates:
        turn, decay = abs(np.angle(np.exp(1j * rate.imag))) / loop.T, max(abs(rate.real), 1e-7) / loop.T
        beside = decay * np.append(0.0, np.geomspace(1e-3, 1e2, 80))
        found += [turn + beside, turn - beside]
    omega = np.unique(np.concatenate(found))
    return omega[(omega > 0.0) & (omega <= top)]


def _scanned(loop: Loop, at: str, k: int) -> np.ndarray:
    """Gain limits within 80 dB of one, phase limit, peak of the sensitivity, alpha of the disk."""
    omega = _lines(loop)
    for _ in range(8):
        L = _ratio(loop, omega, at, k)
        turn = L[1:] / L[:-1]
        coarse = (np.abs(np.angle(turn)) > 0.15) | (np.abs(np.log(np.abs(turn))) > 0.3)
        omega = np.unique(np.append(omega, ((omega[1:] + omega[:-1]) / 2.0)[coarse]))
    L = _ratio(loop, omega, at, k)

    def one(x: float) -> complex:
        return complex(_ratio(loop, np.array([x]), at, k)[0])

    def crossed(level: np.ndarray, of: object) -> list[complex]:
        return [
            one(brentq(of, omega[j], omega[j + 1], xtol=1e-14, rtol=1e-14))
            for j in np.flatnonzero(np.sign(level[1:]) != np.sign(level[:-1]))
        ]

    real = [*crossed(L.imag, lambda x: one(x).imag), complex(L[0]), complex(L[-1])]
    gains = np.array([-1.0 / v.real for v in real if -1e4 < v.real < -1e-4 and abs(v.imag) < 1e-6 * abs(v)])
    phases = [abs(np.angle(-v)) for v in crossed(np.abs(L) - 1.0, lambda x: abs(one(x)) - 1.0)]

    def peak(size: object) -> float:
        most = size(L)
        best = float(most.max())
        for j in np.argsort(-most)[:6]:
            ends = omega[max(j - 1, 0)], omega[min(j + 1, len(omega) - 1)]
            top = minimize_scalar(
                lambda x: -size(one(x)), bounds=ends, method="bounded", options={"xatol": 1e-12}
            )
            best = max(best, -float(top.fun))
        return best

    sensitivity = peak(lambda v: 1.0 / np.abs(1.0 + v))
    disk = 1.0 / peak(lambda v: 0.5 * np.abs(1.0 - v) / np.abs(1.0 + v))
    down, up = gains[gains < 1.0].max(initial=0.0), gains[gains > 1.0].min(initial=np.inf)
    return np.array([down, up, min(phases, default=np.inf), sensitivity, disk])


def _scanned_limit(loop: Loop, at: str, k: int) -> float:
    """Smallest more delay of channel k, up to four periods, that a pole leaves the circle at."""

    def growth(seconds: float) -> float:
        more = np.zeros(loop.late_s.shape)
        more[(slice(None), k) if at == "inputs" else k] = seconds
        return _radius(loop, more) - 1.0

    low = 0.0
    for high in np.linspace(0.0, 4.0 * loop.T, 81)[1:]:
        if growth(high) > 1e-9:
            return float(brentq(growth, low, high, xtol=1e-12 * loop.T))
        low = float(high)
    return np.inf


def _draw(rng: np.random.Generator) -> Loop:
    """Modes below, beside and beyond half the rate, lags, integrators; delays of whole and broken periods."""
    T = 10.0 ** rng.uniform(-2.0, 0.0)
    top, (nu, ny) = np.pi / T, [(1, 1), (1, 1), (2, 2), (2, 1), (1, 2), (3, 2)][rng.integers(6)]
    blocks, B, C = [], [], []
    for kind in rng.integers(0, 3, int(rng.integers(1, 5))):
        if kind == 2:
            blocks.append([[-top * 10.0 ** rng.uniform(-3.0, 0.0) * (rng.random() < 0.6)]])
            B.append(rng.standard_normal((1, nu)))
            C.append(rng.standard_normal((ny, 1)) * 0.05 * top)
            continue
        w = top * (rng.uniform(0.9, 1.3) * rng.choice([1, 2]) if kind else 10.0 ** rng.uniform(-2.0, -0.1))
        zeta = 10.0 ** rng.uniform(-3.0, -1.0)
        blocks.append([[0.0, w], [-w, -2.0 * zeta * w]])
        B.append(np.vstack([np.zeros(nu), 0.3 * np.sqrt(w) * rng.standard_normal(nu)]))
        C.append(np.outer(np.sqrt(w * zeta) * rng.standard_normal(ny), [1.0, 0.0]))
    D = 0.05 * rng.standard_normal((ny, nu)) * (rng.random() < 0.25)
    plant = StateSpace(sla.block_diag(*blocks), np.vstack(B), np.hstack(C), D)
    delay = rng.choice([0.0, 0.0, 1.0, 2.0]) * rng.uniform(0.0, 1.7) * T * np.ones((ny, nu))
    delay += T * rng.uniform(0.0, 1.2, (ny, nu)) * (rng.random() < 0.3)
    n = int(rng.integers(0, 4))
    gains = -0.2 * rng.standard_normal((nu, n)), -0.2 * rng.standard_normal((nu, ny))
    law = SampledStateSpace(
        np.diag(rng.uniform(-0.6, 0.95, n)), rng.standard_normal((n, ny)), *gains, period_s=T
    )
    return Loop(plant, delay, law)


def test_margins_of_sampled_loops_are_those_of_a_scan(campaign) -> None:
    loops = 0
    for seed in campaign(120, share=40):
        rng = np.random.default_rng([90, seed])
        drawn = (_draw(rng) for _ in range(30))
        loop = next((one for one in drawn if _radius(one, 0.0 * one.late_s) < 1.0 - 1e-7), None)
        if loop is None:
            continue
        ny, nu = loop.plant.D.shape
        inputs = tuple(Port(f"u{i}", "N") for i in range(nu))
        outputs = tuple(Port(f"y{i}", "m") for i in range(ny))
        plant = delay_plant(Plant(dynamics=loop.plant, inputs=inputs, outputs=outputs), loop.late_s)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for at in ("inputs", "outputs"):
                found = measure_margins(plant, Compensator(loop.law, outputs, inputs), at=at)
                assert found.stable
                for k, one in enumerate(found.loops):
                    limits = [*one.gain_limits, one.phase_limit_rad, one.sensitivity.gain, one.disk.alpha]
                    assert limits == pytest.approx(_scanned(loop, at, k), rel=1e-4), (seed, at, k)
                    delay = one.delay_limit_s if one.delay_limit_s < 4.0 * loop.T else np.inf
                    assert delay == pytest.approx(_scanned_limit(loop, at, k), rel=1e-5), (seed, at, k)
        loops += 1
    assert loops > 0
