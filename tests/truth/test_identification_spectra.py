import gimbal_record
import numpy as np
import pytest

from middeck import estimate_response
from middeck.identification import response_scatter
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats


def test_recovers_the_closed_form_without_noise():
    record = gimbal_record.multisine(1, outputs=3, inputs=2, noise=0.0)
    found = estimate_response(record)
    truth = gimbal_record.response(found.frequency_hz, 3, 2)
    # Rounding of an FFT of 16384 samples, relative to the largest response.
    assert np.abs(found.H - truth).max() < 1e-11 * np.abs(truth).max()
    assert found.frequency_hz[0] == pytest.approx(7 / 64)  # the first line at 0.1 Hz or above
    assert found.frequency_hz[-1] == 60.0


def test_band_keeps_its_edges():
    found = estimate_response(gimbal_record.multisine(1), band_hz=(1.0, 2.0))
    assert (found.frequency_hz[0], found.frequency_hz[-1], len(found.frequency_hz)) == (1.0, 2.0, 65)


@pytest.mark.parametrize("inputs", repeats([2, 1]))
def test_noise_variance_is_the_scatter_of_the_estimate(inputs):
    draws = [
        response_scatter(gimbal_record.multisine(s, outputs=2, inputs=inputs, samples=512))
        for s in range(200)
    ]
    truth = gimbal_record.response(draws[0].frequency_hz, 2, inputs)
    squared = np.mean([np.abs(d.H - truth) ** 2 for d in draws], axis=(0, 1))
    stated = np.mean([d.noise for d in draws], axis=(0, 1))
    # 200 draws of some 119 lines: one standard deviation of the ratio is below 1 %; four are allowed.
    np.testing.assert_allclose(squared, stated, rtol=0.04)


def test_noise_variance_has_the_units_of_parseval():
    """White noise of variance s2 on N samples has line power N s2; the response has s2 N / (P |U|^2)."""
    rng = np.random.default_rng(3)
    N, P, s = 4096, 8, 0.1
    u = np.repeat(rng.standard_normal((1, 1, N, 1)), P, axis=1)
    y = u + s * rng.standard_normal(u.shape)
    found = response_scatter(
        Record(sample_hz=1.0, u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y", "V"),), periodic=True)
    )
    U2 = np.abs(np.fft.rfft(u[0, 0, :, 0]))[1:-1] ** 2
    ratio = found.noise[:, 0, 0] * P * U2 / (N * s**2)
    # chi-square with 14 degrees of freedom over 2047 lines: its mean scatters by sqrt(2/14/2047) = 0.8 %.
    assert ratio.mean() == pytest.approx(1.0, abs=0.035)


def test_total_variance_sees_the_distortion_that_the_noise_variance_does_not():
    rng = np.random.default_rng(5)
    N = 1024
    f = np.arange(N // 2 + 1)
    on = (f > 0) & (f < 300)
    U = np.where(on, np.exp(2j * np.pi * rng.random((24, N // 2 + 1))), 0.0)
    u = np.fft.irfft(U, n=N, axis=1)
    u = np.repeat((u / u.std())[:, None, :, None], 2, axis=1)
    y = u + 0.1 * u**3
    found = response_scatter(
        Record(sample_hz=1.0, u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y", "V"),), periodic=True)
    )
    # The cube of a Gaussian signal acts as a gain of 3 (Bussgang 1952): 1 + 0.1 * 3. A multisine is Gaussian
    # up to 1/lines, and the 24 experiments average the rest.
    mean = found.H[:, 0, 0].mean()
    deviation = np.sqrt(found.total.sum()) / len(found.H)
    assert abs(mean - 1.3) < 4.0 * deviation + 1.0 / 299
    assert found.noise.mean() < 1e-20
    # What is left of 0.1 u^3 beyond 0.3 u: variance 0.01 (15 - 9) = 0.06, spread to three times the band.
    spread = found.total[:, 0, 0].mean() * 24
    assert 0.06 / 3 < spread < 0.06


def test_measured_noisy_inputs_do_not_add_lines():
    record = gimbal_record.multisine(2, hz=(1.0, 20.0))
    noisy = record.u + 1e-3 * np.random.default_rng(0).standard_normal(record.u.shape)
    found = estimate_response(
        Record(
            sample_hz=256.0, u=noisy, y=record.y, inputs=record.inputs, outputs=record.outputs, periodic=True
        )
    )
    outside = (found.frequency_hz < 1.0 - 1e-9) | (found.frequency_hz > 20.0 + 1e-9)
    # A line of noise passes the test of one in a hundred with 4 degrees of freedom: below 0.1 % of them.
    assert outside.sum() <= 8
    assert (~outside).sum() == 19 * 64 + 1


def squares_over_stated(noise: tuple[float, float, float]) -> float:
    """Mean of |H - truth|^2 over the stated variance, of two inputs in three experiments so noisy.

    The third has the first's drive at a third.
    """
    rng = np.random.default_rng(7)
    periods, samples = 4, 2048
    # Lines of equal power.
    phases = np.exp(2j * np.pi * rng.random((2, samples // 2 + 1)))
    one = np.sqrt(samples) * np.fft.irfft(phases, n=samples, axis=1)
    u = np.stack([one, one * [[1.0], [-1.0]], one / 3.0], axis=0)
    u = np.repeat(np.moveaxis(u, 1, 2)[:, None], periods, axis=1)
    y = u @ np.array([1.0, 2.0]) + np.array(noise)[:, None, None] * rng.standard_normal(u.shape[:3])
    ports = Port("a", "V"), Port("b", "V")
    found = estimate_response(
        Record(sample_hz=1.0, u=u, y=y[..., None], inputs=ports, outputs=(Port("y", "V"),), periodic=True)
    )
    assert found.variance is not None
    H, variance = found.H[1:-1, 0], found.variance[1:-1, 0]
    # By means over lines: the variance of one line has a single degree of freedom.
    return float(np.mean(np.abs(H - [1.0, 2.0]) ** 2) / np.mean(variance))


def test_experiments_of_unlike_noise_state_all_of_it():
    """What three experiments of two inputs differ by is mostly in the third, here the quietest."""
    assert 0.5 < squares_over_stated((0.1, 0.1, 0.003)) < 2.0
    # Of 1000 lines with one degree of freedom, the ratio of like experiments scatters by some 5 %.
    assert squares_over_stated((0.1, 0.1, 0.1)) == pytest.approx(1.0, abs=0.2)
