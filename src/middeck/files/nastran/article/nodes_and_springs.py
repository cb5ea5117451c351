"""Grids and scalar points as nodes of an article and as points of frames, and the springs between them."""

from typing import Any

import numpy as np

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, Parts, Tables, reach, turns
from middeck.files.nastran.masses_and_springs.bodies import Mass
from middeck.files.nastran.masses_and_springs.scalars import ScalarNodes, scalar_nodes
from middeck.structure.model.article_checks import impossible_moments
from middeck.structure.model.connectivity import some_names


def node_tables(basis: Basis, standing: Standing) -> tuple[Tables, list[str]]:
    """Nodes, and a note on those whose inertia no body has by itself."""
    grids = [grid for grid in basis.places.grids if grid in standing.kept]
    nodes = [_node(basis, grid, standing.bodies.get(grid)) for grid in grids]
    rotors = [f"{grid}" for grid, node in zip(grids, nodes, strict=True) if "rotors_excluded" in node]
    note = (
        f"grid {some_names(rotors)} carries an inertia that no body has by itself "
        "(without mass, or the triangle inequality)"
    )
    return nodes, [note] if rotors else []


def carried_points(basis: Basis, standing: Standing) -> Tables:
    """Grids that ride rigidly, as points of the frames of their carriers."""
    return [
        {
            "name": f"g{grid}",
            "frame": f"g{standing.carriers[grid]}",
            "offset_m": (place - basis.places.grids[standing.carriers[grid]]) * basis.units.length,
        }
        for grid, place in basis.places.grids.items()
        if standing.carriers.get(grid) in standing.kept
    ]


def rider_links(standing: Standing) -> Tables:
    """Rigid links to grids that constraints or components join."""
    return [
        {"name": f"rigid_g{grid}", "from": f"g{carrier}", "to": f"g{grid}"}
        for grid, carrier in standing.riders.items()
    ]


def _node(basis: Basis, grid: int, body: Mass | None) -> dict[str, Any]:
    place, length = basis.places.grids[grid], basis.units.length
    x, y, z = place * length
    node: dict[str, Any] = {"name": f"g{grid}", "x_m": x, "y_m": y, "z_m": z}
    if body is None or (body.mass == 0.0 and not np.any(body.inertia)):
        return node
    node["mass_kg"] = body.mass * basis.mass_unit
    arm = body.centre - place
    if np.linalg.norm(arm) > reach(body):
        node["cg_m"] = arm * length
    if turns(body):
        inertia = body.inertia * basis.mass_unit * length**2
        node["inertia_kg_m2"] = inertia
        if body.mass == 0.0 or impossible_moments(inertia) is not None:
            node["rotors_excluded"] = True
    return node


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
