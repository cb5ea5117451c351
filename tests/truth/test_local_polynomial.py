"""Local models of response and transient: exact where they must be, honest about their noise, and refused."""

import tracemalloc

import gimbal_record
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from middeck.errors import DataError
from middeck.identification.spectra.estimate import estimate_response, response_scatter
from middeck.identification.spectra.local_fit import LocalModel, both_kinds, fit_windows, freedom
from middeck.identification.spectra.variance_of_lines import trusted
from middeck.signals.ports import Port
from middeck.signals.record import Record, RecordStream, stream_record

HZ = 256.0


def normal(rng, *shape):
    """Complex noise of unit variance."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def cut_record(seed, *, samples, noise=0.0, outputs=1, inputs=1, experiments=1):
    """Cut from a longer steady response of the gimbal to band-limited noise: it begins and ends in motion."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(2 * samples, 1.0 / HZ)
    on = (f >= 0.1) & (f <= 60.0)
    U = np.zeros((experiments, len(f), inputs), dtype=complex)
    U[:, on] = normal(rng, experiments, on.sum(), inputs)
    H = np.zeros((len(f), outputs, inputs), dtype=complex)
    H[on] = gimbal_record.response(f[on], outputs, inputs)
    u, y = (np.fft.irfft(X, n=2 * samples, axis=1) for X in (U, np.einsum("koi,eki->eko", H, U)))
    u, y = (x[:, None, :samples] / u.std() for x in (u, y))
    y = y + noise * np.sqrt(np.mean(y**2, axis=(0, 1, 2))) * rng.standard_normal(y.shape)
    ports = gimbal_record.INPUTS[:inputs], gimbal_record.OUTPUTS[:outputs]
    return Record(sample_hz=HZ, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=False)


def error_within(found, low, high):
    here = (found.frequency_hz >= low) & (found.frequency_hz <= high)
    outputs, inputs = found.H.shape[1:]
    truth = gimbal_record.response(found.frequency_hz[here], outputs, inputs)
    return gimbal_record.complex_error(found.H[here], truth)


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("experiments", "inputs", "outputs"), [(1, 1, 1), (1, 2, 3), (3, 2, 2)])
def test_is_exact_where_response_and_transient_are_what_it_assumes(rational, experiments, inputs, outputs):
    rng = np.random.default_rng(1)
    k = np.arange(80)[:, None, None] / 40.0 - 1.0
    quadratic = lambda *shape: sum(normal(rng, 1, *shape) * k**n for n in range(3))  # noqa: E731
    D = 1.0 + 0.3j * k + 0.2 * k**2 if rational else 1.0
    G = quadratic(outputs, inputs) / D
    U = normal(rng, 80, experiments, inputs)
    Y = np.einsum("koi,kei->keo", G, U) + quadratic(experiments, outputs) / D
    windows = U, Y, np.arange(80), LocalModel(12, rational)
    found = both_kinds(*windows).sensors if rational else fit_windows(*windows)
    # Normal equations square the condition of a window, some 1e3 with a denominator: 1e6 times rounding, and
    # the ridge of 1e-13 times the same.
    assert np.abs(found.H - G).max() < (1e-6 if rational else 1e-10)


def test_a_fixed_window_states_its_noise_to_the_letter():
    """2 nu (estimated / true variance) is chi-square with 2 nu degrees of freedom; H scatters as it says."""
    rng = np.random.default_rng(2)
    model, lines = LocalModel(7, rational=False), np.arange(7, 3000, 15)  # windows without common lines
    k = np.arange(3000) / 3000.0
    G = np.stack([np.exp(-2j * k), 1.0 / (1.0 + 3j * k)], axis=1)[:, :, None]
    U = normal(rng, 3000, 2, 1)
    mix = np.array([[1.0, 0.0], [0.6 - 0.3j, 0.5]])
    Y = np.einsum("koi,kei->keo", G, U) + 0.1 * normal(rng, 3000, 2, 2) @ mix.T
    found = fit_windows(U, Y, lines, model)
    C = 0.01 * mix @ mix.conj().T
    nu = freedom(model, experiments=2, inputs=1, outputs=2)
    assert nu == 2 * 15 - 2 * 3 - 3
    ratio = 2.0 * nu * np.real(found.covariance[:, 0, 0]) / np.real(C[0, 0])
    # Kolmogorov and Smirnov's test at one in a thousand; the seed is fixed.
    assert stats.kstest(ratio, stats.chi2(2.0 * nu).cdf).pvalue > 1e-3
    # Off the diagonal the mean over 200 windows scatters by sqrt(C_11 C_22 / nu / 200); four are allowed.
    off = found.covariance[:, 0, 1].mean()
    assert abs(off - C[0, 1]) < 4.0 * np.sqrt(np.real(C[0, 0] * C[1, 1]) / nu / len(lines))
    z = (found.H - G[lines])[:, :, 0] / np.sqrt(found.variance[:, :, 0])
    # |z|^2 of complex noise over its own estimate is F(2, 2 nu).
    assert stats.kstest(np.abs(z[:, 0]) ** 2, stats.f(2, 2.0 * nu).cdf).pvalue > 1e-3


