"""C on the host beside the reference to the last bit, and the fast law of Python beside C, over long runs."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.systems.sampling.simulation import simulate
from packaged.study_laws import study_laws
from packaged_laws import compile_law, random_law

CASE, STEPS, BITS = "bits", 100_000, 2000
LIMITS = {"input_range": 0.1, "limit": 0.3, "slew_rate": 50.0, "ramp_s": 0.5}
BUILDS = (("-O0",), ("-O2",), ("-O3", "-march=native"))


def rows(options: Any) -> list[dict]:
    laws = list(study_laws().values())
    rng, different = np.random.default_rng(3), 0
    with tempfile.TemporaryDirectory() as folder:
        for law in laws:
            for form in ("dense", "auto"):
                package = package_law(law, "law", form=form, **LIMITS)
                y = rng.uniform(-0.02, 0.02, (BITS, len(law.inputs)))
                reference = ReferenceLaw(package)
                expected = np.array([reference.step(one) for one in y])
                for flags in BUILDS:
                    found = compile_law(package, Path(folder), *flags)(y)
                    different += int(np.count_nonzero(found.view(np.int64) != expected.view(np.int64)))
        compared = 2 * len(laws) * len(BUILDS) * BITS * len(laws[0].outputs)
        note = f"of {compared}: {len(laws)} compensators, dense and modal, {len(BUILDS)} builds"
        exact = row(
            CASE, "outputs of C that differ from the reference in a bit", "", different, 0.0, note=note
        )
        return [
            exact,
            *(_long_run(form, level, folder) for form, level in (("dense", 1e-12), ("modal", 1e-10))),
        ]


def _long_run(form: str, level: float, folder: str) -> dict:
    """C beside the compensator's own matrices, simulated; and the fast law, over the same steps."""
    rng = np.random.default_rng(11)
    law = random_law(rng, 60, 14, 5)
    package, y = package_law(law, "law", form=form), rng.standard_normal((STEPS, 14))
    truth = simulate(law.sampled, y, np.zeros(60))[0]
    fast = ReferenceLaw(package, fast=True)
    runs = [compile_law(package, Path(folder))(y), np.array([fast.step(one) for one in y])]
    worst = max(float(np.abs(u - truth).max()) for u in runs) / float(np.abs(truth).max())
    return row(CASE, f"{form}: C and fast law to A, B, C, D over {STEPS} steps", "relative", worst, level)
