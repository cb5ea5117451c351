"""Modes followed on streaming data against a truth that moves, propagated exactly."""

import dataclasses

import gimbal_model
import gimbal_record
import moving_gimbal
import numpy as np
import pytest

from middeck.errors import ConfigError, DataError
from middeck.identification.tracking.history import track_modes
from middeck.identification.tracking.kalman_filter import update_tracking
from middeck.identification.tracking.lag import SCORE, add, behind, mean_lag, no_lag, unexplained
from middeck.identification.tracking.loss_and_restart import (
    BLOCK,
    BLOCKS,
    MEMORY,
    WATCHED,
    healed,
    is_large,
    is_trusted,
    no_blocks,
    opening,
    patience,
)
from middeck.identification.tracking.one_period import poles_at, step_modes
from middeck.identification.tracking.tracked_state import FIRST_GAIN, RandomWalk, start_tracking
from middeck.identification.uncertainty.parameter_deviations import ParameterDeviations
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.rig.rig import build_rig
from middeck.signals.record import Record
from middeck.systems.sampling.simulation import simulate
from repeats import repeats

RATE, MODES = moving_gimbal.RATE, gimbal_record.MODES_HZ
WELL_KNOWN = ParameterDeviations(1e-4 * MODES, np.full(5, 1e-4), np.zeros(1))
AT_ONE_RATE = {"sample_hz": RATE, "input_rms": 0.0}


def stepping(seconds, at, mode, factor):
    hz = np.tile(MODES, (round(seconds * RATE), 1))
    hz[round(at * RATE) :, mode] *= factor
    return hz


def test_the_truth_of_these_tests_is_the_rig():
    """Constant modes: the recursion equals the sampled plant of the rig, delays of a fraction included."""
    taken, _ = moving_gimbal.record(0, 4.0, noise=0.0, outputs=3)
    for o in range(3):
        rig = build_rig(gimbal_model.plant(3), sample_hz=RATE, delay_s=gimbal_record.DELAY_S[o])
        expected, _ = simulate(linearise_rig(rig).sampled, taken.u[0, 0])
        # Rounding of a thousand steps.
        np.testing.assert_allclose(
            taken.y[0, 0, :, o], expected[:, o], atol=1e-9 * np.abs(expected[:, o]).max()
        )


def test_slopes_of_a_period_are_its_derivatives():
    logs = np.log([[7.0, 50.0], [0.02, 0.3]])
    rng = np.random.default_rng(0)
    z, new, old = rng.standard_normal((3, 1, 2)) + 1j * rng.standard_normal((3, 1, 2))
    times = (0.01, np.array([[0.007]]), np.array([[0.003]]))

    def after(logs):
        return step_modes(z, poles_at(*logs)[0], new, old, times)[1]

    poles, by_log = poles_at(*logs)
    slope = step_modes(z, poles, new, old, times)[2]
    for which in range(2):
        for m in range(2):
            step = np.zeros((2, 2))
            step[which, m] = 1e-6
            found = (after(logs + step) - after(logs - step)) / 2e-6
            expected = np.zeros((1, 2), dtype=complex)
            expected[0, m] = by_log[which, m] * slope[0, m]
            # Central differences: rounding 1e-10, curvature 1e-11.
            np.testing.assert_allclose(found, expected, atol=1e-8)


def test_exact_data_of_the_exact_model_leave_nothing():
    """Three outputs of two delays, two inputs, no noise to speak of: parameters stay where they are."""
    taken, _ = moving_gimbal.record(0, 5.0, outputs=3, inputs=2, noise=0.0)
    tiny = 1e-6 * np.sqrt(np.mean(taken.y**2, axis=(0, 1, 2)))
    state = start_tracking(
        moving_gimbal.model(outputs=3, inputs=2), noise_rms=tiny, known=WELL_KNOWN, **AT_ONE_RATE
    )
    found = track_modes(state, taken, block=512)
    np.testing.assert_allclose(found.natural_hz[-1], MODES, rtol=1e-7)
    np.testing.assert_allclose(found.damping[-1], gimbal_record.ZETA, rtol=1e-4)
    np.testing.assert_allclose(found.state.gain, 1.0, atol=1e-4)


