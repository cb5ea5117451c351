"""The pictures of the paper's study: those in docs/images are what its chapters give today."""

from __future__ import annotations

import pytest

from drawn_pictures import OF_THE_STUDY, assert_as_kept, picture_module

modules = pytest.fixture(picture_module)


@pytest.fixture
def pictures(modules, paper_outcomes, monkeypatch: pytest.MonkeyPatch):
    """``docs/pictures.py``, which takes the chapters as other tests have computed them."""
    monkeypatch.setattr(modules, "comparison", lambda: paper_outcomes["figures 4 and 5"])
    monkeypatch.setattr(modules, "control", lambda: paper_outcomes["figure 7"])
    return modules


@pytest.mark.parametrize("name", OF_THE_STUDY)
def test_a_picture_of_the_study_drawn_anew_is_the_one_in_the_folder(pictures, name: str):
    assert_as_kept(pictures, name)