def test_error_falls_with_the_third_power_of_the_spacing_of_lines():
    """A quadratic leaves the cubic term of a smooth response: half the spacing, an eighth of the error."""
    errors = []
    for samples in (2048, 4096, 8192):
        u = np.random.default_rng(3).standard_normal(2 * samples)
        y = lfilter([1.0], [1.0, -1.2, 0.72], u)
        record = Record(
            sample_hz=1.0,
            u=u[None, None, samples:, None],
            y=y[None, None, samples:, None],
            inputs=(Port("u", ""),),
            outputs=(Port("y", ""),),
            periodic=False,
        )
        U, Y = (np.fft.rfft(x[0, 0], axis=0)[:, None, :] for x in (record.u, record.y))
        lines = np.arange(20, samples // 2 - 20)
        found = fit_windows(U, Y, lines, LocalModel(6, rational=False))
        q = np.exp(-2j * np.pi * lines / samples)
        errors.append(np.sqrt(np.mean(np.abs(found.H[:, 0, 0] - 1.0 / (1.0 - 1.2 * q + 0.72 * q**2)) ** 2)))
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    # Other random inputs for each length move the error by some tens of per cent: a third of an order.
    np.testing.assert_allclose(order, 3.0, atol=0.4)


def test_a_gimbal_cut_from_noise_is_found_where_windows_and_polynomials_fail():
    record = cut_record(1, samples=49152, noise=0.01)
    rational = estimate_response(record, band_hz=(0.1, 60.0))
    polynomial = estimate_response(record, band_hz=(0.1, 60.0), method="local polynomial")
    welch = estimate_response(record, method="h1")
    errors = [error_within(found, 0.3, 30.0) for found in (rational, polynomial, welch)]
    # The mode at 1.2 Hz is 4.6 lines wide at half power: a window of eleven lines rounds it off, and Welch's
    # of 4096 samples is four times as wide as the mode. With a denominator it is seen for what it is.
    assert errors[0] < 0.003
    assert 30.0 * errors[0] < errors[1] < errors[2]
    # At 9 Hz resonances are 35 lines wide, and polynomials do.
    assert error_within(polynomial, 2.0, 6.0) < 0.01
    assert error_within(welch, 1.1, 1.3) > 0.1


def test_the_stated_variance_is_that_of_the_error(campaign):
    """Sum of squared errors over sum of stated variances, band by band, the data choose windows."""
    bands = [(0.3, 1.1), (1.1, 2.0), (2.0, 6.0), (6.0, 10.0), (10.0, 20.0), (20.0, 60.0)]
    ratios = []
    for seed in campaign(120):
        found = response_scatter(cut_record(seed, samples=16384, noise=0.01), band_hz=(0.25, 60.0))
        squared = np.abs(found.H - gimbal_record.response(found.frequency_hz)) ** 2
        inside = [(found.frequency_hz >= a) & (found.frequency_hz < b) for a, b in bands]
        ratios.append([squared[k].sum() / found.total[k].sum() for k in inside])
    # Choosing the window by its residual flatters it by some 10 %, bias adds up to twice as much, and a band
    # of few independent windows scatters by 20 % over three seeds: within a third, where a bias of one
    # deviation would double it.
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.15, rtol=0.35)


def test_several_inputs_in_one_experiment():
    """Whole periods need as many experiments as inputs; neighbouring lines tell two random inputs apart."""
    found = estimate_response(
        cut_record(4, samples=32768, noise=0.01, inputs=2, outputs=3), band_hz=(0.3, 30.0)
    )
    assert found.H.shape[1:] == (3, 2)
    # Twice the unknowns of a single input on two thirds of the lines: three times its 0.13 %.
    assert error_within(found, 0.3, 10.0) < 0.005


