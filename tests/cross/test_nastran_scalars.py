"""Springs and masses on scalar points against the textbook's matrices, each a row's product more."""

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.errors import ConfigError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from nastran_decks import card, components, motion, random_deck, textbook
from repeats import repeats

DIGITS = 1e-6
POINTS = (501, 502, 503, 504)
HELD = 505
RIGID = 1e-2  # rad/s, of rounding; the softest spring gives some


def frequencies(K, M):
    """By the inverse problem: some motions have no mass, and their frequencies no end."""
    shift = 1e-6 * np.linalg.norm(K) / np.linalg.norm(M)
    mu = scipy.linalg.eigh(M, K + shift * M, eigvals_only=True)[::-1]
    return np.sqrt(np.maximum(1.0 / mu[mu > 1e-13 * mu[0]] - shift, 0.0))


def converted(tmp_path, text, units="m-kg-s-N", formulation="consistent"):
    (tmp_path / "a.dat").write_text(text)
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units(units), formulation, "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "a"))
    return made, md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")


def row_of(deck, end):
    """What an end of an element moves by, in the freedoms of the free grids and the scalar points."""
    size = 6 * len(deck.free)
    row = np.zeros(size + len(POINTS))
    if end is None or end == (HELD, 0):
        return row
    point, component = end
    if not component:
        row[size + POINTS.index(point)] = 1.0
        return row
    axes = np.array(
        [components(*deck.systems[deck.moves_in[point]], deck.places[point], e) for e in np.eye(3)]
    ).T
    own = np.kron(np.eye(2), axes) @ motion(deck, point, np.zeros(3))
    row[:size] = own[component - 1]
    return row


def scalar_deck(deck, seed, held):
    """The deck with scalar points on it, and what they add to its matrices: every way of joining them."""
    rng = np.random.default_rng([11, seed])
    grid = lambda: (int(rng.choice(list(deck.places))), int(rng.integers(1, 7)))  # noqa: E731 -- drawn anew
    a, b, c, d = ((point, 0) for point in POINTS)
    springs = [
        (a, grid()),
        (grid(), b),
        (a, b),
        (b, c),
        (c, (HELD, 0)),
        (grid(), (HELD, 0)),
        (d, c),
        (d, None),
    ]
    masses = [(a, None), (b, None), (a, c), (c, grid()), (None, c)]
    if not held:
        loose = {(HELD, 0), None}
        springs = [pair for pair in springs if loose.isdisjoint(pair)]
    size = 6 * len(deck.free) + len(POINTS)
    K, M = np.zeros((2, size, size))
    lines = card(rng, "SPOINT", *POINTS, HELD) if rng.random() < 0.5 else []
    for k, pair in enumerate([*springs, *masses]):
        ends = [x if end is None else end[i] or None for end in pair for i, x in ((0, None), (1, None))]
        value, mass = float(10.0 ** rng.uniform(2, 4)), k >= len(springs)
        value *= 1e-3 if mass else 1.0
        name, single = "CMASS" if mass else "CELAS", all(end is None or not end[1] for end in pair)
        kind = int(rng.integers(1, 5 if single else 3))
        if kind > 2:
            ends = ends[::2]
        if kind in (1, 3):
            lines += card(rng, "PMASS" if mass else "PELAS", 300 + k, value)
            lines += card(rng, f"{name}{kind}", 7000 + k, 300 + k, *ends)
        else:
            lines += card(rng, f"{name}{kind}", 7000 + k, value, *ends)
        row = row_of(deck, pair[0]) - row_of(deck, pair[1])
        (M if mass else K)[...] += value * np.outer(row, row)
    clamp = card(rng, "SPC1", 72, None, HELD)
    clamp += card(rng, "SPC1", 72, 123456, deck.free[0]) if held else []
    text = deck.text.replace("METHOD = 1", "SPC = 72" if held else "METHOD = 1")
    return text.replace("ENDDATA", "\n".join([*lines, *(clamp if held else []), "ENDDATA"])), K, M


