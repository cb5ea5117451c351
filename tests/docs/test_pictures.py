"""The pictures of the pages: each is used, each is drawn by docs/pictures.py, and is drawn anew."""

from __future__ import annotations

import re

import pytest
from doc_pages import ROOT, tracked

from drawn_pictures import OF_THE_STUDY, assert_as_kept, picture_module
from repeats import repeats

IMAGES = ROOT / "docs" / "images"
IMAGE = re.compile(r"!\[[^\]]+\]\(([^)\s]+)\)")
ALONE = (
    "chain",
    "promise",
    "margins",
    "orders",
    "fit",
    "response",
    "shapes",
    "friction",
    "benchmarks",
    "gimbals",
)
ALONE += ("gravity-path",)
MOST_BYTES, MOST_BYTES_TOGETHER = 60_000, 500_000


pictures = pytest.fixture(picture_module, scope="module")


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


@pytest.mark.parametrize("name", repeats(ALONE, 2))
def test_a_picture_drawn_anew_is_the_one_in_the_folder(pictures, name: str):
    assert_as_kept(pictures, name)


def test_every_picture_is_drawn_anew_by_some_test(pictures):
    assert {*ALONE, *OF_THE_STUDY} == set(pictures.PICTURES)