def test_experiments_with_transients_of_their_own_are_used_together():
    record = cut_record(6, samples=16384, noise=0.01, experiments=4)
    U, Y = (np.fft.rfft(x[:, 0], axis=1).swapaxes(0, 1) for x in (record.u, record.y))
    lines = np.arange(140, 380)  # 2 to 6 Hz, between the resonances
    truth = gimbal_record.response(lines * HZ / 16384)
    errors = [
        gimbal_record.complex_error(fit_windows(U[:, :e], Y[:, :e], lines, LocalModel(12, False)).H, truth)
        for e in (1, 4)
    ]
    # Four times the data in the same windows: half the error, known from some thirty windows to a sixth.
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.4)


def test_ringing_from_before_the_record_is_a_transient():
    record = cut_record(7, samples=16384, noise=0.0)
    t = np.arange(16384) / HZ
    ringing = sum(
        20.0 * record.y.std() * np.exp(-0.01 * w * t) * np.cos(w * t + 1.0)
        for w in 2.0 * np.pi * gimbal_record.MODES_HZ
    )
    y = record.y + ringing[None, None, :, None]
    local, periodic = (
        error_within(
            estimate_response(
                Record(
                    sample_hz=HZ, u=record.u, y=y, inputs=record.inputs, outputs=record.outputs, periodic=p
                ),
                band_hz=(0.3, 30.0),
            ),
            0.3,
            30.0,
        )
        for p in (False, True)
    )
    # What is left of twenty times the output's rms, that lines of the bare DFT carry in full (some hundred
    # times the response): a transient has the poles of the response, and a window that holds one holds both.
    assert periodic > 10.0
    assert local < 0.005


def test_periods_that_are_not_steady_yet():
    """A multisine switched on at rest: whole periods would take its ringing for response."""
    steady = gimbal_record.multisine(8, noise=0.0, samples=4096)
    t = np.arange(3 * 4096) / HZ
    ringing = np.exp(-0.01 * 2.0 * np.pi * 1.2 * t) * np.cos(2.0 * np.pi * 1.2 * t) * 3.0 * steady.y.std()
    record = Record(
        sample_hz=HZ,
        u=steady.u,
        y=steady.y + ringing.reshape(1, 3, 4096, 1),
        inputs=steady.inputs,
        outputs=steady.outputs,
        periodic=True,
    )
    stream = stream_record(record)  # read in pieces, periods are averaged as they are
    periods = error_within(estimate_response(stream, band_hz=(0.5, 30.0)), 0.5, 30.0)
    local = estimate_response(record, band_hz=(0.5, 30.0), method="local rational")
    np.testing.assert_allclose(np.diff(local.frequency_hz), HZ / 4096)  # excited lines only
    assert error_within(local, 0.5, 30.0) < 0.1 * periods
    with pytest.warns(UserWarning, match="begin with a transient"):
        taken_out = estimate_response(record, band_hz=(0.5, 30.0))
    assert error_within(taken_out, 0.5, 30.0) < 1e-3 * periods


def test_too_short_a_record_says_how_many_lines_it_takes():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1, 1, 20, 1))
    record = Record(
        sample_hz=1.0,
        u=u,
        y=2.0 * u + u**2,
        inputs=(Port("u", "V"),),
        outputs=(Port("y", "V"),),
        periodic=False,
    )
    with pytest.raises(DataError, match="9 lines are too few for a local model of 11"):
        estimate_response(record)


def test_a_band_without_excitation_is_refused():
    with pytest.raises(DataError, match="no excited line in the band 200 to 210 Hz"):
        estimate_response(cut_record(1, samples=2048), band_hz=(200.0, 210.0))
    with pytest.raises(DataError, match=r"band .* is empty"):
        estimate_response(cut_record(1, samples=2048), band_hz=(10.0, 1.0))


def test_inputs_that_are_copies_are_refused():
    record = cut_record(1, samples=2048)
    twice = Record(
        sample_hz=HZ,
        u=np.concatenate([record.u, -3.0 * record.u], axis=3),
        y=record.y,
        inputs=gimbal_record.INPUTS,
        outputs=record.outputs,
        periodic=False,
    )
    with pytest.raises(DataError, match="cannot be told apart"):
        estimate_response(twice, band_hz=(1.0, 60.0))


