"""What a plant's response lacks where dampers or loss factors join its modes, each of which has one ratio.

To first order the neighbours of a mode answer in it by the losses between them (`estimate_damping`). A small
share of a neighbour is a large one of a port that hardly sees the mode itself, so that the error is a matter
of the ports.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.structure.model.article import Damping
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import shared_losses
from middeck.systems.state_space.modal_system import ModalSystem

LEFT_OUT = 1e-3
"""Error of a path at the resonances, over its largest response there, above which it is reported."""


def coupling_warnings(
    modes: Modes,
    damping: Damping,
    modal: ModalSystem,
    names: tuple[tuple[str, ...], tuple[str, ...]],
) -> tuple[str, ...]:
    """A sentence on the worst path of the plant ``modal``, of the lowest of ``modes``; none if all are right.

    ``names`` are those of its inputs and of its outputs.
    """
    count = len(modal.omega)
    C, H = shared_losses(modes, modes.equilibrium, damping, modes.omega[:count], modes.shapes[:, :count])
    apart = 1.0 - np.eye(count)
    error = _errors(modal, C * apart, H * apart)
    if not error.size or error.max() <= LEFT_OUT:
        return ()
    output, column, line = np.unravel_index(int(np.argmax(error)), error.shape)
    hz = modal.omega[modal.zeta * modal.omega > 0.0][line] / (2.0 * np.pi)
    off = error.max(axis=2) > LEFT_OUT
    return (
        f"losses join the modes, which modal damping leaves out: from {names[0][column]!r} to "
        f"{names[1][output]!r} the response at {hz:.4g} Hz is off by {error.max():.2g} of its largest "
        f"({off.sum()} of {off.size} paths by more than {LEFT_OUT:g})",
    )


def _errors(
    modal: ModalSystem, C: Float[np.ndarray, "mode mode"], H: Float[np.ndarray, "mode mode"]
) -> Float[np.ndarray, "output input line"]:
    """Errors of the response at the frequencies of damped modes, over the largest of each path there."""
    omega = modal.omega[modal.zeta * modal.omega > 0.0]
    shape = len(modal.phi), modal.psi.shape[1], len(omega)
    if not (np.any(C) or np.any(H)):
        return np.zeros(shape)
    error, size = np.zeros(shape), np.zeros(shape[:2])
    for k, w in enumerate(omega):
        own = modal.omega**2 - w**2 + 2j * modal.zeta * modal.omega * w
        alone = modal.psi / own[:, None]
        joined = np.linalg.solve(np.diag(own) + 1j * (w * C + H), modal.psi)
        read = modal.phi + 1j * w * modal.phi_rate
        if modal.phi_acceleration is not None:
            read = read - w**2 * modal.phi_acceleration
        error[:, :, k] = np.abs(read @ (joined - alone))
        size = np.maximum(size, np.abs(read @ joined))
    return error / np.maximum(size, np.finfo(float).tiny)[:, :, None]
