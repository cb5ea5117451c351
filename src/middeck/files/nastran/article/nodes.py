"""Grids as nodes of an article with their bodies, and as points of the frames that carry them."""

from typing import Any

import numpy as np

from middeck.files.nastran.article.nodes_and_riders import Standing
from middeck.files.nastran.article.parts import Basis, reach, turns
from middeck.files.nastran.masses_and_springs.bodies import Mass
from middeck.structure.model.article_checks import impossible_moments
from middeck.structure.model.connectivity import some_names

Tables = list[dict[str, Any]]


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
