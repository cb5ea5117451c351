"""Single precision: the proved bound over the worst error found, on the study's compensators."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from measured.rows import row
from middeck.realtime.package.core import Core
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.single_precision import bound_error, to_single
from packaged.study_laws import study_laws
from packaged_laws import worst_error

CASE, RANGE = "single precision", 0.02
STEPS = 300_000
"""Five time constants of the slowest pole."""


def rows(options: Any) -> list[dict]:
    ratios, own, unbounded, beyond = [], 0, 0, 0
    laws = study_laws()
    with tempfile.TemporaryDirectory() as folder:
        for law in laws.values():
            package = package_law(law, "law", input_range=RANGE, limit=5.0)
            single = to_single(package)
            own += bound_error(package).own
            unbounded += _grows(package.core)
            worst = worst_error(package, single, STEPS, Path(folder))
            assert single.error_bound is not None
            beyond += int(np.any(worst > single.error_bound))
            ratios.append(float(np.median(single.error_bound / worst)))
    note = (
        f"{len(laws)} laws, largest {max(ratios):.0f}; {own} bounds are for the law's own commands, which no"
        f" input within {RANGE} takes to 5 N m: with limited motors errors grow without end in {unbounded},"
        " and no bound is found in the others"
    )
    return [
        row(CASE, "bound over the worst error found, median", "", float(np.median(ratios)), 100.0, note=note),
        row(CASE, "compensators that exceed their bound", "", beyond, 0.0),
    ]


def _grows(core: Core) -> bool:
    """Whether the law that learns what is applied is unstable with some outputs held at their limits."""
    patterns = itertools.product((0.0, 1.0), repeat=len(core.C))
    laws = np.array([core.A - core.E @ (np.array(held)[:, None] * core.C) for held in patterns])
    return bool(np.abs(np.linalg.eigvals(laws)).max() > 1.0)
