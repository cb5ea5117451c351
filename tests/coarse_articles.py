"""The shipped articles on a coarse mesh, for tests of which the mesh is no part."""

from __future__ import annotations

import atexit
import functools
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


@functools.cache
def scratch() -> Path:
    """A folder that lasts as long as the process."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return Path(folder.name)


@functools.cache
def coarse(name: str) -> Path:
    """``articles/NAME.toml`` with two elements a strut in place of eight: frequencies to a few 1e-5."""
    text = (ROOT / "articles" / f"{name}.toml").read_text(encoding="utf-8")
    assert "elements_per_strut = 8" in text
    made = scratch() / f"{name}.toml"
    made.write_text(text.replace("elements_per_strut = 8", "elements_per_strut = 2"), encoding="utf-8")
    return made
