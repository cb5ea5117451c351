"""What kind of signal it is, by features that noise on its samples moves little."""

from __future__ import annotations

import numpy as np
import scipy.signal
from jaxtyping import Float

from middeck.systems.excitation.signal import line_power

# Kurtosis: 1 for two levels, 1.5 for a sine, 3 for noise.
TWO_LEVELS = 1.15
# A burst is silent for this share of its period, below this share of its rms.
SILENT_SHARE, SILENT_LEVEL = 0.05, 0.05
# Sines of one amplitude at a time have an envelope that is constant but for its jumps.
EVEN_ENVELOPE = 0.05
# Standard deviation of the difference of log power between neighbouring lines: 1.81 for Gaussian noise
# (log of the ratio of two exponential variables), near nothing for chosen amplitudes.
CHOSEN_AMPLITUDES = 0.7


def name_kind(u: Float[np.ndarray, "experiment sample input"], *, repeated: bool) -> str:
    """The kind of one period of each experiment (or of a whole signal that is not repeated)."""
    channels = np.moveaxis(u, 2, 1).reshape(-1, u.shape[1])
    size = channels.std(axis=1)
    if not size.any():
        return "silence"
    x = channels[int(np.argmax(size))] / size.max()
    if np.mean(x**4) < TWO_LEVELS:
        return "binary"
    if _quiet_share(x) > SILENT_SHARE:
        return "burst random"
    if (moving := _moving_sine(x)) is not None:
        return moving
    return "multisine" if repeated and _chosen(x) else "noise"


def _quiet_share(x: Float[np.ndarray, " sample"]) -> float:
    """Longest run of silence as a share of the signal, a run over its ends included."""
    loud = np.flatnonzero(np.abs(x) > SILENT_LEVEL)
    gaps = np.diff(np.concatenate([loud, [loud[0] + len(x)]]))
    return float(gaps.max() - 1) / len(x)


def _moving_sine(x: Float[np.ndarray, " sample"]) -> str | None:
    """Which of "sine", "swept sine" and "stepped sine", if the signal is one sine at a time."""
    analytic = scipy.signal.hilbert(x)
    envelope = np.abs(analytic)
    middle = np.median(envelope)
    if np.median(np.abs(envelope - middle)) > EVEN_ENVELOPE * middle:
        return None
    rate = np.diff(np.unwrap(np.angle(analytic)))
    power = line_power(x[None, :, None])[:, 0]
    if power.max() > 0.99 * power.sum():
        return "sine"
    # Steps: the frequency stays for most samples and moves at a few; a sweep moves at all of them.
    # Averages over a few samples first: noise on the phase is not a step.
    width = max(1, len(rate) // 200)
    smooth = np.array([np.median(part) for part in np.array_split(rate, max(8, len(rate) // width))])
    moves = np.abs(np.diff(smooth))
    return "stepped sine" if np.median(moves) < 0.1 * np.mean(moves) else "swept sine"


def _chosen(x: Float[np.ndarray, " sample"]) -> bool:
    """Whether the excited lines have amplitudes that somebody chose."""
    power = line_power(x[None, :, None])[:, 0]
    loud = power[power > 1e-4 * power.max()]
    if len(loud) < 3:
        return True
    steps = np.diff(np.log(loud))
    # By quantiles: a few steps, at the edges of bands, may be large.
    low, high = np.quantile(steps, [0.16, 0.84])
    return bool(high - low < 2.0 * CHOSEN_AMPLITUDES)
