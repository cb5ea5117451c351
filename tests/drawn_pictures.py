"""The pictures of the pages, drawn anew and compared with the files in docs/images."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

DOCS = Path(__file__).parents[1] / "docs"
OF_THE_STUDY = ("mace-1993", "shape", "modes", "budget", "authority")
NUMBER = re.compile(r"-?\d+\.\d+")


def picture_module() -> Iterator[ModuleType]:
    """``docs/pictures.py``, and afterwards it is forgotten."""
    sys.path.insert(0, str(DOCS))
    try:
        import pictures

        yield pictures
    finally:
        sys.path.remove(str(DOCS))
        sys.modules.pop("pictures", None)


def assert_as_kept(pictures: ModuleType, name: str) -> None:
    """Letters exactly; coordinates, rounded to hundredths of a point, within the next one."""
    anew = pictures.text_of(name)
    kept = (DOCS / "images" / f"{name}.svg").read_text(encoding="utf-8")
    assert NUMBER.sub("#", anew) == NUMBER.sub("#", kept), "drawn otherwise than the file: `make pictures`"
    places = [np.array([float(x) for x in NUMBER.findall(text)]) for text in (anew, kept)]
    np.testing.assert_allclose(*places, rtol=0.0, atol=0.02)
