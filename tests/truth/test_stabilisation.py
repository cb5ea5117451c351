"""Stabilisation diagrams: the modes of the structure are the columns that stay."""

import gimbal_record
import numpy as np
import pytest

from middeck import estimate_response
from middeck.errors import ConfigError, FitError
from middeck.identification.order.stabilisation import stabilisation
from middeck.systems.plants.response import FrequencyResponse


@pytest.fixture(scope="module")
def measured():
    return estimate_response(gimbal_record.multisine(0, outputs=3, inputs=2))


def test_clusters_are_the_modes_and_nothing_else(measured):
    found = stabilisation(measured)
    assert len(found.cluster_hz) == 5
    # 1 % noise, no refinement: a twentieth of the half-power bandwidth, damping to a tenth.
    np.testing.assert_allclose(found.cluster_hz, gimbal_record.MODES_HZ, rtol=1e-3)
    np.testing.assert_allclose(found.cluster_damping, gimbal_record.ZETA, rtol=0.1)


def test_flags_are_what_they_say(measured):
    found = stabilisation(measured, orders=range(6, 31, 2))
    before = found.order == 12
    for k in np.flatnonzero(found.order == 14):
        near = np.abs(found.natural_hz[before] / found.natural_hz[k] - 1.0).min() < 0.01
        # The nearest by ratio; 1 % of either differs by 1e-4.
        assert near == found.stable_frequency[k]
    assert not found.stable_frequency[found.order == 6].any()
    assert (found.stable <= found.stable_frequency).all()
    assert set(found.cluster[~found.stable]) <= {-1}
    # One pole of each order at most in a cluster.
    for c in range(len(found.cluster_hz)):
        orders = found.order[found.cluster == c]
        assert len(set(orders)) == len(orders)


def test_noise_alone_has_no_mode():
    rng = np.random.default_rng(0)
    f = np.arange(0.1, 20.0, 0.05)
    H = rng.standard_normal((len(f), 3, 2)) + 1j * rng.standard_normal((len(f), 3, 2))
    noise = FrequencyResponse(
        frequency_hz=f,
        H=H,
        inputs=gimbal_record.INPUTS,
        outputs=gimbal_record.OUTPUTS,
        variance=np.full(H.shape, 2.0),
    )
    found = stabilisation(noise)
    assert len(found.cluster_hz) == 0


@pytest.mark.parametrize(
    "options",
    [{"orders": ()}, {"orders": (4, 2)}, {"sample_hz": 100.0}],
)
def test_what_cannot_be_is_refused(measured, options):
    with pytest.raises(ConfigError):
        stabilisation(measured, **options)


def test_too_few_lines(measured):
    few = FrequencyResponse(
        frequency_hz=measured.frequency_hz[:3],
        H=measured.H[:3],
        inputs=measured.inputs,
        outputs=measured.outputs,
        variance=measured.variance[:3],
    )
    with pytest.raises(FitError):
        stabilisation(few, orders=(20, 22))
