"""What a sampled design returns: a law from sampled measurements to held inputs, and when it acts."""

from __future__ import annotations

import numpy as np

from middeck.signals.ports import Port
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record


@record
class SampledCompensator:
    """u[k] from y[k] and what came before, added at the plant's inputs and held until u[k+1].

    Parameters
    ----------
    system:
        The law, from ``inputs`` to ``outputs``.
    inputs:
        Plant outputs that are sampled, in the order of the columns.
    outputs:
        Plant inputs that are driven, in the order of the rows.
    method:
        How it was made, in a word or two.
    """

    system: SampledStateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    method: str

    def __post_init__(self) -> None:
        if self.system.D.shape != (len(self.outputs), len(self.inputs)):
            raise ValueError(
                f"SampledCompensator: {len(self.outputs)} outputs and {len(self.inputs)} inputs named, "
                f"the system has {self.system.D.shape}"
            )

    @property
    def period_s(self) -> float:
        """Time from one sample to the next [s]."""
        return self.system.period_s

    @property
    def own_delay_s(self) -> float:
        """From a sample to the first input that it moves [s]: none, or a whole period to compute in."""
        return 0.0 if np.any(self.system.D) else self.system.period_s
