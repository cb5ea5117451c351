"""A basis of rigid modes that separates those that are inert.

All rigid modes have one frequency, zero, so that any basis of them will do. One torque turns a free article
about one axis, which need not be that of a rotation in the structure's basis: then each of these is reached,
though two combinations of them are in no transfer function.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float

from middeck.systems.poles.inert_modes import COUPLING_FLOOR, inert_modes
from middeck.systems.state_space.modal_system import ModalSystem, output_rows, rate_scale

NAMED = 0.1
"""Component of a combination from which on a mode is named in it."""


def align_rigid(modal: ModalSystem) -> ModalSystem:
    """The system with its rigid modes combined such that as many as possible are inert.

    It stays as it is where no more than before become inert. The others have the names of the modes that they
    are nearest to.
    """
    rigid = np.flatnonzero((modal.omega == 0.0) & ~inert_modes(modal))
    coupling = _relative_coupling(modal)[:, rigid]
    _, size, directions = np.linalg.svd(coupling)
    rank = int(np.sum(size > COUPLING_FLOOR))
    if rank == len(rigid):
        return modal
    names = [modal.names[i] for i in rigid]
    active, own = _nearest_basis(directions[:rank])
    idle, _ = _nearest_basis(directions[rank:])
    turn = np.vstack([active, idle])
    labels = [*(names[i] for i in own), *(_combination(v, names) for v in idle)]

    def turned(rows: np.ndarray) -> np.ndarray:
        new = rows.copy()
        new[:, rigid] = rows[:, rigid] @ turn.T
        return new

    acceleration = modal.phi_acceleration
    called = dict(zip(rigid.tolist(), labels, strict=True))
    return dataclasses.replace(
        modal,
        psi=turned(modal.psi.T).T,
        phi=turned(modal.phi),
        phi_rate=turned(modal.phi_rate),
        phi_acceleration=None if acceleration is None else turned(acceleration),
        names=tuple(called.get(i, name) for i, name in enumerate(modal.names)),
    )


def _relative_coupling(modal: ModalSystem) -> Float[np.ndarray, "port mode"]:
    """Couplings of inputs, and of positions and rates in outputs, relative to the best one of their port."""
    rows = output_rows(modal)
    into, position, rate = modal.psi.T, rows.position, rows.rate * rate_scale(modal)
    best_in, best_out = (
        np.abs(part).max(axis=1, initial=0.0, keepdims=True) for part in (into, np.hstack([position, rate]))
    )
    parts = ((into, best_in), (position, best_out), (rate, best_out))
    return np.vstack([part / np.where(best > 0.0, best, 1.0) for part, best in parts])


def _nearest_basis(space: Float[np.ndarray, "direction mode"]) -> tuple[np.ndarray, list[int]]:
    """An orthonormal basis of the rows' span, each row near one mode of its own; and these modes."""
    Q, R, pivots = sl.qr(space, pivoting=True)
    signs = np.where(np.diag(R) < 0.0, -1.0, 1.0)
    return (Q * signs).T @ space, pivots[: len(space)].tolist()


def _combination(direction: np.ndarray, names: list[str]) -> str:
    part = [name for name, x in zip(names, direction, strict=True) if abs(x) > NAMED]
    return part[0] if len(part) == 1 else f"a combination of {', '.join(part)}"