@pytest.mark.parametrize("hold_s", [1.0 / RATE, 0.0])
def test_a_hold_that_the_model_is_behind_is_not_taken_out_again(hold_s):
    """A model of what is behind the hold has no half sample in its delays and no loss in its constants."""
    taken, _ = moving_gimbal.record(0, 5.0, outputs=3, inputs=2, noise=0.0)
    tiny = 1e-6 * np.sqrt(np.mean(taken.y**2, axis=(0, 1, 2)))
    right = gimbal_model.model(3, 2)
    model = dataclasses.replace(right, delay_s=right.delay_s - moving_gimbal.HOLD, hold_s=hold_s)
    state = start_tracking(model, noise_rms=tiny, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken, block=512)
    np.testing.assert_allclose(found.natural_hz[-1], MODES, rtol=1e-7)
    np.testing.assert_allclose(found.state.gain, 1.0, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("mode", repeats([4, 3]))
def test_a_step_of_one_per_cent_is_followed_within_twenty_seconds(campaign, mode):
    """8.90 and 9.35 Hz, 1 % noise, up or down: within a tenth after 20 s, the others undisturbed."""
    close = []
    for seed in campaign(20):
        factor = (0.99, 1.01)[(seed + mode) % 2]
        taken, noise = moving_gimbal.record(seed, 26.0, hz=stepping(26.0, 6.0, mode, factor))
        state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
        found = track_modes(state, taken)
        true = stepping(26.0, 6.0, mode, factor)[-1]
        error = np.abs(found.natural_hz[-1] / true - 1.0)
        close.append(error[mode] < 1e-3)
        assert np.delete(error, mode).max() < 1e-3
        assert np.all(np.abs(found.natural_hz[-1] - true) < 4.5 * found.frequency_std_hz[-1])
        before = found.time_s < 6.0
        # Said while it is so: untouched and trusted before; then a jump, and a deviation that covers it.
        assert found.jumps[before][-1].sum() == 0
        assert found.trusted[before].all()
        assert found.jumps[-1, mode] >= 1
        after = (found.time_s > 6.0) & (found.time_s < 12.0)
        assert found.frequency_std_hz[after, mode].max() > 1e-3 * MODES[mode]
    # Deviations are 1.3e-4 to 4e-4, as the noise falls: one in twenty of the worst may miss by chance.
    assert np.mean(close) >= 0.95


@pytest.mark.long
@pytest.mark.parametrize("factors", repeats([(0.98, 0.98), (0.98, 1.02)]))
def test_neighbours_that_jump_together_do_not_change_places(campaign, factors):
    """Modes at 8.90 and 9.35 Hz move by 2 % each: a mode alone would be found where the other now is."""
    hz = np.tile(MODES, (round(16.0 * RATE), 1))
    hz[round(4.0 * RATE) :, 3:] *= factors
    for seed in campaign(20):
        taken, noise = moving_gimbal.record(seed, 16.0, hz=hz)
        state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
        found = track_modes(state, taken, block=512)
        # Twelve seconds for two at once; changed places would be 5 % off.
        assert np.abs(found.natural_hz[-1] / hz[-1] - 1.0).max() < 3e-3
        assert np.all(np.abs(found.natural_hz[-1] - hz[-1]) < 4.5 * found.frequency_std_hz[-1])


@pytest.mark.long
def test_wandering_parameters_stay_within_their_deviations(campaign):
    """Frequency and damping walk as the drift says; errors over stated deviations have an rms of one."""
    drift = RandomWalk(frequency=3e-4, damping=1e-2)
    ratios = []
    for seed in campaign(60):
        rng = np.random.default_rng(seed)
        first = np.array([[2e-3], [0.05]]) * rng.standard_normal((2, 5))
        walk = np.cumsum(rng.standard_normal((2, 12, 5)), axis=1)
        logs = np.stack([drift.frequency * walk[0], drift.damping * walk[1]])
        hz, zeta = MODES * np.exp(logs[0]), gimbal_record.ZETA * np.exp(logs[1])
        taken, noise = moving_gimbal.record(
            seed, 12.0, hz=np.repeat(hz, 256, axis=0), zeta=np.repeat(zeta, 256, axis=0)
        )
        known = ParameterDeviations(2e-3 * MODES, np.full(5, 5e-4), np.zeros(1))
        state = start_tracking(
            moving_gimbal.model(frequency=first[0], damping=first[1]),
            noise_rms=noise, known=known, drift=drift, **AT_ONE_RATE,
        )  # fmt: skip
        found = track_modes(state, taken)
        half = found.natural_hz[6:], hz[6:], found.frequency_std_hz[6:]
        ratios.append(
            [
                np.sqrt(np.mean(((half[0] - half[1]) / half[2]) ** 2)),
                np.sqrt(
                    np.mean(
                        (np.log(found.damping[6:] / zeta[6:]) * found.damping[6:] / found.damping_std[6:])
                        ** 2
                    )
                ),
            ]
        )
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    # About ten independent numbers a run (five modes, correlated in time): four deviations, and a tenth
    # for what is not linear while the first two seconds find the modes.
    assert np.all(np.abs(rms - 1.0) < 0.1 + 4.0 / np.sqrt(2.0 * 10 * len(ratios)))


def test_without_drift_the_filter_has_the_bound_of_its_record():
    """The Cramer-Rao bound by differences of the exact simulation, with what was known before."""
    seconds, step = 10.0, 1e-5
    taken, noise = moving_gimbal.record(0, seconds)
    v = taken.u[0, 0, :, 0]
    delay = gimbal_record.DELAY_S[0] - moving_gimbal.HOLD
    one = np.ones(len(v))

    def motion(m, hz=1.0, zeta=1.0):
        made = moving_gimbal.motion_of_mode(v, delay, hz * MODES[m] * one, zeta * gimbal_record.ZETA * one)
        return gimbal_record.PHI[0, m] * gimbal_record.PSI[0, m] * made

    J = [(motion(m, hz=1.0 + step) - motion(m, hz=1.0 - step)) / (2.0 * step) for m in range(5)]
    J += [(motion(m, zeta=1.0 + step) - motion(m, zeta=1.0 - step)) / (2.0 * step) for m in range(5)]
    J += [motion(m) for m in range(5)]
    before = np.concatenate([np.full(5, 1e-3), np.full(5, 0.1), np.full(5, FIRST_GAIN)])
    scaled = np.array(J) / noise[0]
    bound = np.sqrt(np.diag(np.linalg.inv(scaled @ scaled.T + np.diag(before**-2.0))))
    known = ParameterDeviations(1e-3 * MODES, np.full(5, 1e-3), np.zeros(1))
    still = RandomWalk(frequency=0.0, damping=0.0, gain=0.0)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=known, drift=still, **AT_ONE_RATE)
    found = track_modes(state, taken, block=2560)
    has = [
        found.frequency_std_hz[-1] / MODES,
        found.damping_std[-1] / found.damping[-1],
        np.sqrt(np.diag(found.state.covariance)[-len(MODES) :]),  # of the gains, the last unknowns
    ]
    # Derivatives are taken along the way, at estimates that are off by what was known before.
    np.testing.assert_allclose(np.concatenate(has), bound, rtol=0.15)
    assert np.abs((found.natural_hz[-1] - MODES) / found.frequency_std_hz[-1]).max() < 4.0


