"""Inert modes: uncontrollable and unobservable up to the rounding of an eigensolution."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.systems.state_space.modal_system import ModalSystem, output_rows, rate_scale

COUPLING_FLOOR = 1e-9
"""Relative coupling below which a port and a mode are unconnected: a thousand times the 1e-12 that an
eigensolution leaves where there should be zero, and 180 dB under the best coupled mode of that port."""


def inert_modes(modal: ModalSystem) -> Bool[np.ndarray, " mode"]:
    """Whether each mode is both uncontrollable and unobservable, hence in no transfer function.

    Each port's coupling to a mode is taken relative to its coupling to the mode it couples best with, so
    that units do not matter, and compared with `COUPLING_FLOOR`.
    """
    return ~reached_modes(modal) & ~observed_modes(modal)


def reached_modes(modal: ModalSystem) -> Bool[np.ndarray, " mode"]:
    """Whether each mode is controllable from at least one input."""
    return _coupled(np.abs(modal.psi).T)


def observed_modes(modal: ModalSystem) -> Bool[np.ndarray, " mode"]:
    """Whether each mode is observable in at least one output, by displacement or rate.

    An accelerometer does not observe a rigid mode's state; it reads the input directly.
    """
    rows = output_rows(modal)
    return _coupled(np.maximum(np.abs(rows.position), np.abs(rows.rate) * rate_scale(modal)))


def silence_inert(modal: ModalSystem) -> ModalSystem:
    """The system with exact zeros between inert modes and ports, which mark these modes from then on."""
    active = ~inert_modes(modal)
    return dataclasses.replace(
        modal,
        psi=modal.psi * active[:, None],
        phi=modal.phi * active,
        phi_rate=modal.phi_rate * active,
        phi_acceleration=None if modal.phi_acceleration is None else modal.phi_acceleration * active,
    )


def _coupled(coupling: Float[np.ndarray, "port mode"]) -> Bool[np.ndarray, " mode"]:
    best = coupling.max(axis=1, initial=0.0, keepdims=True)
    return np.any(coupling > COUPLING_FLOOR * best, axis=0)
