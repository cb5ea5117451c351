"""The truss of data/nastran-truss against the frequencies and mass properties that NX Nastran printed."""

import re

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.structure.summary.summary import summarise

DATA = ROOT / "data/nastran-truss"
PRINTED = (DATA / "full.out.txt").read_text()


def printed_frequencies():
    rows = re.findall(r"^\s+\d+\s+\d+\s+\S+\s+\S+\s+(\S+)\s+1\.0\S*\s+\S+$", PRINTED, re.MULTILINE)
    return np.array([float(row) for row in rows])


def article(capfd, tmp_path, *more):
    target = tmp_path / "full.toml"
    ended = middeck(capfd, "convert", DATA / "full.dat", "-o", target, *more)
    assert ended.code == 0, ended.err
    return md.load_structure(target)


def test_all_elastic_frequencies_with_that_program_s_mass(capfd, tmp_path):
    structure = article(capfd, tmp_path, "--units", "mm-kg-s-mN", "--mass-formulation", "coupled")
    modes = md.solve_modes(md.solve_equilibrium(structure, md.Environment.orbit()))
    expected = printed_frequencies()
    assert len(expected) == len(modes.omega) == 278
    assert np.all(modes.omega[:6] == 0.0)
    # Printed with seven digits.
    np.testing.assert_allclose(modes.frequency_hz[6:], expected[6:], rtol=6e-7)


def test_mass_centre_and_inertia_to_the_last_printed_digit(capfd, tmp_path):
    summary = summarise(article(capfd, tmp_path, "--units", "mm-kg-s", "--mass-formulation", "coupled"))
    numbers = [float(x) for x in re.findall(r"-?\d\.\d+E[+-]\d+", PRINTED.split("\n\n")[0])]
    assert abs(summary.mass - numbers[0]) <= 1e-6
    centre = 1e3 * summary.centre
    np.testing.assert_allclose(centre, [numbers[5], numbers[2], numbers[3]], atol=1e-4)
    inertia = 1e6 * summary.inertia
    assert np.all(np.abs(np.diag(inertia) - [numbers[12], numbers[16], numbers[20]]) <= [0.1, 1.0, 1.0])
    # Products of inertia vanish by symmetry; what is printed, 3e-10, is rounding.
    printed = np.reshape(numbers[12:21], (3, 3))
    np.testing.assert_allclose(inertia[~np.eye(3, dtype=bool)], printed[~np.eye(3, dtype=bool)], atol=1e-7)


def test_the_difference_of_our_own_mass_is_stated_and_small(capfd, tmp_path):
    target = tmp_path / "full.toml"
    ended = middeck(capfd, "convert", DATA / "full.dat", "--units", "mm-kg-s", "-o", target)
    assert "PARAM COUPMASS the deck's own program uses coupled mass" in ended.out
    modes = md.solve_modes(md.solve_equilibrium(md.load_structure(target), md.Environment.orbit()), 20)
    off = np.abs(modes.frequency_hz[6:] / printed_frequencies()[6:20] - 1.0)
    assert 1e-5 < off.max() < 2.5e-4


@pytest.mark.parametrize(
    "units", [[], ["--units", "mm-kg-s-N"], ["--units", "furlong-kg-s"], ["--units", "mm-kg"]]
)
def test_units_are_never_guessed(capfd, tmp_path, units):
    target = tmp_path / "full.toml"
    ended = middeck(capfd, "convert", DATA / "full.dat", "-o", target, *units)
    assert ended.code == 2
    assert "mm-kg-s-mN" in ended.err if not units else "units" in ended.err
    assert not target.exists()
