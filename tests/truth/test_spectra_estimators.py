"""H1, H2, Hv, coherences and their sums over blocks, against identities, closed forms and scipy.signal."""

import dataclasses

import numpy as np
import pytest
import scipy.signal
from scipy.signal import lfilter

from middeck.errors import ConfigError, DataError
from middeck.identification.spectra.averages import estimate_spectra, warnings_on_window
from middeck.identification.spectra.coherence import multiple_coherence, ordinary_coherence
from middeck.identification.spectra.estimate import estimate_response, response_scatter
from middeck.identification.spectra.h1_h2_hv import spectra_response
from middeck.signals.ports import Port
from middeck.signals.record import Campaign, Record, stream_record
from repeats import LONG, repeats

HZ = 64.0
MIX = np.array([[1.0, 0.4], [-0.3, 0.8], [0.6, -0.5]])


def ports(letter, count):
    return tuple(Port(f"{letter}{k}", "V") for k in range(count))


def record_of(u, y, *, periodic=False):
    """From [experiment, sample, channel] or, of a periodic one, [experiment, period, sample, channel]."""
    if u.ndim == 3:
        u, y = u[:, None], y[:, None]
    return Record(
        sample_hz=HZ,
        u=u,
        y=y,
        inputs=ports("u", u.shape[3]),
        outputs=ports("y", y.shape[3]),
        periodic=periodic,
    )


def filtered(rng, *, samples, inputs=2, outputs=3, output_noise=0.0, input_noise=0.0, experiments=1):
    """White inputs through a filter and a mixing matrix; noise white too, so that every bias is a number."""
    u = rng.standard_normal((experiments, samples, inputs))
    y = lfilter([1.0], [1.0, -0.5], u @ MIX[:outputs, :inputs].T, axis=1)
    y = y + output_noise * rng.standard_normal(y.shape)
    return record_of(u + input_noise * rng.standard_normal(u.shape), y)


def truth(frequency, outputs=3, inputs=2):
    q = np.exp(-2j * np.pi * frequency / HZ)
    return MIX[:outputs, :inputs] / (1.0 - 0.5 * q)[:, None, None]


def test_spectra_are_those_of_scipy():
    record = filtered(np.random.default_rng(0), samples=70_000, output_noise=0.3)  # several reads
    S = estimate_spectra(record, segment=256)
    settings = {"fs": HZ, "window": "hann", "nperseg": 256, "noverlap": 128, "return_onesided": False}
    for a, b, mine in (
        (record.u[0, 0, :, 0], record.y[0, 0, :, 2], S.S_yu[:, 2, 0]),
        (record.u[0, 0, :, 0], record.u[0, 0, :, 1], S.S_uu[:, 1, 0]),
        (record.y[0, 0, :, 1], record.y[0, 0, :, 1], S.S_yy[:, 1, 1]),
    ):
        f, theirs = scipy.signal.csd(a, b, **settings)
        np.testing.assert_allclose(S.frequency_hz[:-1], f[:128], rtol=1e-14)
        # Rounding of two FFTs.
        np.testing.assert_allclose(mine[:128], theirs[:128], rtol=1e-10, atol=1e-14)
    _, coherence = scipy.signal.coherence(
        record.u[0, 0, :, 0], record.y[0, 0, :, 2], HZ, "hann", nperseg=256, noverlap=128
    )
    np.testing.assert_allclose(ordinary_coherence(S)[:, 2, 0], coherence, rtol=1e-10)
    H1 = spectra_response(estimate_spectra(filtered(np.random.default_rng(0), samples=3000, inputs=1)))
    assert H1.H.shape == (len(H1.frequency_hz), 3, 1)


def test_the_sum_over_both_signs_is_the_variance():
    """Parseval: two-sided densities of unit^2/Hz (docs/conventions.md)."""
    record = record_of(*np.random.default_rng(1).standard_normal((2, 1, 4096, 1)), periodic=True)
    S = estimate_spectra(record)
    both = S.S_uu[0, 0, 0] + 2.0 * S.S_uu[1:-1, 0, 0].sum() + S.S_uu[-1, 0, 0]
    assert both.real * HZ / 4096 == pytest.approx(np.mean(record.u**2), rel=1e-12)


