"""From a measurement model to a plant: modal states, delays by Pade or exactly sampled, ports by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.model.selection import select_channels
from middeck.identification.plants.modal_states import modal_statespace, state_names
from middeck.systems.delay_approximation import SAME_DELAY_S, approximate_delays, join_channels
from middeck.systems.delayed_sampling import is_sum
from middeck.systems.plant import Plant, delay_plant
from middeck.systems.sampled_plant import sample_plant
from middeck.systems.statespace import StateSpace

Named = tuple[StateSpace, tuple[str, ...]]


def measured_plant(
    model: MeasurementModel,
    *,
    pade_order: int = 3,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model: block-modal states and the states of its delays.

    A delay common to all paths is put on the side with fewer channels, so that a model with one input needs
    ``pade_order`` states for it in all; what an input or an output is late beyond that needs as many each:
    `merge_delays` makes those of a fit one that it does not tell apart, ``fit_response(..., delay="common")``
    fits one.
    Delays that are no sum of one for the input and one for the output give each channel of the smaller side
    modes of its own. Rigid-body modes have the states q and q'. The term L / s^2 of modes below the band is
    left out: it is no part of the plant, only of its neighbourhood.

    Raises
    ------
    ConfigError
        For a sampled model, a Pade order below one or an unknown port.
    """
    _check_continuous(model)
    system, names = _with_delays(model, pade_order)
    return Plant(system, model.inputs, model.outputs, tuple(w), tuple(u), tuple(z), tuple(y), names)


def delayed_plant(
    model: MeasurementModel,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model with its delays as they are: for evaluation, margins and sampling.

    Where ``model.hold_s`` is None and its data had held inputs, half a period of that hold is in the delays:
    sampled, it would count twice.

    Raises
    ------
    ConfigError
        For a sampled model or an unknown port.
    """
    _check_continuous(model)
    groups = tuple(w), tuple(u), tuple(z), tuple(y)
    plant = Plant(modal_statespace(model), model.inputs, model.outputs, *groups, state_names(model))
    return delay_plant(plant, path_delay(model))


def sampled_plant(
    model: MeasurementModel,
    period_s: float,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """What a computer of the period ``period_s`` sees of a continuous model: exact, delays included.

    Inputs are held from one instant to the next, outputs are sampled at the instants, so that the hold's own
    half period comes on top of the model's delays: they must not have it already (``model.hold_s``).

    Raises
    ------
    ConfigError
        For a sampled model, a period that is not positive or an unknown port.
    """
    return sample_plant(delayed_plant(model, w=w, u=u, z=z, y=y), period_s)


def _check_continuous(model: MeasurementModel) -> None:
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit it without sample_hz, or take sampled_statespace",
        )


def _with_delays(model: MeasurementModel, order: int) -> Named:
    delay_s = path_delay(model)
    if is_sum(delay_s, SAME_DELAY_S):
        return _approximated(model, delay_s, order)
    # One channel of the smaller side at a time, each with the modes on its own paths alone.
    by_input = len(model.inputs) <= len(model.outputs)
    parts: list[Named] = []
    for k, port in enumerate(model.inputs if by_input else model.outputs):
        one = (port.name,)
        alone = select_channels(model, inputs=one) if by_input else select_channels(model, outputs=one)
        parts.append(_approximated(alone.model, delay_s[:, [k]] if by_input else delay_s[[k]], order))
    return join_channels(parts, by_input=by_input)


def _approximated(model: MeasurementModel, delay_s: np.ndarray, order: int) -> Named:
    on_time = Plant(modal_statespace(model), model.inputs, model.outputs, state_names=state_names(model))
    late = approximate_delays(delay_plant(on_time, delay_s), order)
    return late.system, late.state_names
