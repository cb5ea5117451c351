"""Single precision: the proved bound over the worst error found, on the study's compensators."""

from __future__ import annotations

import dataclasses
import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.control.law.compensator import Compensator
from middeck.realtime.package.core import Core
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.single_precision import to_single
from packaged.study_laws import study_laws
from packaged_laws import compile_law, worst_error, worst_signs

CASE, RANGE = "single precision", 0.02
STEPS = 300_000
"""Five time constants of the slowest pole."""


def rows(options: Any) -> list[dict]:
    laws = [package_law(law, "law", input_range=RANGE, limit=5.0) for law in study_laws().values()]
    unbounded = sum(_grows(package.core) for package in laws)
    own = (
        "its own commands applied in full: no ramp, and no input within"
        f" {RANGE} takes them to 5 N m; with motors at their limits errors grow without end in {unbounded}"
        f" of {len(laws)}, and no bound is found in the others"
    )
    limited = [_limited(law) for law in study_laws().values()]
    touched = "whatever is applied: a ramp of 0.5 s, limits at half of what inputs reach"
    return [
        *_rows("that learn what is applied", laws, own),
        *_rows("that do not learn it", limited, touched),
    ]


def _limited(law: Compensator) -> ControllerPackage:
    """Without the path of applied commands, at limits that the worst inputs would take twice as far."""
    free = package_law(dataclasses.replace(law, applied=None), "law", input_range=RANGE)
    with tempfile.TemporaryDirectory() as folder:
        run, m = compile_law(free, Path(folder)), len(free.inputs)
        reached = [np.abs(run(RANGE * signs[:, :m])).max(axis=0) for signs in worst_signs(free, STEPS)]
    limit = 0.5 * np.max(reached, axis=0)
    return package_law(
        dataclasses.replace(law, applied=None), "law", input_range=RANGE, limit=limit, ramp_s=0.5
    )


def _rows(which: str, packages: list[ControllerPackage], holds_for: str) -> list[dict]:
    ratios, beyond, own = [], 0, 0
    for package in packages:
        single = to_single(package)
        assert single.error_bound is not None
        with tempfile.TemporaryDirectory() as folder:
            worst = worst_error(package, single, STEPS, Path(folder))
        own += single.error_bound_own
        beyond += int(np.any(worst > single.error_bound))
        ratios.append(float(np.median(single.error_bound / worst)))
    counted = f"{len(packages)} laws, largest {max(ratios):.0f}; {own} bounds for own commands only"
    ratio = f"bound over the worst error found, laws {which}, median"
    return [
        row(CASE, ratio, "", float(np.median(ratios)), 100.0, note=f"{counted}; {holds_for}"),
        row(CASE, f"laws {which}, beyond their bound", "", beyond, 0.0),
    ]


def _grows(core: Core) -> bool:
    """Whether the law that learns what is applied is unstable with some outputs held at their limits."""
    patterns = itertools.product((0.0, 1.0), repeat=len(core.C))
    laws = np.array([core.A - core.E @ (np.array(held)[:, None] * core.C) for held in patterns])
    return bool(np.abs(np.linalg.eigvals(laws)).max() > 1.0)
