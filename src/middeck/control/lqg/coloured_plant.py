"""Plants under coloured disturbances, for evaluating a loop under the spectra assumed in its design."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.control.law.partition import partition_modes
from middeck.control.lqg.design_model import put_beside
from middeck.control.lqg.shaping import PortFilters, Shaping, pick
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.state_space.statespace import StateSpace


def colour_disturbances(plant: Plant, colours: PortFilters) -> Plant:
    """The plant with filters in front of disturbances: its group w becomes the white noises that drive them.

    The noises are inputs ``"noise of NAME"`` (numbered where a filter takes several) and replace their
    disturbances in w; the original inputs remain, so that commands are not coloured. Inert modes are left
    out. Raises `ConfigError` for filters that are not stable or at ports that are not in w.
    """
    Shaping(colours=colours)  # its checks
    active = partition_modes(plant).active
    chosen = [(n, f) for n, f in zip(active.w, pick(colours, active.w), strict=True) if f is not None]
    if not chosen:
        return active
    system, colour = active.system, put_beside([one for _, one in chosen])
    drive = system.B[:, active.input_indices([name for name, _ in chosen])]
    through = system.D[:, active.input_indices([name for name, _ in chosen])]
    states = np.zeros((len(colour.A), len(active.inputs)))
    dynamics = StateSpace(
        np.block([[colour.A, np.zeros((len(colour.A), len(system.A)))], [drive @ colour.C, system.A]]),
        np.block([[states, colour.B], [system.B, drive @ colour.D]]),
        np.hstack([through @ colour.C, system.C]),
        np.hstack([system.D, through @ colour.D]),
    )
    noises_of = {name: _noise_names(name, one.D.shape[1]) for name, one in chosen}
    noises = tuple(Port(noise, "1") for names in noises_of.values() for noise in names)
    return dataclasses.replace(
        active,
        dynamics=dynamics,
        inputs=(*active.inputs, *noises),
        w=tuple(noise for name in active.w for noise in noises_of.get(name, [name])),
        state_names=(
            *(f"colour of {name}" for name, one in chosen for _ in range(len(one.A))),
            *name_states(active),
        ),
    )


def _noise_names(port: str, count: int) -> list[str]:
    return [f"noise of {port}" + (f" {k + 1}" if count > 1 else "") for k in range(count)]
