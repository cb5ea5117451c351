"""What cannot be identified is refused, with the channel and the reason."""

import dataclasses
import re

import numpy as np
import pytest

from middeck import estimate_response, fit_record, fit_response
from middeck.errors import ConfigError, DataError, FitError
from middeck.identification import nrmse
from middeck.identification.model.measurement_model import natural_hz
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from repeats import repeats

U, V, Y = Port("torque", "N m"), Port("wheel", "N m"), Port("angle", "rad")


def a_record(*, inputs=(U,), experiments=1, samples=256, periodic=True):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.standard_normal((experiments, 1, samples, len(inputs))), 2, axis=1)
    y = np.roll(u.sum(axis=3, keepdims=True), 1, axis=2)
    return Record(sample_hz=100.0, u=u, y=y, inputs=tuple(inputs), outputs=(Y,), periodic=periodic)


def changed(record, **arrays):
    fields = {"u": record.u, "y": record.y, **arrays}
    return Record(
        sample_hz=record.sample_hz,
        u=fields["u"],
        y=fields["y"],
        inputs=record.inputs,
        outputs=record.outputs,
        periodic=record.periodic,
    )


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
    with pytest.raises(ConfigError, match="sample = 256"):
        changed(record, y=record.y[:, :, :-1])


def a_response(H, variance=None):
    H = np.asarray(H, dtype=complex)[:, None, None]
    return FrequencyResponse(
        frequency_hz=0.1 * np.arange(1, len(H) + 1), H=H, inputs=(U,), outputs=(Y,), variance=variance
    )


def test_a_constant_response():
    with pytest.raises(FitError, match="output angle: the response is constant"):
        fit_response(a_response(np.full(200, 3.0)), states=4)


def test_a_response_of_zero():
    with pytest.raises(FitError, match="output angle: the response is zero"):
        fit_response(a_response(np.zeros(200)), states=4)


def test_a_response_that_is_not_finite():
    with pytest.raises(FitError, match="not finite"):
        fit_response(a_response(np.r_[np.ones(100), np.nan]), states=4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-4])
def test_a_variance_that_is_none(value):
    variance = np.full((200, 1, 1), 1e-4)
    variance[7] = value
    measured = a_response(1.0 / (1.0 + 0.1j * np.arange(200)), variance)
    with pytest.raises(DataError, match=r"output angle, input torque: the variance of 1 entries .* 0.8 Hz"):
        fit_response(measured, states=2)


def test_a_line_of_zero_has_no_logarithm():
    H = 1.0 / (1.0 + 0.1j * np.arange(200))
    H[49] = 0.0
    measured = a_response(H, np.full((200, 1, 1), 1e-4))
    with pytest.raises(DataError, match=r"output angle, input torque: 1 entries .* zero, first at 5 Hz"):
        fit_response(measured, states=2, cost="logarithmic")
    assert fit_response(measured, states=2).model.states == 2


def test_more_unknowns_than_data():
    with pytest.raises(FitError, match="unknowns cannot be fitted to 20 numbers"):
        fit_response(a_response(1.0 / (np.arange(10) + 1j)), states=28)


def test_a_record_with_more_unknowns_than_its_lines_have_numbers():
    """13 of the model, 8 of its transient, a ramp, a free sample and three tails at each end; 24 numbers."""
    x = np.random.default_rng(1).standard_normal((2, 1, 1, 26, 1))
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    record = Record(sample_hz=20.0, u=x[0], y=x[1], inputs=ports[0], outputs=ports[1], periodic=False)
    with pytest.raises(
        FitError, match=r"30 unknowns, .* free ends among them, cannot be fitted to 24 numbers"
    ):
        fit_record(record, states=8, sampled=False)


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
    other = Record(
        sample_hz=record.sample_hz, u=record.u, y=record.y, inputs=(V,), outputs=(Y,), periodic=True
    )
    with pytest.raises(DataError, match="the record has the inputs wheel"):
        nrmse(model, other)


def numbers_of(value):
    """All floating numbers in a record of records."""
    if dataclasses.is_dataclass(value):
        return [x for f in dataclasses.fields(value) for x in numbers_of(getattr(value, f.name))]
    if isinstance(value, tuple):
        return [x for part in value for x in numbers_of(part)]
    if isinstance(value, float | complex | np.ndarray) and np.asarray(value).dtype.kind in "fc":
        return list(np.ravel(value))
    return []


def a_mode(f, hz=3.0, zeta=0.01, delay_s=0.0):
    s = 2j * np.pi * f
    w = 2.0 * np.pi * hz
    return np.exp(-s * delay_s) * w**2 / (s**2 + 2.0 * zeta * w * s + w**2)


def noisy(H, size, *, seed=0, variance=True):
    rng = np.random.default_rng(seed)
    noise = size * (rng.standard_normal(len(H)) + 1j * rng.standard_normal(len(H))) / np.sqrt(2.0)
    return a_response(H + noise, np.full((len(H), 1, 1), size**2) if variance else None)


F = 0.1 * np.arange(1, 200)
ONE_MODE = a_mode(F)
UNUSUAL = {
    "exact data": a_response(ONE_MODE),
    "exact data with a variance of nothing": a_response(ONE_MODE, np.zeros((len(F), 1, 1))),
    "a scale of 1e-12": noisy(1e-12 * ONE_MODE, 1e-14),
    "a scale of 1e12": noisy(1e12 * ONE_MODE, 1e10),
    "an undamped mode": noisy(a_mode(F + 0.03, zeta=1e-9), 1e-3),
    "a mode below the band": noisy(a_mode(F + 5.0), 1e-4),
    "one strong line": noisy(np.where(np.arange(len(F)) == 40, 1e3, ONE_MODE), 1e-2),
    "a variance of zero on half of the lines": a_response(
        noisy(ONE_MODE, 1e-2).H[:, 0, 0], np.where(F < 10.0, 0.0, 1e-4)[:, None, None]
    ),
}