def test_white_innovations_are_distrusted_as_rarely_as_chi_square_says():
    """Sixteen squares have a longer tail than a normal number, as which they were bounded."""
    rng, count = np.random.default_rng(0), 2.0 * MEMORY
    draws = np.hstack([np.ones((40_000, 1)), rng.standard_normal((40_000, WATCHED)) / np.sqrt(count)])
    assert all(is_trusted(means, 1.0, 1) for means in draws)
    assert np.max(count * np.sum(draws[:, 1:] ** 2, axis=1)) > WATCHED + 5.0 * np.sqrt(2.0 * WATCHED)
    # Not white: every correlation two of its deviations, or one ten.
    for correlated in (np.full(WATCHED, 2.0), 10.0 * np.eye(WATCHED)[3]):
        assert not is_trusted(np.concatenate([[1.0], correlated / np.sqrt(count)]), 1.0, 1)


def test_blocks_are_nothing_but_blocks():
    taken, noise = moving_gimbal.record(1, 2.0)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, **AT_ONE_RATE)
    whole = update_tracking(state, taken.u[0, 0], taken.y[0, 0])
    by_sevens = track_modes(state, taken, block=7).state
    assert whole == by_sevens
    assert state.samples == 0
    assert whole.time_s == 2.0


def test_lost_samples_and_spikes_do_no_harm():
    taken, noise = moving_gimbal.record(2, 6.0)
    y = np.array(taken.y[0, 0])
    y[300:400] = np.nan
    y[700] = 1e3 * y[:300].std()
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = update_tracking(state, taken.u[0, 0], y)
    assert np.isfinite(found.mean).all()
    assert found.trusted
    assert np.all(np.abs(found.natural_hz - MODES) < 4.5 * found.frequency_std_hz)


