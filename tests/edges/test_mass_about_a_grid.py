"""PARAM GRDPNT and COUPMASS: mass about the named grid against sums by hand, WTMASS and units included."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck

G, RHO, AREA = 0.5, 0.1, 2.0  # PARAM WTMASS; density [weight] and area of the bar, inches
PLACES = {3: (2.0, -1.0, 4.0), 7: (12.0, -1.0, 4.0), 9: (12.0, 5.0, 4.0)}
# Grid, weight, arm from the grid, inertia at the centre (in weight too): I11, I21, I22, I31, I32, I33.
BODIES = [(7, 3.0, (0.5, 0.0, -1.0), (4.0, 0.3, 5.0, -0.2, 0.1, 6.0)), (9, 1.5, (0.0, 0.0, 0.0), (0.0,) * 6)]


# Of the second, taken away again; its inertia is taken away too.
TAKEN = (7, -1.2, (0.2, 0.1, 0.0), (-0.5, 0.0, -0.4, 0.0, 0.0, -0.6))


def deck(path: Path, params: str, bodies: Sequence[tuple] = BODIES) -> Path:
    rows = ["SOL 103", "CEND", "BEGIN BULK", "PARAM,WTMASS,.5", *filter(None, params.split(";"))]
    rows += [f"GRID,{n},,{x},{y},{z}" for n, (x, y, z) in PLACES.items()]
    rows += ["MAT1,1,1.+7,,.3,.1", "PBAR,1,1,2.,.1,.1,.2"]
    rows += ["CBAR,1,1,3,7,0.,1.,0.", "CBAR,2,1,7,9,1.,0.,0."]
    for k, (grid, weight, arm, inertia) in enumerate(bodies):
        rows += [f"CONM2,{k + 10},{grid},,{weight},{arm[0]},{arm[1]},{arm[2]}"]
        rows += [",".join(["", *map(str, inertia)])] if any(inertia) else []
    path.write_text("\n".join([*rows, "ENDDATA", ""]))
    return path


def by_hand(
    about: np.ndarray, lumped: bool, bodies: Sequence[tuple] = BODIES
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre from the point and inertia about it, in inches and slinches."""
    points = []  # weight, place, own inertia
    for grid, weight, arm, (xx, yx, yy, zx, zy, zz) in bodies:
        own = np.array([[xx, -yx, -zx], [-yx, yy, -zy], [-zx, -zy, zz]])
        points.append((weight, np.add(PLACES[grid], arm), own))
    for a, b in ((3, 7), (7, 9)):
        start, end = np.array(PLACES[a]), np.array(PLACES[b])
        span, weight = end - start, RHO * AREA * float(np.linalg.norm(end - start))
        rod = (span @ span * np.eye(3) - np.outer(span, span)) / 12.0
        if lumped:
            points += [(0.5 * weight, at, np.zeros((3, 3))) for at in (start, end)]
        else:
            points.append((weight, 0.5 * (start + end), weight * rod))
    mass = sum(w for w, _, _ in points)
    centre = sum(w * (at - about) for w, at, _ in points) / mass
    inertia = np.zeros((3, 3))
    for w, at, own in points:
        r = at - about
        inertia += own + w * (r @ r * np.eye(3) - np.outer(r, r))
    return G * mass, centre, G * inertia


