"""Margins of rational loops by python-control, for tests/cross/test_margins_peers.py.

PYTHON make_margins.py        (python-control 0.10.2 and slycot 0.7.1; writes numbers.json beside itself)
"""

from __future__ import annotations

import json
from pathlib import Path

import loops
import numpy as np

import control


def margins(A, B, C, D) -> dict:
    L = control.ss(A, B, C, D)
    gain, phase, _, w_gain, w_phase, _ = control.stability_margins(L, returnall=True)
    S = control.feedback(1, L)
    return {
        "gain": sorted(gain.tolist()),
        "phase_deg": phase[np.argsort(w_phase)].tolist(),
        "phase_omega": sorted(w_phase.tolist()),
        "gain_omega": w_gain[np.argsort(gain)].tolist(),
        "sensitivity": float(control.system_norm(S, "inf")),
    }


def disk(A, B, C, D, omega) -> dict:
    alpha, gain_db, phase_deg = control.disk_margins(control.ss(A, B, C, D), omega, skew=0.0)
    return {"alpha": float(alpha), "gain_db": float(gain_db), "phase_deg": float(phase_deg)}


single, double = loops.single(), loops.double()
found = {
    "control": control.__version__,
    "single": margins(*single),
    "disk_single": disk(*single, np.geomspace(0.5, 200.0, 20_001)),
    "disk_double": disk(*double, np.geomspace(0.5, 200.0, 4_001)),
}
Path(__file__).with_name("numbers.json").write_text(json.dumps(found, indent=1) + "\n")
