"""Long cases whose results are kept one by one: a run that is cut off goes on where it ended."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from middeck.campaign.cases import Case
from middeck.campaign.run_cases import run_campaign


def kept(function: Callable[[Case, Any], Any], numbers: int | Iterable[int], options: Any) -> list[Any]:
    """``function`` of cases of these numbers, or of the first so many.

    In the folder ``options.ledgers`` it has a file of its name. Without a folder nothing is kept. Raises
    `RuntimeError` for a case that raised an error.
    """
    numbers = range(numbers) if isinstance(numbers, int) else numbers
    cases = [Case(k, k, (), np.zeros(0)) for k in numbers]
    with tempfile.TemporaryDirectory() as nowhere:
        folder = options.ledgers or Path(nowhere)
        folder.mkdir(parents=True, exist_ok=True)
        done = run_campaign(function, cases, folder / f"{function.__name__}.ledger", workers=options.workers)
    faults = [f"case {one.index}: {one.fault}" for one in done.outcomes if one.fault is not None]
    if faults:
        raise RuntimeError(f"{function.__name__}, {faults[0]}")
    return [one.result for one in done.outcomes]
