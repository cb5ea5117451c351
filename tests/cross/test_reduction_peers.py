"""Balanced reductions and peak gains that SLICOT found (reduction/make_reduction.py), found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from balanced_cut import cut_balanced, hankel_values
from middeck.control.reduction.separation import subtract
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.state_space.statespace import StateSpace

NUMBERS = Path(__file__).parent / "reduction" / "numbers.npz"


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    with np.load(NUMBERS) as file:
        return dict(file)


def system(numbers: dict[str, np.ndarray], name: str) -> StateSpace:
    return StateSpace(*(numbers[f"{name}_{k}"] for k in "ABCD"))


@pytest.mark.parametrize(("name", "decaying"), [("stable", 15), ("rigid", 15)])
def test_hankel_values(numbers, name, decaying):
    # Backward stable both: rounding relative to the largest; parting the double integrator costs two digits.
    theirs = numbers[f"{name}_hsv"][:decaying]
    np.testing.assert_allclose(hankel_values(system(numbers, name)), theirs, rtol=0, atol=1e-11 * theirs[0])


@pytest.mark.parametrize("name", ["stable", "rigid"])
@pytest.mark.parametrize("order", [10, 6])
def test_responses_of_reduced_systems(numbers, name, order):
    ours = by_solving(cut_balanced(system(numbers, name), order).system)(1j * numbers["omega"])
    theirs = numbers[f"{name}_truncate_{order}"]
    # Singular values a few percent apart: their spaces are known to 1e-14 over that, responses at 1 % damping
    # to a hundred times it; the integrator's turned block is known to the root of rounding at 0.1 rad/s.
    limit = 1e-9 if name == "stable" else 1e-7
    assert np.abs(ours - theirs).max() <= limit * np.abs(theirs).max()


def test_peak_gains(numbers):
    whole = system(numbers, "stable")
    found = peak_gain(whole)
    # AB13DD stops at a relative 1e-10 of its level set, from below.
    assert found.gain == pytest.approx(numbers["stable_peak"][0], rel=1e-8)
    assert found.omega == pytest.approx(numbers["stable_peak"][1], rel=1e-4)
    for order in (10, 6):
        small = cut_balanced(whole, order)
        assert small.error == pytest.approx(numbers[f"stable_peak_{order}"][0], rel=1e-6)
        assert peak_gain(subtract(whole, small.system)).gain == pytest.approx(small.error, rel=1e-9)
