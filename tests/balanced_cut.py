"""Balanced truncation of a system as ``reduce_compensator(..., method="balanced")`` cuts a compensator."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from middeck.control.reduction.balanced_projection import balance, in_sizes
from middeck.control.reduction.gramian import factor_gramians
from middeck.control.reduction.methods import find_candidate
from middeck.control.reduction.separation import separate_unstable
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.state_space.statespace import StateSpace


class Cut(NamedTuple):
    system: StateSpace
    order: int
    hankel: np.ndarray
    bound: float
    error: float


def cut_balanced(system, order, *, input_size=None, output_size=None):
    """The error is that of the remainder, in the sizes of the ports (one unless given)."""
    outputs, inputs = system.D.shape
    u = np.ones(inputs) if input_size is None else input_size
    y = np.ones(outputs) if output_size is None else output_size
    # A compensator reads y and gives u: its inputs have the sizes of the loop's measurements.
    found = find_candidate(system, order, "balanced", [SimpleNamespace(input_size=y, output_size=u)])
    error = peak_gain(in_sizes(found.remainder, u, y), beside=found.hankel.max(initial=0.0)).gain
    return Cut(found.law, len(found.law.A), found.hankel, found.bound, error)


def hankel_values(system):
    """Hankel singular values of the part of a system that decays, largest first."""
    return balance(factor_gramians(separate_unstable(system).rest)).hankel