def test_blocks_give_what_memory_gives():
    rng = np.random.default_rng(2)
    record = filtered(rng, samples=5000, output_noise=0.1, experiments=2)
    stream = stream_record(record)
    # Read in pieces of a size of its own, the last short: the regrouping is the stream's.
    for method in ("h1", "h2", "hv"):
        held, read = (response_scatter(r, method=method, segment=500) for r in (record, stream))
        assert held == read
    u = np.repeat(rng.standard_normal((3, 1, 200, 2)), 4, axis=1)
    y = 2.0 * u + 1e-6 * rng.standard_normal(u.shape)
    periodic = record_of(u, y, periodic=True)
    held, read = response_scatter(periodic), response_scatter(stream_record(periodic))
    assert held == read
    # The noise is 120 dB down: two sums of squares would have lost it to rounding (1e-16 / 1e-12).
    E = np.fft.rfft(y - 2.0 * u, axis=2)[:, :, 1:-1]
    scatter = np.sum(np.abs(E - E.mean(axis=1, keepdims=True)) ** 2, axis=(0, 1)) / (3 * 3 * 4)
    mine = np.real(np.einsum("koo->ko", held.noise_covariance))
    np.testing.assert_allclose(mine, scatter, rtol=1e-3)


def test_whole_periods_read_in_blocks_need_the_memory_of_one():
    rng = np.random.default_rng(3)
    period = rng.standard_normal((256, 1))
    largest = []

    def pieces(experiment, size):
        for k in range(400):
            largest.append(size)
            noise = 0.1 * np.random.default_rng(k).standard_normal(period.shape)
            yield period, 3.0 * period + noise

    stream = stream_record(record_of(np.zeros((1, 1, 2, 1)), np.zeros((1, 1, 2, 1)), periodic=True))
    long = dataclasses.replace(stream, samples=400 * 256, experiments=1, period=256, pieces=pieces)
    found = estimate_response(long)
    assert set(largest) == {256}
    # Noise 0.1 over 400 periods and a white input: 0.005 on each line on average.
    assert np.sqrt(np.mean(np.abs(found.H - 3.0) ** 2)) == pytest.approx(
        np.sqrt(np.mean(found.variance)), rel=0.25
    )


def test_h1_states_its_variance_and_averages_are_counted_as_independent():
    stated, squared, power = [], [], []
    for seed in range(150):
        record = filtered(np.random.default_rng(seed), samples=2048, output_noise=1.0)
        S = estimate_spectra(record, segment=128)
        found = spectra_response(S)
        stated.append(found.total)
        squared.append(np.abs(found.H - truth(found.frequency_hz)) ** 2)
        power.append(S.S_uu[8:-8, 0, 0].real)
    # 150 draws of 63 lines, some 4000 of them independent: 4 %; leakage adds less than 1 %.
    assert np.mean(squared) == pytest.approx(np.mean(stated), rel=0.05)
    # The variance of a power spectrum is its square over the averages (Welch 1967): 150 x 49 lines.
    relative = np.mean(np.var(power, axis=0)) / np.mean(power) ** 2
    assert 1.0 / relative == pytest.approx(S.averages, rel=0.08)


@pytest.mark.parametrize(("output_noise", "input_noise"), [(1.0, 0.0), (0.0, 0.7), (0.5, 0.5)])
def test_where_noise_is_decides_what_is_biased(output_noise, input_noise):
    record = filtered(
        np.random.default_rng(4),
        samples=400_000,
        inputs=1,
        outputs=1,
        output_noise=output_noise,
        input_noise=input_noise,
    )
    S = estimate_spectra(record, segment=64)
    found = {r: spectra_response(S, r) for r in ("h1", "h2", "hv")}
    size = {r: np.abs(f.H[:, 0, 0]) for r, f in found.items()}
    # An inequality of Cauchy and Schwarz, and a geometric mean: to rounding.
    assert (size["h1"] <= size["hv"] * (1 + 1e-12)).all()
    assert (size["hv"] <= size["h2"] * (1 + 1e-12)).all()
    np.testing.assert_allclose(size["hv"] ** 2, size["h1"] * size["h2"], rtol=1e-9)
    np.testing.assert_allclose(size["h1"] / size["h2"], ordinary_coherence(S)[1:-1, 0, 0], rtol=1e-9)
    G = np.abs(truth(found["h1"].frequency_hz, 1, 1)[:, 0, 0])
    down, up = 1.0 / (1.0 + input_noise**2), 1.0 + output_noise**2 / G**2
    expected = {"h1": G * down, "h2": G * up, "hv": G * np.sqrt(down * up)}
    for ratio, f in found.items():
        # Four standard deviations of a line in 31; a segment of 64 smears 1/(1 - 0.5 q) by a fraction of 1 %.
        allowed = 4.0 * np.sqrt(f.total[:, 0, 0]) + 0.005 * G
        assert (np.abs(size[ratio] - expected[ratio]) < allowed).all()


