"""Samplers: distributions against scipy.stats, strata, balance, groups; cases hang on their index alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from middeck.campaign import (
    Group,
    LogNormal,
    Normal,
    Parameter,
    TruncatedNormal,
    Uniform,
    full_factorial,
    latin_hypercube,
    monte_carlo,
    sobol,
)
from middeck.campaign.cases import case_seed
from middeck.campaign.distributions import from_normal
from middeck.campaign.encoding import decode_result, encode_result
from middeck.errors import ConfigError, DataError

TRUTH = [
    (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
    (LogNormal(2.0, 0.3), stats.lognorm(0.3, scale=2.0)),
    (TruncatedNormal(0.0, 1.0, -0.5, 2.0), stats.truncnorm(-0.5, 2.0)),
    (TruncatedNormal(1.0, 2.0, 0.0, np.inf), stats.truncnorm(-0.5, np.inf, loc=1.0, scale=2.0)),
    (TruncatedNormal(0.0, 1.0, 9.0, 10.0), stats.truncnorm(9.0, 10.0)),
    (TruncatedNormal(0.0, 1.0, -12.0, -9.0), stats.truncnorm(-12.0, -9.0)),
]
FOUR = [Parameter(n, d) for n, (d, _) in zip("abcd", TRUTH, strict=False)]


def values_of(cases):
    return np.array([c.values for c in cases])


@pytest.mark.parametrize(("distribution", "truth"), TRUTH)
def test_quantiles(distribution, truth):
    share = np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 0.9999])
    found = from_normal(distribution, stats.norm.ppf(share))
    np.testing.assert_allclose(found, truth.ppf(share), rtol=1e-9, atol=1e-12)


def test_a_case_is_the_same_in_any_campaign_and_its_seed_the_spawned_one():
    few, many = monte_carlo(FOUR, 3, seed=11), monte_carlo(FOUR, 9, seed=11)
    assert few == many[:3]
    child = np.random.SeedSequence(11).spawn(5)[4].generate_state(4)
    assert case_seed(11, 4) == sum(int(w) << (32 * k) for k, w in enumerate(child))
    assert monte_carlo(FOUR, 3, seed=12)[0] != few[0]


@pytest.mark.parametrize("sampler", [latin_hypercube, sobol])
def test_designs_put_one_case_in_each_stratum(sampler):
    cases = sampler(FOUR, 64, seed=3)
    share = np.array([t.cdf(x) for (_, t), x in zip(TRUTH, values_of(cases).T, strict=False)])
    np.testing.assert_array_equal(np.sort(np.floor(64 * share)), np.tile(np.arange(64), (4, 1)))
    assert cases == sampler(FOUR, 64, seed=3) != sampler(FOUR, 64, seed=4)


def test_groups_move_together():
    R = np.array([[1.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    normal = [Parameter(n, Normal(0.0, 1.0)) for n in "abc"]
    found = values_of(monte_carlo(normal, 4000, seed=1, groups=[Group(("a", "b", "c"), matrix=R)]))
    np.testing.assert_allclose(np.corrcoef(found.T), R, atol=5.0 / np.sqrt(4000.0))
    as_one = values_of(monte_carlo(FOUR, 20, seed=1, groups=[Group(("b", "d"))]))
    np.testing.assert_allclose(TRUTH[1][1].cdf(as_one[:, 1]), TRUTH[3][1].cdf(as_one[:, 3]), rtol=1e-12)
    opposite = values_of(monte_carlo(FOUR, 20, seed=1, groups=[Group(("a", "b"), -1.0)]))
    np.testing.assert_allclose(TRUTH[0][1].cdf(opposite[:, 0]), TRUTH[1][1].sf(opposite[:, 1]), rtol=1e-9)


def test_corners_and_levels():
    two = [Parameter("a", Uniform(1.0, 2.0)), Parameter("b", Normal(0.0, 1.0))]
    assert values_of(full_factorial(two)).tolist() == [[1.0, -3.0], [1.0, 3.0], [2.0, -3.0], [2.0, 3.0]]
    assert values_of(full_factorial(two, groups=[Group(("a", "b"), -1.0)])).tolist() == [
        [1.0, 3.0],
        [2.0, -3.0],
    ]
    assert len(full_factorial(FOUR, 3)) == 81


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: monte_carlo([], 3, seed=1),
        lambda: monte_carlo([FOUR[0], FOUR[0]], 3, seed=1),
        lambda: monte_carlo(FOUR, 0, seed=1),
        lambda: sobol(FOUR, 100, seed=1),
        lambda: full_factorial(FOUR, 1000),
        lambda: full_factorial(FOUR, groups=[Group(("a", "b"), 0.5)]),
        lambda: monte_carlo(FOUR, 3, seed=1, groups=[Group(("a", "x"))]),
        lambda: monte_carlo(FOUR, 3, seed=1, groups=[Group(("a", "b")), Group(("b", "c"))]),
        lambda: monte_carlo(FOUR, 3, seed=1, groups=[Group(("a", "b", "c"), -1.0)]),
        lambda: Uniform(2.0, 1.0),
        lambda: Normal(0.0, 0.0),
        lambda: LogNormal(-1.0, 1.0),
        lambda: TruncatedNormal(0.0, 1.0, 2.0, 1.0),
    ],
)
def test_wrong_campaigns_are_refused(wrong):
    with pytest.raises(ConfigError):
        wrong()


def test_results_come_back_to_the_last_bit():
    given = {
        "b": [1, 2.5e-324, -0.0, float("inf"), None, True, "text"],
        "a": np.array([[0.1, np.nan]], dtype=">f8"),
        "c": np.float32(0.1),
        "z": 1.0 - 0.0j,
        "e": np.zeros((0, 3), dtype=int),
    }
    found = decode_result(encode_result(given))
    assert repr(found["b"]) == repr(given["b"])
    assert found["a"].astype(">f8").tobytes() == given["a"].tobytes()
    assert (found["c"], repr(found["z"]), found["e"].shape) == (
        float(np.float32(0.1)),
        repr(1.0 - 0.0j),
        (0, 3),
    )
    assert encode_result(dict(reversed(given.items()))) == encode_result(given) == encode_result(found)
    for wrong in (object(), {1: 2}, np.array(["text"]), {"array:": 1}):
        with pytest.raises(DataError, match="cannot hold"):
            encode_result(wrong)
