"""The period of a signal, found from its samples.

The share of a signal that is not repeated after a lag P is, with the energies of the parts that overlap,

    d(P) = sum |u[k + P] - u[k]|^2 / (sum |u[k + P]|^2 + sum |u[k]|^2)

(the difference function of de Cheveigne and Kawahara 2002): zero for a period, one for what is unrelated, two
for a signal that comes back with its sign turned. The latter has odd lines only, and its period is twice the
lag. A smooth signal is like itself after a short lag too, and noise of a narrow band like itself after one of
its cycles; so a lag counts only if all its repetitions in the record agree with their mean.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.values import record

# Scatter of the repetitions, as a share of their mean's power, beyond which a signal does not repeat: noise
# as strong as half the signal. Signals that do not repeat have 1 and more.
REPEATS = 0.25
# A lag is as good as the best if it leaves at most this much more: a part of a period leaves lines out.
AS_GOOD = 3.0
ROUNDING = 1e-20
# Lags tried: a signal of a narrow band has a dip for each of its cycles before its period.
MOST_LAGS = 400


@record
class Repetition:
    """A signal's shortest repetition.

    Attributes:
        lag: Samples after which it comes back.
        sign: 1, or -1 where it comes back with its sign turned: odd lines only, and a period of two lags.
        scatter: Power of what is not repeated over the power of the mean repetition.
    """

    lag: int
    sign: int
    scatter: float

    @property
    def period(self) -> int:
        """Samples of a period."""
        return self.lag if self.sign > 0 else 2 * self.lag


def find_repetition(u: Float[np.ndarray, "experiment sample input"]) -> Repetition | None:
    """The shortest repetition common to all channels; None if there is none within half the record."""
    centred = u - u.mean(axis=1, keepdims=True)
    if not np.any(centred):
        return None
    d = lag_difference(centred)
    tried = [
        Repetition(int(lag), sign, scatter_of(centred, int(lag), sign))
        for sign, left in ((1, d), (-1, 2.0 - d))
        for lag in _dips(left)
    ]
    least = min((r.scatter for r in tried), default=np.inf)
    if least > REPEATS:
        return None
    return min((r for r in tried if r.scatter <= AS_GOOD * least + ROUNDING), key=lambda r: r.lag)


def _dips(left: Float[np.ndarray, " lag"]) -> np.ndarray:
    """Lags at which the difference is least, and all but as small as at the best of them."""
    inner = left[1:-1]
    dips = 1 + np.flatnonzero((inner < left[:-2]) & (inner <= left[2:]) & (inner < REPEATS))
    if not len(dips):
        return dips
    return dips[left[dips] <= AS_GOOD * left[dips].min() + 1e-9][:MOST_LAGS]


def lag_difference(u: Float[np.ndarray, "experiment sample input"]) -> Float[np.ndarray, " lag"]:
    """d(P) for lags up to half the record and one more, all channels together, each by its own energy."""
    samples = u.shape[1]
    size = np.sqrt(np.mean(u**2, axis=(0, 1)))
    u = u / np.where(size > 0.0, size, 1.0)
    spectrum = np.fft.rfft(u, 2 * samples, axis=1)
    lags = np.arange(samples // 2 + 2)
    product = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=(0, 2)))[lags]
    energy = np.concatenate([[0.0], np.cumsum(np.sum(u**2, axis=(0, 2)))])
    both = energy[samples - lags] + energy[samples] - energy[lags]
    return 1.0 - 2.0 * product / np.where(both > 0.0, both, np.inf)


def blocks_of(u: np.ndarray, lag: int, sign: int) -> Float[np.ndarray, "experiment block sample channel"]:
    """Whole blocks of ``lag`` samples counted from the end, every other one with its sign turned if asked."""
    count = u.shape[1] // lag
    blocks = u[:, u.shape[1] - count * lag :].reshape(len(u), count, lag, -1)
    return blocks if sign > 0 else blocks * np.where(np.arange(count) % 2, -1.0, 1.0)[:, None, None]


def scatter_of(u: Float[np.ndarray, "experiment sample input"], lag: int, sign: int) -> float:
    """Variance of the blocks about their mean over the power of the mean, pooled over the channels."""
    blocks = blocks_of(u, lag, sign)
    mean = blocks.mean(axis=1, keepdims=True)
    count = blocks.shape[1]
    scatter = np.sum((blocks - mean) ** 2, axis=(1, 2)) / ((count - 1) * lag)
    power = np.mean(mean**2, axis=(1, 2))
    return float(np.sum(scatter) / max(np.sum(power), np.finfo(float).tiny))