def test_a_blow_is_as_smooth_as_a_transient():
    rng = np.random.default_rng(0)
    u = np.zeros((1, 1, 1024, 1))
    u[0, 0, 0] = 1.0
    y = lfilter([1.0], [1.0, -1.2, 0.72], u, axis=2) + 0.01 * rng.standard_normal(u.shape)
    record = Record(
        sample_hz=1.0, u=u, y=y, inputs=(Port("u", "N"),), outputs=(Port("y", "m"),), periodic=False
    )
    with pytest.raises(DataError, match="as smooth as a transient"):
        estimate_response(record)
    # What the hint says: from rest to rest it is one period.
    whole = Record(sample_hz=1.0, u=u, y=y, inputs=record.inputs, outputs=record.outputs, periodic=True)
    found = response_scatter(whole)
    assert np.abs(found.H[255, 0, 0] - 1.0 / (1.0 - 1.2 * (-1j) - 0.72)) < 1.0


def test_periods_that_there_are_not_are_refused():
    with pytest.raises(DataError, match="not periodic"):
        estimate_response(cut_record(1, samples=2048), method="periods")


@pytest.mark.parametrize("method", ["local polynomial", "local rational"])
def test_units_do_not_matter_and_nothing_overflows(method):
    record = cut_record(9, samples=1024, noise=0.01)
    found = estimate_response(record, method=method)
    for size in (1e-120, 1e120):
        other = Record(
            sample_hz=HZ,
            u=record.u,
            y=size * record.y,
            inputs=record.inputs,
            outputs=record.outputs,
            periodic=False,
        )
        scaled = estimate_response(other, method=method)
        # Rounding of the scaled samples, as far as the condition of a window carries it.
        np.testing.assert_allclose(scaled.H, size * found.H, rtol=1e-6)
        np.testing.assert_allclose(scaled.variance, size**2 * found.variance, rtol=1e-6)


@pytest.mark.parametrize("method", ["local polynomial", "local rational", "h1", "h2", "hv"])
def test_what_is_exact_stays_finite(method):
    """No noise, no dynamics: variances at rounding, nothing divided by them."""
    u = np.random.default_rng(10).standard_normal((1, 1, 64, 1))
    for y in (2.0 * u, u * 0.0 + np.arange(64.0)[:, None]):
        found = estimate_response(
            Record(
                sample_hz=1.0, u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y", "V"),), periodic=False
            ),
            method=method,
        )
        assert np.isfinite(found.H).all()
        assert np.isfinite(found.variance).all()
        assert np.isfinite(found.covariance.outputs).all()


