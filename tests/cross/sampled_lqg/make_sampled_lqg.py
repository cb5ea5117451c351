"""Gains of python-control (0.10.2) for the paper's single loop, sampled: python make_sampled_lqg.py

The plant of the benchmark cases, 10 ms late at its input; the cost, its cross term and the noise of a period
by Van Loan's exponential (1978), here once with all inputs in force among the states. Its own Riccati solver,
since slycot's (0.7.1) leaves a relative residual of 1e-5 here. Writes numbers.json.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import scipy.linalg as sla

import control

HERE = Path(__file__).parent
UNIT = 2.0 * np.pi * 3.0
HZ, SHAPE, ZETA = np.array([1.1, 1.7, 7.0, 8.8, 9.4]), np.array([1.0, 0.6, 0.6, 0.8, 0.7]), 0.01
DELAY_S, RHO, SENSOR = 0.010, 1e-2, 1e-6 / UNIT


def plant():
    """States (q, q'/w), mode by mode; torque to angle."""
    w = 2.0 * np.pi * HZ
    A = sla.block_diag(*[np.array([[0.0, k], [-k, -2.0 * ZETA * k]]) for k in w])
    B, C = np.zeros((10, 1)), np.zeros((1, 10))
    B[1::2, 0], C[0, ::2] = 1.0 / w, UNIT**2 * SHAPE
    return A, B, C


def hold(A, B, Q, t):
    """exp([A B; 0 0] t), and the integral of exp(.)' Q exp(.)."""
    M = np.block([[A, B], [np.zeros((1, 11))]])
    block = np.block([[-M.T, Q], [np.zeros((11, 11)), M]])
    e = sla.expm(block * t)
    return e[11:, 11:], e[11:, 11:].T @ e[:11, 11:]


def sampled(T):
    """A, B, Q, N, R and noise of the states (x, the latest input that was issued, the one before it, ...)."""
    A, B, C = plant()
    delay = DELAY_S / T
    depth = int(np.ceil(round(delay, 9)))
    early = round(delay - np.floor(round(delay, 9)), 9) * T
    parts = [(early, depth), (T - early, int(np.floor(round(delay, 9))))] if early else [(T, depth)]
    seen = np.zeros((11, 11))
    seen[:10, :10] = C.T @ C
    x = np.eye(10, 10 + depth + 1)
    cost = np.zeros((10 + depth + 1,) * 2)
    for duration, age in parts:
        force = np.zeros((1, 10 + depth + 1))
        force[0, 10 + depth if age == 0 else 9 + age] = 1.0
        start = np.vstack([x, force])
        e, integral = hold(A, B, seen, duration)
        cost += start.T @ integral @ start
        x = (e @ start)[:10]
    both = np.zeros((10 + depth, 11 + depth))
    both[:10] = x
    both[10, -1] = 1.0
    for k in range(1, depth):
        both[10 + k, 9 + k] = 1.0
    cost = (cost + cost.T) / (2.0 * T)
    R = cost[-1:, -1:] + RHO
    e = sla.expm(np.block([[-A, B @ B.T / UNIT], [np.zeros((10, 10)), A.T]]) * T)
    noise = np.zeros((10 + depth, 10 + depth))
    noise[:10, :10] = e[10:, 10:].T @ e[:10, 10:]
    read = np.hstack([C, np.zeros((1, depth))])
    return both[:, :-1], both[:, -1:], cost[:-1, :-1], cost[:-1, -1:], R, noise, read


def main() -> None:
    rows = []
    for rate in (100.0, 250.0, 500.0, 1000.0):
        A, B, Q, N, R, noise, C = sampled(1.0 / rate)
        K, _, regulator = control.dlqr(A, B, Q, R, N, method="scipy")
        given = np.eye(len(A)), C, (noise + noise.T) / 2.0, np.array([[SENSOR * rate]])
        L, _, estimator = control.dlqe(A, *given, method="scipy")
        rows.append(
            {
                "rate_hz": rate,
                "K": K.ravel().tolist(),
                "L": L.ravel().tolist(),
                "regulator_radius": float(np.abs(regulator).max()),
                "estimator_radius": float(np.abs(estimator).max()),
            }
        )
    (HERE / "numbers.json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