@pytest.mark.parametrize(
    ("params", "grid", "lumped"),
    [
        ("PARAM,GRDPNT,7", 7, True),
        ("PARAM,GRDPNT,0;PARAM,COUPMASS,1", 0, False),
        ("PARAM,GRDPNT,9;PARAM,COUPMASS,-1", 9, True),
        ("PARAM,GRDPNT,55", 0, True),
        ("PARAM,GRDPNT,-1", None, True),
        ("", None, True),
    ],
)
def test_the_mass_about_the_named_grid(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], params: str, grid: int | None, lumped: bool
) -> None:
    asked = ("convert", deck(tmp_path / "a.dat", params), "--units", "in-slinch-s-lbf")
    ended = middeck(capfd, *asked, "--mass-formulation", "deck", "--json")
    assert ended.code == 0, ended.err
    document = json.loads(ended.out)
    assert document["mass_formulation"] == ("lumped" if lumped else "coupled")
    assert not any("GRDPNT" in row["card"] for row in document["left_out"])
    found = document["grid_point_weight"]
    if grid is None:
        assert found is None
        return
    at = np.array(PLACES.get(grid, (0.0, 0.0, 0.0)))
    inch, slinch = 0.0254, 4.4482216152605 / 0.0254
    mass, centre, inertia = by_hand(at, lumped)
    assert found["grid"] == grid
    assert document["mass_kg"] == pytest.approx(slinch * mass, rel=1e-9)
    np.testing.assert_allclose(found["at_m"], inch * at, rtol=1e-12)
    np.testing.assert_allclose(found["centre_of_mass_from_it_m"], inch * centre, rtol=1e-9)
    size = slinch * inch**2 * np.abs(inertia).max()
    expected = slinch * inch**2 * inertia
    np.testing.assert_allclose(found["inertia_about_it_kg_m2"], expected, atol=1e-9 * size)
    assert any("grid 55, which is not there" in note for note in document["notes"]) == ("55" in params)


def test_the_lines_on_it_and_a_bad_grid(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    units = ("--units", "in-slinch-s-lbf", "--mass-formulation", "lumped")
    ended = middeck(capfd, "convert", deck(tmp_path / "a.dat", "PARAM,GRDPNT,7"), *units)
    assert "about grid 7 (PARAM GRDPNT), in SI and basic axes, WTMASS included:" in ended.out
    centre = 0.0254 * by_hand(np.array(PLACES[7]), lumped=True)[1]
    assert f"centre       {'  '.join(f'{x:.6g}' for x in centre)} m from it, x y z" in ended.out
    ended = middeck(capfd, "convert", deck(tmp_path / "b.dat", "PARAM,GRDPNT,YES"), *units)
    assert ended.code == 2
    assert "PARAM GRDPNT" in ended.err
    assert "must be the number of a grid, 0 or -1" in ended.err
    ended = middeck(capfd, "convert", deck(tmp_path / "c.dat", "PARAM,COUPMASS,ABC"), *units)
    assert (ended.code, "PARAM COUPMASS" in ended.err) == (2, True)
    assert "must be a whole number, YES or NO" in ended.err


def test_a_negative_mass_takes_away_what_is_there_and_no_more(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    asked = ("--units", "in-slinch-s-lbf", "--mass-formulation", "lumped", "--json")
    bodies = (*BODIES, TAKEN)
    ended = middeck(capfd, "convert", deck(tmp_path / "a.dat", "PARAM,GRDPNT,9", bodies), *asked)
    assert ended.code == 0, ended.err
    document = json.loads(ended.out)
    mass, centre, inertia = by_hand(np.array(PLACES[9]), True, bodies)
    slinch = 4.4482216152605 / 0.0254
    assert document["mass_kg"] == pytest.approx(slinch * mass, rel=1e-9)
    found = document["grid_point_weight"]
    np.testing.assert_allclose(found["centre_of_mass_from_it_m"], 0.0254 * centre, rtol=1e-9)
    expected = slinch * 0.0254**2 * inertia
    np.testing.assert_allclose(found["inertia_about_it_kg_m2"], expected, atol=1e-9 * np.abs(expected).max())
    for wrong in ((7, -3.1, (0.5, 0.0, -1.0), (0.0,) * 6), (9, -0.1, (3.0, 0.0, 0.0), (0.0,) * 6)):
        path = deck(tmp_path / "b.dat", "", (*BODIES, wrong))
        ended = middeck(capfd, "convert", path, *asked)
        assert ended.code == 2
        assert f"it leaves too little of the masses of grid {wrong[0]}: no body has mass" in ended.err
        assert "CONM2 12" in ended.err
