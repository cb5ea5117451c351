"""``middeck new``: what it makes runs, and nothing is overwritten."""

import json
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import middeck
from middeck.files.records import load_record
from middeck.identification.model.measurement_model import natural_hz


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from middeck.cli.verbs.new import verb

    made = tmp_path_factory.mktemp("place") / "boom"
    verb.main([str(made)], standalone_mode=False)
    return made


def test_the_files_name_the_folder_and_stand_alone(folder: Path) -> None:
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["README.md", "article.toml", "lab.toml", "orbit.toml", "record.npz", "study.toml"]
    assert md.load_structure(folder / "article.toml").title == "boom"
    assert not [path for path in folder.iterdir() if b"$name" in path.read_bytes()]


def test_the_study_runs_the_chapters_that_it_has_and_claims_nothing(folder, capfd, tmp_path) -> None:
    study = folder / "study.toml"
    ended = middeck(capfd, "study", str(study), "-o", str(tmp_path), "--set", "control.levels=3")
    assert ended.code == 0, ended.err
    figures = json.loads((tmp_path / "numbers.json").read_text())["figures"]
    assert list(figures) == ["figure_4", "figure_5", "figure_7"]
    page = (tmp_path / "report.html").read_text()
    assert "Performance against authority" in page
    assert "Figure" not in page  # numbers of a paper that is not about this article
    assert "1993" not in page
    assert 'id="claims"' not in page
    assert figures["figure_7"]["all"]["first_instability"] is not None  # the paper's finding, on this article


def test_the_record_is_of_the_article_in_its_laboratory(folder) -> None:
    """The frequencies of the bending modes that the test moves, and the delay of 10 ms less half a hold."""
    record = load_record(folder / "record.npz")
    fit = md.fit_response(md.estimate_response(record), states=10)
    setup = md.load_setup(folder / "article.toml", folder / "lab.toml")
    modes = md.solve_modes(md.solve_equilibrium(*setup))
    fitted = natural_hz(fit.model)
    for name in ("payload pendulum paddle", "first bending x-y", "second bending x-y"):
        true = modes.frequency_hz[modes.name.index(name)]
        assert np.min(np.abs(fitted / true - 1.0)) < 1e-4, name
    np.testing.assert_allclose(fit.model.delay_s, 0.0075, atol=2e-4)


def test_nothing_is_overwritten_and_names_are_checked(folder, capfd, tmp_path) -> None:
    assert "exists already" in middeck(capfd, "new", str(folder)).err
    ended = middeck(capfd, "new", str(tmp_path / "7 up"))
    assert ended.code == 2
    assert "no name of an article" in ended.err
    assert list(tmp_path.iterdir()) == []
