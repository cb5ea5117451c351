"""Analogue anti-alias filters as part of the plant."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.control.law.partition import partition_modes
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.state_space.statespace import StateSpace

UNFILTERED = "_unfiltered"


def filter_measurements(plant: Plant, section: StateSpace) -> Plant:
    """The plant with ``section`` (one input, one output) behind each of its measurements y.

    The filtered measurement keeps its name. Where it is also a performance output, z reads a copy in front of
    the filter, with the suffix ``_unfiltered``. Inert modes are left out.

    Raises `ConfigError` for a section with more than one input or output.

    >>> from middeck.control.shaping.leads_and_notches import roll_off
    >>> from middeck.signals.ports import Port
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> plant = Plant(dynamics=lag, inputs=(Port("f", "N"),), outputs=(Port("x", "m"),), w=("f",),
    ...     u=("f",), z=("x",), y=("x",))
    >>> filtered = filter_measurements(plant, roll_off(40.0, 2))
    >>> filtered.z, filtered.y, name_states(filtered)
    (('x_unfiltered',), ('x',), ('state 0', 'anti-alias', 'anti-alias'))
    """
    if section.D.shape != (1, 1):
        raise ConfigError(f"the filter has {section.D.shape} outputs and inputs", hint="one of each")
    filtered = _filtered(remove_delays(plant), section)
    return dataclasses.replace(filtered, delay_s=np.vstack([plant.delay_s, plant.delay_s[_shared(plant)]]))


def _shared(plant: Plant) -> list[int]:
    """Rows of the measurements that are performance outputs too."""
    return plant.output_indices([name for name in dict.fromkeys(plant.y) if name in plant.z])


def _filtered(plant: Plant, section: StateSpace) -> Plant:
    active = partition_modes(plant).active
    system, rows, shared = active.system, active.output_indices(active.y), _shared(active)
    one = np.eye(len(rows))
    f = StateSpace(*(np.kron(one, m) for m in (section.A, section.B, section.C, section.D)))
    C = np.hstack([system.C, np.zeros((len(system.C), len(f.A)))])
    C[rows] = np.hstack([f.D @ system.C[rows], f.C])
    D = system.D.copy()
    D[rows] = f.D @ system.D[rows]
    before = np.hstack([system.C[shared], np.zeros((len(shared), len(f.A)))])
    dynamics = StateSpace(
        np.block([[system.A, np.zeros((len(system.A), len(f.A)))], [f.B @ system.C[rows], f.A]]),
        np.vstack([system.B, f.B @ system.D[rows]]),
        np.vstack([C, before]),
        np.vstack([D, system.D[shared]]),
    )
    names = {active.outputs[i].name for i in shared}
    copies = tuple(
        dataclasses.replace(p, name=p.name + UNFILTERED) for p in (active.outputs[i] for i in shared)
    )
    return dataclasses.replace(
        active,
        dynamics=dynamics,
        outputs=(*active.outputs, *copies),
        z=tuple(name + UNFILTERED if name in names else name for name in active.z),
        state_names=(*name_states(active), *("anti-alias",) * len(f.A)),
    )
