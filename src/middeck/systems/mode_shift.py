"""Modes of a plant moved in frequency and damping, whether it comes from a structure or from data."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import cast

import numpy as np
import scipy.sparse.csgraph as csgraph
from jaxtyping import Float, Int

from middeck.errors import ConfigError
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant, name_states
from middeck.systems.statespace import StateSpace


def shift_modes(
    plant: Plant, frequency: Mapping[str, float], damping: Mapping[str, float] | None = None
) -> Plant:
    """The plant with the natural frequencies of named modes multiplied, and their damping ratios.

    A shift leaves the damping ratio, and ``damping`` the frequency. Modal constants phi psi of
    q'' + 2 zeta omega q' + omega^2 q = psi u stay. A plant without modal dynamics needs ``state_names`` and a
    block of two states for each mode named, driven and read by others but not in a loop with them.

    Raises
    ------
    ConfigError
        For modes that do not exist, do not oscillate, or are in a loop with other states (shift the plant
        without the loop and close it again); for factors that are not positive.

    Examples
    --------
    >>> from middeck.systems.ports import Port
    >>> modal = ModalSystem([2.0], [0.01], [[1.0]], [[1.0]], [[0.0]], ("bending",))
    >>> plant = Plant(modal, (Port("force", "N"),), (Port("way", "m"),))
    >>> shift_modes(plant, {"bending": 1.02}).dynamics.omega
    array([2.04])
    """
    damping = damping or {}
    known = name_states(plant)
    unknown = [name for name in (*frequency, *damping) if name not in known]
    if unknown:
        raise ConfigError(
            f"no mode named {', '.join(map(repr, unknown))}",
            hint=f"one of {', '.join(dict.fromkeys(known))}",
        )
    if not all(np.isfinite(f) and f > 0.0 for f in (*frequency.values(), *damping.values())):
        raise ConfigError("a factor on a frequency or a damping ratio is not positive and finite")
    if isinstance(plant.dynamics, ModalSystem):
        return dataclasses.replace(plant, dynamics=_shift_modal(plant.dynamics, frequency, damping))
    return dataclasses.replace(plant, dynamics=_shift_blocks(plant.dynamics, known, frequency, damping))


def _shift_modal(
    modal: ModalSystem, frequency: Mapping[str, float], damping: Mapping[str, float]
) -> ModalSystem:
    rigid = [n for n, omega in zip(modal.names, modal.omega, strict=True) if n in frequency and not omega]
    if rigid:
        raise ConfigError(f"{', '.join(rigid)}: a rigid mode has no frequency to shift")
    omega = modal.omega * np.array([frequency.get(n, 1.0) for n in modal.names])
    return dataclasses.replace(
        modal, omega=omega, zeta=modal.zeta * np.array([damping.get(n, 1.0) for n in modal.names])
    )


def _shift_blocks(
    system: StateSpace, names: tuple[str, ...], frequency: Mapping[str, float], damping: Mapping[str, float]
) -> StateSpace:
    A, B = system.A.copy(), system.B.copy()
    loops = _loops(system.A)
    for name in dict.fromkeys((*frequency, *damping)):
        index = mode_states(names, name)
        if np.any(np.isin(loops, loops[index]) & ~np.isin(np.arange(len(loops)), index)):
            raise ConfigError(
                f"{name} is in a loop with other states: what a shift changes cannot be told from them",
                hint="shift the plant without the loop, then close it again",
            )
        _shift_block(A, B, index, name, frequency.get(name, 1.0), damping.get(name, 1.0))
    return StateSpace(A, B, system.C, system.D)


def mode_states(names: tuple[str, ...], name: str) -> Int[np.ndarray, " 2"]:
    """The two states of a mode; raises `ConfigError` where there are not two."""
    index = np.flatnonzero(np.array(names) == name)
    if len(index) != 2:
        raise ConfigError(
            f"{name!r} has {len(index)} states, a mode that oscillates has two",
            hint="give every mode a name of its own; shift before delays are approximated",
        )
    return index


def _loops(A: np.ndarray) -> Int[np.ndarray, " state"]:
    """Which states act on each other, directly or through others: one label for each such set."""
    found = cast(
        "tuple[int, np.ndarray]",
        csgraph.connected_components(A != 0.0, directed=True, connection="strong"),
    )
    return found[1]


def _shift_block(
    A: np.ndarray, B: np.ndarray, index: np.ndarray, name: str, frequency: float, damping: float
) -> None:
    """In place. With A = sigma I + omega_d J, J^2 = -I, eigenvectors stay; phi psi / (2 j omega_d) is the
    residue of a mode of real constants, so what drives the block is divided by the change of omega_d."""
    block = A[np.ix_(index, index)]
    sigma, squared = np.trace(block) / 2.0, float(np.linalg.det(block))
    if squared <= sigma**2:
        raise ConfigError(f"{name!r} does not oscillate: it has no frequency to shift")
    omega, zeta = np.sqrt(squared), -damping * sigma / np.sqrt(squared)
    if zeta >= 1.0:
        raise ConfigError(f"{name!r} would not oscillate with {damping:g} times its damping")
    ratio = frequency * np.sqrt((1.0 - zeta**2) / (1.0 - (sigma / omega) ** 2))
    A[index] /= ratio
    B[index] /= ratio
    A[np.ix_(index, index)] = ratio * (block - sigma * np.eye(2)) - zeta * frequency * omega * np.eye(2)


def scale_inputs(plant: Plant, inputs: tuple[str, ...], factor: float) -> Plant:
    """The plant with another gain of some inputs."""
    scale = np.ones(len(plant.inputs))
    scale[plant.input_indices(inputs)] = factor
    return dataclasses.replace(plant, dynamics=_scaled(plant.dynamics, scale))


def _scaled(
    dynamics: ModalSystem | StateSpace, scale: Float[np.ndarray, " input"]
) -> ModalSystem | StateSpace:
    if isinstance(dynamics, ModalSystem):
        direct = None if dynamics.direct is None else dynamics.direct * scale
        return dataclasses.replace(dynamics, psi=dynamics.psi * scale, direct=direct)
    return dataclasses.replace(dynamics, B=dynamics.B * scale, D=dynamics.D * scale)
