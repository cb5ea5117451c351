"""Delays made common by a fit's covariance: closed forms, the test's level, and the fit of one delay."""

import dataclasses

import numpy as np
import pytest
import scipy.stats

from middeck.errors import ConfigError
from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.merged_delays import merge_delays
from middeck.identification.uncertainty.covariance import ModelCovariance, as_exact
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of, unknowns_of
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.response import FrequencyResponse

pytestmark = pytest.mark.kernels

LINES = 0.9 + 0.02 * np.arange(60)
PORTS = (Port("torque", "N m"),), tuple(Port(f"angle_{o}", "rad") for o in range(3))
SHAPES = np.array([[1.0, 0.8], [0.7, -0.9], [0.5, 0.6]])
# Weak enough to be seen in the delays, small enough for a linear covariance: 0.2 % of the resonances.
NOISE = 2e-3


def measure(seed, delay_s):
    """Two modes of 1 %, three outputs, noise of known variance."""
    rng = np.random.default_rng((8, seed))
    s, w = 2j * np.pi * LINES, 2.0 * np.pi * np.array([1.2, 1.7])
    modes = 1.0 / (s[:, None] ** 2 + 0.02 * w * s[:, None] + w**2)
    H = np.exp(-s[:, None] * np.asarray(delay_s)) * (modes @ SHAPES.T)
    H = H + NOISE * np.sqrt(0.5) * (rng.standard_normal((60, 3)) + 1j * rng.standard_normal((60, 3)))
    return FrequencyResponse(
        frequency_hz=LINES,
        H=H[:, :, None],
        inputs=PORTS[0],
        outputs=PORTS[1],
        variance=np.full((60, 3, 1), NOISE**2),
    )


def covariance_of(delay_s, deviation_s, *, path_delay_s=None, degrees=np.inf):
    """A model of one mode whose delays are known independently of each other and of all else."""
    outputs, inputs = len(delay_s), 1 if path_delay_s is None else len(path_delay_s[0])
    zero = np.zeros((outputs, inputs))
    model = MeasurementModel(
        poles=np.array([-0.1 + 9j]),
        shapes=np.ones((outputs, 1)),
        participation=np.ones((1, inputs)),
        direct=zero,
        lower=zero,
        delay_s=delay_s,
        inputs=tuple(Port(f"u{i}", "N") for i in range(inputs)),
        outputs=tuple(Port(f"y{o}", "m") for o in range(outputs)),
        path_delay_s=path_delay_s,
    )
    structure = ModelStructure(real_constants=False, with_delay=True, with_lower=False, with_direct=False)
    at = places_of(model, structure)
    variance = np.full(at.size, 1e-6)
    variance[at.delay] = np.square(deviation_s)
    variance[at.path[at.path >= 0]] = 1e-10
    return ModelCovariance(
        model=model,
        structure=structure,
        root=np.diag(np.sqrt(variance)),
        inflation=np.ones(at.size),
        degrees=degrees,
        robust=False,
    )


def test_independent_delays_get_their_weighted_mean():
    d, sigma = np.array([8.00, 8.01, 7.98]) * 1e-3, np.array([1e-5, 2e-5, 2e-5])
    found = merge_delays(covariance_of(d, sigma))
    mean = np.sum(d / sigma**2) / np.sum(1.0 / sigma**2)
    np.testing.assert_allclose(found.model.delay_s, mean, rtol=1e-12)  # rounding
    # Two differences, independent of the mean: chi-square of two degrees.
    assert found.p == pytest.approx(np.exp(-0.5 * np.sum(((d - mean) / sigma) ** 2)), rel=1e-9)
    assert found.sentences[0].startswith("delays not told apart by their deviations are taken as one of 7.99")
    assert "y0 8, y1 8.01, y2 7.98 ms" in found.sentences[0]
    assert len(approximate_delays(measured_plant(found.model), 3).system.A) == 2 + 3
    # All else is independent of the delays and stays.
    exact = dataclasses.replace(found.model, delay_s=d)
    assert np.array_equal(exact.direct, covariance_of(d, sigma).model.direct)
    np.testing.assert_allclose(exact.poles, [-0.1 + 9j], rtol=1e-12)


def test_few_degrees_of_freedom_tell_less_apart():
    # A difference of 3 deviations: 0.27 % by the normal law, 3.0 % by t of 5 degrees.
    d, sigma = np.array([8.0e-3, 8.0e-3 + 3.0e-5 * np.sqrt(2.0)]), np.full(2, 1e-5)
    assert merge_delays(covariance_of(d, sigma)).sentences == ()
    slow = merge_delays(covariance_of(d, sigma, degrees=5.0))
    assert slow.p == pytest.approx(2.0 * scipy.stats.t.sf(3.0, 5.0), rel=1e-9)
    assert len(slow.sentences) == 1


