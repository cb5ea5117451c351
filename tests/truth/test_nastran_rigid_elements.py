"""RBE1 and RBAR with independent components at several grids, beside the same body said otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.files.setups import load_structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium

# Two bars, and what joins them; grid 3 moves in axes of its own.
BULK = """\
SOL 103
CEND
MPC = 7
BEGIN BULK
MAT1,1,7.+10,,.3,2700.
PBAR,1,1,1.-4,1.-9,2.-9,2.-9
CORD2R,5,,0.,0.,0.,.3,.5,1.
,1.,.2,0.
GRID,1,,0.,0.,0.
GRID,2,,1.,.0,.1
GRID,3,,1.2,.3,.2,5
GRID,4,,2.,.5,-.3
GRID,6,,1.1,-.3,.4
CBAR,11,1,1,2,0.,1.,0.
CBAR,12,1,3,4,0.,1.,1.
CBAR,13,1,6,4,0.,1.,1.
CONM2,14,4,,2.5
CONM2,15,1,,1.5
"""


def frequencies(folder, cards: str) -> np.ndarray:
    deck, article = folder / "deck.dat", folder / "article.toml"
    chosen = BULK if "MPC,7" in cards else BULK.replace("MPC = 7\n", "")
    deck.write_text(f"{chosen}{cards}\nENDDATA\n")
    made = convert_deck(read_deck(deck), parse_units("m-kg-s-N"), "consistent", "a")
    article.write_text(document_text(made.document, "a"))
    rest = solve_equilibrium(load_structure(article), Environment.orbit())
    return solve_modes(rest).frequency_hz


BODY = "RBE2,20,2,123456,3,6"


@pytest.mark.parametrize(
    "cards",
    [
        "RBE1,20,2,123456\n,UM,3,123456,6,123456",
        "RBE1,20,2,123,3,3,6,23\n,UM,2,456,3,12456,6,1456",
        "RBAR,20,2,3,123,456\nRBAR,21,2,6,123456",
        "RBAR,20,2,3,1236,23\nRBE2,21,3,123456,6",
    ],
)
def test_whoever_is_independent_a_rigid_body_is_one(tmp_path, cards: str):
    np.testing.assert_allclose(
        frequencies(tmp_path, cards)[6:20], frequencies(tmp_path, BODY)[6:20], rtol=1e-7
    )


@pytest.mark.parametrize(
    ("cards", "same"),
    [
        ("RBE1,20,2,123456\n,UM,3,123,6,12", "RBE2,20,2,123,3\nRBE2,21,2,12,6"),
        ("RBAR,20,2,3,123456,,,1245\nRBE2,21,2,123456,6", "RBE2,20,2,1245,3\nRBE2,21,2,123456,6"),
    ],
)
def test_some_components_are_those_of_rigid_links(tmp_path, cards: str, same: str):
    np.testing.assert_allclose(
        frequencies(tmp_path, cards)[6:20], frequencies(tmp_path, same)[6:20], rtol=1e-7
    )


def test_a_dependent_component_is_a_sum_of_six(tmp_path):
    """Shift of grid 6 along x: u = t + theta x r at three other grids, solved by hand for an MPC."""
    place = {1: (0.0, 0.0, 0.0), 2: (1.0, 0.0, 0.1), 4: (2.0, 0.5, -0.3), 6: (1.1, -0.3, 0.4)}

    def row(grid: int, k: int) -> np.ndarray:
        return np.concatenate([np.eye(3)[k], np.cross(place[grid], np.eye(3)[k])])

    known = [(2, 0), (2, 1), (2, 2), (4, 1), (4, 2), (1, 2)]
    factors = np.linalg.solve(np.array([row(*m) for m in known]).T, row(6, 0))
    terms = ["6,1,1.", *(f"{g},{k + 1},{-f:.12f}" for (g, k), f in zip(known, factors, strict=True))]
    by_hand = "MPC,7," + ",\n,,".join(",".join(terms[i : i + 2]) for i in range(0, len(terms), 2))
    joined = "CBAR,16,1,2,6,0.,1.,0.\nCBAR,17,1,2,3,0.,0.,1.\n"
    split = frequencies(tmp_path, joined + "RBE1,20,2,123,4,23,1,3\n,UM,6,1")
    np.testing.assert_allclose(split[6:20], frequencies(tmp_path, joined + by_hand)[6:20], rtol=1e-7)
    assert np.max(np.abs(split[6:20] / frequencies(tmp_path, joined)[6:20] - 1.0)) > 1e-2


def test_parameters_and_cards_of_other_programs_do_not_stop_a_deck(tmp_path):
    more = "PARAM   EQCHECK  0      3       3                               -1.E10  Y\nDEBUG   192     2"
    np.testing.assert_array_equal(frequencies(tmp_path, f"{BODY}\n{more}"), frequencies(tmp_path, BODY))