@pytest.mark.parametrize(
    ("inputs", "outputs", "input_noise", "output_noise"),
    repeats([(2, 3, 0.3, 0.0), (2, 2, 0.3, 0.3), (1, 1, 0.3, 0.0), (1, 1, 0.3, 0.3)], 2),
)
def test_each_ratio_scatters_as_it_says(inputs, outputs, input_noise, output_noise):
    """About its own limit, with a tenth of the input's power noise: H2 said 9 % too little without its R."""
    rng = np.random.default_rng(15)
    draws, averages, samples = 300 if LONG else 150, 48, 64
    found = {r: ([], []) for r in ("h1", "h2", "hv")}
    for _ in range(draws):
        # Circular, so that whole periods of it have no leakage: every average is an independent draw.
        u = rng.standard_normal((1, averages, samples, inputs))
        y = u @ MIX[:outputs, :inputs].T + 0.5 * np.roll(u, 1, axis=2) @ MIX[:outputs, :inputs].T
        u = u + input_noise * rng.standard_normal(u.shape)
        y = y + output_noise * y.std(axis=(1, 2)) * rng.standard_normal(y.shape)
        S = estimate_spectra(record_of(u, y, periodic=True))
        for ratio, (estimates, stated) in found.items():
            estimate = spectra_response(S, ratio)
            estimates.append(estimate.H)
            stated.append(estimate.total)
    for estimates, stated in found.values():
        share = np.mean(np.mean(stated, axis=0) / np.var(estimates, axis=0, ddof=1))
        # 150 draws of 31 lines: 1.5 % by chance; terms of second order are 1/averages, 2 %.
        assert share == pytest.approx(1.0, abs=0.04)


def test_h2_and_hv_of_one_pair_have_the_variances_of_their_coherence():
    S = estimate_spectra(
        filtered(np.random.default_rng(16), samples=4096, inputs=1, outputs=1, input_noise=1.0)
    )
    g = ordinary_coherence(S)[1:-1, 0, 0]
    for ratio, variance in (("h1", (1 - g) / g), ("h2", (1 - g) / g), ("hv", (1 - g) * (1 + 1 / g) / 2)):
        found = spectra_response(S, ratio)
        size = np.abs(found.H[:, 0, 0]) ** 2
        # The delta method by hand, over the averages left: to rounding.
        np.testing.assert_allclose(
            found.total[:, 0, 0], size * variance / (S.averages - 1.0), rtol=1e-9, err_msg=ratio
        )


def test_h2_of_several_channels_has_no_bias_from_noisy_inputs():
    record = filtered(np.random.default_rng(5), samples=400_000, input_noise=0.7)
    S = estimate_spectra(record, segment=64)
    h1, h2 = spectra_response(S), spectra_response(S, "h2")
    G = truth(h2.frequency_hz)
    # Two inputs of 0.7 noise: the total, per entry, of four standard deviations.
    assert (np.abs(h2.H - G) < 4.0 * np.sqrt(h2.total) + 0.01).all()
    np.testing.assert_allclose(np.abs(h1.H / G).mean(axis=0), 1.0 / 1.49, rtol=0.02)
    with pytest.raises(ConfigError, match="as many outputs as inputs"):
        estimate_response(filtered(np.random.default_rng(5), samples=4096, outputs=1), method="h2")


def test_hv_is_right_where_noise_is_a_like_share_of_all_channels():
    """Total least squares of two inputs: noise of the same share of the power of every channel."""
    rng = np.random.default_rng(6)
    u = rng.standard_normal((1, 400_000, 2))
    y = u @ MIX[:1].T
    share = 0.3
    noisy = [x + share * x.std(axis=1, keepdims=True) * rng.standard_normal(x.shape) for x in (u, y)]
    S = estimate_spectra(record_of(*noisy), segment=64)
    hv, h1 = spectra_response(S, "hv"), spectra_response(S)
    np.testing.assert_allclose(hv.H.mean(axis=0)[0], MIX[0], rtol=0.01)
    np.testing.assert_allclose(h1.H.mean(axis=0)[0], MIX[0] / (1.0 + share**2), rtol=0.01)


