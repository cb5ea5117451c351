"""Pairs by frequency alone: against every way to pair, against known partners, and at ties."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.evaluation import nearby_pairs
from middeck.structure.correlation.frequency_pairs import ALONE, SCATTER, pair_costs, pair_frequencies
from middeck.updating.residuals.pairing import pair_shapes


def paired(ours: np.ndarray, theirs: np.ndarray) -> list[tuple[int, int]]:
    found = pair_frequencies(np.repeat(np.asarray(ours)[:, None], len(theirs), axis=1), np.asarray(theirs))
    return [(int(i), int(j)) for i, j in found]


def every_cost(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Least cost of all pairings that rise together, each at each scatter."""
    least = np.inf
    for scatter in SCATTER:
        cost = pair_costs(np.log(ours)[:, None], np.log(theirs), scatter)
        for count in range(min(cost.shape) + 1):
            for i in combinations(range(len(ours)), count):
                for j in combinations(range(len(theirs)), count):
                    least = min(least, cost[i, j].sum() - count * ALONE)
    return float(least)


def test_no_pairing_that_rises_is_likelier(campaign) -> None:
    for seed in campaign(2000):
        rng = np.random.default_rng([seed, 24])
        ours = np.sort(np.exp(rng.uniform(0.0, rng.choice([0.3, 1.0, 3.0]), rng.integers(1, 7))))
        theirs = np.sort(np.exp(rng.uniform(0.0, rng.choice([0.3, 1.0, 3.0]), rng.integers(1, 6))))
        found = paired(ours, theirs)
        assert [i for i, _ in found] == sorted({i for i, _ in found})
        assert [j for _, j in found] == sorted({j for _, j in found})
        of = tuple(np.array(found, dtype=int).reshape(-1, 2).T)
        costs = [pair_costs(np.log(ours)[:, None], np.log(theirs), s)[of] - ALONE for s in SCATTER]
        # A millionth of a frequency, which settles ties, over the least scatter and up to three of it.
        assert min(c.sum() for c in costs) <= every_cost(ours, theirs) + 1e-3


def survey(seed: int, scatter: float, missed: float, spurious: bool) -> tuple[np.ndarray, ...]:
    """The model's frequencies, a test's, and which of them each is: -1 of the spurious one."""
    rng = np.random.default_rng([seed, 5])
    ours = np.cumsum(rng.gamma(1.5, 1.0, rng.integers(10, 25))) + 1.0
    first = int(rng.integers(len(ours) // 3))
    seen = np.arange(first, min(len(ours), first + int(rng.integers(6, 14))))
    seen = seen[rng.random(len(seen)) >= missed]
    theirs = ours[seen] * np.exp(scatter * rng.standard_normal(len(seen)))
    if spurious:
        seen, theirs = np.append(seen, -1), np.append(theirs, rng.uniform(theirs.min(), theirs.max()))
    order = np.argsort(theirs)
    return ours, theirs[order], seen[order]


@pytest.mark.parametrize("scatter", [0.01, 0.02, 0.03])
def test_more_modes_find_their_own_than_by_the_sum_of_distances(scatter: float, campaign) -> None:
    """Missed modes and one spurious one; the sum of distances within an octave was the rule before."""
    right = before = alone = modes = 0
    seeds = campaign(2000)
    for seed in seeds:
        ours, theirs, truth = survey(seed, scatter, 0.2, spurious=True)
        got, nearest = np.full((2, len(theirs)), -1)
        for i, j in paired(ours, theirs):
            got[j] = i
        i, j = linear_sum_assignment(np.abs(np.log(ours[:, None] / theirs)))
        nearest[j] = i
        right += int(np.sum((got == truth) & (truth >= 0)))
        before += int(np.sum((nearest == truth) & (truth >= 0)))
        alone += int(np.sum((got == truth) & (truth < 0)))
        modes += len(truth) - 1
    assert right > before + 0.04 * modes
    # Where the model has an unmeasured mode beside it, nothing tells that the spurious one is not that.
    assert alone > 0.35 * len(seeds)


def test_a_spurious_mode_stays_alone() -> None:
    gantry = [13.2012, 15.7931, 22.6596, 25.2415, 50.5520, 53.3709]
    assert paired(gantry, [13.47, 15.5, 24.9, 35.0, 51.3, 52.6]) == [(0, 0), (1, 1), (3, 2), (4, 4), (5, 5)]


@pytest.mark.parametrize(
    ("ours", "theirs", "expected"),
    [
        ([7.0242, 7.0254], [7.13, 7.19], [(0, 0), (1, 1)]),  # both on one side: the sum of distances is one
        ([50.55, 53.37], [54.0, 54.9], [(0, 0), (1, 1)]),
        ([5.0, 5.0, 5.0], [5.1, 5.1], [(1, 0), (2, 1)]),
        ([4.0, 9.0], [6.0], [(0, 0)]),  # at equal ratios
        ([6.0], [4.0, 9.0], [(0, 1)]),
        (1.2 ** np.arange(8), 1.2 ** (np.arange(5) + 1.5), [(k + 1, k) for k in range(5)]),
        ([5.0, 5.0], [5.0], [(0, 0)]),
        ([10.0], [25.0], []),
    ],
)
def test_last_digits_decide_nothing(ours: object, theirs: object, expected: list[tuple[int, int]]) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        near = [np.asarray(x) * (1.0 + 1e-12 * rng.standard_normal(len(x))) for x in (ours, theirs)]
        assert paired(*near) == expected


def test_the_order_of_a_survey_changes_no_pair(campaign) -> None:
    for seed in campaign(1000):
        ours, theirs, _ = survey(seed, 0.03, 0.2, spurious=True)
        turn = np.random.default_rng(seed).permutation(len(theirs))
        found = sorted((i, int(turn[j])) for i, j in paired(ours, theirs[turn]))
        assert found == paired(ours, theirs)


def test_shapes_that_one_channel_cannot_tell_are_paired_in_their_order() -> None:
    """All MAC are one to rounding: the sum of MAC says nothing, nor does that of distances."""
    rng = np.random.default_rng(3)
    ours, theirs = np.array([10.0, 10.4, 10.9, 11.5]), np.array([11.6, 11.9, 12.4])
    expected = [(1, 0), (2, 1), (3, 2)]
    for _ in range(10):
        shape, measured = (rng.uniform(0.5, 2.0, (1, n)) * rng.choice([-1, 1], n) for n in (4, 3))
        alike = modal_assurance(shape, measured)
        assert nearby_pairs(alike, ours, theirs).tolist() == [list(p) for p in expected]
        found = pair_shapes(alike, np.abs(np.log(ours[:, None] / theirs)))
        assert sorted(map(tuple, found.tolist())) == expected
