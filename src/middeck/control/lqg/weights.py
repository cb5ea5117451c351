"""Cost weights and noise intensities of LQG designs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.loop.performance import require_intensity, require_one_each
from middeck.errors import ConfigError
from middeck.signals.ports import require_names
from middeck.systems.plants.plant import Plant
from middeck.values import record


@record(kw_only=True)
class LQGWeights:
    """Weights of the cost E[z' W^2 z + rho u' diag(input) u], and noise intensities.

    Attributes:
        output: Weight W of each performance output, in the order of the plant's group z (z is multiplied by
            it).
        input: Weight of each squared control input, in the order of the group u.
        disturbed: Names of the inputs on which white process noise acts.
        process: Its two-sided intensity matrix [unit^2/Hz], in that order.
        sensor: Two-sided intensity [unit^2/Hz] of each measurement's white noise, in the order of the group
            y. Process and sensor noise are independent.
    """

    output: Float[np.ndarray, " z"]
    input: Float[np.ndarray, " u"]
    disturbed: tuple[str, ...]
    process: Float[np.ndarray, "w w"]
    sensor: Float[np.ndarray, " y"]

    def __post_init__(self) -> None:
        require_names(self.disturbed, "disturbed")
        if len(self.disturbed) != len(self.process):
            raise ConfigError(
                f"{len(self.disturbed)} disturbed inputs for {len(self.process)} intensities",
                hint="one row and column of the process intensity for each name in disturbed",
            )
        if not all(np.all(np.isfinite(a)) for a in (self.output, self.input, self.process, self.sensor)):
            raise ConfigError(
                "a weight or an intensity is not a finite number",
                hint="finite ones; 0 for an output left alone",
            )
        if not np.all(self.input > 0.0):
            raise ConfigError(
                "an input weight is not positive: the control would be unbounded",
                hint="give every input a positive weight, or remove it from u",
            )
        if not np.all(self.sensor > 0.0):
            raise ConfigError(
                "a sensor noise intensity is not positive: the filter would be singular",
                hint="give every measurement some noise, or remove it from y",
            )
        require_intensity("the process intensity", self.process)


def require_sizes(weights: LQGWeights, plant: Plant) -> None:
    """Raise `ConfigError` unless there is one weight, or intensity, for each port of its group."""
    for what, given, group in (
        ("output weights", weights.output, plant.z),
        ("input weights", weights.input, plant.u),
        ("sensor intensities", weights.sensor, plant.y),
    ):
        if not group:
            raise ConfigError(
                f"{len(given)} {what}, but that group of the plant is empty",
                hint="name its groups: w=, u=, z=, y=",
            )
        require_one_each(what, len(given), group)