@pytest.mark.parametrize("held", repeats([True, False], 2))
def test_scalar_points_are_those_of_the_textbook(tmp_path, campaign, held):
    for seed in campaign(60):
        deck = random_deck(3000 + seed)
        text, K, M = scalar_deck(deck, seed, held)
        _, (structure, environment) = converted(tmp_path, text)
        own, size = textbook(deck, "consistent"), 6 * len(deck.free)
        K[:size, :size] += own[0]
        M[:size, :size] += own[1]
        if held:
            K, M = K[6:, 6:], M[6:, 6:]
        expected = frequencies(K, M)
        omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
        count = len(omega)
        assert count <= len(expected)
        rigid = expected[:count] < RIGID
        assert np.all(omega[rigid] < RIGID)
        worst = np.abs(omega[~rigid] / expected[:count][~rigid] - 1.0).max()
        assert worst < DIGITS, (seed, worst)


def test_equations_with_scalar_points_are_those_of_the_textbook(tmp_path, campaign):
    """One that ties two of them to a grid; a held one counts as zero; one that stands alone means nothing."""
    for seed in campaign(40):
        deck = random_deck(3000 + seed)
        rng = np.random.default_rng([12, seed])
        text, K, M = scalar_deck(deck, seed, held=True)
        grid, component = int(rng.choice(deck.free[1:])), int(rng.integers(1, 7))
        a, b, c = rng.uniform(0.5, 2.0, 3)
        ties = card(rng, "MPC", 77, 501, 0, a, grid, component, b, None, None, 504, None, c, HELD, 0, 3.0)
        ties += card(rng, "SPOINT", 506) + card(rng, "MPC", 77, 506, 0, 1.0, grid, component, 1.0)
        text = text.replace("SPC = 72", "SPC = 72\nMPC = 77")
        text = text.replace("ENDDATA", "\n".join([*ties, "ENDDATA"]))
        # Consistent units of any kind have the same frequencies, if shifts and turns are told apart.
        _, (structure, environment) = converted(tmp_path, text, ("m-kg-s-N", "mm-t-s-N")[seed % 2])
        own, size = textbook(deck, "consistent"), 6 * len(deck.free)
        K[:size, :size] += own[0]
        M[:size, :size] += own[1]
        row = a * row_of(deck, (501, 0)) + b * row_of(deck, (grid, component)) + c * row_of(deck, (504, 0))
        free = scipy.linalg.null_space(row[None, 6:])
        expected = frequencies(free.T @ K[6:, 6:] @ free, free.T @ M[6:, 6:] @ free)
        omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
        np.testing.assert_allclose(omega, expected[: len(omega)], rtol=DIGITS)


CHAIN = "SPC1,1,0,9\nCELAS4,1,4.,9,1\nCMASS4,2,2.,1\nCELAS2,3,4.,1,,2\nCMASS2,4,2.,2\nCELAS4,5,4.,2\n"
TUNED = """\
MAT1,1,7.+4,,.3,0.
PBAR,1,1,400.,2.+4,2.+4,3.+4
GRID,1,,0.,0.,0.
GRID,2,,1000.,0.,0.
CBAR,11,1,1,2,0.,1.,0.
CONM2,12,2,,2.-3
SPC1,1,123456,1
CELAS2,13,.5,2,3,50
CMASS2,14,4.-4,50
CELAS2,15,2.+4,2,6,51
CMASS2,16,5.,51
"""


def whole(bulk, case="SPC = 1"):
    return f"SOL 103\nCEND\n{case}\nBEGIN BULK\n{bulk}ENDDATA\n"


def test_a_deck_of_scalar_points_alone(tmp_path):
    """Two masses between walls: k/m and 3 k/m; the second wall is no point, the first is held by SPC."""
    _, (structure, environment) = converted(tmp_path, whole(CHAIN))
    omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
    np.testing.assert_allclose(omega, np.sqrt([2.0, 6.0]), rtol=1e-9)


