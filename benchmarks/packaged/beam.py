"""A measured beam's published law (Takacs and Rohal-Ilkiv 2012), packaged, beside its formula."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.control.law.compensator import Compensator
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import compile_law

CASE, STEPS, LIMIT = "beam of Takacs", 10_000, 120.0
# The README of the data set: volts to millimetres at 100 Hz.
A = np.array([[0.867074264700783, 1.118487994649831], [-0.214184972531195, 0.869746240894636]])
B = np.array([[0.933601028678616e-3], [0.530974425107969e-3]])
C = np.array([[-0.552612993066737, 0.705187130687643]])
M = np.array([[-4.336938056233941], [-0.354380105600932]])
K = np.array([[12.967150796211348, 125.5047671231475]])


def rows(options: Any) -> list[dict]:
    tip, wafers = (Port("tip", "mm"),), (Port("wafers", "V"),)
    observer = SampledStateSpace(A - B @ K - M @ C, M, -K, np.zeros((1, 1)), period_s=0.01)
    unstable = bool(np.abs(np.linalg.eigvals(observer.A)).max() >= 1.0)
    package = package_law(
        Compensator(observer, tip, wafers, applied=B),
        "takacs",
        input_range=15.0,
        limit=LIMIT,
        unstable=unstable,
    )
    y, v = _loop()
    with tempfile.TemporaryDirectory() as folder:
        u = compile_law(package, Path(folder))(y)
    note = f"{np.mean(np.abs(v) == LIMIT) * 100.0:.1f} % of {STEPS} steps at the limit of {LIMIT:g} V"
    return [
        row(
            CASE,
            "packaged law to a direct computation",
            "relative",
            np.abs(u - v).max() / LIMIT,
            1e-12,
            note=note,
        )
    ]


def _loop() -> tuple[np.ndarray, np.ndarray]:
    """x+ = A x + B v, its observer, and v = -K x-hat within the limit; the beam is let go again and again."""
    x, estimate, rows = np.zeros(2), np.zeros(2), []
    for k in range(STEPS):
        if k % 1000 == 0:
            x = np.array([8.0, 3.0])
        y = C @ x
        v = np.clip(-K @ estimate, -LIMIT, LIMIT)
        rows.append([y[0], v[0]])
        estimate = A @ estimate + B @ v + M @ (y - C @ estimate)
        x = A @ x + B @ v
    both = np.array(rows)
    return both[:, :1], both[:, 1:]
