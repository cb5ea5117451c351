"""Time of a step of 60 states, 14 inputs and 5 outputs in C, beside one stacked NumPy product."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.realtime.package.package_law import package_law
from packaged_laws import random_law, steps_in_c

CASE, STEPS, REPEATS, RUNS = "step, 60 states, 14 in, 5 out", 4000, 25, 5
BUILDS = {"portable": ("-O3",), "native": ("-O3", "-march=native")}
AT_LEAST = {
    ("modal", "portable"): 3.0,
    ("dense", "portable"): 1.5,
    ("modal", "native"): 8.0,
    ("dense", "native"): 3.0,
}
# Multiplications and additions of a step, and bytes of its coefficients.
FLOOR = {
    "modal": (2 * (60 * 14 + 5 * 74 + 120), 8 * (60 * 14 + 5 * 74 + 120)),
    "dense": (2 * 65 * 74, 8 * 65 * 74),
}


def rows(options: Any) -> list[dict]:
    law = random_law(np.random.default_rng(7), 60, 14, 5, applied=False)
    y = np.random.default_rng(8).standard_normal((STEPS, 14))
    with tempfile.TemporaryDirectory() as folder:
        runs = {("numpy", ""): _numpy_steps(law.sampled)}
        for form in FLOOR:
            for build, flags in BUILDS.items():
                made = steps_in_c(package_law(law, "law", form=form), Path(folder), *flags)
                runs[form, build] = made(y)
        each = [_medians(runs) for _ in range(RUNS)]
    product = float(np.median([spent["numpy", ""] for spent in each]))
    found = [row(CASE, "one stacked NumPy product", "us", product)]
    for key, level in AT_LEAST.items():
        flops, size = FLOOR[key[0]]
        ratios = [spent["numpy", ""] / spent[key] for spent in each]
        ratio, step = float(np.median(ratios)), float(np.median([spent[key] for spent in each]))
        found.append(
            row(CASE, f"{key[0]}, {key[1]}: times faster", "", ratio, level,
                note=f"{step:.3f} us a step, {flops / step / 1e3:.1f} Gflop/s; {flops} operations, "
                     f"{size / 1000:.1f} kB; {min(ratios):.2f} to {max(ratios):.2f} in {RUNS} runs")
            | {"met": bool(ratio >= level)}
        )  # fmt: skip
    return found


def _numpy_steps(system: Any) -> Callable[[], Any]:
    stacked = np.block([[system.C, system.D], [system.A, system.B]])
    both = np.ones(74)

    def run() -> None:
        for _ in range(STEPS):
            stacked @ both

    return run


def _medians(runs: dict[Any, Callable[[], Any]]) -> dict[Any, float]:
    """Microseconds a step; runs take turns, so that a busy machine is busy for all."""
    spent: dict[Any, list[float]] = {key: [] for key in runs}
    for _ in range(REPEATS):
        for key, run in runs.items():
            start = time.process_time()
            run()
            spent[key].append(1e6 * (time.process_time() - start) / STEPS)
    return {key: float(np.median(times)) for key, times in spent.items()}
