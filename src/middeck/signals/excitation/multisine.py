"""Multisines: sums of cosines on the lines of a period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.excitation.grids import band_lines, choose_lines, whole_samples
from middeck.signals.excitation.limits import Limits, as_large_as_allowed
from middeck.signals.excitation.orthogonal_inputs import orthogonal_matrix
from middeck.signals.excitation.signal import Excitation

POWERS = (2, 4, 8, 16, 32, 64, 128)
STEPS = 60  # most steps for each power: later ones gain less than a per cent
# Decimals of phases, of slopes by them (about one over the lines) and of the norm's logarithm.
OF_PHASE, OF_SLOPE, OF_NORM = 6, 9, 12


def random_multisine(
    band_hz: tuple[float, float], period_s: float, sample_hz: float, rms: float, rng: np.random.Generator
) -> Float[np.ndarray, " sample"]:
    """One period of equal cosines on every line of the band, phases uniform at random.

    Lines are the multiples of 1/``period_s`` within ``band_hz``, limits included (Pintelon and Schoukens
    2012, section 5.2). The crest factor is near that of noise, 3 to 4. Raises `ConfigError` if the period
    is not a whole number of samples, if the band holds no line, or if it reaches half the sampling rate.

    >>> u = random_multisine((1.0, 8.0), 4.0, 64.0, 0.5, np.random.default_rng(0))
    >>> u.shape, round(float(np.sqrt(np.mean(u**2))), 12)
    ((256,), 0.5)
    """
    samples = whole_samples(period_s, sample_hz)
    first, last = band_lines(band_hz, period_s, sample_hz)
    count = last - first + 1
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    # rms^2 = count amplitude^2 / 2, and irfft turns amplitude * samples / 2 into a cosine of that amplitude.
    amplitude = rms * np.sqrt(2.0 / count)
    spectrum[first : last + 1] = 0.5 * samples * amplitude * np.exp(2j * np.pi * rng.random(count))
    return np.asarray(np.fft.irfft(spectrum, samples))


@named_kinds
def design_multisine(
    band_hz: tuple[float, float],
    period_s: float,
    sample_hz: float,
    limits: Limits | Sequence[Limits],
    rng: np.random.Generator,
    *,
    inputs: int = 1,
    realisations: int = 1,
    grid: str = "full",
    amplitude: Callable[[np.ndarray], np.ndarray] | None = None,
    phases: str = "random",
) -> Excitation:
    """One period of a multisine, for one or several inputs.

    Args:
        band_hz, period_s: Lines are the multiples of 1/``period_s`` within the band, limits included.
        limits: Limits of every input, or of each.
        inputs, realisations: A realisation is ``inputs`` experiments, orthogonal on every line (`inputs`).
            Phases are drawn anew for each realisation and input: several of them show nonlinear distortion,
            which changes with phases.
        grid: "full", "odd", "odd-odd" or "random-odd" (`grids.choose_lines`); silent lines detect distortion.
        amplitude: Amplitude of a line of so many Hz, up to a factor; equal by default.
        phases: "random", uniform; "schroeder" (Schroeder 1970; sums to a sweep); "compact", of the least peak
            that is found from there, each realisation and input from its own random share of a turn; the same
            on all processors.

    Raises `ConfigError` as `random_multisine`, for an unknown grid or kind of phases, or for amplitudes that
    are not finite, negative or all zero.

    >>> made = design_multisine(
    ...     (1.0, 8.0), 4.0, 64.0, Limits(peak=1.0), np.random.default_rng(0), phases="compact"
    ... )
    >>> made.u.shape, bool(made.crest_factor[0] < 1.5), float(made.peak[0].round(9))
    ((1, 256, 1), True, 1.0)
    """
    if inputs < 1 or realisations < 1:
        raise ConfigError(f"{realisations} realisations for {inputs} inputs", hint="one or more of each")
    samples = whole_samples(period_s, sample_hz)
    lines = choose_lines(*band_lines(band_hz, period_s, sample_hz), grid, rng)
    size = _amplitudes(amplitude, lines / period_s)
    T = orthogonal_matrix(inputs)
    u = np.concatenate([_realisation(lines, size, samples, T, phases, rng) for _ in range(realisations)])
    what = f"{phases}-phase multisine of {len(lines)} lines ({grid} grid) from {lines[0] / period_s:.6g} to "
    what += f"{lines[-1] / period_s:.6g} Hz"
    if inputs > 1:
        what += f", orthogonal for {inputs} inputs over {inputs} experiments"
    return as_large_as_allowed("multisine", what, u, lines, limits, sample_hz)


def _amplitudes(
    amplitude: Callable[[np.ndarray], np.ndarray] | None, frequency_hz: Float[np.ndarray, " line"]
) -> Float[np.ndarray, " line"]:
    if amplitude is None:
        return np.ones(len(frequency_hz))
    size = np.broadcast_to(np.asarray(amplitude(frequency_hz), dtype=float), frequency_hz.shape)
    if not np.isfinite(size).all() or (size < 0.0).any() or not size.any():
        raise ConfigError(
            "an amplitude is negative or not finite, or all are zero",
            where=f"{frequency_hz[0]:.6g} to {frequency_hz[-1]:.6g} Hz",
            hint="a positive amplitude for every frequency of the band",
        )
    return size


def _realisation(
    lines: np.ndarray,
    amplitude: np.ndarray,
    samples: int,
    T: np.ndarray,
    phases: str,
    rng: np.random.Generator,
) -> Float[np.ndarray, "experiment sample input"]:
    inputs = T.shape[1]
    U = np.zeros((len(T), samples // 2 + 1, inputs), dtype=complex)
    for i in range(inputs):
        angle = _phases(lines, amplitude, samples, np.angle(T[:, i]), phases, rng)
        U[:, lines, i] = T[:, i, None] * (0.5 * samples * amplitude * np.exp(1j * angle))
    return np.fft.irfft(U, samples, axis=1)


def _phases(
    lines: np.ndarray,
    amplitude: np.ndarray,
    samples: int,
    rotations: np.ndarray,
    phases: str,
    rng: np.random.Generator,
) -> Float[np.ndarray, " line"]:
    match phases:
        case "random":
            return 2.0 * np.pi * rng.random(len(lines))
        case "schroeder":
            return schroeder_phases(amplitude)
        case "compact":
            # A random share of a turn on each line keeps realisations apart and costs the start little.
            start = schroeder_phases(amplitude) + rng.random(len(lines))
            return compact_phases(lines, amplitude, samples, start, rotations)
        case _:
            raise ConfigError(f"no phases named {phases!r}", hint="random, schroeder or compact")


def schroeder_phases(amplitude: Float[np.ndarray, " line"]) -> Float[np.ndarray, " line"]:
    """phi_k = -2 pi sum_{j<k} (k - j) p_j with p the share of power (Schroeder 1970, eq. 11)."""
    share = amplitude**2 / np.sum(amplitude**2)
    before = np.append(0.0, np.cumsum(share[:-1]))
    phases: np.ndarray = np.cumsum(before)
    return -2.0 * np.pi * phases


def compact_phases(
    lines: np.ndarray,
    amplitude: Float[np.ndarray, " line"],
    samples: int,
    start: Float[np.ndarray, " line"],
    rotations: Float[np.ndarray, " experiment"],
) -> Float[np.ndarray, " line"]:
    """Phases of a small peak, for all experiments at once: each turns all lines by its own angle."""
    # A turn by pi changes a sign and no peak.
    distinct = np.unique(np.round(np.mod(rotations, np.pi), 9) % np.round(np.pi, 9))
    scale = np.sqrt(0.5 * np.sum(amplitude**2))
    phases = np.mod(start, 2.0 * np.pi)
    for p in POWERS:
        found: Any = scipy.optimize.minimize(
            _log_norm,
            phases,
            args=(lines, amplitude / scale, samples, distinct, p),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": STEPS},
        )
        phases = np.round(np.asarray(found.x), OF_PHASE)
    return phases


def _log_norm(
    phases: np.ndarray, lines: np.ndarray, amplitude: np.ndarray, samples: int, turns: np.ndarray, p: int
) -> tuple[float, np.ndarray]:
    """log of the norm of order 2p of all turned signals together, and its gradient by the phases."""
    spectrum = np.zeros((len(turns), samples // 2 + 1), dtype=complex)
    rotated = np.exp(1j * (np.round(phases, OF_PHASE) + turns[:, None]))
    spectrum[:, lines] = 0.5 * samples * amplitude * rotated
    u = np.fft.irfft(spectrum, samples, axis=1)
    largest = np.abs(u).max()
    power = u / largest
    for _ in range((2 * p).bit_length() - 1):  # p is a power of two; a general power takes ten times longer
        power = power * power
    total = float(np.sum(power))
    # d log norm / du = u^(2p-1) / sum u^2p; du_t / dphi_k = -A_k sin(2 pi k t / N + phi_k).
    slope = np.fft.rfft(power / np.where(u == 0.0, 1.0, u), axis=1)[:, lines] / total
    gradient = -amplitude * np.sum(np.imag(rotated * slope.conj()), axis=0)
    norm = float(np.log(largest) + np.log(total / u.size) / (2 * p))
    return round(norm, OF_NORM), np.round(gradient, OF_SLOPE)