def lost_between(seconds, *, hz=None, seed=7):
    """A transmission that gives zeros for two seconds from the sixth."""
    taken, noise = moving_gimbal.record(seed, seconds, hz=hz)
    y = np.array(taken.y)
    y[0, 0, round(6.0 * RATE) : round(8.0 * RATE)] = 0.0
    return dataclasses.replace(taken, y=y), noise


JUMPS = [(3, 0.9), (0, 1.1), (1, 0.9), (2, 0.9)]


@pytest.mark.long
def test_modes_lost_in_a_dropout_are_found_again_though_one_jumped_by_a_tenth(campaign):
    for mode, factor in JUMPS[: len(campaign(20))]:  # one, or all
        found_again(mode, factor)


def found_again(mode, factor):
    hz = stepping(24.0, 7.0, mode, factor)
    taken, noise = lost_between(24.0, hz=hz)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken)
    during = (found.time_s > 7.0) & (found.time_s < 12.0)
    assert not found.trusted[during].any()
    assert found.restarts[found.time_s < 8.0][-1] == 0
    first = found.state.restarts[0]
    assert first.good_s < 6.0 < first.time_s
    assert first.opening == 0.01
    # Neighbours of like gains may have changed names; 0.2 % is a few deviations after ten seconds.
    error = np.sort(found.natural_hz[-1]) / np.sort(hz[-1]) - 1.0
    assert np.abs(error).max() < 2e-3
    assert mode == 3 or np.abs(found.natural_hz[-1] / hz[-1] - 1.0).max() < 2e-3


def test_trust_and_good_states_come_back_soon_after_a_loss_is_over():
    taken, noise = lost_between(34.0)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken, block=256)
    (restart,) = found.state.restarts
    back = found.time_s[found.trusted & (found.time_s > restart.time_s)]
    # Four seconds of whole blocks after the way back; a mean that forgets alone would take some twenty.
    assert restart.time_s + 4.0 < back[0] < restart.time_s + 12.0
    assert found.trusted[found.time_s >= back[0]].all()
    # The state that a further restart would begin from is one of after this one.
    assert found.state.recovery.taken[0] / RATE > restart.time_s
    error = np.abs(found.natural_hz[found.time_s >= back[0]] / MODES - 1.0)
    assert error.max() < 2e-3  # as of the modes found again above


def test_a_loss_that_is_over_is_nothing_to_begin_again_for():
    """Patience is at an end, but the last block is of the expected size."""
    blocks, seen = no_blocks()
    assert not is_large(blocks, seen)
    blocks[2:, 0] = 25.0 * BLOCK
    blocks[1, 0] = BLOCK
    assert not is_large(blocks, BLOCK * BLOCKS)
    blocks[1, 0] = 2.0 * BLOCK
    assert is_large(blocks, BLOCK * BLOCKS)
    large = np.zeros(WATCHED + 1)
    large[0] = 4.0
    # One block that is not yet right leaves the mean as it is.
    assert healed(large, 1.0, blocks, BLOCK * BLOCKS, 1) is None
    blocks[1:, 0] = BLOCK
    assert healed(large, 1.0, blocks, BLOCK * BLOCKS, 1) is not None
    assert healed(large, 1.0, blocks, BLOCK * (BLOCKS - 1), 1) is None
    # A little too large for long is not a loss.
    assert healed(0.3 * large, 1.0, blocks, BLOCK * BLOCKS, 1) is None


@pytest.mark.long
def test_a_mode_that_went_too_far_for_one_opening_is_found_by_the_next():
    hz = stepping(40.0, 7.0, 2, 1.15)
    taken, noise = lost_between(40.0, hz=hz)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken, block=2560)
    assert [r.opening for r in found.state.restarts[:2]] == [0.01, 0.02]
    assert np.abs(np.sort(found.natural_hz[-1]) / np.sort(hz[-1]) - 1.0).max() < 2e-3


def scalar_filter(errors, noise, q, information, T):
    """Sums of the lag of a steady filter of one random walk, whose error before each sample is given."""
    # P of P - P^2 I T / (1 + P I T) + q^2 T = P, before a sample.
    variance = 0.5 * q * (q * T + np.sqrt((q * T) ** 2 + 4.0 / information))
    gain = variance * information * T / (1.0 + variance * information * T)
    sums = no_lag(errors.shape[1])
    for error, chance in zip(errors, noise, strict=True):
        news = error + chance / np.sqrt(information * T)
        add(sums, gain * news, np.full(len(news), gain * variance), np.full(len(news), variance), T)
    return sums, gain, variance