def test_coherences_of_known_noise():
    """y = u1 + v, u2 = u1 + w: what each coherence must be."""
    rng = np.random.default_rng(7)
    u1, w, v = rng.standard_normal((3, 1, 300_000))
    u = np.stack([u1, u1 + 0.5 * w], axis=2)
    y = (u1 + 0.8 * v)[:, :, None]
    S = estimate_spectra(record_of(u, y), segment=64)
    # The noise of a coherence over some 9000 averages of 31 lines is below 0.1 %; its bias 1/9000.
    inner = slice(2, -2)
    assert ordinary_coherence(S)[inner, 0, 0].mean() == pytest.approx(1.0 / 1.64, rel=0.01)
    assert ordinary_coherence(S)[inner, 0, 1].mean() == pytest.approx(1.0 / (1.25 * 1.64), rel=0.01)
    assert multiple_coherence(S)[inner, 0].mean() == pytest.approx(1.0 / 1.64, rel=0.01)


def test_identities_of_coherence():
    record = filtered(np.random.default_rng(8), samples=4096, output_noise=0.5)
    S = estimate_spectra(record, segment=256)
    multiple, ordinary = multiple_coherence(S), ordinary_coherence(S)
    assert np.all(multiple >= ordinary.max(axis=2) * (1.0 - 1e-12))
    # What H1 leaves of the output is what no input explains.
    found = spectra_response(S)
    left = np.real(np.einsum("koo->ko", found.total_covariance)) * (1.0 - 2.0 / S.averages)
    whole = np.real(np.einsum("koo->ko", S.S_yy))[1:-1]
    np.testing.assert_allclose(left, whole * (1.0 - multiple[1:-1]), rtol=1e-8)
    one = estimate_spectra(filtered(np.random.default_rng(8), samples=4096, inputs=1, output_noise=0.5))
    np.testing.assert_allclose(multiple_coherence(one), ordinary_coherence(one)[:, :, 0], rtol=1e-12)


def test_a_window_as_wide_as_the_peak_is_reported():
    rng = np.random.default_rng(9)
    u = rng.standard_normal((1, 65536, 1))
    radius = np.exp(-0.01 * 2.0 * np.pi * 0.125)  # 1 % damping at an eighth of the sampling rate
    y = lfilter([1.0], [1.0, -2.0 * radius * np.cos(2.0 * np.pi * 0.125), radius**2], u, axis=1)
    record = record_of(u, y)
    short, long = (estimate_spectra(record, segment=n) for n in (512, 8192))
    (doubt,) = warnings_on_window(spectra_response(short), short)
    assert "8 Hz" in doubt
    assert "local model" in doubt
    assert warnings_on_window(spectra_response(long), long) == []


def test_too_few_averages_and_wrong_segments_are_refused():
    record = filtered(np.random.default_rng(10), samples=1000)
    with pytest.raises(DataError, match="explain everything"):
        multiple_coherence(estimate_spectra(record, segment=1000))
    with pytest.raises(DataError, match="cannot tell 2 inputs from noise"):
        estimate_response(record, method="h1", segment=1000)
    with pytest.raises(DataError, match="do not fit 1000 samples"):
        estimate_spectra(record, segment=1001)
    with pytest.raises(ConfigError, match="no method"):
        estimate_response(record, method="h3")
    copies = record_of(record.u[:, 0, :, [0, 0]].transpose(1, 2, 0), record.y[:, 0])
    for method in ("h1", "h2", "hv"):
        with pytest.raises(DataError, match="cannot be told apart"):
            estimate_response(copies, method=method)
    with pytest.raises(DataError, match="cannot be told apart"):
        multiple_coherence(estimate_spectra(copies))


def test_a_stream_is_checked_while_it_is_read():
    record = filtered(np.random.default_rng(11), samples=1000)
    y = record.y.copy()
    y[..., 1] = 0.25
    dead = Record(sample_hz=HZ, u=record.u, y=y, inputs=record.inputs, outputs=record.outputs, periodic=False)
    with pytest.raises(DataError, match=r"output y1: the channel is constant at 0\.25 V"):
        estimate_response(stream_record(dead), method="h1")
    y[0, 0, 700, 1] = np.nan
    broken = Record(
        sample_hz=HZ, u=record.u, y=y, inputs=record.inputs, outputs=record.outputs, periodic=False
    )
    with pytest.raises(DataError, match="not finite"):
        estimate_response(stream_record(broken), method="h1")
    with pytest.raises(DataError, match="not finite"):
        estimate_response(stream_record(broken), band_hz=(5.0, 9.0))


