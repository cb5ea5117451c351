"""What several tests of the rig do: hand it bare laws, step it, and join what its blocks hold."""

from __future__ import annotations

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.simulation import cut_blocks, simulate_rig
from middeck.laboratory.rig.ticks.state import RigState
from middeck.systems.state_space.statespace import SampledStateSpace


def on_rig(rig: Rig, law: SampledStateSpace | None) -> Compensator | None:
    """A law from all outputs of ``rig`` to all its inputs, in their order, as a compensator."""
    return None if law is None else Compensator(law, rig.outputs, rig.inputs)


def run_through(
    rig: Rig,
    law: SampledStateSpace | None,
    u: np.ndarray,
    rng: np.random.Generator | None = None,
    size: int = 777,
    start: RigState | None = None,
) -> dict[str, np.ndarray]:
    """All that the blocks of a run hold, by name, and the ``state`` at its end."""
    rng = np.random.default_rng(0) if rng is None else rng
    blocks = list(simulate_rig(rig, on_rig(rig, law), cut_blocks(u, size), rng, start))
    joined = {n: np.concatenate([getattr(b, n) for b in blocks]) for n in blocks[0]._fields[:-1]}
    return joined | {"state": blocks[-1].state}