def test_the_lag_behind_a_ramp_is_that_of_the_theory():
    """r / (q sqrt(I)) of a random walk's filter under a ramp: seen as it is, and beyond chance."""
    q, information, T, ramp = 3e-5, 1e7, 0.01, 4e-4
    lag = ramp / (q * np.sqrt(information))
    sums, gain, variance = scalar_filter(np.full((8000, 1), lag), np.zeros((8000, 1)), q, information, T)
    assert gain * lag == pytest.approx(ramp * T, rel=1e-3)  # it moves as the ramp does
    assert mean_lag(sums)[0] == pytest.approx(lag, rel=1e-9)
    assert lag > 40.0 * np.sqrt(variance)
    assert behind(sums, 1.0).tolist() == [0]
    assert np.sqrt(unexplained(sums)[0]) == pytest.approx(lag, rel=0.01)


def test_chance_is_no_lag():
    """Errors of a filter whose random walk is as stated: the score has the deviation that it is told."""
    rng, q, information, T = np.random.default_rng(0), 3e-5, 1e7, 0.01
    runs, samples = 400, 4000
    _, gain, variance = scalar_filter(np.zeros((1, 1)), np.zeros((1, 1)), q, information, T)
    errors, noise = np.empty((samples, runs)), rng.standard_normal((samples, runs))
    error = np.sqrt(variance) * rng.standard_normal(runs)
    for k in range(samples):
        errors[k] = error
        error = (1.0 - gain) * error - gain * noise[k] / np.sqrt(information * T)
        error = error + q * np.sqrt(T) * rng.standard_normal(runs)
    sums, _, _ = scalar_filter(errors, noise, q, information, T)
    # 400 draws: the deviation of the score to 3.5 %, four of these.
    assert np.std(sums[SCORE] / np.sqrt(sums[2])) == pytest.approx(1.0, abs=0.14)
    assert len(behind(sums, 1.0)) <= 2
    # Of a twentieth of the runs, by less than a deviation.
    assert np.mean(unexplained(sums) > 0.0) < 0.1
    assert np.mean(np.sqrt(unexplained(sums))) < 0.1 * np.sqrt(variance)


def test_a_ramp_is_followed_within_its_deviation_once_it_is_noticed():
    """1.2 Hz rising by 0.1 % a second: 10 to 75 deviations behind until the drift was taken for faster."""
    seconds = 13.0
    t = np.arange(round(seconds * RATE)) / RATE
    hz = np.tile(MODES, (len(t), 1))
    hz[:, 0] *= np.exp(1e-3 * np.clip(t - 4.0, 0.0, 12.0))
    taken, noise = moving_gimbal.record(2, seconds, hz=hz)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken)
    delay = found.time_s >= 9.0
    true = hz[np.round(found.time_s[delay] * RATE).astype(int) - 1]
    assert np.abs((found.natural_hz[delay] - true) / found.frequency_std_hz[delay]).max() < 4.0
    assert np.all(found.frequency_std_hz[delay, 0] < 2e-3 * MODES[0])


def test_more_noise_is_no_loss():
    """Twice the stated noise: not trusted, but nothing to begin again for."""
    taken, noise = moving_gimbal.record(3, 12.0)
    state = start_tracking(moving_gimbal.model(), noise_rms=0.5 * noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken, block=2560)
    assert not found.trusted[-1]
    assert found.restarts[-1] == 0
    assert np.abs(found.natural_hz[-1] / MODES - 1.0).max() < 2e-3  # twice the noise, twice the deviation


def test_what_is_never_found_is_looked_for_ever_more_rarely():
    taken, noise = moving_gimbal.record(3, 24.0)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, **AT_ONE_RATE)
    found = track_modes(state, dataclasses.replace(taken, y=taken.y[:, :, ::-1]), block=2560)
    assert np.isfinite(found.natural_hz).all()
    # At most one in PATIENCE_S of 6 s.
    assert 1 <= found.restarts[-1] <= 4
    assert [opening(k) for k in range(4)] == [1.0, 2.0, 4.0, 1.0]
    assert patience(6) == 3.0 * patience(0)


