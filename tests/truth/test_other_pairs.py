"""Measured modes that may be others of the model: said where nothing but the frequency tells."""

from __future__ import annotations

import forked_case as case
import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.other_pairs import other_pairs
from middeck.updating.refinement.refine import Refined, refine
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
def test_a_mode_taken_for_the_one_that_nobody_measured_is_said(seed: int):
    """Frequencies alone, and a wrong set of unknowns that fits them to the noise."""
    off, found = refined(seed, HOLES)
    assert off > 30.0
    (said,) = [line for line in findings(found) if "may as well be that of" in line]
    pair = other_pairs(found)[0]
    assert f"{pair.other_hz:.4g} Hz" in said
    # The model's mode beside it is the one that was measured.
    modes, ours = found.compared[0].modes, found.compared[0].pairs[:, 0]
    assert np.argmin(np.abs(modes.frequency_hz - pair.other_hz)) == 13
    assert 13 not in ours


def test_shapes_leave_no_doubt():
    for seed in repeats(range(10), 2):
        off, found = refined(seed, tuple(range(14)), ("c", "x"), ("d", "y"), ("a", "z"), ("b", "ry"))
        assert off < WRONG
        assert other_pairs(found) == ()


def test_no_wrong_pair_is_silent():
    """Of articles whose surveys missed two modes and measured no shape, every one that came out wrong."""
    silent = said = 0
    for seed in repeats(range(100, 100 + SEEDS), 3):
        off, found = refined(seed, HOLES)
        told = bool(other_pairs(found))
        silent += off > WRONG and not told
        said += off < WRONG and told
    assert silent == 0
    # A third of them is in doubt and comes out right.
    assert said <= 0.5 * SEEDS


def test_a_parameter_that_two_patterns_name_is_refused():
    """It would move twice as far as its fellows."""
    _, modes, rng = case.drawn(0)
    both = Unknown(name="u", parameters=("member.a-b.EI_*", "member.a-b.EI_y"), spread=0.1)
    with pytest.raises(ConfigError, match="EI_y is named twice"):
        refine(case.fork(), [case.survey(modes, range(8), rng)], [both])