def test_only_those_that_are_alike_are_made_one():
    d = np.array([12.00, 8.00, 12.01, 8.01, 20.00]) * 1e-3
    found = merge_delays(covariance_of(d, np.full(5, 1e-5)))
    np.testing.assert_allclose(found.model.delay_s, [12.005e-3, 8.005e-3, 12.005e-3, 8.005e-3, 20e-3])
    assert len(found.sentences) == 2
    assert "y1 8, y3 8.01" in found.sentences[0]
    assert "y0 12, y2 12.01" in found.sentences[1]


def test_delays_of_paths():
    delay = np.array([[0.0, 1e-6], [2e-6, 0.0]])
    one = merge_delays(covariance_of([8e-3, 8e-3], [1e-5, 1e-5], path_delay_s=delay))
    assert one.model.path_delay_s is None
    assert np.ptp(one.model.delay_s) == 0.0
    delay = np.array([[0.0, 4e-3], [4e-3 + 1e-6, 0.0]])
    two = merge_delays(covariance_of([8e-3, 8e-3], [1e-5, 1e-5], path_delay_s=delay))
    delay_s = path_delay(two.model)
    assert delay_s[0, 0] == delay_s[1, 1]
    # The same number twice, once through a difference: rounding.
    assert delay_s[0, 1] == pytest.approx(delay_s[1, 0], rel=1e-12)
    assert delay_s[0, 1] - delay_s[0, 0] == pytest.approx(4e-3, abs=2e-6)
    assert any("u0 to y0" in sentence for sentence in two.sentences)


def test_nothing_to_merge_leaves_the_model_as_it_is():
    far = covariance_of(np.array([8e-3, 9e-3]), np.full(2, 1e-5))
    structure = dataclasses.replace(far.structure, common_delay=True)
    size = places_of(far.model, structure).size
    common = ModelCovariance(
        model=far.model,
        structure=structure,
        root=1e-3 * np.eye(size),
        inflation=np.ones(size),
        degrees=np.inf,
        robust=False,
    )
    for covariance in (far, common, as_exact(far.model), covariance_of([8e-3], [1e-5])):
        found = merge_delays(covariance)
        assert found.model is covariance.model
        assert (found.sentences, found.p) == ((), 1.0)
    with pytest.raises(ConfigError, match="no probability"):
        merge_delays(far, level=0.0)


def test_a_decay_that_is_not_known_is_not_moved_out_of_bounds():
    covariance = covariance_of(np.array([8e-3, 8.02e-3]), np.full(2, 1e-5))
    at = places_of(covariance.model, covariance.structure)
    root = covariance.deviation()
    root[at.sigma[0]] = 4.0  # of its logarithm, and tied to the first delay
    correlation = np.eye(at.size)
    correlation[at.sigma[0], at.delay[0]] = correlation[at.delay[0], at.sigma[0]] = 0.99
    known = dataclasses.replace(covariance, root=root[:, None] * np.linalg.cholesky(correlation))
    assert merge_delays(known).model is known.model


def test_the_merged_fit_is_the_fit_of_one_delay_and_the_level_is_kept(campaign):
    p, kept_apart = [], 0
    seeds = campaign(400)
    for k, seed in enumerate(seeds):
        measured = measure(seed, [8e-3] * 3)
        fit = fit_response(measured, states=4)
        found = merge_delays(fit.covariance, level=1e-9)
        p.append(found.p)
        kept_apart += len(set(merge_delays(fit.covariance, level=0.05).model.delay_s)) > 1
        if k < 2:
            common = fit_response(measured, states=4, delay="common")
            deviation = common.covariance.deviation()
            x, merged = (unknowns_of(m, common.covariance.structure) for m in (common.model, found.model))
            # The fit's curvature beyond the linear: its square over the signal, a hundredth of a deviation.
            assert np.all(np.abs(x - merged) < 0.02 * deviation)
            assert parameters_of(common.covariance).values[-1] == pytest.approx(
                found.model.delay_s[0], abs=0.02 * parameters_of(common.covariance).deviation[-1]
            )
    assert scipy.stats.kstest(p, "uniform").pvalue > 1e-3
    assert scipy.stats.binomtest(kept_apart, len(seeds), 0.05).pvalue > 1e-3


def test_an_output_that_is_delayed_stays_so(campaign):
    """4 ms, a good many deviations of this noise."""
    for seed in campaign(100):
        covariance = fit_response(measure(seed, [8e-3, 8e-3, 12e-3]), states=4).covariance
        delay_s = merge_delays(covariance, level=1e-4).model.delay_s
        assert delay_s[0] == delay_s[1]
        assert delay_s[2] - delay_s[0] > 3e-3