@pytest.mark.parametrize("wrong", ["noise", "missing mode", "sign"])
def test_a_model_that_does_not_hold_is_not_trusted(wrong):
    taken, noise = moving_gimbal.record(3, 8.0)
    model = moving_gimbal.model()
    if wrong == "missing mode":
        keep = np.arange(5) != 2
        model = dataclasses.replace(
            model,
            poles=model.poles[keep],
            shapes=model.shapes[:, keep],
            participation=model.participation[keep],
        )
    if wrong == "sign":
        taken = dataclasses.replace(taken, y=-taken.y)
    rms = 0.5 * noise if wrong == "noise" else noise
    found = track_modes(start_tracking(model, noise_rms=rms, **AT_ONE_RATE), taken, block=2048)
    assert not found.trusted[-1]
    assert np.isfinite(found.natural_hz).all()


def test_a_record_taken_while_the_test_runs():
    """The motion at the start is unknown: judged by the rms of what moved the article before."""
    taken, noise = moving_gimbal.record(4, 22.0)
    cut = Record(
        sample_hz=RATE,
        u=taken.u[:, :, 2560:],
        y=taken.y[:, :, 2560:],
        inputs=taken.inputs,
        outputs=taken.outputs,
        periodic=False,
    )
    state = start_tracking(
        moving_gimbal.model(), sample_hz=RATE, noise_rms=noise, input_rms=1.0, known=WELL_KNOWN
    )
    found = track_modes(state, cut)
    # What is unknown at first is large, and products of what is unknown are not in a linear filter.
    assert found.trusted[found.time_s > 4.0].all()
    assert np.all(np.abs(found.natural_hz[-1] - MODES) < 4.5 * found.frequency_std_hz[-1])


@pytest.mark.long
def test_a_long_record_does_not_wear_the_filter_out(campaign):
    """No divergence: the covariance stays positive, the modes known, over hours of samples."""
    minutes = 60 if len(campaign(20)) > 1 else 0.25
    taken, noise = moving_gimbal.record(5, 60.0 * minutes)
    state = start_tracking(moving_gimbal.model(), noise_rms=noise, known=WELL_KNOWN, **AT_ONE_RATE)
    found = track_modes(state, taken, block=1280)
    assert np.linalg.eigvalsh(found.state.covariance)[0] > 0.0
    assert found.trusted.mean() > 0.99
    assert np.all(np.abs(found.natural_hz - MODES) < 5.0 * found.frequency_std_hz)
    # Chance is taken for a jump about once in 150,000 looks at ten sums, every four seconds.
    assert found.jumps[-1].sum() <= 1
    assert found.restarts[-1] == 0


def test_what_cannot_be_followed_is_refused():
    model = moving_gimbal.model()
    with pytest.raises(ConfigError, match="continuous"):
        start_tracking(dataclasses.replace(model, sample_hz=RATE), noise_rms=1.0, **AT_ONE_RATE)
    with pytest.raises(ConfigError, match="continuous"):
        start_tracking(dataclasses.replace(model, lower=np.ones((1, 1))), noise_rms=1.0, **AT_ONE_RATE)
    with pytest.raises(ConfigError, match="at 16"):
        start_tracking(model, sample_hz=16.0, noise_rms=1.0, input_rms=0.0)
    with pytest.raises(ConfigError, match="noise"):
        start_tracking(model, noise_rms=0.0, **AT_ONE_RATE)
    with pytest.raises(ConfigError, match="inputs of rms"):
        start_tracking(model, sample_hz=RATE, noise_rms=1.0, input_rms=np.nan)
    with pytest.raises(ConfigError, match="hold"):
        start_tracking(dataclasses.replace(model, delay_s=np.zeros(1)), noise_rms=1.0, **AT_ONE_RATE)
    with pytest.raises(ConfigError, match="drifts"):
        RandomWalk(frequency=-1.0)
    state = start_tracking(model, noise_rms=1.0, **AT_ONE_RATE)
    with pytest.raises(DataError, match="block"):
        update_tracking(state, np.zeros((5, 2)), np.zeros((5, 1)))
    with pytest.raises(DataError, match="not finite"):
        update_tracking(state, np.full((5, 1), np.nan), np.zeros((5, 1)))
    taken, _ = moving_gimbal.record(0, 1.0)
    with pytest.raises(ConfigError, match="rate"):
        track_modes(state, dataclasses.replace(taken, sample_hz=100.0))
    with pytest.raises(ConfigError, match="blocks"):
        track_modes(state, taken, block=0)
