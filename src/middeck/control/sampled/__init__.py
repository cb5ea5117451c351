"""Sampled control: direct design and emulation of continuous designs."""

from middeck.control.sampled.aliases import Alias, AliasReport, find_aliases
from middeck.control.sampled.antialias import filter_measurements
from middeck.control.sampled.comparison import SamplingComparison, SamplingRow, compare_sampling
from middeck.control.sampled.design import SampledCost, SampledLQG, design_sampled_lqg, sample_cost
from middeck.control.sampled.emulation import emulate
from middeck.control.sampled.held import HeldPlant, hold_plant
from middeck.control.sampled.outcome import SampledOutcome, measure_sampled_loop

__all__ = [
    "Alias",
    "AliasReport",
    "HeldPlant",
    "SampledCost",
    "SampledLQG",
    "SampledOutcome",
    "SamplingComparison",
    "SamplingRow",
    "compare_sampling",
    "design_sampled_lqg",
    "emulate",
    "filter_measurements",
    "find_aliases",
    "hold_plant",
    "measure_sampled_loop",
    "sample_cost",
]