def correlated(rng, *, experiments, samples, periods=1, noise=0.1):
    """Two inputs, the second an echo of the first, to two outputs of like noise."""
    u = rng.standard_normal((experiments, 1, samples, 2))
    u[..., 1] += 1.5 * np.roll(u[..., 0], 1, axis=2)
    u = np.repeat(u, periods, axis=1)
    y = np.roll(u, 1, axis=2) @ MIX[:2].T
    v = noise * rng.standard_normal(y.shape) @ np.array([[1.0, 0.8], [0.0, 0.5]])
    v[..., 1] += 0.1 * np.roll(v[..., 0], 2, axis=2)
    # Errors in variables: the inputs of periodic records are measured, and noisy.
    m = 0.05 * rng.standard_normal(u.shape) if periods > 1 else 0.0
    return record_of(u + m, y + v, periodic=True) if periods > 1 else record_of(u[:, 0], (y + v)[:, 0])


@pytest.mark.parametrize(
    ("method", "shape", "draws"),
    [
        ("periods", {"experiments": 3, "samples": 64, "periods": 4}, 150),
        ("h1", {"experiments": 1, "samples": 4096, "noise": 1.0}, 60),  # noise far above the window's leakage
        ("local polynomial", {"experiments": 2, "samples": 2048}, 8),
    ],
)
def test_entries_err_together_as_stated(method, shape, draws):
    """E[dH_oi conj(dH_pj)] = C_op R_ij, phases and all, from the scatter of many estimates."""
    errors, stated, own = [], [], []
    for seed in range(draws):
        found = response_scatter(correlated(np.random.default_rng(seed), **shape), method=method, segment=64)
        dH = found.H - MIX[:2] * np.exp(-2j * np.pi * found.frequency_hz / HZ)[:, None, None]
        C = found.noise_covariance if method == "periods" else found.total_covariance
        # Lines apart in phase: the echo's exp(-j omega) would average out.
        turn = np.exp(-2j * np.pi * found.frequency_hz / HZ)
        errors.append(np.einsum("koi,kpj,k->oipj", dH, dH.conj(), turn) / len(dH))
        stated.append(np.einsum("kop,kij,k->oipj", C, found.inverse_power, turn) / len(dH))
        own.append(np.einsum("kop,kij->oipj", C, found.inverse_power).real / len(dH))
    errors, stated = np.mean(errors, axis=0), np.mean(stated, axis=0)
    scale = np.sqrt(np.einsum("oioi->oi", np.mean(own, axis=0)))
    allowed = scale[:, :, None, None] * scale[None, None]
    # A thousand independent lines and more: 3 % of the product of two deviations; the cross terms of the two
    # inputs turn by twice the phase of the echo if conjugated wrongly, which is most of them.
    assert (np.abs(errors - stated) < 0.15 * allowed).all()
    assert np.abs(stated[:, 0, :, 1] - stated[:, 1, :, 0]).max() > 0.3 * allowed.max()


def test_whole_periods_keep_their_variances_whatever_the_ratio():
    """Periods of one signal share its distortion: as averages they would be taken for independent."""
    rng = np.random.default_rng(12)
    u = np.repeat(rng.standard_normal((6, 1, 256, 2)), 3, axis=1)
    y = u @ MIX.T + 0.1 * (u @ MIX.T) ** 3 + 0.01 * rng.standard_normal((6, 3, 256, 3))
    record = record_of(u, y, periodic=True)
    periods, h1, h2 = (response_scatter(record, method=m) for m in ("periods", "h1", "h2"))
    np.testing.assert_array_equal(h1.total, periods.total)
    # Inputs without noise: H1 of periods is their average to rounding, and H2 takes distortion for input.
    np.testing.assert_allclose(h1.H, periods.H, rtol=1e-8, atol=1e-10)
    assert np.abs(h2.H - periods.H).max() > 0.01
    noisy = record_of(u + 1e-3 * rng.standard_normal(u.shape), y, periodic=True)
    lines = [
        response_scatter(noisy, method=m).frequency_hz for m in ("periods", "h1", "hv", "local polynomial")
    ]
    assert all(np.array_equal(found, lines[0]) for found in lines[1:])


def test_records_of_a_campaign_count_by_their_length():
    rng = np.random.default_rng(13)
    long, short = (filtered(rng, samples=n, output_noise=0.3) for n in (128 * 30, 128 * 10))
    S, a, b = (estimate_spectra(r, segment=128) for r in (Campaign((long, short)), long, short))
    assert S.averages == pytest.approx(a.averages + b.averages)
    np.testing.assert_allclose(S.S_yu, (59 * a.S_yu + 19 * b.S_yu) / 78, rtol=1e-12, atol=1e-15)
    whole = [record_of(*rng.standard_normal((2, 1, 2, n, 1)), periodic=True) for n in (64, 128)]
    with pytest.raises(DataError, match="other periods"):
        estimate_spectra(Campaign(tuple(whole)))
