"""A law as the rig's computer runs it: from all its outputs to all its inputs, once a tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.signals.ports import Port, port_indices
from middeck.systems.statespace import SampledStateSpace, same_period

Law = SampledStateSpace | Compensator


def place_law(
    law: Law, inputs: Sequence[Port], outputs: Sequence[Port], period_s: float
) -> SampledStateSpace:
    """``law`` on a rig of these ports and this period.

    A compensator finds its ports by name and leaves other inputs at rest; a bare system must have all of them
    in the rig's order. Raises `ConfigError` for ports that the rig lacks, other sizes, another period, or a
    law that is not sampled.

    >>> y, u = Port("y", "rad"), Port("u", "N m")
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.1)
    >>> place_law(Compensator(lag, (y,), (u,)), (Port("v", "N m"), u), (y,), 0.1).D.tolist()
    [[0.0], [-2.0]]
    """
    if isinstance(law, SampledStateSpace):
        check_law(law, len(inputs), len(outputs), period_s)
        return law
    rows = port_indices(inputs, [p.name for p in law.outputs], "input of the rig")
    columns = port_indices(outputs, [p.name for p in law.inputs], "output of the rig")
    into, out = np.eye(len(outputs))[columns], np.eye(len(inputs))[:, rows]
    s = law.sampled
    placed = SampledStateSpace(s.A, s.B @ into, out @ s.C, out @ s.D @ into, period_s=s.period_s)
    check_law(placed, len(inputs), len(outputs), period_s)
    return placed


def check_law(law: SampledStateSpace, inputs: int, outputs: int, period_s: float) -> None:
    """Raise `ConfigError` unless ``law`` has the rig's sizes and period."""
    if law.D.shape != (inputs, outputs) or not same_period(law.period_s, period_s):
        raise ConfigError(
            f"the law has {law.D.shape} outputs and inputs at {law.period_s} s, the rig wants "
            f"{(inputs, outputs)} at {period_s} s",
            hint="a sampled Compensator finds its ports by name; emulate(law, period_s) has the rig's period",
        )
