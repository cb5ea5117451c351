"""Single precision: the proved bound over the worst error found, on the study's compensators."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.errors import ConfigError
from middeck.realtime.package.build import package_law, without_applied
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.single_precision import to_single
from packaged.study_laws import study_laws
from packaged_laws import compile_law

CASE, STEPS, RANGE = "single precision", 20_000, 0.02


def rows(options: Any) -> list[dict]:
    ratios, refused, beyond = [], 0, 0
    laws = study_laws()
    with tempfile.TemporaryDirectory() as folder:
        for law in laws.values():
            package = package_law(law, "law", input_range=RANGE, limit=5.0)
            try:
                single = to_single(package)
            except ConfigError:
                refused += 1
                package = without_applied(package)
                single = to_single(package)
            worst = _search(package, single, Path(folder))
            assert single.error_bound is not None
            beyond += int(np.any(worst > single.error_bound))
            ratios.append(float(np.median(single.error_bound / worst)))
    note = f"{len(laws)} laws, largest {max(ratios):.0f}; {refused} had to leave out what was applied"
    return [
        row(CASE, "bound over the worst error found, median", "", float(np.median(ratios)), 100.0, note=note),
        row(CASE, "compensators that exceed their bound", "", beyond, 0.0),
    ]


def _search(package: ControllerPackage, single: ControllerPackage, folder: Path) -> np.ndarray:
    double_run, single_run = compile_law(package, folder), compile_law(single, folder)
    worst = np.zeros(len(package.outputs))
    for y in _bad_inputs(package):
        given = (y * single.input_range).astype(np.float32).astype(float)
        worst = np.maximum(worst, np.abs(double_run(given) - single_run(given)).max(axis=0))
    return worst


def _bad_inputs(package: ControllerPackage) -> Iterator[np.ndarray]:
    """The rhythm of each pole as a square wave, constants, noise of full range and of a tenth."""
    rng, k, m = np.random.default_rng(5), np.arange(STEPS)[:, None], len(package.inputs)
    for pole in np.linalg.eigvals(package.core.A):
        if pole.imag >= 0.0:
            yield np.sign(np.sin(np.angle(pole) * k + rng.uniform(0.0, 6.3, (1, m))))
    yield np.ones((STEPS, m))
    noise = np.sign(rng.standard_normal((STEPS, m)))
    yield noise
    yield 0.1 * noise
