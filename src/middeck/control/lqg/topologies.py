"""Comparison of sensor and actuator topologies on one plant and one cost."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from middeck.control.loop.closed_loop import close_loop, leave_open
from middeck.control.loop.performance import Performance, commands_rms, loop_metric
from middeck.control.lqg.levels import design_levels
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.values import record

Topology = tuple[Sequence[str], Sequence[str]]
"""Names of the inputs that are driven and of the outputs that are read: SISO one each, SITO one and two."""


@record(kw_only=True)
class TopologyTable:
    """Performance of each topology at each authority.

    Attributes:
        names: The topologies, in the order of the rows.
        authority: The levels, in the order of the columns.
        db: 20 log10 of the metric over that of the open loop; ``inf`` where unstable.
        control_rms: Root sum of squares of the rms of all control inputs, under the disturbance and in the
            band of the performance; ``inf`` where unstable. In the inputs' units: compare like inputs only.
        stable: By eigenvalues.
        order: States of the compensator.
    """

    names: tuple[str, ...]
    authority: Float[np.ndarray, " level"]
    db: Float[np.ndarray, "topology level"]
    control_rms: Float[np.ndarray, "topology level"]
    stable: Bool[np.ndarray, "topology level"]
    order: Int[np.ndarray, " topology"]


def compare_topologies(
    plant: Plant,
    weights: LQGWeights,
    topologies: Mapping[str, Topology],
    levels: Sequence[float],
    performance: Performance,
) -> TopologyTable:
    """Design for each choice of u and y, subsets of the plant's, at each authority, and close the loop.

    ``weights`` are those of the whole plant: each topology takes its ports' part. Raises `ConfigError` for
    ports that are not in the plant's groups and `NotStabilisableError` where a topology cannot hold a mode.
    """
    reference = loop_metric(leave_open(plant), performance)
    db, control, stable, order = [], [], [], []
    for u, y in topologies.values():
        part = dataclasses.replace(plant, u=tuple(u), y=tuple(y))
        laws = design_levels(part, select_weights(plant, weights, part), levels)
        loops = [close_loop(part, law) for law in laws]
        metric = np.array([loop_metric(loop, performance) for loop in loops])
        db.append(20.0 * np.log10(metric / reference))
        control.append([float(np.linalg.norm(commands_rms(part, law, performance))) for law in laws])
        stable.append([loop.stable for loop in loops])
        order.append(len(laws[0].system.A))
    return TopologyTable(
        names=tuple(topologies),
        authority=np.asarray(levels, dtype=float),
        db=np.array(db),
        control_rms=np.array(control),
        stable=np.array(stable),
        order=np.array(order, dtype=int),
    )


def select_weights(plant: Plant, weights: LQGWeights, part: Plant) -> LQGWeights:
    """The weights of ``plant`` for the ports that ``part`` drives and reads.

    Raises `ConfigError` for ports outside the plant's groups u and y.
    """
    u, y = _positions(plant.u, part.u, "u"), _positions(plant.y, part.y, "y")
    return dataclasses.replace(weights, input=weights.input[u], sensor=weights.sensor[y])


def _positions(group: tuple[str, ...], names: tuple[str, ...], which: str) -> list[int]:
    missing = [name for name in names if name not in group]
    if missing or not names:
        raise ConfigError(
            f"a topology names {missing[0]!r}, which is not in {which}" if missing else f"an empty {which}",
            hint=f"one or more of {', '.join(group)}",
        )
    return [group.index(name) for name in names]
