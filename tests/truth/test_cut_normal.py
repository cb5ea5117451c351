"""Normal numbers of which one sum has a sign, against SciPy's truncated normal distribution."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats as st

from middeck.updating.refinement.bayesian_estimate import cut_below


@pytest.mark.parametrize("mean", [-0.6, 0.0, 0.4, 2.0])
def test_a_sum_that_cannot_be_negative_is_a_truncated_normal(mean):
    rng, along = np.random.default_rng(2), np.array([0.3, 0.0, -0.4])
    drawn = rng.standard_normal((4000, 3))
    moved = np.array([cut_below(n, along, mean) for n in drawn])
    a = mean + moved @ along
    assert a.min() >= 0.0
    assert st.kstest(a, st.truncnorm(-2.0 * mean, np.inf, loc=mean, scale=0.5).cdf).pvalue > 0.01
    across = np.array([[0.0, 1.0, 0.0], [0.4, 0.0, 0.3]])
    np.testing.assert_allclose(moved @ across.T, drawn @ across.T, atol=1e-12)
    assert st.spearmanr(drawn @ along, moved @ along).statistic == pytest.approx(1.0)


def test_what_is_never_negative_and_what_surely_is_stay():
    n, along = np.array([0.3, -1.2]), np.array([0.1, 0.0])
    np.testing.assert_allclose(cut_below(n, along, 1.0), n, atol=1e-12)
    assert cut_below(n, along, -0.3) is n
    assert cut_below(n, 0.0 * along, 0.0) is n
