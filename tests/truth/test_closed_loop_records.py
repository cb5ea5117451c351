"""An unstable plant held by feedback: directly one finds 1/K, by the reference the plant."""

import contextlib

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.errors import ConfigError, DataError
from middeck.identification.spectra.estimate import estimate_response, response_scatter
from middeck.signals.ports import Port
from middeck.signals.record import Record, stream_record
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from repeats import LONG

# y = b/a u + v with poles at 1.2 exp(+-0.8j), outside the circle; u = r + K y (docs/conventions.md).
B = np.array([0.0, 0.5])
A = np.array([1.0, -2.0 * 1.2 * np.cos(0.8), 1.2**2])
K = np.array([-2.35, 1.9])
CONTROLLER = SampledStateSpace(
    np.zeros((1, 1)), np.ones((1, 1)), np.full((1, 1), K[1]), np.full((1, 1), K[0]), period_s=1.0
)
NOISE = 0.3
SEEDS = 15
NAMES = Port("r", "N"), Port("u", "N"), Port("y", "m")


def response(polynomial, frequency):
    return np.polyval(polynomial[::-1], np.exp(-2j * np.pi * frequency))


def plant(frequency):
    return response(B, frequency) / response(A, frequency)


def loop(r, v):
    """u and y, from (A - B K) y = B r + A v and u = r + K y."""
    closed = np.pad(A, (0, 1)) - np.pad(np.convolve(B, K), (0, 4 - len(np.convolve(B, K))))
    y = lfilter(B, closed, r, axis=-1) + lfilter(A, closed, v, axis=-1)
    return r + lfilter(K, [1.0], y, axis=-1), y


def cut(seed, *, samples=4096, noise=NOISE, experiments=1):
    """r, u and y [experiment, period, sample, channel], cut from a longer run."""
    rng = np.random.default_rng(seed)
    r, v = rng.standard_normal((2, experiments, samples + 512))
    u, y = loop(r, noise * v)
    return tuple(x[:, None, 512:, None] for x in (r, u, y))


def named(r, u, y, *, periodic=False):
    return Record(
        sample_hz=1.0,
        u=np.concatenate([r, u], axis=3),
        y=y,
        inputs=NAMES[:2],
        outputs=NAMES[2:],
        periodic=periodic,
    )


def bare(u, y, *, periodic=False):
    return Record(sample_hz=1.0, u=u, y=y, inputs=NAMES[1:2], outputs=NAMES[2:], periodic=periodic)


def test_the_direct_estimate_is_where_theory_has_it():
    """(G S_rr + conj(K) S_vv) / (S_rr + |K|^2 S_vv): between the plant and 1/K."""
    for noise in (NOISE, 10.0):
        _, u, y = cut(0, samples=400_000 if LONG else 100_000, noise=noise)
        caught = pytest.warns(UserWarning, match="feedback") if noise == NOISE else contextlib.nullcontext()
        with caught:
            found = estimate_response(bare(u, y), method="h1", segment=1024, band_hz=(0.01, 0.4))
        G, k = plant(found.frequency_hz), response(K, found.frequency_hz)
        biased = (G + k.conj() * noise**2) / (1.0 + np.abs(k) ** 2 * noise**2)
        # Four standard deviations, and half a per cent for a notch of five samples seen through 1024.
        allowed = 4.0 * np.sqrt(found.variance[:, 0, 0]) + 0.005 * np.abs(biased)
        assert (np.abs(found.H[:, 0, 0] - biased) < allowed).all()
    # A hundred times more noise than reference: the controller's inverse, to |K|^-2 / 100.
    assert np.abs(found.H[:, 0, 0] - 1.0 / k).mean() < 0.02 * np.abs(1.0 / k).mean()


GIVEN = {
    "name": lambda r, u, y: (named(r, u, y), {"reference": ("r",)}),
    "samples": lambda r, u, y: (bare(u, y), {"reference": r}),
    "controller": lambda r, u, y: (bare(u, y), {"controller": CONTROLLER}),
}


