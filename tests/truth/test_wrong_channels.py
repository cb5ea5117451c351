"""Channels that read otherwise than the model moves are named, and none is without cause."""

from __future__ import annotations

import dataclasses

import forked_case as case
import numpy as np
import pytest

from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import refine
from middeck.updating.refinement.wrong_channels import wrong_channels
from middeck.updating.residuals.surveys import Survey
from repeats import repeats

SHIFTS = [(n, d) for n in "abcd" for d in "xyz"]


def surveyed(seed: int, kept: list[tuple[str, str]] | None = None) -> Survey:
    _, modes, rng = case.drawn(seed)
    survey = case.survey(modes, range(16), rng, shape=0.005)
    return survey if kept is None else case.at_channels_of(survey, kept)


def with_rows(survey: Survey, change) -> Survey:
    """Rows of its shapes changed in place, by channel."""
    measured = survey.measured
    place = {channel: i for i, channel in enumerate(zip(measured.node, measured.direction, strict=True))}
    shape = np.array(measured.shape)
    change(shape, place)
    return dataclasses.replace(survey, measured=dataclasses.replace(measured, shape=shape))


def said_of(survey: Survey) -> tuple[str, ...]:
    found = refine(case.fork(), [survey], case.UNKNOWNS, model_error=3e-5)
    said = wrong_channels(found.compared[0])
    assert set(said) <= set(findings(found))
    return said


def turned(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[place["d", "y"]] *= -1.0


def thrice(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[place["d", "z"]] *= 3.0


def swapped(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
    shape[[place["c", "x"], place["c", "y"]]] = shape[[place["c", "y"], place["c", "x"]]]


@pytest.mark.parametrize(
    ("change", "what"),
    repeats(
        [
            (turned, ["channel d y reads with the other sign"]),
            (swapped, ["channel c x does not read", "channel c y does not read"]),
            (thrice, ["channel d z reads 3 times"]),
        ],
        2,
    ),
)
@pytest.mark.parametrize("kept", [SHIFTS, None])
def test_a_channel_that_is_wrong_is_named(change, what: list[str], kept: list[tuple[str, str]] | None):
    for seed in repeats(range(8)):
        said = sorted(said_of(with_rows(surveyed(seed, kept), change)))
        assert len(said) == len(what)
        assert all(expected in line for expected, line in zip(what, said, strict=True))


def test_no_channel_is_named_without_cause():
    """Of right surveys, of few channels, and of another article than the model's, whose shapes all differ."""
    for seed in repeats(range(8), 2):
        for kept in (None, SHIFTS, SHIFTS[:3], SHIFTS[4:5]):
            assert said_of(surveyed(seed, kept)) == ()
    rng = np.random.default_rng(5)

    def all_of_them(shape: np.ndarray, place: dict[tuple[str, str], int]) -> None:
        shape *= np.exp(0.5 * rng.standard_normal((len(shape), 1)))

    assert said_of(with_rows(surveyed(0), all_of_them)) == ()
