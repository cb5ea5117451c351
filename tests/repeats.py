"""How much of what is repeated `make test` runs; `make test-all` runs the whole."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

LONG = os.environ.get("MIDDECK_LONG") == "1"


def repeats(cases: Iterable[Any], quick: int = 1) -> list[Any]:
    """Cases of one law; `make test` runs the first few: put first what is hardest or most unlike the rest."""
    return list(cases)[: None if LONG else quick]
