"""Rows of a result file, and programs beside ours run in an environment of their own."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import scipy.sparse.linalg as spla

PEERS = Path(__file__).resolve().parents[1] / "peers"


def row(
    case: str, measure: str, unit: str, value: float, level: float | None = None, **more: Any
) -> dict[str, Any]:
    """One figure; ``more`` may hold states, note and peers."""
    met = None if level is None else bool(value <= level)
    return {"case": case, "measure": measure, "unit": unit, "value": float(value), "level": level, "met": met,
            "peers": {}, **more}  # fmt: skip


def miss_row(case: str, measure: str, missed: float, **more: Any) -> dict[str, Any]:
    """Per cent of 95 % intervals that miss: 90 to 99 % are to hold, since too wide is wrong too."""
    found = row(case, measure, "%", missed, **more)
    return {**found, "level": "1 to 10", "met": bool(1.0 <= missed <= 10.0)}


def cell(name: str, found: dict[str, np.ndarray], value: float) -> dict[str, dict[str, Any]]:
    """The column of one peer."""
    return {name: {"value": float(value), "version": str(found["version"])}}


def peer(python: str | None, script: str, **given: Any) -> dict[str, np.ndarray] | None:
    """What ``script`` of the folder peers answers; None without an interpreter that has the peers."""
    if python is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(source, **given)
        subprocess.run([python, str(PEERS / script), str(source), str(target)], check=True)
        with np.load(target, allow_pickle=False) as answer:
            return {k: answer[k] for k in answer.files}


@contextlib.contextmanager
def counted_factorisations() -> Iterator[list[int]]:
    """A list that grows by one entry with every sparse factorisation."""
    found: list[int] = []
    real = spla.splu

    def counted(*given: Any, **more: Any) -> Any:
        found.append(1)
        return real(*given, **more)

    with mock.patch.object(spla, "splu", counted):
        yield found
