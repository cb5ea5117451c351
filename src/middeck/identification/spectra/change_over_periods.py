"""Warnings for outputs whose gain or delay changes over the periods: the mean is that of none of them."""

from __future__ import annotations

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from middeck.identification.spectra.variance_of_lines import ResponseScatter
from middeck.signals.record import Record

# Probability of a trend by chance below which it is reported; lines that count from which it is tested.
BY_CHANCE, FEWEST = 1e-7, 8.0
# Deviations of a mean over the periods by which a line must exceed it.
CLEAR = 5.0


def warnings_on_change(record: Record, found: ResponseScatter) -> list[str]:
    """Warnings for trends over the periods of gains and delays of outputs: one for gains, one for delays.

    Transients that were taken out (``found.warnings``) have taken some of a trend with them.
    """
    _, periods, samples, _ = record.u.shape
    if not record.periodic or periods < 2:
        return []
    at = np.rint(found.frequency_hz * samples / record.sample_hz).astype(int)
    trend = np.linspace(-0.5, 0.5, periods)  # from the first period to the last it grows by one
    trend = trend / (trend @ trend)
    gains: dict[str, list[float]] = {}
    delays_ms: dict[str, list[float]] = {}
    for u, y in zip(record.u, record.y, strict=True):
        U, Y = (np.fft.rfft(x, axis=1)[:, at] for x in (u, y))
        # An input that grows moves no response.
        grown = np.einsum("p,pko->ko", trend, Y) - np.einsum("p,pki,koi->ko", trend, U, found.H)
        for o, port in enumerate(record.outputs):
            mean = Y[:, :, o].mean(axis=0)
            # Where one period's fault is most of the mean, it is in phase with itself.
            clear = np.abs(mean) > CLEAR * Y[:, :, o].std(axis=0) / np.sqrt(periods)
            omega = 2.0 * np.pi * found.frequency_hz[clear]
            gain, delay_s = _changes(mean[clear], grown[clear, o], omega)
            if gain is not None:
                gains.setdefault(port.name, []).append(gain)
            if delay_s is not None:
                delays_ms.setdefault(port.name, []).append(1e3 * delay_s)
    by = "by at least" if found.warnings else "by"
    return [*_change("gain", gains, "of itself", by), *_change("delay", delays_ms, "ms", by)]


def _change(what: str, by_output: dict[str, list[float]], unit: str, by: str) -> list[str]:
    if not by_output:
        return []
    sizes = [size for each in by_output.values() for size in each]
    size = " to ".join(dict.fromkeys(f"{one:+.2g}" for one in (min(sizes), max(sizes))))
    several = len(by_output) > 1
    return [
        f"output{'s' * several} {', '.join(by_output)}: {'their' if several else 'its'} {what} changes "
        f"{by} {size} {unit} from the first period to the last, by more than noise explains: a sensor, an "
        "amplifier or a clock that drifts, or an article that changes; the response is a mean over the "
        "record, and no variance counts the change; let it warm up, or take fewer periods"
    ]


def _changes(
    mean: Complex[np.ndarray, " line"], grown: Complex[np.ndarray, " line"], omega: Float[np.ndarray, " line"]
) -> tuple[float | None, float | None]:
    """Share by which a gain grows, and seconds by which a delay does; None where noise explains it.

    Noise is as large in quadrature to the response as in phase with it, on each line. A gain grows in phase,
    a delay in quadrature and with frequency: each is compared with what the other one has.
    """
    size = np.abs(mean)
    turned = grown * np.conj(mean) / np.where(size > 0.0, size, 1.0)
    along, across = np.real(turned), -np.imag(turned)
    gain = float(along @ size / (size @ size)) if _beyond(along, across) else None
    late = omega * size
    delay_s = float(across @ late / (late @ late)) if _beyond(omega * across, omega * along) else None
    return gain, delay_s


def _beyond(trend: Float[np.ndarray, " line"], noise: Float[np.ndarray, " line"]) -> bool:
    """Whether a sum over lines is beyond chance, where each is as uncertain as that of ``noise``.

    Student's distribution of as many degrees of freedom as lines count.
    """
    power = noise**2
    count = power.sum() ** 2 / max(power @ power, np.finfo(float).tiny)
    if count < FEWEST:
        return False
    return bool(2.0 * scipy.stats.t.sf(abs(trend.sum()) / np.sqrt(power.sum()), count) < BY_CHANCE)
