"""Modes both uncontrollable and unobservable, set aside by name before a design.

A free translation of a structure driven by torques alone is a double pole at the origin that is neither
reachable nor observed. It belongs to no transfer function, yet it makes both Riccati equations unsolvable;
whether a stock solver then fails or returns noise is luck.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from middeck.control.law.stabilisability import require_reachable
from middeck.systems.plants.mode_blocks import unmix_states
from middeck.systems.plants.plant import Plant, name_states, remove_delays, require_plant, subsystem
from middeck.systems.poles.inert_modes import inert_modes
from middeck.systems.poles.rigid_alignment import align_rigid
from middeck.systems.poles.stability import growth_limits, none_grows
from middeck.systems.poles.state_units import in_units, uneven_units
from middeck.systems.state_space.modal_system import select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record
class ModePartition:
    """A plant without its inert modes.

    Attributes:
        active: The plant of the other modes: the same transfer functions.
        inert: Names of the modes left out, in the order of the plant.
        unit: Units of the states of ``active``, x = unit * x_active; None where they are the plant's.
    """

    active: Plant
    inert: tuple[str, ...]
    unit: Float[np.ndarray, " state"] | None = None


def partition_modes(plant: Plant) -> ModePartition:
    """`set_inert_aside`, the states in like units (`settle_states`)."""
    require_plant(plant)
    part = set_inert_aside(plant)
    system = part.active.dynamics
    if not isinstance(system, StateSpace) or (unit := uneven_units(system)) is None:
        return part
    return ModePartition(dataclasses.replace(part.active, dynamics=in_units(system, unit)), part.inert, unit)


def set_inert_aside(plant: Plant) -> ModePartition:
    """Set aside the modes that are neither controllable from any input nor observable in any output.

    Modal dynamics use `inert_modes`, of rigid modes combined by `align_rigid`; a state space loses the states
    of one name that exact zeros separate from all other states and ports. Modes that grow stay, and so do
    those only uncontrollable or only unobservable: a design then refuses them by name.
    """
    modal = plant.modal
    if modal is None:
        return _partition_states(plant, remove_delays(plant).system)
    modal = align_rigid(modal)
    # An unstable mode stays for verdict and design to name.
    grows = -modal.zeta * modal.omega > growth_limits(1j * modal.omega)
    inert = inert_modes(modal) & ~grows
    names = tuple(name for name, out in zip(modal.names, inert, strict=True) if out)
    active = dataclasses.replace(plant, dynamics=select_modes(modal, ~inert)) if names else plant
    return ModePartition(active, names)


def pose_states(plant: Plant, *, driven: bool = True) -> Plant:
    """The plant in unmixed states (`unmix_states`), for a design, which squares their condition.

    Raises `NotStabilisableError` where a mode of mixed states does not decay and no measurement sees it (no
    input reaches it, where the plant is to be ``driven``).
    """
    unmixed, condition = unmix_states(plant)
    if condition > 1.0:
        # In the states given: in others rounding of what is zero has the size of weak modes.
        names, loop = name_states(plant), subsystem(remove_delays(plant), plant.u, plant.y)
        require_reachable(loop.A.T, loop.C.T, names, mixed=True, complaint="no measurement in y sees it")
        if driven:
            require_reachable(loop.A, loop.B, names, mixed=True, complaint="no control input in u reaches it")
    return unmixed


def _partition_states(plant: Plant, system: StateSpace) -> ModePartition:
    names = np.array(name_states(plant), dtype=object)
    at_ports = np.any(system.B, axis=1) | np.any(system.C, axis=0)
    quiet = dict.fromkeys(names[~at_ports])
    inert = tuple(name for name in quiet if _is_alone(system, names == name))
    if not inert:
        return ModePartition(plant, ())
    kept = np.flatnonzero([name not in inert for name in names])
    active = StateSpace(system.A[np.ix_(kept, kept)], system.B[kept], system.C[:, kept], system.D)
    return ModePartition(dataclasses.replace(plant, dynamics=active, state_names=tuple(names[kept])), inert)


def _is_alone(system: StateSpace, own: Bool[np.ndarray, " state"]) -> bool:
    """Whether the states ``own`` meet exact zeros only, and do not grow."""
    joined = (system.A[own][:, ~own], system.A[~own][:, own], system.B[own], system.C[:, own])
    return not any(np.any(part) for part in joined) and none_grows(
        np.linalg.eigvals(system.A[own][:, own]).astype(complex)
    )
