"""PLOAD1 against integrals of the beam equation, CTUBE against its closed forms."""

import numpy as np
import pytest

import middeck as md
from middeck.errors import ConfigError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

E, NU, L, A, J = 7e10, 0.3, 1.25, 2e-4, 3e-8
G = E / (2.0 * (1.0 + NU))
HEAD = ("SOL 103", "CEND", "SPC = 1", "BEGIN BULK", f"MAT1,1,{E:.1e},,{NU},2700.")
SPREAD = [  # type, X1, P1, X2, P2 in fractions of the length
    ("FYE", 0.0, 2.0, 1.0, 2.0), ("FZE", 0.2, 1.0, 0.9, -3.0), ("FXE", 0.1, 3.0, 0.8, 1.0),
    ("FY", 0.7, 4.0, None, None), ("MX", 0.4, 0.5, None, None), ("MZE", 0.0, 1.0, 1.0, 0.5),
    ("MYE", 0.5, 2.0, 1.0, 2.0), ("FZ", 0.0, 1.0, 1.0, 0.0),
]  # fmt: skip


def converted(tmp_path, rows):
    (tmp_path / "a.dat").write_text("\n".join([*HEAD, *rows, "ENDDATA"]))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), "consistent", "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "e"))
    return made, *md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")


def tip(load, at, bend, shear):
    """Shift and turn, in element axes, of a cantilever's end by a load at one place; load at its root."""
    (fx, fy, fz), (mx, my, mz) = load[:3], load[3:]
    give = np.linalg.inv(bend)
    across, slope = np.array([fy, fz]), np.array([mz, -my])
    v = give @ (across * at**2 * (3.0 * L - at) / 6.0 + slope * (at * L - 0.5 * at**2)) + shear * across * at
    dv = give @ (across * 0.5 * at**2 + slope * at)
    moved = np.array([fx * at / (E * A), *v, mx * at / (G * J), -dv[1], dv[0]])
    return np.array([moved, load + np.array([0.0, 0.0, 0.0, 0.0, -fz * at, fy * at])])


@pytest.mark.parametrize("skew", [True, False], ids=["I12", "shear"])
@pytest.mark.parametrize("case", range(len(SPREAD)))
def test_the_end_of_a_cantilever_moves_as_under_the_load_itself(tmp_path, case, skew):
    kind, first, p1, last, p2 = SPREAD[case]
    x, up = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    axes = np.column_stack([x, up, np.cross(x, up)])
    second = np.array([[3e-8, 1e-8 * skew], [1e-8 * skew, 2e-8]])
    factors = np.array([0.4, 0.8])
    more = ",,,1.-8" if skew else ",0.4,0.8"
    to, by = ("", "") if last is None else (f"{last * L:.9E}", f"{p2 * 1e-3:.9E}")
    _, article, held = converted(
        tmp_path,
        [
            "GRID,1", f"GRID,2,,{L * x[0]},0.,{L * x[2]}", "CBAR,1,1,1,2,0.,1.,0.", "SPC1,1,123456,1",
            f"PBAR,1,1,2.-4,3.-8,2.-8,3.-8\n,\n{more}",
            f"PLOAD1,5,1,{kind},LE,{first * L:.9E},{p1 * 1e-3:.9E},{to},{by}",
        ],
    )  # fmt: skip
    along = (axes if kind[-1] == "E" else np.eye(3))[:, "XYZ".index(kind[1])]
    load = np.zeros(6)
    load[3 * (kind[0] == "M") :][:3] = axes.T @ along
    shear = np.zeros(2) if skew else 1.0 / (factors * G * A)
    if last is None:
        want = 1e-3 * p1 * tip(load, first * L, E * second, shear)
    else:
        points, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * (last - first)
        places = first + half * (1.0 + points)
        p = 1e-3 * (p1 + (p2 - p1) * (places - first) / (last - first))
        parts = [
            L * half * w * q * tip(load, L * at, E * second, shear)
            for at, w, q in zip(places, weights, p, strict=True)
        ]
        want = np.sum(parts, axis=0)
    want, root = want
    rest = md.solve_equilibrium(article, held, "load5")
    moved = rest.config.x[1] - article.nodes[1].position
    turn = rest.config.R[1]
    small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    found = np.concatenate([axes.T @ moved, axes.T @ small])
    np.testing.assert_allclose(found, want, rtol=1e-5, atol=1e-5 * np.abs(want[:3]).max())
    (wall,) = rest.reactions
    holds = -np.concatenate([axes.T @ wall.force, axes.T @ wall.moment])
    np.testing.assert_allclose(holds, root, rtol=1e-6, atol=1e-8)


