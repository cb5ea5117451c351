"""Poles of a fit that represent a delay which its model lacks, rather than modes.

A sampled model, or one with complex constants, has no delay. If the article has one, poles follow its phase:
heavily damped pairs, and real ones, inside the band, with small standard deviations. They are recognised if
the other poles, with a delay and a constant term, fit all paths as well within the noise.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.fit.missing_delay import stack_parts
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    is_mode,
    model_response,
    natural_hz,
)

# Least damping ratio of a pole that may stand for a delay.
DAMPED = 0.1
# Delays are tried up to so many periods of the last line, so many in each, then as many about the best.
PERIODS, IN_PERIOD = 8, 16
# Deviations of each of the two numbers that a path has of a pair: no more than so many are not distinguished.
TOLD = 4.0


def stands_for_delay(
    model: MeasurementModel,
    s: Complex[np.ndarray, " line"],
    U: Complex[np.ndarray, "line input column"],
    residual: Complex[np.ndarray, "output line column"],
    weight: Float[np.ndarray, "output line column"],
) -> tuple[Int[np.ndarray, " mode"], float]:
    """Damped poles which a delay [s] of each output replaces, and the longest; none, and zero, without.

    ``U`` are spectra of the inputs in each experiment, ``residual`` what the model leaves of the outputs, and
    ``weight`` one over its deviation.
    """
    last_hz, zeta = float(np.imag(s[-1])) / (2.0 * np.pi), damping_ratio(model)
    rate = np.inf if model.sample_hz is None else model.sample_hz
    modes = ~model.is_pair | is_mode(model, rate)
    damped = damped_poles(model)
    if not len(damped):
        return damped, 0.0
    left = np.sum(np.abs(residual * weight) ** 2, axis=(1, 2))
    for least in np.unique(zeta[damped]):
        out = damped[zeta[damped] >= least]
        allowed = left + TOLD**2 * 2.0 * len(out) * U.shape[1]
        kept = np.setdiff1d(np.flatnonzero(modes), out)
        found = _each_delay(model, s, U, residual, weight, kept)
        served = itertools.takewhile(lambda of: of[0][1] <= of[1], zip(found, allowed, strict=True))
        delay_s = [tau for (tau, _), _ in served]  # most often none replaces them at the first output
        if len(delay_s) == len(allowed) and max(delay_s) > 0.0:
            return out[natural_hz(model)[out] <= last_hz], max(delay_s)
    return damped[:0], 0.0


def damped_poles(model: MeasurementModel) -> Int[np.ndarray, " mode"]:
    """Poles that may stand for a delay; a sampled model has real ones for much else."""
    may = model.is_pair | (model.sample_hz is None)
    return np.flatnonzero(may & (damping_ratio(model) > DAMPED))


def delays_with(
    model: MeasurementModel,
    s: Complex[np.ndarray, " line"],
    U: Complex[np.ndarray, "line input column"],
    residual: Complex[np.ndarray, "output line column"],
    weight: Float[np.ndarray, "output line column"],
    kept: Int[np.ndarray, " mode"],
) -> tuple[Float[np.ndarray, " output"], Float[np.ndarray, " output"]]:
    """The best delay [s] of each output behind the poles ``kept`` alone, and the squares that it leaves."""
    delay_s, left = np.array(list(_each_delay(model, s, U, residual, weight, kept))).T
    return delay_s, left


def _each_delay(
    model: MeasurementModel,
    s: Complex[np.ndarray, " line"],
    U: Complex[np.ndarray, "line input column"],
    residual: Complex[np.ndarray, "output line column"],
    weight: Float[np.ndarray, "output line column"],
    kept: Int[np.ndarray, " mode"],
) -> Iterator[tuple[float, float]]:
    response = model_response(model, np.imag(s) / (2.0 * np.pi))
    data, basis = np.einsum("koi,kic->okc", response, U) + residual, _basis(model, s, kept)
    for own in zip(data, weight, strict=True):
        yield _delay_of_output(s, basis, U, *own)


def _delay_of_output(
    s: np.ndarray, basis: np.ndarray, U: np.ndarray, data: np.ndarray, weight: np.ndarray
) -> tuple[float, float]:
    """The delay with which an output is followed best, and the squares that are left."""
    columns = np.einsum("kb,kic,kc->kcbi", basis, U, weight).reshape(data.size, -1)
    q, seen = np.linalg.qr(stack_parts(columns))[0], data * weight
    both = (q[: data.size] - 1j * q[data.size :]).reshape(*data.shape, -1)
    by_line = np.einsum("kcb,kc->bk", both, seen)

    def best_of(tau: np.ndarray) -> float:
        """The delay with which most is followed."""
        followed = np.real(by_line @ np.exp(s[:, None] * tau))
        return float(tau[np.argmax(np.sum(followed**2, axis=0))])

    step = 2.0 * np.pi / float(np.imag(s[-1])) / IN_PERIOD
    near = best_of(step * np.arange(PERIODS * IN_PERIOD + 1))
    best = best_of(np.maximum(near + step * np.linspace(-1.0, 1.0, 2 * IN_PERIOD + 1), 0.0))
    y = stack_parts((seen * np.exp(s * best)[:, None]).reshape(-1, 1))[:, 0]
    return best, float(np.sum((y - q @ (q.T @ y)) ** 2))


def _basis(model: MeasurementModel, s: np.ndarray, kept: np.ndarray) -> Complex[np.ndarray, "line column"]:
    """Responses of one path by these poles, with real coefficients, and a constant."""
    one = np.ones((1, 1))
    columns = [np.ones(len(s), dtype=complex)]
    for m in kept:
        for shape in (1.0, 1j) if model.is_pair[m] else (1.0,):
            alone = dataclasses.replace(
                model, poles=model.poles[[m]], shapes=shape * one, participation=one, direct=0.0 * one,
                lower=0.0 * one, delay_s=np.zeros(1), path_delay_s=None, rigid=None, integral=None,
                inputs=model.inputs[:1], outputs=model.outputs[:1],
            )  # fmt: skip
            columns.append(model_response(alone, np.imag(s) / (2.0 * np.pi))[:, 0, 0])
    return np.column_stack(columns)