@pytest.mark.parametrize(
    "options", repeats([{"states": 8}, {"states": 4, "constants": "complex"}, {"states": 2}], 2)
)
@pytest.mark.parametrize("measured", UNUSUAL.values(), ids=UNUSUAL.keys())
def test_no_nan_leaves_a_fit(measured, options):
    """More modes than there are, no noise at all, unlike scales: refused, or finite in every number."""
    try:
        result = fit_response(measured, **options)
    except FitError:
        return
    numbers, deviations = np.array(numbers_of(result)), np.array(numbers_of(result.uncertainty))
    assert not np.isnan(numbers).any()
    # Known variances have infinitely many degrees of freedom; a deviation is infinite where the data do not
    # determine the number, and then it is said.
    unknown = np.sum(np.isinf(deviations))
    assert np.sum(np.isinf(numbers)) == unknown + np.isinf(result.covariance.degrees)
    assert not unknown or any("not determined" in w for w in result.warnings)
    assert np.all(result.uncertainty.natural_hz >= 0.0)


def test_noise_of_unknown_size_is_flagged():
    """One period of noise: no variance refuses it, so what the model leaves must."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(300) + 1j * rng.standard_normal(300)
    warnings = fit_response(a_response(noise), states=4).warnings
    assert any("unexplained" in w for w in warnings)
    assert any("one period" in w for w in warnings)


def test_a_mode_outside_the_band_is_flagged():
    result = fit_response(noisy(a_mode(F, hz=22.0) + ONE_MODE, 1e-3), states=4)
    assert any("mode at 22" in w and "outside the band 0.1-19.9 Hz" in w for w in result.warnings)


def test_damping_below_what_the_lines_resolve_is_flagged():
    result = fit_response(noisy(a_mode(F, hz=3.04, zeta=0.001), 1e-3), states=2)
    assert any("half-power width is 0.006" in w and "lines are 0.1 Hz apart" in w for w in result.warnings)
    wide = fit_response(noisy(a_mode(F, hz=3.04, zeta=0.05), 1e-3), states=2)
    assert not any("half-power" in w for w in wide.warnings)


def test_damping_that_is_not_known_is_flagged():
    result = fit_response(noisy(a_mode(F, hz=3.04, zeta=0.002), 6.0, seed=4), states=2)
    assert any("damping" in w and re.search("not (known|determined)", w) for w in result.warnings)


def test_a_delay_of_whole_periods_cannot_be_seen():
    """A periodic record says nothing of a delay beyond its period: the fit finds what is left of it."""
    delayed = fit_response(noisy(a_mode(F, delay_s=10.02), 1e-3), states=2).model
    # 0.1 % noise on 199 lines: far below a millisecond.
    assert delayed.delay_s[0] == pytest.approx(0.02, abs=1e-3)


def test_an_output_without_the_others_modes_is_flagged():
    """y2 is 10 ms late, without a mode; real modal constants of y1's modes follow it only with a lead."""
    f = np.arange(0.1, 40.0, 0.05)
    s = 2j * np.pi * f
    modes = sum(g / (s**2 + 0.02 * w * s + w**2) for g, w in ((1.0, 18.8), (0.5, 53.4)))
    H = np.stack([modes * np.exp(-0.01 * s), 2e-3 * np.exp(-0.01 * s)], axis=1)[:, :, None]
    rng = np.random.default_rng(0)
    size = 0.01 * np.sqrt(np.mean(np.abs(H) ** 2, axis=0, keepdims=True))
    noise = (rng.standard_normal((*H.shape, 2)) @ np.array([1.0, 1j])) * size / np.sqrt(2.0)
    ports = (Port("force", "N"),), (Port("y1", "m"), Port("y2", "m"))
    measured = FrequencyResponse(
        frequency_hz=f,
        H=H + noise,
        inputs=ports[0],
        outputs=ports[1],
        variance=np.broadcast_to(size**2, H.shape).copy(),
    )
    fit = fit_response(measured, states=4)
    assert fit.model.delay_s.min() > 0.0
    assert any("output y1: the model leaves 10% of the response unexplained" in w for w in fit.warnings)
    assert any("lies outside the band" in w for w in fit.warnings)


def test_an_acceleration_takes_complex_constants():
    """Real ones would be 30 deviations off in the delay that they find, and not say so."""
    f = np.arange(0.1, 40.0, 0.05)
    s = 2j * np.pi * f
    H = s**2 * sum(g / (s**2 + 0.02 * w * s + w**2) for g, w in ((1.0, 18.8), (0.5, 53.4), (-0.8, 138.2)))
    size = 0.01 * np.sqrt(np.mean(np.abs(H) ** 2))
    noise = np.random.default_rng(1).standard_normal((len(f), 2)) @ np.array([1.0, 1j]) * size / np.sqrt(2.0)
    ports = (Port("force", "N"),), (Port("tip", "m/s^2"),)
    measured = FrequencyResponse(
        frequency_hz=f,
        H=(H + noise)[:, None, None],
        inputs=ports[0],
        outputs=ports[1],
        variance=np.full((len(f), 1, 1), size**2),
    )
    fitted = fit_response(measured, states=6)
    found = np.sort(natural_hz(fitted.model))
    # A hundredth of the half-power bandwidth of 1 % damping.
    assert found == pytest.approx(np.array([18.8, 53.4, 138.2]) / (2.0 * np.pi), rel=2e-4)
    assert not fitted.model.delay_s.any()
