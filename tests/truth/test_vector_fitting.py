"""Vector fitting: exact data give the exact poles, from a start that knows nothing of them."""

import gimbal_record
import numpy as np
import pytest

from middeck.identification.problem.data import Data
from middeck.identification.start.vector_fitting import relocate

POLES = np.array([-0.3 + 7j, -0.3 - 7j, -0.5 + 11j, -0.5 - 11j, -1.0 + 45j, -1.0 - 45j, -6.0])


def response(s, poles, period_s, seed=0):
    """Two outputs, two inputs, full residues closed under conjugation, a constant."""
    rng = np.random.default_rng(seed)
    q, p = (np.exp(s * period_s), np.exp(poles * period_s)) if period_s else (s, poles)
    H = np.ones((2, len(s), 2), dtype=complex)
    for k in range(0, len(p) - 1, 2):
        r = rng.standard_normal((2, 1, 2)) + 1j * rng.standard_normal((2, 1, 2))
        H += r / (q[:, None] - p[k]) + r.conj() / (q[:, None] - p[k].conj())
    return H + rng.standard_normal((2, 1, 2)) / (q[:, None] - p[-1])


def far_start(highest):
    omega = np.linspace(0.5, highest, 3)
    pairs = np.concatenate([[-0.01 * w + 1j * w, -0.01 * w - 1j * w] for w in omega])
    return np.append(pairs, -1.0)


@pytest.mark.parametrize("period_s", [0.0, 0.05])
def test_exact_data_give_the_exact_poles(period_s):
    s = 1j * np.linspace(0.2, 55.0, 400)
    data = Data(s=s, H=response(s, POLES, period_s), weight=np.ones((2, 400, 2)))
    found = relocate(data, far_start(50.0), period_s, iterations=20)
    # Residues of order one and a hundred bandwidths between start and pole: rounding, amplified a little.
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(POLES), rtol=1e-8)


@pytest.mark.parametrize("period_s", [0.0, 0.05])
def test_all_poles_are_stable_whatever_the_data(period_s):
    rng = np.random.default_rng(3)
    s = 1j * np.linspace(0.2, 55.0, 60)
    H = rng.standard_normal((1, 60, 1)) + 1j * rng.standard_normal((1, 60, 1))
    for k in range(1, 12):
        found = relocate(Data(s=s, H=H, weight=np.ones(H.shape)), far_start(50.0), period_s, iterations=k)
        assert np.real(found).max() < 0.0
        # Closed under conjugation: as many poles above the axis as below, counting pi / T as real.
        inner = np.abs(np.imag(found)) < (np.pi / period_s if period_s else np.inf) * (1.0 - 1e-9)
        assert np.sum(found[inner].imag) == pytest.approx(0.0, abs=1e-9 * np.abs(found).max())


def test_noise_moves_poles_by_no_more_than_their_bandwidth():
    """The gimbal's five modes with 1 % noise, two inputs and three outputs, from evenly spaced poles."""
    f = np.arange(0.3, 15.0, 1.0 / 64.0)
    H = np.moveaxis(gimbal_record.response(f, 3, 2), 0, 1)
    rng = np.random.default_rng(0)
    level = 0.01 * np.sqrt(np.mean(np.abs(H) ** 2, axis=(1, 2), keepdims=True))
    noisy = H + level * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2.0)
    omega = 2.0 * np.pi * np.linspace(0.5, 14.0, 7)
    start = np.concatenate([[-0.01 * w + 1j * w, -0.01 * w - 1j * w] for w in omega])
    found = relocate(
        Data(s=2j * np.pi * f, H=noisy, weight=np.ones(H.shape) / level), start, 0.0, iterations=12
    )
    hz = np.abs(found[found.imag > 0.0]) / (2.0 * np.pi)
    # Two pairs are spare, for the delays; half the half-power bandwidth is 1 % of the frequency.
    for mode in gimbal_record.MODES_HZ:
        assert np.min(np.abs(hz / mode - 1.0)) < 0.01
