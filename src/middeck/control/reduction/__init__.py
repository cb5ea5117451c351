"""Reduction of plants and compensators, with error bound, actual error and stability of the loop."""

from middeck.control.reduction.balanced import hankel_values, reduce_balanced
from middeck.control.reduction.compensators import reduce_compensator
from middeck.control.reduction.modal import reduce_modes
from middeck.control.reduction.plants import reduce_plant
from middeck.control.reduction.result import ReducedCompensator, ReducedPlant, Reduction
from middeck.control.reduction.weighted import reduce_weighted

__all__ = [
    "ReducedCompensator",
    "ReducedPlant",
    "Reduction",
    "hankel_values",
    "reduce_balanced",
    "reduce_compensator",
    "reduce_modes",
    "reduce_plant",
    "reduce_weighted",
]
