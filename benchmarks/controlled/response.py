"""ISS part 1R, 270 states, 3x3, at 10,000 frequencies: full matrices and modes, beside python-control."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.io

from measured.rows import cell, peer, row
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.modal_system import ModalSystem, modal_response
from middeck.systems.state_space.statespace import StateSpace

CASE = "response"
OMEGA, REPEATS = np.geomspace(0.1, 100.0, 10_000), 5


def rows(options: Any) -> list[dict]:
    modal = _modes(options.data / "slicot_iss" / "iss1R.mat")
    system = _turned(modal)
    true = _by_modes(modal)
    # The two are interleaved, so that a busy machine is busy for both.
    times: dict[str, list[float]] = {"dense": [], "modal": []}
    for _ in range(REPEATS):
        seconds, dense = _cpu(lambda: statespace_response(system, OMEGA))
        times["dense"].append(seconds)
        times["modal"].append(_cpu(lambda: modal_response(modal, OMEGA))[0])
    dense_s, modal_s = float(np.median(times["dense"])), float(np.median(times["modal"]))
    made = [row(CASE, "10,000 lines, full matrices", "CPU s", dense_s, states=270),
            row(CASE, "10,000 lines, modal form", "CPU s", modal_s, states=270),
            row(CASE, "error, full matrices", "relative", _error(dense, true), 1e-11)]  # fmt: skip
    found = peer(options.peer_python, "control_response.py", A=system.A, B=system.B, C=system.C, D=system.D,
                 omega=OMEGA, repeats=REPEATS)  # fmt: skip
    if found is not None:
        name, theirs = "python-control, slycot", float(found["seconds"])
        made[0]["peers"] = made[1]["peers"] = cell(name, found, theirs)
        made[2]["peers"] = cell(name, found, _error(found["H"], true))
        made.append(row(CASE, "time over python-control's, full matrices", "ratio", dense_s / theirs, 1 / 30))
        made.append(row(CASE, "time over python-control's, modal form", "ratio", modal_s / theirs, 1 / 60))
    return made


def _modes(path: Any) -> ModalSystem:
    """The file's A is [0, I; -Omega^2, -2 zeta Omega] with diagonal blocks, its B and C read rates."""
    file = scipy.io.loadmat(path)
    A, B, C = (np.asarray(file[k].todense() if hasattr(file[k], "todense") else file[k]) for k in "ABC")
    m = len(A) // 2
    omega = np.sqrt(-np.diag(A[m:, :m]))
    zeta = -np.diag(A[m:, m:]) / (2.0 * omega)
    return ModalSystem(
        omega=omega,
        zeta=zeta,
        psi=B[m:],
        phi=C[:, :m],
        phi_rate=C[:, m:],
        names=tuple(f"mode {k}" for k in range(m)),
    )


def _turned(modal: ModalSystem) -> StateSpace:
    """The matrices of the file after a random orthogonal change of coordinates."""
    m = len(modal.omega)
    nothing, one = np.zeros((m, m)), np.eye(m)
    A = np.block([[nothing, one], [np.diag(-(modal.omega**2)), np.diag(-2.0 * modal.zeta * modal.omega)]])
    B = np.vstack([np.zeros_like(modal.psi), modal.psi])
    C = np.hstack([modal.phi, modal.phi_rate])
    T, _ = np.linalg.qr(np.random.default_rng(0).standard_normal(A.shape))
    return StateSpace(T @ A @ T.T, T @ B, C @ T.T, np.zeros((len(C), B.shape[1])))


def _by_modes(modal: ModalSystem) -> np.ndarray:
    """The sum over modes written out: exact but for rounding."""
    s = 1j * OMEGA[:, None]
    q = 1.0 / (s**2 + 2.0 * modal.zeta * modal.omega * s + modal.omega**2)
    return np.einsum("om,lm,mi->loi", modal.phi_rate, s * q, modal.psi, optimize=True) + np.einsum(
        "om,lm,mi->loi", modal.phi, q, modal.psi, optimize=True
    )


def _error(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(np.sum(np.abs(found - true) ** 2) / np.sum(np.abs(true) ** 2)))


def _cpu(work: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    start = time.process_time()
    answer = work()
    return time.process_time() - start, answer
