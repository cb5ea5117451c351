"""The compensator as the rig's computer runs it: from all its outputs to all its inputs, once a tick."""

from collections.abc import Sequence

import numpy as np

from middeck.control.law.compensator import Compensator, locate_ports
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace, same_period


def place_law(
    law: Compensator | None, inputs: Sequence[Port], outputs: Sequence[Port], period_s: float
) -> SampledStateSpace:
    """``law`` from all outputs to all inputs of a rig of this period; None commands nothing.

    A compensator finds its ports by name and leaves other inputs at rest. Raises `ConfigError` for ports that
    the rig lacks or has in another unit, another period, or a compensator that is not sampled.

    >>> y, u = Port("y", "rad"), Port("u", "N m")
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.1)
    >>> place_law(Compensator(lag, (y,), (u,)), (Port("v", "N m"), u), (y,), 0.1).D.tolist()
    [[0.0], [-2.0]]
    """
    if law is None:
        p, m = len(outputs), len(inputs)
        return SampledStateSpace(
            np.zeros((0, 0)), np.zeros((0, p)), np.zeros((m, 0)), np.zeros((m, p)), period_s=period_s
        )
    rows, columns = locate_ports(law, inputs, outputs, "rig")
    into, out = np.eye(len(outputs))[columns], np.eye(len(inputs))[:, rows]
    s = law.sampled
    if not same_period(s.period_s, period_s):
        raise ConfigError(
            f"the compensator is sampled at {s.period_s} s, the rig at {period_s} s",
            hint="emulate(compensator, period_s) of the continuous design has the rig's period",
        )
    return SampledStateSpace(s.A, s.B @ into, out @ s.C, out @ s.D @ into, period_s=period_s)
