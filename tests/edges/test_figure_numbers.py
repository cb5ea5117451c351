"""What stands in the figures of ``level`` and ``design`` are the numbers that the verbs give as JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch

import middeck as md
from cli_runner import ROOT, middeck
from middeck.cli import figures

Capture = pytest.CaptureFixture[str]
ARTICLE = ("articles/mace-simple.toml", "--set", "mesh.elements_per_strut=1")
LOW = "suspension.offsets.0.2=0"


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures as they are about to be written."""
    kept: list[Figure] = []
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(figures, "write_figure", lambda figure, *_, **__: kept.append(figure))
    return kept


def asked(capfd: Capture, *arguments: object) -> dict[str, Any]:
    ended = middeck(capfd, *arguments, "--json")
    assert ended.code == 0, ended.err
    return json.loads(ended.out)


def vertices(figure: Figure, panel: int, *, ghost: bool) -> np.ndarray:
    """Points of members as drawn (``ghost``) or at rest, on the page."""
    paths = [a for a in figure.axes[panel].get_children() if isinstance(a, PathPatch)]
    wanted = [p for p in paths if (p.get_zorder() == 1.0) == ghost and p.get_zorder() in (1.0, 3.0)]
    return np.concatenate([p.get_path().vertices for p in wanted])


def test_level_draws_the_rest_before_and_after(capfd: Capture, drawn: list[Figure], tmp_path: Path) -> None:
    """Nodes are where JSON says that they rest, in the scale that the title states, seen from one eye."""
    found = asked(capfd, "level", *ARTICLE, "--set", LOW, "--free", "n1.z", "--about", "x", "--figure",
                  tmp_path / "a.svg")  # fmt: skip
    (figure,) = drawn
    heading = figure.get_suptitle()
    times, largest = (float(x) for x in re.findall(r"times (\S+), the largest (\S+) mm", heading)[0])
    by = found["change_m"]["n1.z"]
    assert [a.get_title("left") for a in figure.axes] == ["before", f"after n1.z {1e3 * by:+.1f} mm"]
    # The page: 32 degrees about the vertical y to the left, 22 from above.
    a, e = np.radians([-32.0, 22.0])
    right = np.array([np.cos(a), 0.0, np.sin(a)])
    eye = np.array([-np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    page = np.column_stack([right, np.cross(eye, right)])
    places = {n.name: n.position for n in md.load_structure(ARTICLE[0]).nodes}
    moved = []
    for panel, offset in enumerate((0.0, by)):
        rest = asked(capfd, "modes", *ARTICLE, "--set", f"suspension.offsets.0.2={offset!r}", "--count", 1)
        ghost, at_rest = (vertices(figure, panel, ghost=g) for g in (True, False))
        for name, shift in rest["node_shift_m"].items():
            moved.append(np.linalg.norm(shift))
            for points, x in ((ghost, places[name]), (at_rest, places[name] + times * np.array(shift))):
                assert np.linalg.norm(points - x @ page, axis=1).min() < 1e-9, (name, panel)
    assert largest >= 1e3 * max(moved)  # what stands away from nodes moves more by their rotation


def test_design_draws_the_margins_of_its_law(capfd: Capture, drawn: list[Figure], tmp_path: Path) -> None:
    law = tmp_path / "law.json"
    article = ("articles/mace-dm.toml", "--set", "mesh.elements_per_strut=1", "--count", 12)
    designed = asked(capfd, "design", *article, "--control", "pri_rel_z", "--measure", "pri_in_z", "-o", law,
                     "--figure", tmp_path / "a.svg")  # fmt: skip
    (row,) = asked(capfd, "qualify", law, *article, "--environment", "lab")["rows"]
    (figure,) = drawn
    (axes,) = figure.axes
    assert designed["control"] == ["pri_rel_z"]
    words = f"{row['gain_db']:.1f} dB, {row['phase_deg']:.1f} deg, disk {row['disk']:.2f}"
    assert axes.get_title("left") == f"broken at pri_rel_z:\n{words}"
    lines = {line.get_label(): np.asarray(line.get_xydata()) @ [1.0, 1.0j] for line in axes.get_lines()}
    dots, squares = (lines[next(n for n in lines if n.startswith(w))] for w in ("unit gain", "negative"))
    np.testing.assert_allclose(np.abs(dots), 1.0, rtol=1e-12)
    assert np.degrees(np.abs(np.angle(-dots))).min() == pytest.approx(row["phase_deg"], rel=1e-9)
    assert np.abs(20.0 * np.log10(-squares.real)).min() == pytest.approx(row["gain_db"], rel=1e-9)
    assert not squares.imag.any()
    # The disk that L keeps out of, its gains on the axis: alpha = 2 (1 - low) / (1 + low).
    (disk,) = [p for p in axes.patches if isinstance(p, Circle)]
    near = -disk.center[0] - disk.radius
    assert 2.0 * (1.0 - near) / (1.0 + near) == pytest.approx(row["disk"], rel=1e-9)
    # The curve itself: the law that was written, around the plant.
    curve = lines["L"][np.isfinite(lines["L"])]
    assert np.abs(curve - complex(*disk.center)).min() == pytest.approx(disk.radius, rel=0.02)
    for point in (*dots, *squares):
        assert np.abs(curve - point).min() <= 0.06 * abs(point)
