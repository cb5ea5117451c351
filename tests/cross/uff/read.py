"""Read with pyuff (2.5.8) the responses that the package wrote into this folder: python read.py

../test_uff.py writes them again, to the byte, and compares what stands in read.npz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyuff

HERE = Path(__file__).parent
OUTPUTS, INPUTS = 3, 2


def main():
    found = {}
    for path in sorted(HERE.glob("written-*.uff")):
        sets = [s for s in pyuff.UFF(str(path)).read_sets() if s["type"] == 58]
        assert [s["func_type"] for s in sets] == [4] * OUTPUTS * INPUTS
        each = [sets[o * INPUTS : (o + 1) * INPUTS] for o in range(OUTPUTS)]
        name = path.stem
        found[f"{name}/H"] = np.array([[s["data"] for s in row] for row in each]).transpose(2, 0, 1)
        found[f"{name}/f"] = sets[0]["x"]
        found[f"{name}/names"] = np.array([row[0]["id1"].strip() for row in each])
        units = [row[0]["ordinate_axis_units_lab"].strip() for row in each]
        units += [s["orddenom_axis_units_lab"].strip() for s in each[0]]
        found[f"{name}/units"] = np.array(units)
        ends = ("rsp_node", "rsp_dir", "ref_node", "ref_dir")
        found[f"{name}/ends"] = np.array([[[s[k] for k in ends] for s in row] for row in each])
    np.savez(HERE / "read.npz", **found)


if __name__ == "__main__":
    main()
