"""Sines in the outputs that no input makes: hum of the mains, unbalance of machines.

A pole without damping fits a sine as free motion. It is no mode of the article: its residue is noise, and its
decay is the least that the search allows. Such a pole is given up for the sine itself, a linear term of each
output and experiment, whose amplitude and phase may wander slowly (a parabola in time).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex

from middeck.identification.problem.data import Data, Transient

# Powers of time in the amplitude.
POWERS = 3


def with_line(data: Data, omega: float) -> Data:
    """Data whose transients have a sine of ``omega`` [rad/s] in them."""
    assert data.transient is not None
    return _with(data, _sines(data.s, data.transient, omega))


def with_free_motion(data: Data, poles: Complex[np.ndarray, " pole"]) -> Data:
    """Data whose transients have free motion of ``poles`` [rad/s] in them, which no input is to move."""
    assert data.transient is not None
    T = data.transient.period_s
    series = 1.0 / (1.0 - np.exp(poles[:, None] * T) * np.exp(-data.s * T))
    mirrored = 1.0 / (1.0 - np.exp(poles.conj()[:, None] * T) * np.exp(-data.s * T))
    pair = np.imag(poles) * T % np.pi != 0.0
    return _with(data, _even(np.concatenate([series + mirrored, 1j * (series - mirrored)[pair]])))


def _with(data: Data, spectra: Complex[np.ndarray, "column line"]) -> Data:
    assert data.transient is not None
    known = data.transient.steady
    spectra = spectra if known is None else np.concatenate([known, spectra])
    return dataclasses.replace(data, transient=dataclasses.replace(data.transient, steady=spectra))


def _sines(
    s: Complex[np.ndarray, " line"], transient: Transient, omega: float
) -> Complex[np.ndarray, "column line"]:
    """Discrete Fourier transforms of t^k cos and t^k sin over the record, to the mean square of one."""
    step = float(np.min(np.diff(np.imag(s)))) if len(s) > 1 else float(np.imag(s[0]))
    count = round(2.0 * np.pi / (step * transient.period_s))
    time = np.linspace(-1.0, 1.0, count, endpoint=False)
    turning = np.exp(1j * omega * transient.period_s * np.arange(count))
    lines = np.round(np.imag(s) / step).astype(int)
    parts = [x * time**k for k in range(POWERS) for x in (np.real(turning), np.imag(turning))]
    return _even(np.fft.rfft(parts, axis=1)[:, lines])


def _even(spectra: Complex[np.ndarray, "column line"]) -> Complex[np.ndarray, "column line"]:
    return spectra / np.sqrt(np.mean(np.abs(spectra) ** 2, axis=1, keepdims=True))
