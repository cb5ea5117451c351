"""What a plant's response lacks where dampers or loss factors join its modes, each of which has one ratio.

To first order the neighbours of a mode answer in it by the losses between them (`estimate_damping`). A small
share of a neighbour is a large one of a port that hardly sees the mode itself, so that the error is a matter
of the ports.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.model.article import Damping
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import shared_losses
from middeck.systems.state_space.modal_system import ModalSystem

LEFT_OUT = 1e-3
"""Error of a path at the resonances, over its largest response there, above which it is reported."""
ROUNDED, LINES = 1e-9, 40
"""Part below which a coupling, or a path beside the terms that cancel in it, is rounding; the most resonances
that are looked at: those where the coupling does most."""


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
    C, H = _apart(C), _apart(H)
    lines = _lines(modal, C, H)
    error = _errors(modal, C, H, modal.omega[lines])
    if not error.size or error.max() <= LEFT_OUT:
        return ()
    output, column, line = np.unravel_index(int(np.argmax(error)), error.shape)
    hz = modal.omega[lines][line] / (2.0 * np.pi)
    off = error.max(axis=2) > LEFT_OUT
    return (
        f"losses join the modes, which modal damping leaves out: from {names[0][column]!r} to "
        f"{names[1][output]!r} the response at {hz:.4g} Hz is off by {error.max():.2g} of its largest "
        f"({off.sum()} of {off.size} paths by more than {LEFT_OUT:g})",
    )


def _apart(loss: Float[np.ndarray, "mode mode"]) -> Float[np.ndarray, "mode mode"]:
    """What joins the modes, without what is rounding beside their own losses."""
    own = np.sqrt(np.abs(np.diag(loss)))
    return np.where(np.abs(loss) > ROUNDED * own * own[:, None], loss, 0.0) * (1.0 - np.eye(len(loss)))


def _lines(
    modal: ModalSystem, C: Float[np.ndarray, "mode mode"], H: Float[np.ndarray, "mode mode"]
) -> Int[np.ndarray, " line"]:
    """Damped modes at whose frequencies others are most joined to them; none at that of an undamped one."""
    omega = modal.omega
    own = np.abs(omega**2 - omega[:, None] ** 2 + 2j * modal.zeta * omega * omega[:, None])
    joined = np.abs(omega[:, None] * C) + np.abs(H)
    sound = np.all(own > 0.0, axis=1) & (joined.max(axis=1, initial=0.0) > 0.0)
    does = np.max(joined / np.where(own > 0.0, own, np.inf), axis=1, initial=0.0)
    return np.sort(
        np.argsort(-np.where(sound, does, -1.0), kind="stable")[: min(LINES, np.count_nonzero(sound))]
    )


def _errors(
    modal: ModalSystem,
    C: Float[np.ndarray, "mode mode"],
    H: Float[np.ndarray, "mode mode"],
    omega: Float[np.ndarray, " line"],
) -> Float[np.ndarray, "output input line"]:
    """Errors of the response at ``omega``, over the largest of each path there."""
    error = np.zeros((len(modal.phi), modal.psi.shape[1], len(omega)))
    size = np.full(error.shape[:2], np.finfo(float).tiny)
    for k, w in enumerate(omega):
        own = modal.omega**2 - w**2 + 2j * modal.zeta * modal.omega * w
        alone = modal.psi / own[:, None]
        joined = np.linalg.solve(np.diag(own) + 1j * (w * C + H), modal.psi)
        read = modal.phi + 1j * w * modal.phi_rate
        if modal.phi_acceleration is not None:
            read = read - w**2 * modal.phi_acceleration
        error[:, :, k] = np.abs(read @ (joined - alone))
        terms = ROUNDED * (np.abs(read) @ np.abs(alone))
        size = np.maximum(size, np.maximum(np.abs(read @ joined), terms))
    return error / size[:, :, None]
