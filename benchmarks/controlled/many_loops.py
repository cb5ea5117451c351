"""Ten thousand perturbed loops of 30 + 30 states, half of them stable, beside a loop over python-control."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as sla

from measured.rows import cell, peer, row
from middeck.control.h2.closed_cost import Law
from middeck.control.robust.verification.many_loops import close_many, decide_many, measure_many

CASE, REPEATS = "many_loops", 3
LOOPS, MODES, CHANNELS, SPREAD, SEED = 10_000, 15, 3, 0.03, 0
# Of input and sensor noise in the design: the authority at which 40 to 60 % of the loops are stable.
NOISE = 1e-4
# Of the loops, how many the peers get; their times are of one loop.
SHARE = 500


def rows(options: Any) -> list[dict]:
    A, B, C = _loops()
    ours, found = _timed(lambda: measure_many(A, B, C), LOOPS)
    decided, _ = _timed(lambda: decide_many(A), LOOPS)
    by_values, values = _timed(lambda: np.linalg.eigvals(A[:SHARE]), SHARE)
    made = [
        row(CASE, "stability and rms", "CPU ms a loop", 1e3 * ours, states=4 * MODES),
        row(CASE, "share that is stable", "%", 100.0 * np.mean(found.stable)),
        row(CASE, "stability alone over batched eigvals", "ratio", decided / by_values, 1.0),
        row(CASE, "verdicts unlike eigvals'", "loops",
            np.sum(found.stable[:SHARE] != (values.real.max(axis=1) <= 1e-8)), 0),
        row(CASE, "largest relative residual", "relative", np.nanmax(found.residual), 1e-11),
        row(CASE, "largest stated error of an rms", "relative", found.error[found.stable].max(), 1e-4),
    ]  # fmt: skip
    answer = peer(options.peer_python, "control_many_loops.py", A=A[:SHARE], B=B[:SHARE], C=C[:SHARE])
    if answer is not None:
        made[0]["peers"] = cell("python-control, slycot", answer, 1e3 * float(answer["seconds"]))
        made.append(row(CASE, "time over python-control's", "ratio", ours / float(answer["seconds"]), 0.25))
        both = np.isfinite(answer["rms"])
        made.append(row(CASE, "largest difference of rms", "relative",
                        np.abs(found.rms[:SHARE][both] / answer["rms"][both] - 1.0).max()))  # fmt: skip
    return made


def _timed(work: Callable[[], Any], loops: int) -> tuple[float, Any]:
    times, answer = [], None
    for _ in range(REPEATS):
        start = time.process_time()
        answer = work()
        times.append(time.process_time() - start)
    return float(np.median(times)) / loops, answer


def _loops() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Modes of 1 % damping from 0.5 to 30 Hz, each frequency off by up to 3 %, under the nominal LQG."""
    rng, k, n = np.random.default_rng(SEED), 2 * np.arange(MODES), 2 * MODES
    omega = 2.0 * np.pi * np.geomspace(0.5, 30.0, MODES)
    drawn = np.vstack([omega, omega * (1.0 + SPREAD * rng.uniform(-1.0, 1.0, (LOOPS, MODES)))])
    A = np.zeros((LOOPS + 1, n, n))
    A[:, k, k + 1], A[:, k + 1, k], A[:, k + 1, k + 1] = drawn, -drawn, -0.02 * drawn
    psi = rng.standard_normal((MODES, CHANNELS))
    B, C = np.zeros((n, CHANNELS)), np.zeros((CHANNELS, n))
    B[1::2], C[:, ::2] = psi, psi.T / omega
    X = sla.solve_continuous_are(A[0], B, C.T @ C, NOISE * np.eye(CHANNELS))
    Y = sla.solve_continuous_are(A[0].T, C.T, B @ B.T, NOISE * np.eye(CHANNELS))
    K, L = B.T @ X / NOISE, Y @ C.T / NOISE
    law = Law(A[0] - B @ K - L @ C, L, -K)
    inputs, outputs = (np.broadcast_to(M, (LOOPS, *M.shape)) for M in (B, C))
    return close_many(A[1:], (inputs, inputs), (outputs, outputs), law)
