"""From a measurement model to a plant: modal states, delays by Pade or exactly sampled, ports by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.identification.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.modal_states import block, modal_statespace, state_names
from middeck.identification.plants.selection import select_channels
from middeck.systems.delay import pade
from middeck.systems.delayed_sampling import is_sum, sample_delayed, split_delays
from middeck.systems.plant import Plant
from middeck.systems.ports import Port, port_indices
from middeck.systems.statespace import SampledStateSpace, StateSpace, series
from middeck.values import record

# Delays that differ by less [s] are one: far below what any record can tell.
SAME_DELAY_S = 1e-12

Named = tuple[StateSpace, tuple[str, ...]]


@record
class SampledPlant:
    """A plant as a computer sees it: inputs held, outputs sampled, delays exact.

    Parameters
    ----------
    system:
        From held inputs to sampled outputs; states as in `sample_delayed`.
    inputs, outputs, w, u, z, y, state_names:
        As in `Plant`.
    """

    system: SampledStateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    w: tuple[str, ...]
    u: tuple[str, ...]
    z: tuple[str, ...]
    y: tuple[str, ...]
    state_names: tuple[str, ...]


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


def sampled_plant(
    model: MeasurementModel,
    period_s: float,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> SampledPlant:
    """What a computer of the period ``period_s`` sees of a continuous model: exact, delays included.

    Inputs are held from one instant to the next, outputs are sampled at the instants, so that the hold's own
    half period comes on top of the model's delays.

    Raises
    ------
    ConfigError
        For a sampled model, a period that is not positive or an unknown port.
    """
    _check_continuous(model)
    for ports, names, side in ((model.inputs, (*w, *u), "input"), (model.outputs, (*z, *y), "output")):
        port_indices(ports, names, side)
    delay_s = path_delay(model)
    system = sample_delayed(modal_statespace(model), period_s, delay_s)
    modes = state_names(model) * (1 if is_sum(delay_s / period_s) else len(model.inputs))
    names = (*modes, *("delay",) * (len(system.A) - len(modes)))
    return SampledPlant(system, model.inputs, model.outputs, tuple(w), tuple(u), tuple(z), tuple(y), names)


def _check_continuous(model: MeasurementModel) -> None:
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit without sample_hz (identify --continuous), or take sampled_statespace",
        )


def _with_delays(model: MeasurementModel, order: int) -> Named:
    delay_s = path_delay(model)
    if is_sum(delay_s, SAME_DELAY_S):
        return _late_channels(model, delay_s, order)
    # One channel of the smaller side at a time: its paths are late by one side's delays alone.
    by_input = len(model.inputs) <= len(model.outputs)
    ports = model.inputs if by_input else model.outputs
    parts: list[Named] = []
    for k, port in enumerate(ports):
        one = (port.name,)
        alone = select_channels(model, inputs=one) if by_input else select_channels(model, outputs=one)
        late = delay_s[:, [k]] if by_input else delay_s[[k]]
        parts.append(_late_channels(alone.model, late, order))
    names = tuple(name for _, names in parts for name in names)
    return _join([system for system, _ in parts], by_input=by_input), names


def _join(systems: Sequence[StateSpace], *, by_input: bool) -> StateSpace:
    """Systems of one input each, their outputs added, or of one output each, driven by the same inputs."""
    side_by_side, stacked = (block, np.hstack) if by_input else (np.vstack, block)
    return StateSpace(
        block([s.A for s in systems]),
        side_by_side([s.B for s in systems]),
        stacked([s.C for s in systems]),
        (np.hstack if by_input else np.vstack)([s.D for s in systems]),
    )


def _late_channels(model: MeasurementModel, delay_s: np.ndarray, order: int) -> Named:
    """Delays that are sums: inputs' delays in front, outputs' delays behind, the common one on one side."""
    split = split_delays(delay_s)
    of_input, of_output = split.input_s, split.output_s
    if len(of_input) < len(of_output):
        common = of_output.min()
        of_input, of_output = of_input + common, of_output - common
    before, after = (_late(side, order) for side in (of_input, of_output))
    system = series(series(before, modal_statespace(model)), after)
    names = (*("delay",) * len(before.A), *state_names(model), *("delay",) * len(after.A))
    return system, names


def _late(delay_s: Float[np.ndarray, " channel"], order: int) -> StateSpace:
    """A Pade approximation for each channel, none for those that are on time."""
    each = [pade(tau if tau > SAME_DELAY_S else 0.0, order) for tau in delay_s]
    return StateSpace(*(block([getattr(s, name) for s in each]) for name in "ABCD"))
