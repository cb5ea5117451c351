"""Shapes of promised modes, by which a later test identifies them in any order."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import every_channel, sensor_rows
from middeck.structure.modes.solve import Modes
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.refinement.refine import Refined
from middeck.values import record

# Largest number of nodes in a document, in even steps: it has to stay readable.
NODES = 60
# Decimals of readings over the largest of a mode: more would differ between machines.
DECIMALS = 4
# A channel that moves as much as this part of the most moving one decides the sign: not the largest, of
# which symmetric articles have two.
CLEAR = 0.4


@record(kw_only=True)
class PromisedShapes:
    """Channels as of `MeasuredModes`, and their readings of each promised mode, the largest of them one."""

    node: tuple[str, ...]
    direction: tuple[str, ...]
    shape: Float[np.ndarray, "channel mode"]


def promised_shapes(refined: Refined, predicted: Prediction) -> PromisedShapes:
    """Shapes at the channels of the surveys of ``refined``, and at nodes and joints of the article."""
    modes = predicted.modes
    measured = [c.survey.measured for c in refined.compared]
    surveyed = [channel for m in measured for channel in zip(m.node, m.direction, strict=True)]
    seen = [channel for channel in dict.fromkeys(surveyed) if _has(modes, channel)]
    at = list(dict.fromkeys([*seen, *_of_the_article(modes)]))
    node, direction = tuple(n for n, _ in at), tuple(d for _, d in at)
    shape = np.asarray(sensor_rows(modes, node, direction) @ modes.shapes[:, predicted.index])
    return PromisedShapes(node=node, direction=direction, shape=_rounded(shape))


def _of_the_article(modes: Modes) -> list[tuple[str, str]]:
    model = modes.equilibrium.model
    names = [node.name for node in model.structure.nodes]
    left_out = set(names) - set(names[:: -(-len(names) // NODES) or 1])
    return [channel for channel in every_channel(model) if channel[0] not in left_out]


def _has(modes: Modes, channel: tuple[str, str]) -> bool:
    """Whether the article has the channel in this environment: a joint may be held there."""
    try:
        sensor_rows(modes, channel[:1], channel[1:])
    except ConfigError:
        return False
    return True


def _rounded(shape: np.ndarray) -> np.ndarray:
    """The shape with a sign and digits that are equal on every machine."""
    if not shape.size:
        return shape
    size = np.abs(shape)
    largest = size.max(axis=0)
    first = np.argmax(size >= CLEAR * largest, axis=0)
    sign = np.where(np.take_along_axis(shape, first[None], axis=0) < 0.0, -1.0, 1.0)
    return np.round(sign * shape / np.where(largest > 0.0, largest, 1.0), DECIMALS) + 0.0
