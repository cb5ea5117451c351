"""Read a survey that ours wrote with pyuff (2.5.8): python read_survey.py; prints the largest difference.

The file: md.files.write_measured_modes("written.unv", md.load_measured_modes("normal-mm.unv")), perhaps with
sets=(15, 2414).
"""

from __future__ import annotations

import numpy as np
import pyuff
from make_survey import HERE, HZ, ZETA, motions, places

sets = pyuff.UFF(str(HERE / "written.unv")).read_sets()
modes = [s for s in sets if s["type"] in (55, 2414)]
nodes = next(s for s in sets if s["type"] in (15, 2411))
assert [s["type"] for s in sets] in ([164, 2411, 55, 55, 55], [151, 164, 15, 2414, 2414, 2414])
if modes[0]["type"] == 2414:
    hz, zeta, shape = "record12_field2", "record12_field5", np.array([m["data_at_node"] for m in modes])
else:
    hz, zeta = "freq", "modal_damp_vis"
    shape = np.array([[m[f"r{a}"] for a in range(1, 7)] for m in modes]).transpose(0, 2, 1)
print("shapes", np.abs(shape / motions(6).real - 1.0).max())
print("hertz", np.abs([m[hz] / f - 1.0 for m, f in zip(modes, HZ, strict=True)]).max())
print("damping", np.abs([m[zeta] / z - 1.0 for m, z in zip(modes, ZETA, strict=True)]).max())
print("metres", np.abs(np.stack([nodes[a] for a in "xyz"], axis=1) - places()).max())
