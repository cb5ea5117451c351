"""Frequencies of the sheet's articles on two meshes, for their limit: writes mesh.json beside this file."""

from __future__ import annotations

import json
import tomllib

from . import article
from .__main__ import HERE, SHEET

MESHES = (8, 16)


def main() -> None:
    sheet = tomllib.loads(SHEET.read_text())
    lab_hz = {name: {} for name in ("simple", "dm")}
    for elements in MESHES:
        article.ELEMENTS = elements
        for name in lab_hz:
            lab_hz[name][str(elements)] = [float(f"{f:.10g}") for f in article.solve(sheet, name).lab.hz]
    (HERE / "mesh.json").write_text(json.dumps(lab_hz, indent=1) + "\n")


if __name__ == "__main__":
    main()
