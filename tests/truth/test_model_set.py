"""Sets of models have the covariance of their fit, its structure, and stay within its bounds."""

import dataclasses

import gimbal_fits
import numpy as np
import pytest
import scipy.stats
import two_modes

from middeck.errors import ConfigError
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import model_response, natural_hz
from middeck.identification.uncertainty.model_set import sample_models
from middeck.identification.uncertainty.model_unknowns import unknowns_of
from middeck.identification.uncertainty.response_bounds import response_bounds, simultaneous_bounds
from middeck.signals.ports import Port

F = np.geomspace(0.3, 30.0, 80)
COUNT = 2000


@pytest.fixture(scope="module")
def fit():
    return gimbal_fits.fit(1993)


def test_members_have_the_covariance_of_the_fit(fit):
    of = fit.covariance
    members = sample_models(of, count=COUNT, rng=np.random.default_rng(0))
    drawn = np.array([unknowns_of(m, of.structure) for m in members])
    # A t of nu degrees has the variance nu / (nu - 2) of its scale.
    stated = of.matrix * of.degrees / (of.degrees - 2.0)
    scale = np.sqrt(np.diag(stated))
    found = np.cov(drawn.T) / np.outer(scale, scale)
    # 2000 draws give variances to 3.2 % and correlations to 2.2 %: four and a half of those.
    np.testing.assert_allclose(found, stated / np.outer(scale, scale), atol=0.15)
    error = (drawn.mean(axis=0) - unknowns_of(fit.model, of.structure)) / scale
    np.testing.assert_allclose(error, 0.0, atol=4.5 / np.sqrt(COUNT))


def test_members_keep_the_structure(fit):
    for member in sample_models(fit.covariance, count=50, rng=np.random.default_rng(1)):
        assert np.all(member.poles.real < 0.0)
        assert member.states == fit.model.states
        assert np.all(member.delay_s >= 0.0)
        constants = 2j * member.poles.imag * member.shapes * member.participation.T
        # Real modal constants, up to rounding: relative degree two.
        np.testing.assert_allclose(constants.imag, 0.0, atol=1e-12)
        assert not np.any(member.direct)
    # As uncertain as a set may be: damping known to a factor of three or so.
    wild = dataclasses.replace(fit.covariance, root=1e2 * fit.covariance.root)
    for member in sample_models(wild, count=50, rng=np.random.default_rng(2)):
        assert np.all(member.poles.real < 0.0)
        assert np.all(member.delay_s >= 0.0)


def test_members_stay_within_the_bounds_at_their_level(fit):
    """Pointwise on the stated share of lines, all together in the stated share of members; 95 and 80 %."""
    members = sample_models(fit.covariance, count=COUNT, rng=np.random.default_rng(3))
    H = np.array([model_response(m, F) for m in members])
    for level in (0.8, 0.95):
        alone = response_bounds(fit.covariance, F, level=level)
        together = simultaneous_bounds(fit.covariance, F, np.random.default_rng(4), level=level)
        inside = np.mean(holds(alone, H), axis=0)
        # 2000 members: a share is known to 0.9 % at 80 %; four of those, with what is not linear.
        np.testing.assert_allclose(inside, level, atol=0.04)
        hits = int(np.sum(np.all(holds(together, H), axis=(1, 2, 3))))
        # Both the bound and the members are draws of 2000.
        assert hits / COUNT == pytest.approx(level, abs=4.0 * np.sqrt(2.0 * level * (1.0 - level) / COUNT))
        size = np.abs(H)
        for bounds in (alone, together):
            share = np.mean((size >= bounds.magnitude_low) & (size <= bounds.magnitude_high), axis=0)
            assert share.min() > level - 0.04


def holds(bounds, H):
    off = (H - bounds.H)[..., None]
    return np.sum((np.real(off * bounds.axes.conj()) / np.abs(bounds.axes) ** 2) ** 2, axis=-1) <= 1.0


def test_a_set_of_two_weeks_spans_both():
    """One mode had moved between the records: the union holds it where it was and where it is."""
    before, after = gimbal_fits.fit(1993), gimbal_fits.fit(1994, moved=1.003)
    members = sample_models(before.covariance, after.covariance, count=41, rng=np.random.default_rng(5))
    assert len(members) == 41
    highest = np.array([natural_hz(m).max() for m in members])
    moved = highest > 9.36
    assert np.sum(moved) == 20
    assert scipy.stats.sem(highest[moved]) < 1e-3
    assert highest[moved].mean() - highest[~moved].mean() == pytest.approx(0.003 * 9.35, rel=0.2)


def test_the_same_generator_gives_the_same_set(fit):
    one, two = (sample_models(fit.covariance, count=3, rng=np.random.default_rng(6)) for _ in range(2))
    assert one == two


def test_what_makes_no_set(fit):
    rng = np.random.default_rng(0)
    with pytest.raises(ConfigError, match="make no set"):
        sample_models(fit.covariance, count=0, rng=rng)
    with pytest.raises(ConfigError, match="make no set"):
        sample_models(count=3, rng=rng)
    other = dataclasses.replace(fit.model, outputs=(Port("elsewhere", "rad"),))
    with pytest.raises(ConfigError, match=r"outputs differ: payload \[rad\] and elsewhere \[rad\]"):
        sample_models(fit.covariance, dataclasses.replace(fit.covariance, model=other), count=2, rng=rng)
    sampled = dataclasses.replace(fit.model, sample_hz=256.0)
    with pytest.raises(ConfigError, match="sampling rates"):
        sample_models(fit.covariance, dataclasses.replace(fit.covariance, model=sampled), count=2, rng=rng)


def test_a_confounded_delay_makes_no_set():
    measured = two_modes.measure(np.random.default_rng(7))
    confounded = fit_response(measured, states=4, constants="complex", delay=True)
    assert any("confounded" in w for w in confounded.warnings)
    # Not known, and said so: no small deviation of what the data cannot tell.
    assert confounded.uncertainty.delay_s[0] > 0.1
    with pytest.raises(ConfigError, match="delay of payload is not known"):
        sample_models(confounded.covariance, count=2, rng=np.random.default_rng(8))
    # The response is known all the same.
    bounds = response_bounds(confounded.covariance, two_modes.LINES)
    assert np.all(np.abs(bounds.axes) < 10.0 * two_modes.NOISE)
