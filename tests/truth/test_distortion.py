"""Distortion levels of a known polynomial, line by line, from one experiment and from many."""

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.errors import DataError
from middeck.identification.spectra.distortion import estimate_distortion
from middeck.identification.spectra.estimate import response_scatter
from middeck.signals.ports import Port
from middeck.signals.record import Record, stream_record

N = 2048
QUADRATIC, CUBIC = 0.05, 0.03
NOISE = 0.01


def odd_grid(rng, last=400):
    """Odd lines up to ``last``, one of every four left silent at random."""
    groups = np.arange(1, last, 2).reshape(-1, 4)
    silent = rng.integers(0, 4, len(groups))
    return np.sort(groups[np.arange(4) != silent[:, None]])


def multisines(rng, lines, experiments):
    U = np.zeros((experiments, N // 2 + 1), dtype=complex)
    U[:, lines] = np.exp(2j * np.pi * rng.random((experiments, len(lines))))
    u = np.fft.irfft(U, n=N, axis=1)
    return u / np.sqrt(np.mean(u**2, axis=1, keepdims=True))


def polynomial(u):
    return u + QUADRATIC * u**2 + CUBIC * u**3


def record_of(u, y, rng, *, periods=4, noise=NOISE):
    """Periods [experiment, sample] repeated, with noise on the outputs."""
    u, y = (np.repeat(x[:, None, :, None], periods, axis=1) for x in (u, y))
    y = y + noise * rng.standard_normal(y.shape)
    return Record(
        sample_hz=float(N), u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y", "V"),), periodic=True
    )


def two_sided(lines):
    """Power of each line from -N/2, of a unit multisine: 1/2F on each of 2F lines."""
    S = np.zeros(2 * N + 1)
    S[N + lines] = S[N - lines] = 0.5 / len(lines)
    return S


def expected_square(lines):
    """E|U^2|^2 line by line: of two lines a and b, 2 ab; of one twice, aa."""
    S = two_sided(lines)
    k = np.arange(2, N, 2)
    return 2.0 * np.convolve(S, S, "same")[N + k] - S[N + k // 2] ** 2


def expected_cube(lines, k):
    """E|U^3|^2 on odd lines k, of triples without a pair a, -a: those are response."""
    S = two_sided(lines)
    triples = 6.0 * np.convolve(np.convolve(S, S, "same"), S, "same")[N + k]
    own, power = S[N + k], np.sum(S**2) / 2.0
    paired = 6.0 * (6.0 * own * (power - own**2) + 3.0 * own**3)
    a = np.arange(-N // 3, N // 3)
    twice = np.zeros(len(k))
    for row, line in enumerate(k):
        b = line - 2 * a
        twice[row] = np.sum(
            (S[N + a] ** 2 * S[N + np.clip(b, -N, N)])[(b != a) & (b != -a) & (np.abs(b) < N)]
        )
    thrice = np.where(k % 3 == 0, S[N + k // 3] ** 3, 0.0)
    return triples - paired - 9.0 * twice - 5.0 * thrice


def test_one_experiment_shows_even_and_odd_distortion_and_noise():
    rng = np.random.default_rng(0)
    lines = odd_grid(rng)
    u = multisines(rng, lines, 6)
    found = estimate_distortion(record_of(u, polynomial(u), rng))
    np.testing.assert_array_equal(found.frequency_hz[found.kind == 1], lines)
    k = found.frequency_hz.astype(int)
    even, odd = k[found.kind == 2], k[found.kind == 3]
    # A density of lines on both sides: twice the power of the positive one.
    square = 2.0 * QUADRATIC**2 * expected_square(lines)[even // 2 - 1].mean()
    cube = 2.0 * CUBIC**2 * expected_cube(lines, odd).mean()
    # Powers of single lines are exponential: 200 even, 50 odd lines of six experiments scatter by 3 and 6 %.
    assert found.level(2)[0] == pytest.approx(square, rel=0.12)
    assert found.level(3)[0] == pytest.approx(cube, rel=0.24)
    # White noise of variance s^2 puts 2 s^2/N on each line of a period, a quarter of it on the mean of four.
    assert found.noise.mean() == pytest.approx(0.25 * 2.0 * NOISE**2 / N, rel=0.05)


def test_the_best_linear_gain_of_a_cube_is_three_variances():
    """On F lines 1 + 3 a (1 - 1/2F) for unit rms, exactly (Gaussian: F to infinity; Bussgang 1952)."""
    rng = np.random.default_rng(1)
    lines = odd_grid(rng)
    u = multisines(rng, lines, 40)
    found = response_scatter(record_of(u, polynomial(u), rng, periods=2))
    gain = found.H[:, 0, 0].mean()
    # 150 lines of 40 experiments, by the variance that the estimate itself states.
    deviation = np.sqrt(found.total.sum()) / len(found.H)
    assert abs(gain - (1.0 + 3.0 * CUBIC * (1.0 - 0.5 / len(lines)))) < 4.0 * deviation
    assert deviation < 2e-3


def test_many_realisations_show_the_same_distortion_below_the_response():
    rng = np.random.default_rng(2)
    lines = odd_grid(rng)
    u = multisines(rng, lines, 30)
    robust = response_scatter(record_of(u, polynomial(u), rng, periods=2))
    # Variance of H times |U|^2 and the number of experiments is the power of one experiment's line.
    U2 = N**2 / 2.0 / len(lines)
    one = 30 * robust.distortion[:, 0, 0] * U2 * 2.0 / N**2
    expected = 2.0 * CUBIC**2 * expected_cube(lines, lines)
    # Variances of 29 degrees of freedom on 150 lines: 1.5 %.
    assert one.mean() == pytest.approx(expected.mean(), rel=0.07)
    assert robust.noise.mean() * 30 * U2 * 2.0 / N**2 == pytest.approx(0.5 * 2.0 * NOISE**2 / N, rel=0.05)


def test_silent_lines_give_one_experiment_its_total_variance():
    rng = np.random.default_rng(3)
    lines = odd_grid(rng)
    ratios = []
    for u in multisines(rng, lines, 40):
        found = response_scatter(record_of(u[None], polynomial(u)[None], rng))
        assert found.total_dof[0] == 8
        truth = 1.0 + 3.0 * CUBIC * (1.0 - 0.5 / len(lines))
        ratios.append([np.mean(np.abs(found.H - truth) ** 2), found.total.mean(), found.noise.mean()])
    squared, total, noise = np.mean(ratios, axis=0)
    # 150 lines of 40 experiments, 50 of them silent: 3 %; and distortion is no larger on a silent line than
    # on an excited one but for 1/F.
    assert squared == pytest.approx(total, rel=0.1)
    # What periods alone say is forty times too sure of itself here.
    assert total > 20.0 * noise


def test_an_actuator_that_distorts_is_not_the_article():
    """The input is measured: what it has on silent lines is answered by the linear article."""
    rng = np.random.default_rng(4)
    u = multisines(rng, odd_grid(rng), 1)
    u = u + 0.05 * u**2 + 0.02 * u**3
    two = np.tile(u, 2)
    y = lfilter([1.0], [1.0, -0.6], two, axis=1)[:, N:]  # settled: 0.6^2048
    found = estimate_distortion(record_of(u, y, rng, noise=1e-9))
    # The response is drawn straight between excited lines two or four apart: its curvature times their
    # distance squared is below 1e-3 here, and the actuator's distortion lies 25 dB below the response.
    assert (found.level(3) < 1e-6 * found.level(1)).all()
    assert (found.level(2) < 1e-6 * found.level(1)).all()
    blind = estimate_distortion(
        record_of(multisines(np.random.default_rng(4), odd_grid(np.random.default_rng(4)), 1), y, rng)
    )
    assert (blind.level(2) > 1e-4 * blind.level(1)).all()


def test_a_stream_shows_the_same():
    rng = np.random.default_rng(5)
    u = multisines(rng, odd_grid(rng), 2)
    record = record_of(u, polynomial(u), rng)
    assert estimate_distortion(record) == estimate_distortion(stream_record(record))


def test_records_without_silent_lines_get_a_hint():
    rng = np.random.default_rng(6)
    u = multisines(rng, np.arange(1, 400), 2)
    full = record_of(u, polynomial(u), rng)
    with pytest.raises(DataError, match="even lines are excited"):
        estimate_distortion(full)
    with pytest.raises(DataError, match="periodic records only"):
        estimate_distortion(
            Record(
                sample_hz=1.0,
                u=full.u[:, :1],
                y=full.y[:, :1],
                inputs=full.inputs,
                outputs=full.outputs,
                periodic=False,
            )
        )
    u = multisines(rng, np.arange(1, 400, 2), 2)
    found = estimate_distortion(record_of(u, polynomial(u), rng))
    with pytest.raises(DataError, match="no silent odd line"):
        found.level(3)
    # All odd lines excited, and one experiment: nothing tells the distortion below them.
    one = response_scatter(record_of(u[:1], polynomial(u)[:1], rng))
    assert one.total is None
    assert one.distortion is None
