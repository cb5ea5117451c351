"""The pictures of the pages: each is used, each is drawn by docs/pictures.py, and one is drawn anew."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from doc_pages import ROOT, tracked

IMAGES = ROOT / "docs" / "images"
IMAGE = re.compile(r"!\[[^\]]+\]\(([^)\s]+)\)")
NUMBER = re.compile(r"-?\d+\.\d+")
MOST_BYTES, MOST_BYTES_TOGETHER = 60_000, 500_000


@pytest.fixture(scope="module")
def pictures():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import pictures

        yield pictures
    finally:
        sys.path.remove(str(ROOT / "docs"))
        sys.modules.pop("pictures", None)


def test_every_picture_is_shown_and_every_one_shown_is_there():
    shown = {
        (page.parent / target).resolve()
        for page in tracked("*.md")
        for target in IMAGE.findall(page.read_text(encoding="utf-8"))
    }
    assert shown == set(IMAGES.iterdir())


def test_every_picture_is_small_and_has_its_function(pictures):
    sizes = {path.stem: path.stat().st_size for path in IMAGES.iterdir()}
    assert set(sizes) == set(pictures.PICTURES)
    assert max(sizes.values()) < MOST_BYTES
    assert sum(sizes.values()) < MOST_BYTES_TOGETHER
    assert all(draw.__doc__ for draw in pictures.PICTURES.values())


@pytest.mark.parametrize("name", ["chain", "modes", "promise"])
def test_a_picture_drawn_anew_is_the_one_in_the_folder(pictures, name: str):
    """Letters exactly; coordinates, rounded to hundredths of a point, within the next one."""
    anew, kept = pictures.text_of(name), (IMAGES / f"{name}.svg").read_text(encoding="utf-8")
    assert NUMBER.sub("#", anew) == NUMBER.sub("#", kept)
    places = [np.array([float(x) for x in NUMBER.findall(text)]) for text in (anew, kept)]
    np.testing.assert_allclose(*places, rtol=0.0, atol=0.02)
