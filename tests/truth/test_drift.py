"""Drift between two records: false alarms as stated, and a mode that moved is found and named."""

import dataclasses

import gimbal_fits
import gimbal_record
import numpy as np
import pytest
import scipy.stats
import two_modes

from middeck.errors import ConfigError
from middeck.files.measured.models import load_fitted, write_model
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.uncertainty.covariance import as_exact
from middeck.identification.uncertainty.fit_drift import compare_fits
from middeck.identification.uncertainty.response_drift import compare_responses, holm
from middeck.signals.ports import Port
from middeck.systems.plants.response import FrequencyResponse


def assert_no_more_than(level, alarms, runs):
    """As many false alarms as stated, or fewer; more only by a chance of 1e-3."""
    assert scipy.stats.binom.sf(alarms - 1, runs, level) > 1e-3, f"{alarms} false alarms of {runs}"


DRAWS = 40


def test_false_alarms_of_fitted_modes(campaign):
    fits = two_modes.fits(DRAWS, 3)
    drifts = [compare_fits(a.covariance, b.covariance) for a, b in zip(fits[::2], fits[1::2], strict=True)]
    many = [gimbal_fits.fit(s).covariance for s in campaign(200, share=40)]
    drifts += [compare_fits(a, b) for a, b in zip(many[::2], many[1::2], strict=False)]
    assert_no_more_than(0.05, sum(d.drifted for d in drifts), len(drifts))
    # The overall test is exact: its probability is uniform when nothing has changed.
    p = [d.p_overall for d in drifts[:20]]
    assert scipy.stats.kstest(p, "uniform").pvalue > 1e-3
    alarms = sum(q < 0.05 for d in drifts for m in d.modes for q in (m.p_pole, m.p_constants))
    tests = sum(2 * len(d.modes) for d in drifts)
    # Pole and constants of one mode go together: half of the tests are taken as independent.
    assert scipy.stats.binom.sf(alarms // 2 - 1, tests // 2, 0.05) > 1e-3


def test_false_alarms_of_a_model_file_against_a_record(campaign, tmp_path):
    """The file carries what the model's own record left uncertain; taken as exact, the model alarms often."""
    file = tmp_path / "model.json"
    fits = two_modes.fits(DRAWS, 3)
    pairs = zip(fits[::2], fits[1::2], strict=True)
    many = [gimbal_fits.fit(s) for s in campaign(200, share=40)]
    drifts, exact = [], 0
    for a, b in [*pairs, *zip(many[::2], many[1::2], strict=False)]:
        write_model(file, a.model, a.covariance)
        model, covariance = load_fitted(file)
        drifts.append(compare_fits(covariance, b.covariance))
        exact += compare_fits(as_exact(model), b.covariance).drifted
    assert_no_more_than(0.05, sum(d.drifted for d in drifts), len(drifts))
    assert scipy.stats.kstest([d.p_overall for d in drifts[:20]], "uniform").pvalue > 1e-3
    # By chance alone, so many alarms at 5 % have a probability below 1e-3.
    assert scipy.stats.binom.sf(exact - 1, len(drifts), 0.05) < 1e-3


def test_a_mode_that_moved_by_a_third_of_a_per_cent_is_always_found(campaign):
    """0.3 % of 9.35 Hz at 1 % noise: some forty deviations."""
    elsewhere = []
    for seed in campaign(60):
        before, after = gimbal_fits.fit(seed), gimbal_fits.fit(seed + 5000, moved=1.003)
        found = compare_fits(before.covariance, after.covariance)
        assert [m.moved for m in found.modes] == [False] * 4 + [True]
        moved = found.modes[4]
        change = moved.frequency_hz[1] - moved.frequency_hz[0]
        # Within four deviations of what was done to it.
        assert abs(change - 0.003 * 9.35) < 4.0 * moved.frequency_std_hz
        assert change > 20.0 * moved.frequency_std_hz
        assert found.drifted
        assert found.sentence.startswith("1 of 5 modes moved: 9.3")
        assert "Hz by +0.02" in found.sentence
        assert "%, " in found.sentence
        assert "deviations" in found.sentence
        quick = compare_responses(gimbal_fits.measured(seed), gimbal_fits.measured(seed + 5000, moved=1.003))
        assert quick.drifted
        inside = [b.low_hz > 8.9 and b.high_hz < 9.9 for b in quick.bands]
        assert any(inside)
        elsewhere.append(not all(inside))
        assert quick.sentence.startswith("the response moved at ")
        assert " 9." in quick.sentence
    # The level of any false alarm beside it.
    assert_no_more_than(0.05, sum(elsewhere), len(elsewhere))


def test_what_did_not_move_is_not_said_to(campaign):
    fits = [gimbal_fits.fit(s) for s in campaign(200)[:2]]
    found = compare_fits(*(f.covariance for f in fits))
    assert not found.drifted
    assert found.sentence == "none of 5 modes moved at the level 0.05"
    assert len(found.only_before) == len(found.only_after) == 0


def test_constants_and_delays_that_change_are_distinguished_from_poles():
    rng = np.random.default_rng(12)
    before = fit_response(two_modes.measure(rng), states=4).covariance
    s = 2j * np.pi * two_modes.LINES
    plain = two_modes.measure(rng)
    delayed = fit_response(
        dataclasses.replace(plain, H=plain.H * np.exp(-0.005 * s)[:, None, None]), states=4
    ).covariance
    found = compare_fits(before, delayed)
    assert [m.moved or m.reshaped for m in found.modes] == [False, False]
    assert found.delays[0].changed
    assert "the delay of payload from" in found.sentence
    strong = fit_response(
        dataclasses.replace(plain, H=1.1 * plain.H, variance=1.21 * plain.variance), states=4
    ).covariance
    found = compare_fits(before, strong)
    assert [m.moved for m in found.modes] == [False, False]
    assert [m.reshaped for m in found.modes] == [True, True]
    assert "constants changed of the modes at 1.2 Hz, 1.7 Hz" in found.sentence


def test_unlike_orders_leave_modes_without_a_counterpart():
    four, two = (
        fit_response(gimbal_fits.measured(1993), states=states, residuals=states == 8).covariance
        for states in (10, 8)
    )
    found = compare_fits(four, two)
    assert len(found.modes) == 4
    assert len(found.only_before) == 1
    assert len(found.only_after) == 0
    assert "not compared" in found.sentence


def test_modes_are_matched_by_shape_where_frequencies_crossed():
    """Two modes with two outputs exchange their places in frequency: each is found by its shape."""
    covariance = gimbal_fits.fit(1993, outputs=2).covariance
    model = covariance.model
    order = np.argsort(model.poles.imag)
    a, b = order[3], order[4]
    poles = model.poles.copy()
    # 8.90 and 9.35 Hz are drawn to 9.10 and 9.15, and beyond each other in the second model.
    near, far = 2.0 * np.pi * 9.10 * (-0.01 + 1j), 2.0 * np.pi * 9.15 * (-0.01 + 1j)
    poles[a], poles[b] = near, far
    crossed = poles.copy()
    crossed[a], crossed[b] = far, near
    before, after = (
        dataclasses.replace(covariance, model=dataclasses.replace(model, poles=p)) for p in (poles, crossed)
    )
    pairs = {m.before: m.after for m in compare_fits(before, after).modes}
    assert pairs[a] == a
    assert pairs[b] == b


def test_false_alarms_of_responses(campaign):
    runs = 20 * len(campaign(40))
    alarms = 0
    for seed in range(runs):
        rng = np.random.default_rng((31, seed))
        pair = [two_modes.measure(rng, periods=2 + k) for k in range(2)]
        alarms += compare_responses(*pair).drifted
    assert_no_more_than(0.05, alarms, runs)


def test_the_statistic_of_responses_is_f():
    rng = np.random.default_rng(9)
    found = np.concatenate(
        [compare_responses(*(two_modes.measure(rng) for _ in range(2))).statistic.ravel() for _ in range(40)]
    )
    # Two averages over 21 lines of two complex degrees each: 84 degrees and 84.
    assert scipy.stats.kstest(found, scipy.stats.f(2, 168).cdf).pvalue > 1e-3


def test_holm():
    # The worked example of Holm's (1979) kind: 0.05/4, 0.05/3, 0.05/2, 0.05.
    assert holm(np.array([0.01, 0.04, 0.03, 0.005]), 0.05).tolist() == [True, False, False, True]


def test_channels_that_differ_are_refused():
    fit = two_modes.fits(40, 3)[0].covariance
    other = dataclasses.replace(fit, model=dataclasses.replace(fit.model, inputs=(Port("wheel", "N m"),)))
    with pytest.raises(ConfigError, match=r"inputs differ: gimbal \[N m\] and wheel \[N m\]"):
        compare_fits(fit, other)
    with pytest.raises(ConfigError, match="no probability"):
        compare_fits(fit, fit, level=1.5)


def test_responses_that_cannot_be_compared():
    rng = np.random.default_rng(10)
    one = two_modes.measure(rng)
    with pytest.raises(ConfigError, match="outputs differ"):
        compare_responses(one, dataclasses.replace(one, outputs=(Port("bus", "rad"),)))
    with pytest.raises(ConfigError, match="without a variance"):
        compare_responses(one, dataclasses.replace(one, variance=None))
    with pytest.raises(ConfigError, match="no line in common"):
        compare_responses(one, dataclasses.replace(one, frequency_hz=one.frequency_hz + 0.005))
    with pytest.raises(ConfigError, match="no probability"):
        compare_responses(one, one, level=0.0)


def test_only_common_lines_are_compared():
    rng = np.random.default_rng(11)
    one, two = (two_modes.measure(rng) for _ in range(2))
    half = FrequencyResponse(
        frequency_hz=two.frequency_hz[::2],
        H=two.H[::2],
        inputs=two.inputs,
        outputs=two.outputs,
        variance=two.variance[::2],
    )
    np.testing.assert_allclose(compare_responses(one, half).frequency_hz, one.frequency_hz[::2])
    np.testing.assert_allclose(compare_responses(half, one).frequency_hz, one.frequency_hz[::2])
    assert gimbal_record.INPUTS[0].name in {p.name for p in half.inputs}
