"""From a measurement model to a plant: block-modal states, delays exact, ports by name."""

from __future__ import annotations

from collections.abc import Sequence

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.modal_states import modal_statespace, state_names
from middeck.systems.plant import Plant


def measured_plant(
    model: MeasurementModel,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model, its delays as they are.

    Verdicts take it so. A design of finite order takes ``approximate_delays(plant, 3)``, whose states are few
    where a path is delayed by its input plus its output: `merge_delays` makes the delays of a fit one that it
    does not tell apart, ``fit_response(..., delay="common")`` fits one. A computer sees
    ``sample_plant(plant, period_s)``, whose hold comes on top of the delays. Where ``model.hold_s`` is None
    and its data had held inputs, half a period of that hold is in the delays: sampled, it would count twice.

    States are block-modal; rigid-body modes have q and q'. The term L / s^2 of modes below the band is left
    out: it is no part of the plant, only of its neighbourhood.

    Raises `ConfigError` for a sampled model or an unknown port.
    """
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit it without sample_hz, or take sampled_statespace",
        )
    return Plant(
        dynamics=modal_statespace(model),
        inputs=model.inputs,
        outputs=model.outputs,
        w=tuple(w),
        u=tuple(u),
        z=tuple(z),
        y=tuple(y),
        state_names=state_names(model),
        delay_s=path_delay(model),
    )
