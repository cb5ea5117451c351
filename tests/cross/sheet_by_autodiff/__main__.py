"""Run all cases and write results.json beside this file."""

from __future__ import annotations

import copy
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from .article import Sheet, Solved, solve
from .control import figure_6, figure_7

HERE = Path(__file__).parent
SHEET = HERE.parents[1] / "reference" / "mace-article.toml"
DIGITS = 10  # significant ones kept; the eigensolution itself is good to 6 or 7 in the lowest modes


def cases(sheet: Sheet) -> dict[str, Sheet]:
    """The sheet as it is, and with one value changed at a time."""
    changed = {name: copy.deepcopy(sheet) for name in ("base", "bounce_0.2", "act_noise_0", "offset_z_0")}
    for article in changed["bounce_0.2"]["article"].values():
        article["suspension"]["bounce_hz"] = 0.2
    changed["act_noise_0"]["control"]["actuator_noise_ratio"] = 0.0
    changed["offset_z_0"]["article"]["simple"]["suspension"]["offsets"][0][2] = 0.0
    return changed


def summary(solved: Solved) -> dict[str, Any]:
    """Frequencies, forces, attitudes, and the pairs of flexible modes with their cross-orthogonality."""
    article, hung, rigid = solved.article, solved.hung, solved.rigid
    nodes = len(article.table["node"])
    flexible = np.abs(solved.orbit.shapes.T @ solved.orbit.M @ solved.lab.shapes)[rigid:, rigid:]
    i, j = linear_sum_assignment(-flexible)
    joints = [f"{g.name}_rel_{letter}" for g in article.gimbals for letter in "xz"]
    names = [article.table["node"][h.node]["name"] for h in article.hangers]
    return {
        "rigid_modes": rigid,
        "orbit_hz": solved.orbit.hz,
        "lab_hz": solved.lab.hz,
        "reactions_n": dict(zip(names, hung.reaction, strict=True)),
        "holding_torque_nm": dict(zip(joints, hung.holding_torque, strict=True)),
        "node_rotation_deg": np.rad2deg(Rotation.from_matrix(hung.poses.R[:nodes]).as_rotvec()),
        "pairs": [[int(a + rigid), int(b + rigid), flexible[a, b]] for a, b in zip(i, j, strict=True)],
    }


def run(sheet: Sheet) -> dict[str, Any]:
    """All numbers of one case."""
    simple, dm = solve(sheet, "simple"), solve(sheet, "dm")
    return {
        "simple": summary(simple),
        "dm": summary(dm),
        "figure_6": figure_6(dm, sheet),
        "figure_7": figure_7(simple, sheet),
    }


def plain(value: Any) -> Any:
    """JSON's own types, floats to `DIGITS` digits."""
    match value:
        case dict():
            return {k: plain(v) for k, v in value.items()}
        case list() | tuple() | np.ndarray():
            return [plain(v) for v in value]
        case float():
            return float(f"{value:.{DIGITS}g}")
    return value


def main(output: Path) -> None:
    """Write one line a case and quantity."""
    with open(SHEET, "rb") as file:
        sheet = tomllib.load(file)
    results = {}
    for name, case in cases(sheet).items():
        results[name] = plain(run(case))
        print(name, json.dumps(results[name]["figure_7"]["all"]["first_instability"]), flush=True)
    lines = [
        f" {json.dumps(name)}: {{\n"
        + ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in case.items())
        + "\n }"
        for name, case in results.items()
    ]
    output.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results.json")
