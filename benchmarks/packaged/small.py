"""The same C on emulated small processors: bits, flash, memory and instructions of a step."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from small_processor.emulated import emulate_package

from measured.rows import row
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.single_precision import to_single
from packaged.study_laws import study_laws
from packaged_laws import random_law

CASE = "small processors"
SIZES = ((8, 1, 1, "modal"), (24, 2, 1, "modal"), (60, 14, 5, "modal"), (60, 14, 5, "dense"))


STUDY = ("-1.5", "0", "2")
"""Compensators of the study, by log10 of their authority."""


def rows(options: Any) -> list[dict]:
    found, different = [], 0
    for name, double in _packages():
        for package in (double,) if double.core.pairs is None else (double, to_single(double)):
            with tempfile.TemporaryDirectory() as folder:
                one = emulate_package(package, Path(folder))
            different += one.first_difference > 0
            processor = "Cortex-M4, single" if package.single else "Cortex-M7, double"
            found.append(
                row(CASE, f"{name}: {processor}", "instructions", one.instructions,
                    note=f"{one.flash} bytes of flash, {one.memory} of memory")
            )  # fmt: skip
    return [
        row(CASE, f"of {len(found)} packages, that differ in a bit from the reference", "", different, 0.0),
        *found,
    ]


def _packages() -> Iterator[tuple[str, ControllerPackage]]:
    for states, inputs, outputs, form in SIZES:
        law = random_law(np.random.default_rng(1), states, inputs, outputs, applied=False)
        name = f"{states} states, {inputs} in, {outputs} out, {form}"
        yield name, package_law(law, "law", input_range=0.1, limit=1.0, ramp_s=0.02, form=form)
    for level in STUDY:
        package = package_law(study_laws()[level], "law", input_range=0.02, limit=5.0)
        form = "dense" if package.core.pairs is None else "modal"
        name = f"the study's at 10^{level}, {len(package.core.A)} states, 14 in, 5 out, {form}"
        yield f"{name}, learns what is applied", package
