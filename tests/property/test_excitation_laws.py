"""Whatever the period, the cut and the scale: a repeated signal is found, and laws of designs hold."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.excitation.recognition import cut_periods, recognise_excitation
from middeck.signals.excitation.signal import line_power
from middeck.signals.ports import Port
from middeck.signals.record import Record

seeds = st.integers(0, 2**32 - 1)


@given(
    seed=seeds,
    period=st.integers(20, 400),
    periods=st.integers(3, 6),
    scale=st.sampled_from([1e-9, 1.0, 1e9]),
)
def test_a_repeated_signal_is_found_wherever_the_record_begins(seed, period, periods, scale):
    rng = np.random.default_rng(seed)
    whole = scale * np.tile(rng.standard_normal(period), periods)
    u = whole[int(rng.integers(period)) :][None, None, :, None]
    run = Record(sample_hz=1.0, u=u, y=u, inputs=(Port("u", "V"),), outputs=(Port("y", "V"),), periodic=False)
    found = recognise_excitation(run)
    assert found.period == period
    cut = cut_periods(run, found)
    np.testing.assert_array_equal(cut.u[:, 1:], cut.u[:, :-1])


@given(seed=seeds, inputs=st.integers(1, 5), phases=st.sampled_from(["random", "schroeder"]))
def test_power_of_a_multisine_is_that_of_its_lines(seed, inputs, phases):
    rng = np.random.default_rng(seed)
    made = design_multisine((2.0, 30.0), 1.0, 100.0, Limits(rms=2.0), rng, inputs=inputs, phases=phases)
    power = line_power(made.u)
    # Rounding of a transform of 100 samples.
    np.testing.assert_allclose(power.sum(axis=0), made.rms**2, rtol=1e-12)
    np.testing.assert_allclose(power[made.lines].sum(axis=0), made.rms**2, rtol=1e-12)
    assert np.all(made.crest_factor >= 1.0)