def test_a_sum_over_lines_is_as_certain_as_its_data():
    """A gain from all lines, weighed as if independent, scatters by one over the sum of its weights."""
    gains, stated, pointwise = [], [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((2, 1, 256, 1))
        y = 2.0 * u + 0.5 * rng.standard_normal(u.shape)
        record = Record(
            sample_hz=1.0, u=u, y=y, inputs=(Port("u", ""),), outputs=(Port("y", ""),), periodic=False
        )
        found = response_scatter(record, method="local polynomial")
        variance, _ = trusted(found)
        gains.append(np.sum(found.H / variance) / np.sum(1.0 / variance))
        stated.append(1.0 / np.sum(1.0 / variance))
        pointwise.append(1.0 / np.sum(1.0 / found.total))
    squared = np.mean(np.abs(np.array(gains) - 2.0) ** 2)
    # 40 complex numbers: their mean square is known to 16 %; weights that follow the noise take some more.
    assert squared == pytest.approx(np.mean(stated), rel=0.5)
    # With the variances of the smoothed lines it would be taken for far more certain than it is.
    assert squared > 4.0 * np.mean(pointwise)


@pytest.mark.parametrize("method", ["local polynomial", "local rational"])
@pytest.mark.parametrize("band", [(0.0, 3.0), (5.0, 9.0), (40.0, 58.0)])
def test_a_stream_gives_what_memory_gives(method, band):
    record = cut_record(3, samples=3001, noise=0.01, outputs=2, inputs=2, experiments=2)
    held = response_scatter(record, method=method, band_hz=band)
    read = response_scatter(stream_record(record), method=method, band_hz=band)
    assert np.array_equal(read.frequency_hz, held.frequency_hz)
    # Rounding of the transforms, times the condition of a window (normal equations: some 1e6).
    np.testing.assert_allclose(read.H, held.H, rtol=1e-7, atol=1e-9 * np.abs(held.H).max())
    np.testing.assert_allclose(read.total, held.total, rtol=1e-6)


def test_periods_that_are_not_steady_are_streamed_too():
    rng = np.random.default_rng(9)
    u = np.tile(rng.standard_normal(256), 6)[None, None, :, None]
    y = lfilter([1.0], [1.0, -1.8, 0.9], u, axis=2)
    ports = gimbal_record.INPUTS[:1], gimbal_record.OUTPUTS[:1]
    record = Record(
        sample_hz=HZ,
        u=u.reshape(1, 6, 256, 1),
        y=y.reshape(1, 6, 256, 1),
        inputs=ports[0],
        outputs=ports[1],
        periodic=True,
    )
    held = response_scatter(record, method="local rational", band_hz=(20.0, 60.0))
    read = response_scatter(stream_record(record), method="local rational", band_hz=(20.0, 60.0))
    assert np.array_equal(read.frequency_hz, held.frequency_hz)
    np.testing.assert_allclose(read.H, held.H, rtol=1e-7)


def drawn_as_read(samples, blocks):
    """A stream of two million samples that are never all there."""

    def pieces(experiment, size):
        rng = np.random.default_rng(experiment)
        state = np.zeros(2)
        for start in range(0, samples, blocks):
            u = rng.standard_normal(min(blocks, samples - start))
            y, state = lfilter([1.0], [1.0, -1.8, 0.9], u, zi=state)
            yield u[:, None], y[:, None]

    return RecordStream(
        sample_hz=HZ,
        inputs=gimbal_record.INPUTS[:1],
        outputs=gimbal_record.OUTPUTS[:1],
        samples=samples,
        experiments=1,
        period=None,
        pieces=pieces,
    )


def test_a_record_longer_than_memory_takes_that_of_its_band():
    stream = drawn_as_read(1 << 20, 10_000)
    tracemalloc.start()
    found = estimate_response(stream, band_hz=(10.0, 10.25))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    q = np.exp(-2j * np.pi * found.frequency_hz / HZ)
    assert len(found.frequency_hz) == 1025
    # No noise; the transient of the filter is one of the models'.
    np.testing.assert_allclose(found.H[:, 0, 0], 1.0 / (1.0 - 1.8 * q + 0.9 * q**2), rtol=1e-6)
    # The record has 16 MB, its transform as much again.
    assert peak < 12e6
    with pytest.raises(DataError, match="lines of 2 channels") as caught:
        estimate_response(drawn_as_read(1 << 22, 10_000))
    assert "band_hz of at most" in caught.value.hint
    assert "h1" in caught.value.hint


@pytest.mark.parametrize(("forces", "sensors"), [(0.02, 0.0), (0.0, 0.5)])
def test_states_the_noise_of_a_peak_of_few_lines(forces, sensors):
    """Noise of forces peaks with a mode, that of sensors does not; input and forces are white, at one place.

    A line's variance over that of a white input is then forces^2 |H|^2 + sensors^2, by the closed form of H.
    """
    denominator = [1.0, -2.0 * 0.997 * np.cos(0.7), 0.997**2]  # a mode 2.9 lines wide at half power
    ratio, error = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        u, w, e = rng.standard_normal((3, 6000)) * np.array([[1.0], [forces], [sensors]])
        y = lfilter([1.0], denominator, u + w) + e
        ports = {"inputs": (Port("u", ""),), "outputs": (Port("y", ""),)}
        cut = {"u": u[None, None, 3000:, None], "y": y[None, None, 3000:, None]}
        found = estimate_response(Record(sample_hz=1.0, periodic=False, **cut, **ports), band_hz=(0.09, 0.13))
        H = 1.0 / np.polyval(denominator[::-1], np.exp(-2j * np.pi * found.frequency_hz))
        peak = np.abs(H) > np.abs(H).max() / np.sqrt(2.0)
        variance = found.variance[peak, 0, 0]
        ratio.append(variance / (forces**2 * np.abs(H[peak]) ** 2 + sensors**2))
        error.append(np.abs(found.H[peak, 0, 0] - H[peak]) ** 2 / variance)
    # Above one, as what the denominator's own error adds is counted; noise of the other kind is tenfold off.
    assert 0.5 < np.exp(np.mean(np.log(ratio))) < 4.0
    assert np.mean(error) < 1.0
