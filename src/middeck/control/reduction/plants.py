"""Plants of lower order, rigid modes kept by name."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.control.law.partition import partition_modes
from middeck.control.reduction.balanced import Sizes, reduce_balanced
from middeck.control.reduction.result import ReducedPlant, Reduction, Rest
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal import ModalSystem, modal_to_statespace, select_modes
from middeck.systems.state_space.statespace import StateSpace, add


def reduce_plant(
    plant: Plant,
    order: int | None = None,
    *,
    bound: float | None = None,
    rest: Rest = "truncate",
    input_size: Sizes | None = None,
    output_size: Sizes | None = None,
) -> ReducedPlant:
    """The plant with fewer states by balanced reduction of its decaying part; same ports and groups.

    Inert modes are removed first. Rigid modes of a modal plant (by name) and all other poles that do not
    decay are kept exactly and count in the order. Sizes, ``bound`` and ``rest`` as for `reduce_balanced`:
    give sizes where ports differ in unit, e.g. rad beside rad/s.
    """
    active = partition_modes(plant).active
    rigid, names, flexible = _set_rigid_aside(active)
    if order is not None and order < len(rigid.A):
        raise ConfigError(
            f"order {order} is too low: {len(rigid.A)} states of rigid modes are kept: {', '.join(names)}",
            hint=f"an order from {len(rigid.A)}, or leave modes out of the plant",
        )
    found = reduce_balanced(
        flexible,
        None if order is None else order - len(rigid.A),
        bound=bound,
        rest=rest,
        input_size=input_size,
        output_size=output_size,
    )
    whole = add(rigid, found.system)
    states = (*(name for name in names for _ in range(2)), *_state_names(found))
    smaller = dataclasses.replace(active, dynamics=whole, state_names=states)
    kept = (*names, *(f"kept {i}" for i in range(found.kept)))
    return ReducedPlant(
        plant=smaller,
        order=len(whole.A),
        method=found.method,
        kept=kept,
        dropped=(),
        hankel=found.hankel,
        bound=found.bound,
        error=found.error,
        error_hz=found.error_omega / (2.0 * np.pi),
    )


def _set_rigid_aside(plant: Plant) -> tuple[StateSpace, tuple[str, ...], StateSpace]:
    modal = plant.rational
    if not isinstance(modal, ModalSystem):
        empty = StateSpace(
            np.zeros((0, 0)), np.zeros((0, len(plant.inputs))), np.zeros((len(plant.outputs), 0)),
            np.zeros((len(plant.outputs), len(plant.inputs))),
        )  # fmt: skip
        return empty, (), modal
    rigid = modal.omega == 0.0
    aside = dataclasses.replace(select_modes(modal, rigid), direct=None)
    return modal_to_statespace(aside), aside.names, modal_to_statespace(select_modes(modal, ~rigid))


def _state_names(found: Reduction) -> tuple[str, ...]:
    balanced = found.order - found.kept
    return (*(f"kept {i}" for i in range(found.kept)), *(f"balanced {i}" for i in range(balanced)))
