"""Pairs of measured modes and modes of the model, by shape and nearness in frequency."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.frequency_pairs import pair_frequencies
from middeck.structure.correlation.measured_modes import MeasuredModes, seen, sensor_rows
from middeck.structure.modes.solve import Modes

# Least common part of a measured shape and the shape of the model that is paired with it.
COMMON = 0.4
# No measured mode is a mode of twice its frequency.
WINDOW = 2.0


def at_channels(modes: Modes, measured: MeasuredModes) -> Float[np.ndarray, "channel mode"]:
    """Readings of the test's channels in each mode."""
    return seen(sensor_rows(modes, measured.node, measured.direction), modes)


def pair(
    modes: Modes, measured: MeasuredModes, columns: Int[np.ndarray, "row measured"] | None = None
) -> Int[np.ndarray, "pair 2"]:
    """Pairs, one to one: by shape and nearness in frequency; without shapes by frequency alone.

    ``columns`` are the modes that each measured mode may be, those of one row as one; else all may be any.
    """
    hz = modes.frequency_hz
    if columns is None:
        columns = np.repeat(np.flatnonzero(hz > 0.0)[:, None], len(measured.frequency_hz), axis=1)
    if measured.node:
        apart = np.abs(np.log(np.maximum(hz[columns], np.finfo(float).tiny) / measured.frequency_hz))
        alike = modal_assurance(at_channels(modes, measured), measured.shape)
        found = pair_shapes(np.take_along_axis(alike, columns, axis=0), apart)
    else:
        found = pair_frequencies(hz[columns], measured.frequency_hz)
    row, of = found[np.argsort(found[:, 1], kind="stable")].T
    return np.stack([columns[row, of], of], axis=1)


def pair_shapes(
    alike: Float[np.ndarray, "mode measured"], apart: Float[np.ndarray, "mode measured"]
) -> Int[np.ndarray, "pair 2"]:
    """Pairs, one to one, from the MAC of all with all and the distances of log frequencies."""
    # At few channels modes far apart look alike: of two that do the nearer one counts. In squares, so that
    # pairs of modes that all look alike rise together: the sum of distances is the same where they cross.
    near = np.maximum(1.0 - (apart / np.log(WINDOW)) ** 2, 0.0)
    i, j = linear_sum_assignment(alike * near, maximize=True)
    kept = (alike[i, j] >= COMMON) & (near[i, j] > 0.0)
    return np.stack([i[kept], j[kept]], axis=1)
