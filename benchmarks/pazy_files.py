"""The Pazy wing's article and refinement as files, from its tables: what the verbs read.

    python benchmarks/pazy_files.py FOLDER [--data FOLDER]
    middeck refine FOLDER/pazy.toml FOLDER/refine.toml --predict FOLDER/hangs.toml

The tables' licence is not stated: the files stay out of the repository.
"""

from __future__ import annotations

import argparse
import dataclasses
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from measured import pazy, pazy_promise
from measured.result_file import DATA
from middeck.files.articles.document import document_text
from middeck.files.measured.modes import write_measured_modes

ARTICLE, HANGS, MODES, REFINE = "pazy.toml", "hangs.toml", "own-weight.json", "refine.toml"
HEAD = "From pazy_skin_off (Riso and Cesnik 2022; tests of Avin et al. 2022), by benchmarks/pazy_files.py."


def write(folder: Path, data: Path) -> None:
    """Article, environment, measured modes and refinement.

    Damping was not published; the file of modes asks for it and has zero.
    """
    folder.mkdir(parents=True, exist_ok=True)
    texts = {ARTICLE: article(data), HANGS: hangs(), REFINE: refinement(data)}
    for name, document in texts.items():
        (folder / name).write_text(document_text(document, HEAD), encoding="utf-8")
    modes = pazy_promise.tapped(pazy.world(pazy.GRAVITY)).measured
    undamped = dataclasses.replace(modes, damping=np.zeros_like(modes.damping))
    write_measured_modes(folder / MODES, undamped)


def article(data: Path) -> dict[str, Any]:
    """Keypoints, sections and lumps, and a node at the trailing edge that carries what may have been on."""
    points, stiffness, inertia = (
        np.loadtxt(data / name, delimiter=",", skiprows=1)
        for name in ("keypoints.csv", "stiffness_skin0.csv", "inertia_skin0.csv")
    )
    names = [f"k{i}" for i in range(1, len(points) + 1)]
    nodes = [_node(name, x, lump[1:]) for name, x, lump in zip(names, points, inertia, strict=True)]
    x, y, z = (points[-1] + pazy_promise.TRAILING).tolist()
    nodes.append({"name": "trailing", "x_m": x, "y_m": y, "z_m": z, "mass_kg": pazy_promise.TRAILING_KG})
    massless = dict.fromkeys(("rho_A_kg_per_m", "rho_I_y_kg_m", "rho_I_z_kg_m"), 0.0)
    sections = {
        f"s{i}": {"stiffness": pazy.matrix(line[1:]), **massless} for i, line in enumerate(stiffness, 1)
    }
    common = {"up": (-1.0, 0.0, 0.0), "elements": pazy.ELEMENTS}
    struts = [
        {"name": f"m{i}", "section": f"s{i}", "from": a, "to": b, **common}
        for i, (a, b) in enumerate(pairwise(names), 1)
    ]
    return {
        "schema": 1,
        "name": "pazy",
        "section": sections,
        "node": nodes,
        "strut": struts,
        "link": [{"from": names[-1], "to": "trailing"}],
    }


def _node(name: str, at: np.ndarray, lump: np.ndarray) -> dict[str, Any]:
    body = pazy.body(lump)
    x, y, z = at.tolist()
    return {
        "name": name,
        "x_m": x,
        "y_m": y,
        "z_m": z,
        "mass_kg": body.mass,
        "cg_m": tuple(body.cg.tolist()),
        "inertia_kg_m2": body.inertia,
    }


def hangs() -> dict[str, Any]:
    """Clamped at the root, with weight along -z."""
    gravity = {"gravity_m_s2": pazy.GRAVITY, "gravity_direction": (0.0, 0.0, -1.0)}
    return {"schema": 1, "name": "hangs", "constants": gravity, "clamp": [{"node": "k1"}]}


def refinement(data: Path) -> dict[str, Any]:
    """As `pazy_promise.refined`."""
    span = float(pazy.structure(data).nodes[-1].position[1])
    kg, sag = pazy_promise.measured(data)
    fitted = kg <= pazy_promise.TO_KG + 1e-9
    levels = zip(kg[fitted].tolist(), sag[fitted].tolist(), strict=True)
    return {
        "schema": "middeck.refinement/1",
        "model_error": pazy_promise.MODEL_ERROR,
        "static_error": pazy_promise.STATIC_ERROR,
        "survey": [{"name": "own weight", "modes": MODES, "environment": "hangs"}],
        "static": [_static(m, 0.01 * s * span) for m, s in levels],
        "unknown": [
            {"name": u.name, "parameters": [_parameter(p) for p in u.parameters], "spread": u.spread}
            for u in pazy_promise.unknowns()
        ],
    }


def _parameter(name: str) -> str:
    """The mass at the trailing edge is a node's here, and moves with no other."""
    return {"mass.trailing.mass": "node.trailing.mass", "node.*.mass": "node.k*.mass"}.get(name, name)


def _static(kg: float, height: float) -> dict[str, Any]:
    gauge = pazy_promise.HEIGHT
    return {
        "name": f"{kg:g} kg",
        "environment": "hangs",
        "series": pazy_promise.SERIES,
        "mass": [{"frame": gauge.at, "mass_kg": kg, "cg_m": tuple(gauge.point.tolist())}],
        "reading": [
            {
                "name": gauge.name,
                "at": gauge.at,
                "direction": tuple(gauge.direction.tolist()),
                "point_m": tuple(gauge.point.tolist()),
                "value_m": height,
                "std_m": gauge.std,
            }
        ],
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--data", type=Path, default=DATA)
    options = parser.parse_args()
    write(options.folder, options.data / "pazy_skin_off")


if __name__ == "__main__":
    main()
