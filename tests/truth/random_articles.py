"""Random articles that somebody could have built, as tables of an article's file: what is varied is physical.

Three families: a suspended bus of nodes in a row (spacecraft testbeds), a hub with booms (satellites) and
an arm of sprung joints (robots). Bodies have the inertia of boxes of a density between 150 and 4000 kg/m^3.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

Tables = dict[str, Any]
# E [Pa], nu, rho [kg/m^3]: aluminium, steel, titanium, carbon fibre, polycarbonate, invar, glass fibre
MATERIALS = (
    (7.0e10, 0.33, 2700.0),
    (2.1e11, 0.3, 7850.0),
    (1.1e11, 0.34, 4430.0),
    (1.2e11, 0.3, 1600.0),
    (2.35e9, 0.37, 1200.0),
    (1.4e11, 0.29, 8100.0),
    (3.0e10, 0.25, 1900.0),
)


def draw_article(rng: np.random.Generator) -> Tables:
    """One of the three families."""
    return (draw_bus, draw_satellite, draw_arm)[int(rng.integers(3))](rng)


def draw_bus(rng: np.random.Generator, spacing: float | None = None) -> Tables:
    """Nodes along x, joined by tubes, hung at some of them; sometimes a gimballed payload below an end."""
    count = int(rng.integers(3, 7))
    spacing = float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))) if spacing is None else spacing
    side = spacing * rng.uniform(0.08, 0.35, count)
    nodes = []
    for i in range(count):
        density = np.exp(rng.uniform(np.log(150.0), np.log(4000.0)))
        cg = [0.0, -float(rng.uniform(0.05, 0.5) * side[i]), float(rng.uniform(-0.1, 0.1) * side[i])]
        nodes.append(_node(rng, f"n{i}", (i * spacing, 0.0, 0.0), side[i], density, cg))
    diameter = spacing * float(rng.uniform(0.03, 0.12))
    tables = _frame(rng, nodes, [(f"n{i}", f"n{i + 1}") for i in range(count - 1)], diameter)
    hung = [f"n{i}" for i in range(count)] if rng.random() < 0.5 else ["n0", f"n{count - 1}"]
    tables["suspension"] = {
        "nodes": hung,
        "offsets_m": [[0.0, float(rng.uniform(0.05, 0.6) * side[int(n[1:])]), 0.0] for n in hung],
    }
    if rng.random() < 0.5:
        mass, arm = float(side[0] ** 3 * 1500.0), float(0.5 * side[0])
        inertia = _box(rng, mass, side[0])
        tables["gimbal"] = [
            {"name": "pay", "node": "n0", "offset_m": [0.0, -0.6 * side[0], 0.0], "stage_mass_kg": 0.3 * mass,
             "stage_inertia_kg_m2": [0.3 * x for x in inertia], "payload_mass_kg": mass,
             "payload_cg_m": [0.0, -arm, 0.0], "payload_inertia_kg_m2": inertia}
        ]  # fmt: skip
    return tables


def draw_satellite(rng: np.random.Generator) -> Tables:
    """A heavy hub, and two booms of some bays with light tips."""
    side = float(rng.uniform(0.5, 3.0))
    bays = int(rng.integers(1, 4))
    bay = float(rng.uniform(0.5, 3.0))
    nodes = [_node(rng, "hub", (0.0, 0.0, 0.0), side, float(rng.uniform(100.0, 500.0)), [0.0, 0.0, 0.0])]
    pairs = []
    for sign, arm in ((1.0, "p"), (-1.0, "m")):
        before = "hub"
        for k in range(1, bays + 1):
            tip = 0.05 + 0.1 * float(rng.random())
            at = (sign * (0.5 * side + k * bay), 0.0, 0.0)
            nodes.append(_node(rng, f"{arm}{k}", at, tip, float(rng.uniform(300.0, 3000.0)), [0.0, 0.0, 0.0]))
            pairs.append((before, f"{arm}{k}"))
            before = f"{arm}{k}"
    tables = _frame(rng, nodes, pairs, bay * float(rng.uniform(0.01, 0.06)))
    tables["suspension"] = {
        "nodes": ["hub", f"p{bays}", f"m{bays}"],
        "offsets_m": [[0.0, 0.5 * side, 0.0], [0.0, 0.05, 0.0], [0.0, 0.05, 0.0]],
    }
    return tables


def draw_arm(rng: np.random.Generator) -> Tables:
    """A base plate, a stiff column and two sprung joints with solid links."""
    reach = float(rng.uniform(0.2, 1.0))
    side = 0.4 * reach
    base = _node(rng, "base", (0.0, 0.0, 0.0), side, float(rng.uniform(1000.0, 7000.0)), [0.0, 0.0, 0.0])
    top = _node(rng, "top", (0.0, reach, 0.0), 0.5 * side, 2000.0, [0.0, 0.0, 0.0])
    tables = _frame(rng, [base, top], [("base", "top")], reach * float(rng.uniform(0.05, 0.15)))
    tables["revolute"] = []
    parent = "top"
    for k in range(2):
        mass = float(rng.uniform(200.0, 1500.0)) * (0.15 * reach) ** 2 * reach
        slim = mass * reach**2 / 12.0
        tables["revolute"].append(
            {"name": f"j{k}", "parent": parent, "offset_m": [0.0 if k == 0 else 0.8 * reach, 0.0, 0.0],
             "axis": [0.0, 0.0, 1.0] if k else [0.0, 1.0, 0.0], "mass_kg": mass,
             "cg_m": [0.4 * reach, 0.0, 0.0], "inertia_kg_m2": [0.06 * slim, slim, slim], "state": "sprung",
             "stiffness_nm_per_rad": float(mass * reach**2 * (2.0 * np.pi * rng.uniform(3.0, 30.0)) ** 2)}
        )  # fmt: skip
        parent = f"j{k}"
    tables["suspension"] = {"nodes": ["base", "top"], "offsets_m": [[0.0, side, 0.0], [0.0, 0.5 * side, 0.0]]}
    return tables


def _node(
    rng: np.random.Generator, name: str, at: tuple[float, ...], side: float, density: float, cg: list[float]
) -> Tables:
    mass = float(density * side**3)
    return {
        "name": name,
        "x_m": float(at[0]),
        "y_m": float(at[1]),
        "z_m": float(at[2]),
        "size_m": float(side),
        "mass_kg": mass,
        "cg_m": cg,
        "inertia_kg_m2": _box(rng, mass, side),
    }


def _box(rng: np.random.Generator, mass: float, side: float) -> list[float]:
    """Of a box whose sides are about ``side``."""
    a, b, c = side * rng.uniform(0.5, 1.4, 3)
    return [float(mass * (p**2 + q**2) / 12.0) for p, q in ((b, c), (a, c), (a, b))]


def _frame(
    rng: np.random.Generator, nodes: list[Tables], pairs: list[tuple[str, str]], diameter: float
) -> Tables:
    E, nu, rho = MATERIALS[int(rng.integers(len(MATERIALS)))]
    wall = float(rng.uniform(0.05, 0.5))
    return {
        "schema": 1,
        "name": "drawn",
        "mesh": {"elements_per_strut": 4},
        "material": {"stuff": {"E_pa": E, "nu": nu, "rho_kg_m3": rho}},
        "section": {
            "tube": {
                "material": "stuff",
                "outer_diameter_m": diameter,
                "inner_diameter_m": diameter * (1.0 - 2.0 * wall) if wall < 0.5 else 0.0,
            }
        },
        "node": nodes,
        "strut": [{"section": "tube", "from": a, "to": b} for a, b in pairs],
    }


def environment_of(tables: Tables, cable_m: float, bounce_hz: float) -> Tables:
    """A laboratory that hangs the article at all of its attach points, held along x at the first of them."""
    hung = tables["suspension"]["nodes"]
    return {
        "schema": 1,
        "name": "lab",
        "constants": {"gravity_m_s2": 9.80665, "gravity_direction": [0.0, -1.0, 0.0]},
        "suspension": {
            "cable_length_m": cable_m,
            "bounce_hz": bounce_hz,
            "held": {n: "xyz" if i == 0 else "yz" for i, n in enumerate(hung)},
        },
    }


def write_tables(tables: Tables, file: Path) -> Path:
    """As TOML, with whatever is nested as inline tables: JSON writes the values alike."""
    lines: list[str] = []
    for key, value in tables.items():
        lines.append(f"{key} = {_inline(value)}")
    file.write_text("\n".join(lines) + "\n")
    return file


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)
