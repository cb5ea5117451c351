"""Sampled control: the continuous problem as a computer meets it, solved directly or emulated."""

from middeck.control.sampled.compensator import SampledCompensator
from middeck.control.sampled.design import SampledCost, SampledLQG, design_sampled_lqg, sample_cost
from middeck.control.sampled.emulation import emulate
from middeck.control.sampled.held import HeldPlant, hold_plant
from middeck.control.sampled.outcome import SampledOutcome, measure_sampled_loop

__all__ = [
    "HeldPlant",
    "SampledCompensator",
    "SampledCost",
    "SampledLQG",
    "SampledOutcome",
    "design_sampled_lqg",
    "emulate",
    "hold_plant",
    "measure_sampled_loop",
    "sample_cost",
]
