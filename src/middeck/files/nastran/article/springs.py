"""Springs and bushings between points as bushings of an article, those to the ground as an environment's."""

from typing import Any

import numpy as np

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, Parts
from middeck.files.nastran.masses_and_springs.scalars import ScalarNodes, scalar_nodes
from middeck.structure.model.connectivity import some_names

Tables = list[dict[str, Any]]


def spring_tables(basis: Basis, parts: Parts, standing: Standing) -> tuple[Tables, Tables, Tables]:
    """Attach points, bushings between them, and bushings to the ground."""
    points: Tables = []
    between: Tables = []
    grounds: Tables = []
    length, force = basis.units.length, basis.units.force
    unit = np.repeat([1.0 / length, 1.0], 3)
    for tie in parts.ties:
        name = tie.name
        ends = [name + end for end in "ab"[: len(tie.grids)]]
        for end, grid, point in zip(ends, tie.grids, tie.points, strict=True):
            carrier = standing.carrier(grid)
            offset = (point - basis.places.grids[carrier]) * length
            points.append({"name": end, "frame": f"g{carrier}", "offset_m": offset})
        law = {
            "stiffness": _written(force * length * np.outer(unit, unit) * tie.stiffness),
            "x_axis": tie.axes[:, 0],
            "y_axis": tie.axes[:, 1],
        }
        if len(ends) == 2:
            between.append({"name": name, "from": ends[0], "to": ends[1], **law})
        else:
            grounds.append({"name": name, "attach": ends[0], **law})
    return points, between, grounds


def _written(stiffness: np.ndarray) -> np.ndarray:
    """Six numbers where there is nothing off the diagonal."""
    diagonal = np.diagonal(stiffness)
    return stiffness if np.any(stiffness - np.diag(diagonal)) else diagonal


def scalar_tables(basis: Basis, parts: Parts) -> tuple[ScalarNodes, list[str]]:
    """Scalar points as nodes, and a note on what they are."""
    units, scalars = basis.units, parts.scalars
    made = scalar_nodes(scalars, basis.places, units.length, basis.mass_unit, units.force / units.length)
    if not scalars:
        return made, []
    names = some_names([f"{p}" for p in dict.fromkeys(p for e in scalars for p in e.points)])
    note = (
        f"scalar point {names} is a node that turns about x, one metre as one radian, so that it has "
        "no weight; its mass counts as inertia, and the environment holds its other motions"
    )
    return made, [note]
