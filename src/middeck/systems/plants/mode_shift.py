"""Shifts of modes of a plant in frequency and damping."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

ROUNDING = 1e-9
"""Fraction of a row that counts as rounding."""


def shift_modes(
    plant: Plant, frequency: Mapping[str, float], damping: Mapping[str, float] | None = None
) -> Plant:
    """The plant with natural frequencies and damping ratios of named modes multiplied by factors.

    A shift keeps the damping ratio, ``damping`` keeps the frequency. The forces psi u of q'' + 2 zeta omega
    q' + omega^2 q = psi u stay, and so do the outputs of q and q'. A plant without modal form needs
    ``state_names`` and, for each mode named, two states that are in no loop with others; q is then the
    coordinate that the strongest input does not move immediately.

    Raises `ConfigError` for modes that do not exist, do not oscillate, or are in a loop with other states
    (shift the plant without the loop and close it again); outside modal form, for outputs that read q''; and
    for factors that are not positive.

    >>> from middeck.signals.ports import Port
    >>> modal = ModalSystem(omega=[2.0], zeta=[0.01], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]],
    ...     names=("bending",))
    >>> plant = Plant(dynamics=modal, inputs=(Port("force", "N"),), outputs=(Port("way", "m"),))
    >>> shift_modes(plant, {"bending": 1.02}).dynamics.omega
    array([2.04])
    """
    damping = damping or {}
    known = name_states(plant)
    unknown = [name for name in (*frequency, *damping) if name not in known]
    if unknown:
        named = plant.modal is not None or plant.state_names
        raise ConfigError(
            f"no mode named {', '.join(map(repr, unknown))}",
            hint=f"one of {', '.join(dict.fromkeys(known))}"
            if named
            else "part_modes(plant) names its modes",
        )
    if not all(np.isfinite(f) and f > 0.0 for f in (*frequency.values(), *damping.values())):
        raise ConfigError(
            "a factor on a frequency or a damping ratio is not positive and finite",
            hint="factors above zero, such as 0.95",
        )
    dynamics = plant.continuous
    if isinstance(dynamics, ModalSystem):
        return dataclasses.replace(plant, dynamics=_shift_modal(dynamics, frequency, damping))
    return dataclasses.replace(plant, dynamics=_shift_blocks(plant, dynamics, frequency, damping))


def _shift_modal(
    modal: ModalSystem, frequency: Mapping[str, float], damping: Mapping[str, float]
) -> ModalSystem:
    rigid = [n for n, omega in zip(modal.names, modal.omega, strict=True) if n in frequency and not omega]
    if rigid:
        raise ConfigError(f"{', '.join(rigid)}: a rigid mode has no frequency to shift", hint="leave it out")
    omega = modal.omega * np.array([frequency.get(n, 1.0) for n in modal.names])
    return dataclasses.replace(
        modal, omega=omega, zeta=modal.zeta * np.array([damping.get(n, 1.0) for n in modal.names])
    )


def _shift_blocks(
    plant: Plant, system: StateSpace, frequency: Mapping[str, float], damping: Mapping[str, float]
) -> StateSpace:
    A, names = system.A.copy(), name_states(plant)
    for name in dict.fromkeys((*frequency, *damping)):
        index = mode_states(names, name)
        if _is_in_a_loop(system.A, index):
            raise ConfigError(
                f"{name} is in a loop with other states: the effect of a shift cannot be separated from them",
                hint="shift the plant without the loop, then close it again",
            )
        at = mode_coordinates(system.A, system.B, index, name)
        _refuse_accelerations(plant, system, index, at, name)
        f, g = frequency.get(name, 1.0), damping.get(name, 1.0)
        if g * at.zeta >= 1.0:
            raise ConfigError(
                f"{name!r} would not oscillate with {g:g} times its damping", hint="a smaller factor"
            )
        less = (1.0 - f**2) * at.omega**2 * at.position + (1.0 - f * g) * 2.0 * at.zeta * at.omega * at.rate
        A[np.ix_(index, index)] += np.outer(at.push, less)
    return StateSpace(A, system.B, system.C, system.D)


@record(kw_only=True)
class ModeCoordinates:
    """Coordinates q and q' of the two states of a mode, with q'' + 2 zeta omega q' + omega^2 q = force.

    Attributes:
        push: Change of the two states' rates by a unit force.
        position, rate: Rows that read q and q': position @ push = 0, rate @ push = 1.
    """

    push: Float[np.ndarray, " 2"]
    position: Float[np.ndarray, " 2"]
    rate: Float[np.ndarray, " 2"]
    omega: float
    zeta: float


def mode_coordinates(A: np.ndarray, B: np.ndarray, index: np.ndarray, name: str) -> ModeCoordinates:
    """Coordinates of the mode with the states ``index``; raises `ConfigError` where it does not oscillate."""
    block = A[np.ix_(index, index)]
    pushes = np.hstack([B[index], A[index][:, _others(A, index)]])
    # Without any input, the second state counts as the rate.
    push = np.linalg.svd(pushes)[0][:, 0] if np.any(pushes) else np.array([0.0, 1.0])
    decay, squared = -float(np.trace(block)) / 2.0, float(np.linalg.det(block))
    if squared <= decay**2:
        raise ConfigError(
            f"{name!r} does not oscillate: it has no frequency to shift",
            hint="a mode with a pair of complex poles",
        )
    omega, aside = float(np.sqrt(squared)), np.array([-push[1], push[0]])
    position = aside / float(aside @ block @ push)
    return ModeCoordinates(
        push=push, position=position, rate=position @ block, omega=omega, zeta=decay / omega
    )


def _refuse_accelerations(
    plant: Plant, system: StateSpace, index: np.ndarray, at: ModeCoordinates, name: str
) -> None:
    """Refuse rows that read q'' = force - 2 zeta omega q' - omega^2 q: those with a direct term, whose part
    of q' is 2 zeta of that of omega q."""
    others = _others(system.A, index)
    driven = np.any(system.B[index], axis=0)
    direct = np.any(np.vstack([system.D, system.B[others]])[:, driven], axis=1)
    rows = np.vstack([system.C, system.A[others]])[:, index]
    read = rows @ np.linalg.inv(np.vstack([at.omega * at.position, at.rate]))
    off = np.abs(read[:, 1] - 2.0 * at.zeta * read[:, 0])
    size = np.linalg.norm(read, axis=1)
    found = np.flatnonzero(direct & (size > 0.0) & (off <= (0.2 * abs(at.zeta) + ROUNDING) * size))
    if len(found):
        names = (*(p.name for p in plant.outputs), *(name_states(plant)[i] for i in others))
        raise ConfigError(
            f"{names[found[0]]} reads the acceleration of {name}, which outside modal form cannot be parted "
            "from that of other modes",
            hint="shift the plant in modal form, or without its accelerometers",
        )


