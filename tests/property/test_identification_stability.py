"""Stable and real whatever the search does: there is no theta of an unstable model."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.unknowns_layout import Layout, unpack

numbers = st.lists(st.floats(-30.0, 30.0), min_size=8, max_size=8)


@settings(deadline=None)
@given(numbers, st.sampled_from([0.0, 1e-3]))
def test_every_theta_is_a_stable_model(values, period_s):
    layout = Layout(
        pair=np.array([True, True, False]),
        fixed_imag=np.zeros(3),
        pivot=np.zeros(3, dtype=int),
        inputs=2,
        outputs=1,
        options=FitOptions(constants="real", sample_hz=1.0 / period_s if period_s else None),
    )
    poles = unpack(layout, np.array(values)).poles
    assert (poles.real < 0.0).all()
    if period_s:
        # exp rounds to one where the decay over a sample is below rounding.
        assert (np.abs(np.exp(poles * period_s)) <= 1.0 + 1e-15).all()
