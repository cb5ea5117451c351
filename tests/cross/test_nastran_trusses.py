"""Trusses of rods, scalar masses and lumped beams of a deck against the textbook's matrices."""

import itertools
import re

import numpy as np
import pytest
import scipy.linalg

import middeck as md
from middeck.errors import ConfigError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from nastran_decks import NU, RHO, E, card, components, inside, random_deck

DIGITS = 1e-6
EYE = np.eye(3)


def solved(tmp_path, lines, formulation):
    """The conversion, and the frequencies of the article where the deck's ground holds it."""
    held = ["SPC = 7"] if any(re.match(r"SPC1\*?[ ,]+7\b", line, re.IGNORECASE) for line in lines) else []
    text = ["SOL 103", "CEND", *held, "BEGIN BULK", *lines, "ENDDATA"]
    (tmp_path / "a.dat").write_text("\n".join(text))
    made = convert_deck(read_deck(tmp_path / "a.dat"), parse_units("m-kg-s-N"), formulation, "a")
    (tmp_path / "a.toml").write_text(document_text(made.document, "a"))
    (tmp_path / "e.toml").write_text(document_text(made.environment, "a"))
    setup = md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")
    return made, md.solve_modes(md.solve_equilibrium(*setup)).omega


def rod_mass(m, along, formulation):
    """Of a rod of mass m: straight between its ends; coupled in halves across the axis (MSC Nastran)."""
    straight = np.kron([[1 / 3, 1 / 6], [1 / 6, 1 / 3]], EYE)
    if formulation == "consistent":
        return m * straight
    halves = 0.5 * np.eye(6)
    if formulation == "lumped":
        return m * halves
    return m * (halves - np.kron([[1, -1], [-1, 1]], np.outer(along, along)) / 12.0)


