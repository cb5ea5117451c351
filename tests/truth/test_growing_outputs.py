"""An output that grows by itself is refused; one that a sweep drives ever nearer to a mode is not."""

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from middeck.errors import FitError
from middeck.identification.model.unstable_article import refuse_growth
from middeck.signals.ports import Port
from middeck.signals.record import Record


def driven(seed: int, kind: str, samples: int, grown: float, slow: float) -> Record:
    """The rate of a mode z = exp(p), exactly, which grows ``grown`` times by itself, and 1 % noise.

    Mode and sweep are so many times as ``slow``.
    """
    rng, t = np.random.default_rng([74, seed]), np.arange(samples)
    low, high = rng.uniform(0.004, 0.01) / slow, rng.uniform(0.35, 0.45) / slow
    first, last = (low, high) if kind.endswith("up") else (high, low)
    method = "linear" if kind.startswith("linear") else "logarithmic"
    u = rng.standard_normal(samples) if kind == "white" else chirp(t, first, samples, last, method, -90)
    omega = 2.0 * np.pi * rng.uniform(0.02, 0.38) / slow
    rate = np.log(grown) / samples if grown > 1.0 else -omega * rng.uniform(0.003, 0.05)
    y = np.real(lfilter([0.0, 1.0], [1.0, -np.exp(rate + 1j * omega)], u.astype(complex)))
    y += 0.01 * y.std() * rng.standard_normal(samples)
    return Record(
        sample_hz=50.0, u=u[None, None, :, None], y=y[None, None, :, None], periodic=False,
        inputs=(Port("force", "N"),), outputs=(Port("rate", "m/s"),),
    )  # fmt: skip


def refused(record: Record) -> bool:
    try:
        refuse_growth(record)
    except FitError:
        return True
    return False


@pytest.mark.parametrize(("samples", "slow"), [(300, 1.0), (2000, 1.0), (3000, 10.0)])
@pytest.mark.parametrize("kind", ["white", "linear up", "linear down", "log up", "log down"])
def test_what_grows_by_itself_is_refused_and_what_a_sweep_drives_is_not(
    kind: str, samples: int, slow: float
) -> None:
    """Of stable modes under sweeps up to half were refused."""
    seeds = range(25)
    assert sum(refused(driven(seed, kind, samples, 1.0, slow)) for seed in seeds) <= 1
    assert np.mean([refused(driven(seed, kind, samples, 1e3, slow)) for seed in seeds]) >= 0.8