@pytest.mark.parametrize(
    ("given", "method"), [("name", "local polynomial"), ("samples", "local rational"), ("controller", "h1")]
)
def test_with_the_reference_or_the_controller_there_is_no_bias(given, method):
    errors, stated = [], []
    for seed in range(SEEDS):
        record, how = GIVEN[given](*cut(seed, samples=2048))
        found = response_scatter(record, method=method, band_hz=(0.02, 0.4), segment=256, **how)
        errors.append(found.H[:, 0, 0] - plant(found.frequency_hz))
        stated.append(found.total[:, 0, 0])
    G, k = plant(found.frequency_hz), response(K, found.frequency_hz)
    variance = np.mean(stated, axis=0)
    of_mean = np.abs(np.mean(errors, axis=0)) ** 2 * SEEDS / variance
    direct = np.abs(k.conj() * (1.0 - G * k) * NOISE**2 / (1.0 + np.abs(k) ** 2 * NOISE**2)) ** 2
    # A mean of unbiased estimates scatters by variance / SEEDS: |z|^2 is one, known to a fifth from the some
    # thirty independent windows of the band.
    assert np.mean(of_mean) < 1.6
    assert np.mean(direct * SEEDS / variance) > 10.0  # what the direct estimate's bias would make of it
    # And each estimate scatters as it says: half of the |z|^2 of complex noise are below ln 2. A ratio's mean
    # square would not do, its tails are long where u is small. 400 windows in all: 2.5 %; four of them.
    below = np.mean(np.abs(errors) ** 2 < np.log(2.0) * np.array(stated))
    assert below == pytest.approx(0.5, abs=0.1)


def test_all_three_say_the_same():
    r, u, y = cut(1, samples=2048)
    given = {name: give(r, u, y) for name, give in GIVEN.items()}
    found = {n: estimate_response(record, band_hz=(0.02, 0.4), **how) for n, (record, how) in given.items()}
    assert found["name"] == found["samples"]
    assert [p.name for p in (*found["name"].inputs, *found["name"].outputs)] == ["u", "y"]
    # K y of a cut record differs from what K did by the end of its own state: a transient like any other.
    difference = np.abs(found["controller"].H - found["name"].H) ** 2
    assert np.median(difference / found["name"].variance) < 0.05


def test_periods_in_closed_loop():
    """Averages over periods of the reference are the joint estimate already, name or no name."""
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(20):
        lines = np.exp(2j * np.pi * rng.random(1025)) * (np.arange(1025) > 0)
        period = np.fft.irfft(lines, n=2048) * 32.0
        r = np.tile(period, (1, 10))
        u, y = loop(r, 0.02 * rng.standard_normal(r.shape))
        r, u, y = (x[:, 4096:].reshape(1, 8, 2048, 1) for x in (r, u, y))
        by_name = response_scatter(named(r, u, y, periodic=True), reference=("r",))
        without = response_scatter(bare(u, y, periodic=True))
        # One experiment and one input: Y R^-1 (U R^-1)^-1 is Y U^-1.
        np.testing.assert_allclose(by_name.H, without.H, rtol=1e-9)
        np.testing.assert_allclose(by_name.noise, without.noise, rtol=1e-6)
        error = np.abs(by_name.H[:, 0, 0] - plant(by_name.frequency_hz)) ** 2
        ratios.append([error.sum(), by_name.noise.sum()])
    squared, stated = np.sum(ratios, axis=0)
    # 20 draws of 1023 lines, most of the sum from the tenth near resonance: 3 %. What the loop, driven by
    # noise, carries from one period into the next adds to their scatter, hardly to their mean: 10/2048 of it.
    assert squared == pytest.approx(stated, rel=0.1)


