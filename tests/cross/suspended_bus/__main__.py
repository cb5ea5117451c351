"""Run all programs on all variants that they can do, and write results.json beside this file."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import numpy as np

from . import case, exudyn_bus, mujoco_bus, opensees_bus
from .richardson import extrapolate

HERE = Path(__file__).parent
MESHES = (32, 64, 128)  # elements in each half of the tube
DIGITS = 10
RUNS = (
    ("mujoco", mujoco_bus, ("bare_1g", "gimbal_0_1g", "gimbal_45_0g", "gimbal_45_1g")),
    ("exudyn", exudyn_bus, ("bare_1g", "gimbal_0_1g", "gimbal_45_0g")),
    ("openseespy", opensees_bus, ("bare_1g",)),
)


def plain(value: Any) -> Any:
    match value:
        case dict():
            return {k: plain(v) for k, v in value.items()}
        case list() | tuple() | np.ndarray():
            return [plain(v) for v in value]
        case float():
            return float(f"{value:.{DIGITS}g}")
    return value


def main() -> None:
    results: dict[str, Any] = {"meshes": list(MESHES), "versions": {}, "variants": {}}
    for name, program, variants in RUNS:
        results["versions"][name] = importlib.metadata.version(name)
        for variant in variants:
            hz = np.array([program.solve(case.VARIANTS[variant], n)["hz"] for n in MESHES])
            found = {**extrapolate(hz), "finest_hz": hz[-1]}
            results["variants"].setdefault(variant, {})[name] = plain(found)
            print(name, variant, f"{found['error']:.1e}", found["order"], flush=True)
    lines = [
        f'  "{variant}": {{\n'
        + ",\n".join(f'   "{name}": {json.dumps(found)}' for name, found in programs.items())
        + "\n  }"
        for variant, programs in results["variants"].items()
    ]
    head = f' "meshes": {json.dumps(results["meshes"])},\n "versions": {json.dumps(results["versions"])},\n'
    (HERE / "results.json").write_text("{\n" + head + ' "variants": {\n' + ",\n".join(lines) + "\n }\n}\n")


if __name__ == "__main__":
    main()
