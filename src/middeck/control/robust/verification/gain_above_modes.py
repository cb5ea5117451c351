"""Bound of a plant's gain above all of its modes, where the gain of most loops is small.

A loop whose gain is below one has no root on the axis at that frequency, whatever its delay: an approximation
of the delay need not be good there to decide whether the loop is stable.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.law.partition import partition_modes
from middeck.systems.plants.plant import Plant, remove_delays, subsystem
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import StateSpace

WELL = 1e8
"""Condition of eigenvectors up to which residues are known."""


def gain_above(plant: Plant, low: float) -> float:
    """At least the norm of the plant from u to y at any frequency from ``low`` [rad/s] on, which no pole
    exceeds; delays leave it as it is. ``inf`` or ``nan`` where nothing is known.
    """
    active = remove_delays(partition_modes(plant).active)
    with np.errstate(all="ignore"):
        return float(np.linalg.norm(_entries_above(subsystem(active, active.u, active.y), low)))


def _entries_above(system: StateSpace, low: float) -> Float[np.ndarray, "output input"]:
    """Bounds of the entries, each pair of poles together: residues of a position cancel but for 1/s^2."""
    balanced, unit = balance(system.A)
    poles, vectors = np.linalg.eig(balanced)
    try:
        left = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return np.full(system.D.shape, np.inf)
    if not np.linalg.norm(vectors) * np.linalg.norm(left) < WELL:
        return np.full(system.D.shape, np.inf)
    into, out = left @ (system.B / unit[:, None]), (system.C * unit) @ vectors
    residue = out.T[:, :, None] * into[:, None, :]
    # r/(s - p) + r'/(s - p') = (2 Re r s - 2 Re(r p')) / ((s - p)(s - p')), and |s| < |s - p'|.
    turn = np.imag(poles)
    near = np.hypot(np.real(poles), np.maximum(low - turn, 0.0))
    moved, held = np.abs(np.real(residue)), np.abs(np.real(residue * np.conj(poles)[:, None, None]))
    pair, alone = turn > 0.0, turn == 0.0
    far = (low + turn[pair])[:, None, None]
    each = 2.0 * (moved[pair] + held[pair] / far) / near[pair][:, None, None]
    rest = np.abs(residue[alone]) / near[alone][:, None, None]
    return np.abs(system.D) + each.sum(axis=0) + rest.sum(axis=0)