def test_two_inputs_and_two_references():
    rng = np.random.default_rng(2)
    mix = np.array([[1.0, 0.5], [-0.4, 0.8]])
    r = rng.standard_normal((2, 8192))
    v = 0.3 * rng.standard_normal((2, 8192))
    # y = mix z^-1 u + v, u = r + 0.3 y turned by a delay: sample by sample.
    u, y = np.zeros_like(r), np.zeros_like(r)
    for k in range(r.shape[1]):
        y[:, k] = (mix @ u[:, k - 1] if k else 0.0) + v[:, k]
        u[:, k] = r[:, k] - 0.4 * y[:, k]
    ports = tuple(Port(n, "V") for n in ("r1", "r2", "u1", "u2")), (Port("y1", "V"), Port("y2", "V"))
    record = Record(
        sample_hz=1.0,
        u=np.concatenate([r, u]).T[None, None],
        y=y.T[None, None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )
    found = response_scatter(record, reference=("r1", "r2"), band_hz=(0.05, 0.45))
    truth = mix * np.exp(-2j * np.pi * found.frequency_hz)[:, None, None]
    z2 = np.abs(found.H - truth) ** 2 / found.total
    # Some forty independent windows of four entries; choosing windows flatters by a tenth.
    assert np.mean(z2) == pytest.approx(1.1, rel=0.3)
    K = gain_system(-0.4 * np.eye(2))
    plain = Record(
        sample_hz=1.0, u=record.u[..., 2:], y=record.y, inputs=ports[0][2:], outputs=ports[1], periodic=False
    )
    by_controller = estimate_response(plain, controller=K, band_hz=(0.05, 0.45))
    np.testing.assert_allclose(by_controller.H, found.H, rtol=1e-6, atol=1e-9)


def test_a_stream_takes_its_reference_by_name():
    record = named(*cut(3, experiments=2))
    how = {"method": "h1", "segment": 256, "reference": ("r",)}
    assert response_scatter(record, **how) == response_scatter(stream_record(record), **how)
    with pytest.raises(ConfigError, match="by name only"):
        estimate_response(stream_record(record), method="h1", controller=CONTROLLER)


def test_what_cannot_be_determined_is_refused():
    r, u, y = cut(4)
    record = bare(u, y)
    with pytest.raises(ConfigError, match="both given"):
        estimate_response(record, reference=r, controller=CONTROLLER)
    with pytest.raises(DataError, match="the reference has"):
        estimate_response(record, reference=r[:, :, 1:])
    with pytest.raises(DataError, match="the reference has the shape"):
        estimate_response(record, reference=r[0])
    twins = Record(
        sample_hz=1.0,
        u=u,
        y=np.concatenate([y, u], axis=3),
        inputs=NAMES[1:2],
        outputs=(NAMES[2], NAMES[1]),
        periodic=False,
    )
    with pytest.raises(ConfigError, match="u is an input and an output"):
        estimate_response(twins, reference=("u",))
    with pytest.raises(ConfigError, match="no channel named 'nobody'"):
        estimate_response(record, reference=("nobody",))
    with pytest.raises(ConfigError, match="leave no input"):
        estimate_response(record, reference=("u",))
    with pytest.raises(ConfigError, match="1 inputs and 2 outputs"):
        estimate_response(record, controller=gain_system(np.ones((2, 1))))
    slow = SampledStateSpace(CONTROLLER.A, CONTROLLER.B, CONTROLLER.C, CONTROLLER.D, period_s=2.0)
    with pytest.raises(ConfigError, match="sampled every 2 s"):
        estimate_response(record, controller=slow)
    feedback = bare(
        *(x[:, None, :, None] for x in _held(np.random.default_rng(0).standard_normal((1, 4096))))
    )
    with pytest.raises(DataError, match="all feedback"):
        estimate_response(feedback, controller=CONTROLLER)


def _held(v):
    """The loop without a reference, over a period of its own so that K y is exact."""
    frequency = np.fft.rfftfreq(v.shape[1])
    G, k = plant(frequency), response(K, frequency)
    Y = np.fft.rfft(v) / (1.0 - G * k)
    return np.fft.irfft(k * Y), np.fft.irfft(Y)


def test_an_integrator_in_the_controller_is_no_obstacle():
    """It is infinite at zero, where no response is estimated."""
    rng = np.random.default_rng(5)
    y, r = rng.standard_normal((2, 4, 1, 128, 1))
    integrator = StateSpace(np.zeros((1, 1)), np.ones((1, 1)), -np.ones((1, 1)), np.zeros((1, 1)))
    found = estimate_response(
        Record(sample_hz=1.0, u=r, y=y + r, inputs=NAMES[1:2], outputs=NAMES[2:], periodic=False),
        controller=integrator,
        method="h1",
        segment=32,
    )
    assert np.isfinite(found.H).all()
