"""Closed-loop response with exact delays, from disturbances and sensor noise to z and u.

Behind an integrator, the open-loop path and the feedback path are both unbounded at zero frequency, and
cancel. The integrators of plant and compensator are therefore states; only the rest is a response. In each
path

    R_k exp(-s tau) / s^k  =  R_k (1 - s tau + ...) / s^k  +  R_k (exp(-s tau) - 1 + s tau - ...) / s^k

the first part is integrated, the second has no pole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import part_transfer
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.systems.plants.plant import Plant, select_ports
from middeck.systems.poles.integrators import realise_residues

TERMS = 20
"""Terms of the power series of an exponential, up to a delay of one radian."""


def closed_response(
    plant: Plant, compensator: Compensator, disturbed: Sequence[str]
) -> Callable[[np.ndarray], Complex[np.ndarray, "line zu wv"]]:
    """Response over omega [rad/s] from (``disturbed``, measurement noise v) to (z, commands u)."""
    active = partition_modes(plant).active
    u_ports, y = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    path = select_ports(active, (*disturbed, *u_ports), (*active.z, *y))
    residues, moving = part_transfer(path.continuous)
    delay_s = path.delay_s
    body = realise_residues(_delayed_residues(residues, delay_s))
    of_law, law = part_transfer(compensator.system)
    memory = realise_residues(of_law)
    nz, nw, ny, n = len(active.z), len(disturbed), len(y), len(body.A)

    def response(omega: np.ndarray) -> np.ndarray:
        s = 1j * omega
        H = moving(s) * np.exp(-s[:, None, None] * delay_s) + _beyond(residues, delay_s, s)
        Hyw, Hyu = H[:, nz:, :nw], H[:, nz:, nw:]
        K = law(s)
        # u from the integrators' states, w, and noise on y; then the same of y and z.
        from_body = np.broadcast_to(body.C[nz:], (len(s), ny, n))
        from_memory = np.zeros((len(s), ny, len(memory.A)))
        noise = np.broadcast_to(np.eye(ny), (len(s), ny, ny))
        known = np.concatenate([from_body, from_memory, Hyw, noise], axis=2)
        drive = K @ known
        drive[:, :, n : n + len(memory.A)] += memory.C
        u = np.linalg.solve(np.eye(len(u_ports)) - K @ Hyu, drive)
        read = known + Hyu @ u
        states = n + len(memory.A)
        moved = np.concatenate([body.B[:, nw:] @ u, memory.B @ read], axis=1)
        moved[:, :n, states : states + nw] += body.B[:, :nw]
        A = moved[:, :, :states]
        A[:, :n, :n] += body.A
        A[:, n:, n:] += memory.A
        x = np.linalg.solve(s[:, None, None] * np.eye(states) - A, moved[:, :, states:])
        seen = H[:, :nz, nw:] @ u
        seen[:, :, :n] += body.C[:nz]
        seen[:, :, states : states + nw] += H[:, :nz, :nw]
        whole = np.concatenate([seen, u], axis=1)
        return whole[:, :, states:] + whole[:, :, :states] @ x

    return response


def _delayed_residues(
    residues: Float[np.ndarray, "chain output input"], delay_s: Float[np.ndarray, "output input"]
) -> Float[np.ndarray, "chain output input"]:
    """Residues at the origin of R_k / s^k times the delays."""
    total = np.zeros_like(residues)
    for k in range(len(residues)):
        for j in range(k + 1):
            total[k - j] += residues[k] * (-delay_s) ** j / math.factorial(j)
    return total


def _beyond(residues: np.ndarray, delay_s: np.ndarray, s: np.ndarray) -> np.ndarray:
    """The sum of R_k s^-k (exp(-s tau) - its first k terms), which has no pole."""
    total = np.zeros((len(s), *delay_s.shape), dtype=complex)
    turn = -s[:, None, None] * delay_s
    short = np.abs(turn) < 1.0
    for k, residue in enumerate(residues, start=1):
        # (-tau)^k times the function that begins with 1 / k!.
        series = np.zeros_like(turn)
        for j in range(TERMS, -1, -1):
            series = series * np.where(short, turn, 0.0) + 1.0 / math.factorial(j + k)
        first = sum(turn**j / math.factorial(j) for j in range(k))
        direct = (np.exp(turn) - first) / np.where(short, 1.0, turn) ** k
        total += residue * (-delay_s) ** k * np.where(short, series, direct)
    return total