def test_a_load_on_a_pinned_end_goes_to_the_pin(tmp_path):
    """Under q the free slope of a beam pinned at its wall and guided at its end: q L^3 / (6 E I) + ..."""
    made, article, held = converted(
        tmp_path,
        [
            "GRID,1", f"GRID,2,,{L},0.,0.", "CBAR,1,1,1,2,0.,1.,0.\n,6", "PBAR,1,1,2.-4,3.-8,2.-8,3.-8",
            "SPC1,1,123456,1", "SPC1,1,13456,2", "PLOAD1,5,1,FYE,FR,0.,.001,1.,.001",
        ],
    )  # fmt: skip
    rest = md.solve_equilibrium(article, held, "load5")
    moved = rest.config.x[1] - article.nodes[1].position
    assert ("PLOAD1 of load set 5", 1) in [left[:2] for left in made.left_out]  # its own bending
    # Moment zero at the pin, slope zero at the guide: v(L) = 5 q L^4 / (24 E I).
    np.testing.assert_allclose(moved[1], 5.0 * 1e-3 * L**4 / (24.0 * E * 3e-8), rtol=1e-6)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("PLOAD1,5,1,FY,LEPR,0.,1.,1.,1.", "FY by LEPR is not converted"),
        ("PLOAD1,5,1,FY,FR,0.,1.,1.5,1.", "it acts from 0 to 1.5 of 1"),
        ("PLOAD1,5,7,FY,FR,0.,1.,1.,1.", "element 7, which is no bar or beam"),
        ("PLOAD1,5,1,FY,FR,0.,1.,1.", "has a value at both"),
    ],
)
def test_a_load_that_is_not_converted_leaves_its_set_out(tmp_path, row, words):
    rows = [
        "GRID,1",
        "GRID,2,,1.,0.,0.",
        "CBAR,1,1,1,2,0.,1.,0.",
        "PBAR,1,1,2.-4,3.-8,2.-8,3.-8",
        "SPC1,1,123456,1",
    ]
    made, *_ = converted(tmp_path, [*rows, row])
    assert any(card == "load set 5" and words in why for card, _, why in made.left_out)
    assert "load_case" not in made.document


@pytest.mark.parametrize(("wall", "inner"), [("", 0.0), (0.004, 0.012)], ids=["solid", "tube"])
def test_a_tube_is_a_rod_of_its_area_and_torsion_constant(tmp_path, wall, inner):
    outer, mass, about = 0.02, 3.0, 0.5
    _, article, held = converted(
        tmp_path,
        [
            "GRID,1", f"GRID,2,,{L},0.,0.", "CTUBE,1,7,1,2", f"PTUBE,7,1,{outer},{wall}",
            "SPC1,1,123456,1", "SPC1,1,2356,2", f"CONM2,9,2,,{mass},,,,\n,{about},,{about},,,{about}",
        ],
    )  # fmt: skip
    area, twist = np.pi / 4.0 * (outer**2 - inner**2), np.pi / 32.0 * (outer**4 - inner**4)
    own = 2700.0 * area * L / 3.0
    want = np.sqrt(sorted([G * twist / L / about, E * area / L / (mass + own)]))
    np.testing.assert_allclose(md.solve_modes(md.solve_equilibrium(article, held)).omega, want, rtol=1e-9)


def test_a_tube_that_is_none_is_refused(tmp_path):
    for row, words in (("PTUBE,7,1,.02,.02", "no tube has diameter 0.02"), ("PTUBE,7,1,.02,,,.03", "OD2")):
        with pytest.raises(ConfigError, match=words):
            converted(tmp_path, ["GRID,1", "GRID,2,,1.,0.,0.", "CTUBE,1,7,1,2", row])
