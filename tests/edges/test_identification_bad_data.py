"""What cannot be identified is refused, with the channel and the reason."""

import numpy as np
import pytest

from middeck.errors import DataError, FitError
from middeck.identification import estimate_response, fit_response, nrmse
from middeck.systems.ports import Port
from middeck.systems.record import Record
from middeck.systems.response import FrequencyResponse

U, V, Y = Port("torque", "N m"), Port("wheel", "N m"), Port("angle", "rad")


def a_record(*, inputs=(U,), experiments=1, samples=256, periodic=True):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.standard_normal((experiments, 1, samples, len(inputs))), 2, axis=1)
    y = np.roll(u.sum(axis=3, keepdims=True), 1, axis=2)
    return Record(100.0, u, y, tuple(inputs), (Y,), periodic)


def changed(record, **arrays):
    fields = {"u": record.u, "y": record.y, **arrays}
    return Record(record.sample_hz, fields["u"], fields["y"], record.inputs, record.outputs, record.periodic)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_samples_that_are_not_finite(value):
    record = a_record()
    y = record.y.copy()
    y[0, 1, 7, 0] = value
    with pytest.raises(DataError, match=r"output angle: 1 samples are not finite.*period 1, sample 7"):
        estimate_response(changed(record, y=y))


def test_constant_channels():
    record = a_record()
    with pytest.raises(DataError, match="input torque: the channel is constant at 2 N m"):
        estimate_response(changed(record, u=np.full_like(record.u, 2.0)))
    with pytest.raises(DataError, match="output angle: the channel is constant at 0 rad"):
        estimate_response(changed(record, y=np.zeros_like(record.y)))


def test_too_few_samples():
    with pytest.raises(DataError, match="are too few"):
        estimate_response(a_record(samples=8))


def test_records_that_are_not_periodic():
    with pytest.raises(DataError, match="not periodic"):
        estimate_response(a_record(periodic=False))


def test_fewer_experiments_than_inputs():
    with pytest.raises(DataError, match="1 experiments cannot tell 2 inputs apart"):
        estimate_response(a_record(inputs=(U, V)))


def test_inputs_that_are_one_signal():
    record = a_record(inputs=(U, V), experiments=2)
    with pytest.raises(DataError, match="cannot be told apart"):
        estimate_response(changed(record, u=np.repeat(record.u[..., :1], 2, axis=3)))


def test_band_without_lines():
    with pytest.raises(DataError, match="no excited line"):
        estimate_response(a_record(), band_hz=(60.0, 70.0))


def test_mismatched_lengths():
    record = a_record()
    with pytest.raises(ValueError, match="sample = 256"):
        changed(record, y=record.y[:, :, :-1])


def a_response(H, variance=None):
    H = np.asarray(H, dtype=complex)[:, None, None]
    return FrequencyResponse(0.1 * np.arange(1, len(H) + 1), H, (U,), (Y,), variance)


def test_a_constant_response():
    with pytest.raises(FitError, match="output angle: the response is constant"):
        fit_response(a_response(np.full(200, 3.0)), states=4)


def test_a_response_of_zero():
    with pytest.raises(FitError, match="output angle: the response is zero"):
        fit_response(a_response(np.zeros(200)), states=4)


def test_a_response_that_is_not_finite():
    with pytest.raises(FitError, match="not finite"):
        fit_response(a_response(np.r_[np.ones(100), np.nan]), states=4)


def test_more_unknowns_than_data():
    with pytest.raises(FitError, match="unknowns cannot be fitted to 20 numbers"):
        fit_response(a_response(1.0 / (np.arange(10) + 1j)), states=28)


def test_nothing_but_noise():
    rng = np.random.default_rng(1)
    H = rng.standard_normal(300) + 1j * rng.standard_normal(300)
    with pytest.raises(FitError, match=r"output angle: .* noise"):
        fit_response(a_response(H, np.full((300, 1, 1), 2.0)), states=4)


@pytest.mark.parametrize("delay_s", [-0.5, 7.0])
def test_a_delay_longer_than_half_the_record_or_an_output_that_leads(delay_s):
    """Lines 0.1 Hz apart come from a period of 10 s: a delay of 7 s is there the same as a lead of 3 s."""
    s = 2j * np.pi * 0.1 * np.arange(1, 200)
    w = 2.0 * np.pi * 3.0
    H = np.exp(-s * delay_s) / (s**2 + 0.04 * w * s + w**2)
    with pytest.raises(FitError, match=r"output angle: .*leads its input"):
        fit_response(a_response(H), states=2)


def test_simulating_a_record_of_other_inputs():
    record = a_record()
    s = 2j * np.pi * 0.1 * np.arange(1, 200)
    model = fit_response(a_response(1.0 / (s**2 + 0.4 * s + 400.0)), states=2).model
    other = Record(record.sample_hz, record.u, record.y, (V,), (Y,), periodic=True)
    with pytest.raises(DataError, match="the record has the inputs wheel"):
        nrmse(model, other)
