"""Where a sweep turns no more than a transient, the deviations of its response are as large as its errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from middeck.identification.spectra.estimate import Method, response_scatter
from middeck.signals.ports import Port
from middeck.signals.record import Record

Response = Callable[[np.ndarray], np.ndarray]


def swept(seed: int) -> tuple[Record, Response, float]:
    """Modes z = exp(p), a sweep that ends with the record soon after the last, and the response, exactly."""
    rng = np.random.default_rng([5, seed])
    n, modes = int(rng.choice([2000, 4000])), int(rng.integers(1, 4))
    turns, zeta = np.sort(rng.uniform(0.03, 0.3, modes)), rng.uniform(0.003, 0.02, modes)
    last = float(turns[-1] * rng.uniform(1.02, 1.3))
    u = chirp(np.arange(n), 0.004, n, last, method=str(rng.choice(["linear", "logarithmic"])), phi=-90)
    size = rng.choice([-1.0, 1.0], modes) * rng.uniform(0.5, 1.5, modes) * turns
    poles = np.exp(2.0 * np.pi * turns * (1j - zeta))
    y = sum(s * lfilter([0.0, 1.0], [1.0, -p], u).imag for s, p in zip(size, poles, strict=True))
    y = y + rng.choice([1e-4, 1e-3, 1e-2]) * y.std() * rng.standard_normal(n)

    def response(frequency: np.ndarray) -> np.ndarray:
        turn = np.exp(-2j * np.pi * frequency)[:, None]
        return (turn / (1.0 - poles * turn) - turn / (1.0 - poles.conj() * turn)) @ size / 2j

    record = Record(
        sample_hz=1.0, u=u[None, None, :, None], y=y[None, None, :, None], inputs=(Port("force", "N"),),
        outputs=(Port("tip", "m"),), periodic=False,
    )  # fmt: skip
    return record, response, last


@pytest.mark.parametrize("method", ["local rational", "local polynomial"])
def test_the_errors_of_a_sweep_that_ends_soon_after_a_mode_are_stated(
    method: Method, campaign: Callable[..., range]
) -> None:
    """Of 60 sweeps 27 had over 2 % of lines off by four deviations, up to 150, where they ended; of
    polynomials, which round resonances off and make of that a transient, 36 of 40 had half a per cent."""
    silent: list[int] = []
    for seed in campaign(60, 8):
        record, response, last = swept(seed)
        found = response_scatter(record, method=method, band_hz=(0.008, 0.99 * last))
        assert found.total is not None
        off = np.abs(found.H[:, 0, 0] - response(found.frequency_hz)) / np.sqrt(found.total[:, 0, 0])
        silent += [seed] if np.mean(off > 4.0) > 0.005 else []
    assert len(silent) <= len(campaign(60, 8)) // 8, silent


def test_the_deviations_under_noise_are_no_larger(campaign: Callable[..., range]) -> None:
    """Noise as the input turns enough on all lines: |error|^2 over the variance has the median of noise."""
    rng, medians = np.random.default_rng(6), list[float]()
    for _ in campaign(60, 10):
        u, pole = rng.standard_normal(3000), np.exp(2.0 * np.pi * 0.12 * (1j - 0.01))
        y = lfilter([0.0, 1.0], [1.0, -pole], u).imag
        y += 0.01 * y.std() * rng.standard_normal(3000)
        record = Record(
            sample_hz=1.0, u=u[None, None, :, None], y=y[None, None, :, None], inputs=(Port("force", "N"),),
            outputs=(Port("tip", "m"),), periodic=False,
        )  # fmt: skip
        found = response_scatter(record, method="local rational", band_hz=(0.01, 0.49))
        assert found.total is not None
        turn = np.exp(-2j * np.pi * found.frequency_hz)
        H = (turn / (1.0 - pole * turn) - turn / (1.0 - pole.conj() * turn)) / 2j
        medians.append(float(np.median(np.abs(found.H[:, 0, 0] - H) ** 2 / found.total[:, 0, 0])))
    assert 0.8 < np.mean(medians) / np.log(2.0) < 1.4
