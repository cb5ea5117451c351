"""Sampled models of a record out of local minima: grown from smaller ones, with modes exchanged."""

import numpy as np
import pytest

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.unknowns_layout import unpack
from middeck.identification.record_fit.missed_modes import exchanges, grown
from middeck.identification.record_fit.record_spectra import record_data
from middeck.identification.record_fit.record_starts import start_of
from middeck.identification.record_fit.refine_record import leader, refine_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

POLES = np.array([-0.01 + 0.5j, -0.02 + 1.5j])
PAIR = np.array([True, True])
FOUR = FitOptions(states=4, sample_hz=1.0, constants="complex", direct=True)
TWO = FitOptions(states=2, sample_hz=1.0, constants="complex", direct=True)


@pytest.fixture(scope="module")
def data():
    """Two modes driven by white noise, under noise of 1 %; the record begins in motion."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal(600)
    x, y = np.zeros(2, dtype=complex), np.empty(600)
    for k in range(600):
        y[k] = np.real(np.array([1.0, 0.7j]) @ x)
        x = np.exp(POLES) * x + u[k]
    y += 0.01 * y.std() * rng.standard_normal(600)
    u, y = u[None, None, 200:, None], y[None, None, 200:, None]
    record = Record(
        sample_hz=1.0, u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y", "m"),), periodic=False
    )
    return record_data(record, None, whole=True)


def fitted(data, options, poles):
    start = start_of(data, options, np.asarray(poles), np.full(len(poles), True))
    return refine_record(data, start, "flat", rounds=2, steps=20)


def frequencies(layout, theta):
    return np.sort(np.imag(unpack(layout, theta).poles))


def test_a_pair_more_stands_where_the_residual_peaks(data):
    one = fitted(data, TWO, POLES[:1])
    start = grown(data, FOUR, one)
    # 199 lines in pi: the peak is found within the lines of its window, 2 to either side.
    assert abs(frequencies(start.layout, start.theta)[1] - 1.5) < 3 * np.pi / 200


def test_what_has_no_pair_to_grow_does_not(data):
    two = fitted(data, FOUR, POLES)
    assert grown(data, FOUR, two) is None
    assert grown(data, TWO, two) is None


def test_an_exchange_brings_two_modes_that_share_one_resonance_apart(data):
    # Both pairs near the first resonance: no step of a search carries one across to the second.
    stuck = fitted(data, FOUR, [-0.01 + 0.49j, -0.03 + 0.52j])
    best = leader(data, exchanges(data, FOUR, stuck), "flat")
    assert best.likelihood < stuck.likelihood
    # Noise of 1 % over 400 samples: a frequency is known to about 1e-4.
    np.testing.assert_allclose(frequencies(best.layout, best.refined.theta), [0.5, 1.5], atol=1e-3)


def test_a_sampled_model_has_one_slow_real_pole_and_no_more(data):
    for slow, allowed in (([-0.001, -0.05], True), ([-0.001, -0.002], False)):
        poles, pair = np.array([POLES[0], *slow]), np.array([True, False, False])
        start = start_of(data, FOUR, poles, pair)
        # No step: the poles stay where they are, 400 samples long.
        run = refine_record(data, start, "flat", rounds=1, steps=0)
        assert (run is not None) == allowed
