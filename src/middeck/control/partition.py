"""Modes that no port moves and no port sees, set aside by name before a design.

A free translation of a structure driven by torques alone is a double pole at the origin that is neither
reachable nor observed. It belongs to no transfer function, yet it makes both Riccati equations unsolvable;
whether a stock solver then fails or returns noise is luck.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.systems.modal import ModalSystem, output_rows, rate_scale, select_modes
from middeck.systems.plant import Plant
from middeck.values import record

COUPLING_FLOOR = 1e-9
"""Relative coupling below which a port and a mode are unconnected: a thousand times the 1e-12 that an
eigensolution leaves where there should be zero, and 180 dB under the best coupled mode of that port."""


@record
class ModePartition:
    """A plant without the modes that its ports cannot tell from absent ones.

    Parameters
    ----------
    active:
        The plant of the other modes: the same transfer functions.
    inert:
        Names of the modes left out, in the order of the plant.
    """

    active: Plant
    inert: tuple[str, ...]


def partition_modes(plant: Plant) -> ModePartition:
    """Set aside the modes that are neither reachable from any input nor observed by any output.

    Each port's coupling to a mode is taken relative to its coupling to the mode it couples best with, so
    that units do not matter, and compared with `COUPLING_FLOOR`. A mode that is only unreachable, or only
    unobserved, stays: a design then refuses it by name. Plants without modal dynamics come back whole.
    """
    modal = plant.dynamics
    if not isinstance(modal, ModalSystem):
        return ModePartition(plant, ())
    inert = ~reached_modes(modal) & ~observed_modes(modal)
    names = tuple(name for name, out in zip(modal.names, inert, strict=True) if out)
    active = dataclasses.replace(plant, dynamics=select_modes(modal, ~inert)) if names else plant
    return ModePartition(active, names)


def reached_modes(modal: ModalSystem) -> Bool[np.ndarray, " mode"]:
    """Which modes at least one input moves."""
    return _coupled(np.abs(modal.psi).T)


def observed_modes(modal: ModalSystem) -> Bool[np.ndarray, " mode"]:
    """Which modes at least one output sees, by displacement or rate.

    An accelerometer does not see the state of a rigid mode: what it reads of it is the input, directly.
    """
    rows = output_rows(modal)
    return _coupled(np.maximum(np.abs(rows.position), np.abs(rows.rate) * rate_scale(modal)))


def _coupled(coupling: Float[np.ndarray, "port mode"]) -> Bool[np.ndarray, " mode"]:
    best = coupling.max(axis=1, initial=0.0, keepdims=True)
    return np.any(coupling > COUPLING_FLOOR * best, axis=0)