def test_units_of_springs_on_shifts_and_turns(tmp_path):
    """A tip with absorbers on a shift and on a turn, in mm, t and N: both are those of the closed form."""
    _, (structure, environment) = converted(tmp_path, whole(TUNED), "mm-t-s-N")
    omega = md.solve_modes(md.solve_equilibrium(structure, environment)).omega
    E, inertia, L, tip = 7e4, 2e4, 1e3, 2e-3
    bending = E * inertia / L**3 * np.array([[12.0, 6.0 * L], [6.0 * L, 4.0 * L**2]])
    found = [np.sqrt(7e4 * 400.0 / L / tip)]
    for k, m, at in ((0.5, 4e-4, 0), (2e4, 5.0, 1)):
        K, M = np.zeros((3, 3)), np.diag([tip, 0.0, m])
        K[:2, :2] = bending
        K[np.ix_([at, 2], [at, 2])] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        found += frequencies(K, M).tolist()
    np.testing.assert_allclose(omega, np.sort(found), rtol=1e-6)


def test_gravity_does_not_load_scalar_points(tmp_path):
    """In Nastran GRAV acts on grids alone; weight and mass of the article are those of its bodies."""
    made, (structure, environment) = converted(
        tmp_path, whole(TUNED + "GRAV,7,,9810.,1.,1.,1.\n", "SPC = 1\nLOAD = 7"), "mm-t-s-N"
    )
    assert made.environment["constants"]["gravity_m_s2"] == pytest.approx(9.81 * 3**0.5)
    rest = md.solve_equilibrium(structure, environment)
    assert structure.mass == pytest.approx(2.0)
    again = converted(
        tmp_path,
        whole(TUNED.split("CELAS2,13")[0] + "GRAV,7,,9810.,1.,1.,1.\n", "SPC = 1\nLOAD = 7"),
        "mm-t-s-N",
    )[1]
    bare = md.solve_equilibrium(*again)
    own = sum(reaction.force for reaction in rest.reactions)
    np.testing.assert_allclose(own, -2.0 * 9.81 * np.ones(3), rtol=1e-6)
    sag = [found.config.x[1] for found in (rest, bare)]
    np.testing.assert_allclose(sag[0], sag[1], rtol=1e-9)


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("CELAS2,20,1.,1,0", "CELAS2 20 field 5 (C1) = 0: grid 1 has components, 1 to 6: which?"),
        ("CELAS2,20,1.,1,0,50", "grid 1 has components, 1 to 6: which?"),
        ("CELAS4,20,1.,1,50", "grid 1 has components, 1 to 6: which?"),
        ("CELAS2,20,1.,50,3", "scalar point 50 has no component 3"),
        ("CELAS2,20,1.,50,,50", "it joins a motion to itself"),
        ("CELAS2,20,1.", "it joins no point"),
        ("CELAS2,20,1.,50,,,3", "component 3 of no point"),
        ("CELAS2,20,1.,50,,77,2", "there is no grid 77"),
        ("CELAS2,20,-1.,50", "a negative stiffness"),
        ("CMASS4,20,-1.,50", "a negative mass"),
        ("CELAS3,20,9,50", "there is no PELAS 9"),
        ("CMASS3,20,9,50", "there is no PMASS 9"),
        ("SPOINT,1", "SPOINT 1 field 2 (IDS) = 1: there is a grid 1 too"),
        ("SPC1,1,3,50", "scalar point 50 has no components"),
        ("CELAS2,20,1.,60,,61\nCMASS2,21,1.,60", "joins scalar point '60', '61' to the rest"),
        ("SPOINT,60\nMPC,7,60,,1.,2,3,-1.\nMPC,7,2,2,1.,60,,-1.", "scalar point 60 in equations"),
        ("MPC,7,60,,1.,2,3,-1.", "MPC 7 field 3 (TERMS) = 60: ['60', None, '1.'] is no grid"),
        ("MPC,7,50,,1.,2,3,-1.\nMPC,7,50,,1.,2,2,-1.", "scalar point 50 is dependent twice"),
    ],
)
def test_connections_that_make_no_sense(tmp_path, card, words):
    case = "SPC = 1\nMPC = 7" if "MPC,7" in card else "SPC = 1\nECHO = NONE"
    with pytest.raises(ConfigError) as error:
        converted(tmp_path, whole(TUNED + card + "\n", case), "mm-t-s-N")
    assert words in str(error.value)
    assert any(f"a.dat:{line}: " in str(error.value) for line in (17, 18))