def mode_states(names: tuple[str, ...], name: str) -> Int[np.ndarray, " 2"]:
    """The two states of a mode; raises `ConfigError` where there are not two."""
    index = np.flatnonzero(np.array(names) == name)
    if len(index) != 2:
        raise ConfigError(
            f"{name!r} has {len(index)} states, a mode that oscillates has two",
            hint="give every mode a name of its own; shift before delays are approximated",
        )
    return index


def _others(A: np.ndarray, index: np.ndarray) -> Int[np.ndarray, " state"]:
    return np.delete(np.arange(len(A)), index)


def _is_in_a_loop(A: np.ndarray, index: np.ndarray) -> bool:
    """Whether the states ``index`` are in a strongly connected component with others."""
    others = _others(A, index)
    if not (A[index][:, others].any() and A[others][:, index].any()):
        return False
    own = [np.isin(loop, index) for loop in strong_components(A)]
    return any(np.any(one) and not np.all(one) for one in own)


def natural_hz(plant: Plant) -> dict[str, float]:
    """The natural frequency [Hz] of each mode of modal form that has one, else of each that oscillates."""
    inside = remove_delays(plant)
    if inside.modal is not None:
        each = zip(inside.modal.names, inside.modal.omega, strict=True)
        return {name: float(omega / (2.0 * np.pi)) for name, omega in each if omega > 0.0}
    names, A = np.array(name_states(plant)), inside.system.A
    found: dict[str, float] = {}
    for name in dict.fromkeys(names.tolist()):
        index = np.flatnonzero(names == name)
        values = np.linalg.eigvals(A[np.ix_(index, index)])
        if len(index) == 2 and np.any(np.imag(values)):
            found[name] = float(np.abs(values[0]) / (2.0 * np.pi))
    return found


def scale_inputs(plant: Plant, inputs: tuple[str, ...], factor: float) -> Plant:
    """The plant with another gain of some inputs."""
    scale = np.ones(len(plant.inputs))
    scale[plant.input_indices(inputs)] = factor
    return dataclasses.replace(plant, dynamics=plant.continuous.scale_inputs(scale))
