"""A Riccati equation of 500 states, in modal and in turned coordinates, beside Slycot and SciPy."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from measured.rows import cell, peer, row
from middeck.control.riccati.continuous import solve_riccati

CASE = "riccati"
STATES, INPUTS, OUTPUTS, REPEATS = 500, 5, 14, 3


def rows(options: Any) -> list[dict]:
    return _rows("modal", _modal(), options.peer_python) + _rows("turned", _turned(), options.peer_python)


def _rows(form: str, given: tuple[np.ndarray, ...], peer_python: str | None) -> list[dict]:
    """Ours and the peers interleaved; the medians of their CPU seconds."""
    A, B, Q = given
    ours, left, theirs = [], [], {"slycot": [], "scipy": []}
    last = {}
    for _ in range(REPEATS):
        start = time.process_time()
        solution = solve_riccati(A, B, Q, np.eye(INPUTS))
        ours.append(time.process_time() - start)
        left.append(_residual(solution.X, A, B, Q))
        for name in theirs:
            found = peer(peer_python, "control_riccati.py", A=A, B=B, Q=Q, program=name)
            if found is not None:
                theirs[name].append(float(found["seconds"]))
                last[name] = found
    case, seconds = f"{CASE} {form}", float(np.median(ours))
    made = [row(case, "500 states", "CPU s", seconds, states=STATES),
            row(case, "residual", "relative", max(left), 1e-10)]  # fmt: skip
    for name, found in last.items():
        made[0]["peers"] |= cell(name, found, float(np.median(theirs[name])))
        made[1]["peers"] |= cell(name, found, found["residual"])
        level = {"slycot": 1.0, "scipy": 0.125}[name]
        made.append(row(case, f"time over {name}'s", "ratio", seconds / np.median(theirs[name]), level))
    return made


def _modal() -> tuple[np.ndarray, ...]:
    """250 modes of 1 % over three decades, five inputs, fourteen outputs; R of the regulator is in B."""
    rng = np.random.default_rng(0)
    omega = 2.0 * np.pi * np.geomspace(0.1, 100.0, STATES // 2)
    A, B, C = np.zeros((STATES, STATES)), np.zeros((STATES, INPUTS)), np.zeros((OUTPUTS, STATES))
    even, odd = np.arange(0, STATES, 2), np.arange(1, STATES, 2)
    A[even, odd], A[odd, even], A[odd, odd] = omega, -omega, -0.02 * omega
    B[1::2] = rng.standard_normal((STATES // 2, INPUTS)) / omega[:, None]
    C[:, ::2] = rng.standard_normal((OUTPUTS, STATES // 2))
    return A, B / np.sqrt(1e-4), C.T @ C


def _turned() -> tuple[np.ndarray, ...]:
    A, B, Q = _modal()
    T, _ = np.linalg.qr(np.random.default_rng(1).standard_normal(A.shape))
    turned = T @ Q @ T.T
    return T @ A @ T.T, T @ B, (turned + turned.T) / 2.0


def _residual(X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> float:
    terms = A.T @ X, X @ A, -(X @ B) @ (X @ B).T, Q
    return float(np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms))
