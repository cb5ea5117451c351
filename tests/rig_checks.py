"""What tests of the rig share: bare laws to hand it, runs of it, what its blocks hold, errors alone."""

from __future__ import annotations

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.laboratory.hidden_errors import HiddenErrors
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.simulate_rig import cut_blocks, simulate_rig
from middeck.laboratory.rig.ticks.state import RigState
from middeck.systems.state_space.statespace import SampledStateSpace


def hidden(**changes) -> HiddenErrors:
    """No errors but these."""
    none = {
        "modulus": 1.0, "strut": (), "mass": (), "inertia": (), "payload_inertia": (), "payload_cg": (),
        "bounce": 1.0, "cable_length": 1.0, "damping": np.zeros(400), "delay_s": 0.0, "gain": (),
    }  # fmt: skip
    return HiddenErrors(**none | changes)


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
    names = ("measured", "readings", "control", "torque", "momentum")
    joined = {n: np.concatenate([getattr(b, n) for b in blocks]) for n in names}
    return joined | {"state": blocks[-1].state}