def random_truss(seed, formulation):
    """Lines of a deck of rods between points that stand and move in random systems; K and M of its shifts."""
    rng = np.random.default_rng([11, seed])
    systems = random_deck(seed).systems
    lines = random_deck(seed).text.split("\n")
    lines = lines[lines.index("BEGIN BULK") + 2 :]
    names = ("CORD2R", "CORD2C", "CORD2S")
    kept, taken = [], False
    for line in lines:  # with their continuations
        if line[:1].isalpha():
            taken = line.upper().startswith(names)
        if taken:
            kept.append(line)
    x = rng.uniform(-1.0, 1.0, (7, 3))
    K, M = np.zeros((21, 21)), np.zeros((21, 21))
    moves = rng.integers(0, 6, 7)
    for k, place in enumerate(x):
        cp = int(rng.integers(0, 6))
        kept += card(rng, "GRID", k + 1, cp, *inside(*systems[cp], place), int(moves[k]))
    kept += card(rng, "MAT1", 3, E, None, NU, RHO)
    for k, (a, b) in enumerate(itertools.combinations(range(7), 2)):
        along, length = x[b] - x[a], float(np.linalg.norm(x[b] - x[a]))
        along /= length
        area, torsion = 1e-4 * rng.uniform(1.0, 2.0), float(rng.choice([0.0, 1.1e-8]))
        kept += card(rng, "CONROD", k + 10, a + 1, b + 1, 3, area, torsion)
        at = np.r_[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
        K[np.ix_(at, at)] += E * area / length * np.kron([[1, -1], [-1, 1]], np.outer(along, along))
        M[np.ix_(at, at)] += rod_mass(RHO * area * length, along, formulation)
    for k in range(3):
        mass = rng.uniform(0.5, 2.0)
        kept += card(rng, "PMASS", k + 1, mass, 90 + k, 9.0)
        for c in (1, 2, 3):
            name, value = ("CMASS1", k + 1) if c > 1 else ("CMASS2", mass)
            kept += card(rng, name, 100 + 3 * k + c, value, k + 1, c)
        M[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += mass * EYE
    held = []
    for grid in (0, 4, 6):
        digits = "".join(sorted(rng.choice(list("123"), int(rng.integers(1, 4)), replace=False)))
        kept += card(rng, "SPC1", 7, digits + str(rng.choice(["", "4", "56"])), grid + 1)
        own = np.array([components(*systems[int(moves[grid])], x[grid], e) for e in EYE]).T
        rows = np.zeros((len(digits), 21))
        rows[:, 3 * grid : 3 * grid + 3] = own[[int(d) - 1 for d in digits]]
        held.append(rows)
    return kept, K, M, np.vstack(held)


@pytest.mark.parametrize("formulation", ["consistent", "coupled", "lumped"])
def test_trusses_are_those_of_the_textbook(tmp_path, campaign, formulation):
    for seed in campaign(40):
        lines, K, M, held = random_truss(seed, formulation)
        free = scipy.linalg.null_space(held)
        expected = np.sqrt(np.abs(scipy.linalg.eigh(free.T @ K @ free, free.T @ M @ free)[0]))
        made, omega = solved(tmp_path, lines, formulation)
        first = int(np.sum(expected < 1e-4 * expected[-1]))  # what the ground leaves free
        np.testing.assert_allclose(omega[first : len(expected)], expected[first:], rtol=DIGITS)
        # Torsion of rods has no mass: no mode, or none of finite frequency.
        assert np.all(omega[len(expected) :] > 1e3 * expected[-1])
        assert "as PARAM AUTOSPC does" in " ".join(made.notes)
        # A rod cut in two is a mechanism: it stays one element where the mesh is refined.
        assert all(strut["elements"] == 1 for strut in made.document["strut"])


def test_a_free_truss_keeps_its_rigid_motions(tmp_path):
    """The rotations that the environment holds are of hinges: they hold no rigid motion of the truss."""
    lines, K, M, _ = random_truss(1, "lumped")
    lines = [line for line in lines if not line.upper().startswith("SPC1")]
    made, omega = solved(tmp_path, lines, "lumped")
    expected = np.sqrt(np.abs(scipy.linalg.eigh(K, M)[0]))
    assert np.all(omega[:6] < 1e-5 * omega[6])
    np.testing.assert_allclose(omega[6:21], expected[6:], rtol=DIGITS)
    assert not any(c["along"] for c in made.environment["clamp"])


def shaft(element, prop, extra=()):
    lines = ["MAT1,1,7.+10,,.3,2700.", prop, "SPC1,7,123456,1", "SPC1,7,12356,2,THRU,5"]
    lines += [f"GRID,{k},,{k / 10 - 0.1:.1f}" for k in range(1, 6)]
    lines += [f"{element},{k},1,{k},{k + 1},0.,1.,0." for k in range(1, 5)]
    return [*lines, *extra]


@pytest.mark.parametrize(("polar", "wheels"), [(3e-8, 0.0), (3e-8, 2.1e-6), (0.0, 2.1e-6)])
def test_lumped_beams_and_scalar_inertias_twist(tmp_path, polar, wheels):
    """A CBEAM lumps its torsional inertia, a CBAR none; CMASS of turns are inertia without mass."""
    element = "CBEAM" if polar else "CBAR"
    rest = "2.-8,0.,4.-8" if polar else "2.-8,4.-8"
    extra = [f"CMASS2,{20 + k},{wheels!r},{k},4" for k in range(2, 6)] if wheels else []
    prop = f"P{element[1:]},1,1,1.-4,1.-8,{rest}" if polar else f"PBAR,1,1,1.-4,1.-8,{rest}"
    _, omega = solved(tmp_path, shaft(element, prop, extra), "lumped")
    G, J, L = E / (2 * (1 + NU)), 4e-8, 0.1
    K = G * J / L * (np.diag([2.0, 2.0, 2.0, 1.0]) - np.eye(4, k=1) - np.eye(4, k=-1))
    M = np.diag(wheels + RHO * polar * L * np.array([1.0, 1.0, 1.0, 0.5]))
    np.testing.assert_allclose(omega[:4], np.sqrt(scipy.linalg.eigh(K, M)[0]), rtol=DIGITS)


def test_springs_between_floors_that_do_not_turn(tmp_path):
    """A frame of floors: springs across the line between masses, no member; frequencies in closed form."""
    k, m, n = 2e5, 3.0, 4
    lines = ["GRDSET,,,,,,,13456", *(f"GRID,{i},,{0.3 * i:.1f}" for i in range(n + 1)), "SPC1,7,2,9"]
    lines = [line.replace("GRID,0,", "GRID,9,") for line in lines]
    lines += [f"CONM2,{20 + i},{i},,{m}" for i in range(1, n + 1)]
    lines += ["SPC1,7,13456,9", "CONM2,40,9,,7."]  # a mass that the ground holds has no part
    lines += [f"CELAS2,{30 + i},{k},{i},2,{i - 1 or 9},2" for i in range(1, n + 1)]
    made, omega = solved(tmp_path, lines, "lumped")
    wave = np.arange(1, 2 * n, 2) * np.pi / (2 * (2 * n + 1))
    np.testing.assert_allclose(omega, 2.0 * np.sqrt(k / m) * np.sin(wave), rtol=DIGITS)
    assert [b["name"] for b in made.environment["bushing"]] == ["spring31"]


def test_an_article_without_mass_has_no_modes(tmp_path):
    lines = ["MAT1,1,7.+10,,.3", "PBAR,1,1,1.-4,1.-8,2.-8,4.-8", "SPC1,7,123456,1", "GRID,1", "GRID,2,,1."]
    with pytest.raises(ConfigError, match="nothing that moves has mass"):
        solved(tmp_path, [*lines, "CBAR,1,1,1,2,0.,1.,0."], "lumped")


@pytest.mark.parametrize("end", ["1.", "1.,.1,.7"])
def test_a_free_article_without_mass_has_no_modes(tmp_path, end):
    """Nothing drives it, but rounding; it rests, and has no modes."""
    lines = ["MAT1,1,7.+10,,.3", "PBAR,1,1,1.-4,1.-8,2.-8,4.-8", "GRID,1", f"GRID,2,,{end}", "SPC1,8,1,1"]
    with pytest.raises(ConfigError, match="nothing that moves has mass"):
        solved(tmp_path, [*lines, "CBAR,1,1,1,2,0.,1.,0."], "lumped")


def test_what_a_selected_union_sums_is_not_left_out(tmp_path):
    lines = ["SPCADD,7,8", "SPC1,8,12356,2", "SPC1,8,123456,1", "FORCE,3,2,,1.,1.", "LOAD,4,1.,2.,3"]
    lines = [*lines, "GRID,1", "GRID,2,,1.", "MAT1,1,7.+10,,.3,2700.", "PBAR,1,1,1.-4,1.-8,2.-8,4.-8"]
    (tmp_path / "b.dat").write_text(
        "\n".join(["CEND", "SPC=7", "LOAD=4", "BEGIN BULK", *lines, "CBAR,1,1,1,2,0.,1.,0.,1", "ENDDATA"])
    )
    made = convert_deck(read_deck(tmp_path / "b.dat"), parse_units("m-kg-s-N"), "lumped", "b")
    assert [case["name"] for case in made.document["load_case"]] == ["load4"]
    assert made.left_out == ()


@pytest.mark.parametrize(("held", "reported"), [("", True), ("SPC1,7,3,3,4", False)])
def test_a_plane_truss_is_advised_to_be_free_across_its_plane(tmp_path, held, reported):
    """AUTOSPC holds these shifts in the deck's own program; here weight may, and a note names the grids."""
    lines = ["GRID,1", "GRID,2,,1.", "GRID,3,,0.,1.", "GRID,4,,1.,1.", "MAT1,1,7.+10,,.3", "PROD,1,1,1.-4"]
    lines += ["CROD,1,1,1,3", "CROD,2,1,2,4", "CROD,3,1,1,4", "CROD,4,1,3,4", "SPC1,7,123456,1,2", held]
    made, omega = solved(tmp_path, [*lines, "CONM2,11,3,,1.", "CONM2,12,4,,1."], "lumped")
    assert np.count_nonzero(omega < 1.0) == 2 * reported
    assert any("grid '3', '4' has no stiffness in some direction" in note for note in made.notes) == reported
