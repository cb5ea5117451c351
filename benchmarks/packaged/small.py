"""The same C on emulated small processors: bits, flash, memory and instructions of a step."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from small_processor.emulated import emulate_package

from measured.rows import row
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.single_precision import to_single
from packaged_laws import random_law

CASE = "small processors"
SIZES = ((8, 1, 1, "modal"), (24, 2, 1, "modal"), (60, 14, 5, "modal"), (60, 14, 5, "dense"))


def rows(options: Any) -> list[dict]:
    found, different = [], 0
    for states, inputs, outputs, form in SIZES:
        law = random_law(np.random.default_rng(1), states, inputs, outputs, applied=False)
        double = package_law(law, "law", input_range=0.1, limit=1.0, ramp_s=0.02, form=form)
        for package in (double, to_single(double)) if form == "modal" else (double,):
            with tempfile.TemporaryDirectory() as folder:
                one = emulate_package(package, Path(folder))
            different += one.first_difference > 0
            processor = "Cortex-M4, single" if package.single else "Cortex-M7, double"
            found.append(
                row(CASE, f"{states} states, {inputs} in, {outputs} out, {form}: {processor}", "instructions",
                    one.instructions, note=f"{one.flash} bytes of flash, {one.memory} of memory")
            )  # fmt: skip
    return [row(CASE, "packages that differ from the reference in a bit", "", different, 0.0), *found]
