"""Measured modes that may be others of the model: said where nothing but the frequency tells."""

from __future__ import annotations

import dataclasses

import forked_case as case
import numpy as np
import pytest

import structure_builders as build
from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.other_pairs import OtherPair, other_pairs
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from repeats import repeats

HOLES = (6, 7, 9, 10, 11, 13, 14)  # flexible modes, of which a test missed two
SEEDS = 40
WRONG = 4.0  # deviations


def refined(seed: int, chosen: tuple[int, ...], *kept: tuple[str, str]) -> tuple[float, Refined]:
    """Largest error in stated deviations, of a survey with these modes and channels."""
    x, modes, rng = case.drawn(seed)
    survey = case.at_channels_of(case.survey(modes, chosen, rng), kept)
    found = refine(case.fork(), [survey], case.UNKNOWNS, model_error=3e-5)
    return float(np.abs((found.x - x) / found.estimate.x_std).max()), found


@pytest.mark.parametrize("seed", repeats([5, 9]))
def test_a_mode_taken_for_the_one_that_nobody_measured_is_reported(seed: int):
    """Frequencies alone, and a wrong set of unknowns that fits them to the noise."""
    off, found = refined(seed, HOLES)
    assert off > 30.0
    (warning,) = [line for line in findings(found) if "may as well be that of" in line]
    pair = other_pairs(found)[0]
    assert f"{pair.other_hz:.4g} Hz" in warning
    # The model's mode beside it is the one that was measured.
    modes, ours = found.compared[0].modes, found.compared[0].pairs[:, 0]
    assert np.argmin(np.abs(modes.frequency_hz - pair.other_hz)) == 13
    assert 13 not in ours


def test_shapes_leave_no_doubt():
    for seed in repeats(range(10)):
        off, found = refined(seed, tuple(range(14)), ("c", "x"), ("d", "y"), ("a", "z"), ("b", "ry"))
        assert off < WRONG
        assert other_pairs(found) == ()


def test_no_wrong_pair_is_silent():
    """Of articles whose surveys missed two modes and measured no shape, every one that came out wrong."""
    silent = without_cause = 0
    seeds = repeats(range(100, 100 + SEEDS), 3)
    for seed in seeds:
        off, found = refined(seed, HOLES)
        reported = bool(other_pairs(found))
        silent += off > WRONG and not reported
        without_cause += off < WRONG and reported
    assert silent == 0
    # A third of them is in doubt and comes out right.
    assert without_cause <= 0.5 * len(seeds)


HELD = Environment(title="mast", gravity=np.zeros(3), clamps=(Clamp(node="a"),))
TIP = [(n, d) for n in "bc" for d in "yz"]


def mast(factor: float, split: float) -> Structure:
    """Clamped at a, with a body at b; along y it is stiffer by ``split``."""
    section = dataclasses.replace(case.THICK, EA=1e6, GJ=4e3, EI_y=50.0 * factor, EI_z=50.0 * factor * split)
    light = build.body(0.2, (0, 0, 0), (1e-4, 1e-4, 1e-4))
    nodes = [build.node("a", (0, 0, 0)), build.node("c", (0.5, 0, 0)), build.node("b", (1, 0, 0), light)]
    return build.structure(nodes, [build.member("a", "c", section, 4), build.member("c", "b", section, 4)])


def mast_refined(factor: float, split: float, chosen: list[int], shapes: bool) -> tuple[float, Refined]:
    """Error of E in stated deviations, of a survey of these modes with 0.05 % of noise."""
    modes = solve_modes(solve_equilibrium(mast(factor, split), HELD))
    seen = measure_modes(modes, TIP, chosen=chosen)
    hz = seen.frequency_hz * (1.0 + 5e-4 * np.random.default_rng(1).standard_normal(len(chosen)))
    seen = dataclasses.replace(seen, frequency_hz=hz, frequency_std_hz=5e-4 * hz)
    survey = Survey(name="mast", measured=seen, environment=HELD)
    survey = survey if shapes else case.at_channels_of(survey, [])
    bends = Unknown(name="E", parameters=("member.*.EI_y", "member.*.EI_z"), spread=0.1)
    found = refine(mast(1.0, split), [survey], [bends])
    return float(abs(found.x[0] - np.log(factor)) / found.estimate.x_std[0]), found


@pytest.mark.parametrize(
    ("split", "factor"),
    repeats([(1.02, 1.1), (1.1, 1.16), (1.02, 1.05), (1.03, 1.05), (1.05, 1.08), (1.1, 1.1)], 2),
)
def test_a_family_that_is_taken_for_the_other_is_reported(split: float, factor: float):
    """One plane measured, all its modes taken for those of the other: E fits them as well, and is wrong."""
    off, found = mast_refined(factor, split, [0, 2, 4], shapes=False)
    assert off > 25.0
    assert len(other_pairs(found)) == 3
    # The other pairs say by how much: to the true E.
    assert other_pairs(found)[0].off == pytest.approx(off, abs=2.0)
    (warning,) = [line for line in findings(found) if "may as well be that of" in line]
    assert "if it is, E is wrong by" in warning
    assert "Measured shapes" in warning


@pytest.mark.parametrize("chosen", [[0, 1, 2, 3, 4, 5], [0, 2, 4]])
@pytest.mark.parametrize("shapes", [False, True])
def test_modes_that_change_places_without_moving_an_unknown_are_not_said(chosen: list[int], shapes: bool):
    """Planes that are alike, or by 0.1 % not: whichever a mode is of, E is the same."""
    for split in (1.0, 1.001) if len(chosen) > 3 else (1.0,):
        off, found = mast_refined(1.05, split, chosen, shapes)
        assert off < 1.0
        assert other_pairs(found) == ()


def test_advice_asks_for_more_channels_where_there_are_shapes(monkeypatch: pytest.MonkeyPatch):
    _, found = mast_refined(1.05, 1.02, [0, 2, 4], shapes=True)
    pair = OtherPair(survey="mast", measured_hz=1.0, paired_hz=1.1, other_hz=1.2, unknown="E", off=9.0)
    monkeypatch.setattr("middeck.updating.refinement.findings.other_pairs", lambda _: (pair,))
    (warning,) = [line for line in findings(found) if "may as well be that of" in line]
    assert "Shapes at more channels" in warning
    assert "Measured shapes" not in warning


def test_a_parameter_that_two_patterns_name_is_refused():
    """It would move twice as far as its fellows."""
    _, modes, rng = case.drawn(0)
    both = Unknown(name="u", parameters=("member.a-b.EI_*", "member.a-b.EI_y"), spread=0.1)
    with pytest.raises(ConfigError, match="EI_y is named twice"):
        refine(case.fork(), [case.survey(modes, range(8), rng)], [both])
