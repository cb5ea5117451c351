"""The closed loop as a response with exact delays: what disturbances and sensor noise do to z and to u."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Complex

from middeck.control.analysis.loop import evaluate_halves, form_loop, select_dynamics, transfer_of
from middeck.control.compensator import Compensator
from middeck.control.partition import partition_modes
from middeck.systems.delayed_plant import DelayedPlant


def closed_response(
    plant: DelayedPlant, compensator: Compensator, disturbed: Sequence[str]
) -> Callable[[np.ndarray], Complex[np.ndarray, "line zu wv"]]:
    """From the inputs ``disturbed`` and noise v on the measurements to the group z and commands u.

    Over omega [rad/s]; z first, then u, and ``disturbed`` first, then v. With M = (1 - K G_yu)^-1 K commands
    are M (G_yw w + v), and z = G_zw w + G_zu u.
    """
    active = partition_modes(plant.plant).active
    w, z = active.input_indices(disturbed), active.output_indices(active.z)
    u = active.input_indices([p.name for p in compensator.outputs])
    y = active.output_indices([p.name for p in compensator.inputs])
    rows, columns = [*z, *y], [*w, *u]
    transfer = transfer_of(select_dynamics(active, columns, rows))
    late = plant.delay_s[np.ix_(rows, columns)]
    halves = evaluate_halves(form_loop(plant, compensator))
    nz, nw = len(z), len(w)

    def response(omega: np.ndarray) -> np.ndarray:
        s = 1j * omega
        G = transfer(s) * np.exp(-s[:, None, None] * late)
        K = halves(s)[1]
        M = np.linalg.solve(np.eye(len(u)) - K @ G[:, nz:, nw:], K)
        commands = np.concatenate([M @ G[:, nz:, :nw], M], axis=2)
        seen = G[:, :nz, nw:] @ commands
        seen[:, :, :nw] += G[:, :nz, :nw]
        return np.concatenate([seen, commands], axis=1)

    return response
