"""Rms of a loop with exact delays under process and sensor noise, by integration over all frequencies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex

from middeck.control.analysis.loop.feedback_loop import (
    approximate_halves,
    close_channels,
    form_loop,
)
from middeck.control.analysis.rms.closed_response import closed_response
from middeck.control.analysis.stability.delayed_roots import find_open_poles
from middeck.control.analysis.stability.stability import find_roots, judge_roots
from middeck.control.h2.generalized_plant import generalize
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.systems.norms.band_rms import response_rms, square_root
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.state_space.statespace import poles
from middeck.values import record

FAR = 1e5
"""Upper limit of the integral relative to the fastest pole; the rest falls with the square of frequency and
is extrapolated with a relative error of 1 / FAR^2."""
REST = 1e-4
"""Lower limit relative to the slowest pole; the integrand is flat below, and nearer to zero frequency the
integrators of a plant cancel beyond double precision."""


@record
class NoiseOutcome:
    """Stability and rms of a loop under noise.

    Attributes:
        stable: Whether the loop is stable (`decide_stability`), delays exact.
        rms, control_rms: (E[z' W^2 z])^1/2 and (E[u' R u])^1/2; ``inf`` for an unstable loop, for one with
            a root that does not decay, and for white noise through a direct term.
    """

    stable: bool
    rms: float
    control_rms: float


def integrate_noise(
    plant: Plant, compensator: Compensator, weights: LQGWeights, *, measured: bool = True
) -> NoiseOutcome:
    """Outputs and commands under the process and sensor noise of ``weights``, delays exact.

    Stability is decided first (`decide_stability`); then |T|^2 is integrated by adaptive quadrature, which
    without ``measured`` is left out: a finite rms is then any finite number.

    Raises `ConfigError` for ports that do not exist, weights that do not fit, and process noise that reaches
    z directly; `NumericalError` where stability cannot be decided.
    """
    generalize(remove_delays(plant), weights, 1.0)  # refuses a plant of infinite cost
    loop = form_loop(plant, compensator)
    roots = find_roots(loop)
    found = judge_roots(roots, loop.period_s)
    if not found.decays:
        return NoiseOutcome(found.stable, np.inf, np.inf)
    fastest = np.abs(np.append(find_open_poles(loop)[0], found.pole))
    top = FAR * float(fastest[np.isfinite(fastest)].max(initial=1.0))
    low = REST * float(np.abs(roots).min(initial=top))
    respond, outputs = _noise_response(plant, compensator, weights), len(weights.output)
    first, *last = respond(np.array([low, top, 10.0 * top]))
    unit = np.eye(first.shape[1])
    limits = low / (2.0 * np.pi), top / (2.0 * np.pi)
    band = response_rms(respond, roots, unit, limits) if measured else np.zeros(len(first))
    square = band**2 + np.sum(low * np.abs(first) ** 2 + top * np.abs(last[0]) ** 2, axis=1) / np.pi
    # A response that does not fall beyond the last line passes white noise: infinite rms.
    level = np.linalg.norm(last, axis=2)
    square[(level[1] > 0.5 * level[0]) & (level[1] > 0.0)] = np.inf
    return NoiseOutcome(True, float(np.sqrt(square[:outputs].sum())), float(np.sqrt(square[outputs:].sum())))


def integrate_band_noise(
    plant: Plant, compensator: Compensator, weights: LQGWeights, band_hz: tuple[float, float]
) -> tuple[float, float]:
    """(E[z' W^2 z])^1/2 and (E[u' R u])^1/2 within ``band_hz``, delays exact.

    Of a loop that decays: stability is not looked at. Raises `ConfigError` as `integrate_noise`, and for a
    band that is not 0 <= low < high < inf.
    """
    generalize(remove_delays(plant), weights, 1.0)  # refuses what `integrate_noise` does
    respond, outputs = _noise_response(plant, compensator, weights), len(weights.output)
    unit = np.eye(len(weights.process) + len(weights.sensor))
    rms = response_rms(
        respond, poles(close_channels(approximate_halves(form_loop(plant, compensator)))), unit, band_hz
    )
    return float(np.linalg.norm(rms[:outputs])), float(np.linalg.norm(rms[outputs:]))


def _noise_response(
    plant: Plant, compensator: Compensator, weights: LQGWeights
) -> Callable[[np.ndarray], Complex[np.ndarray, "line e noise"]]:
    """From unit white noise (process, then sensor) to W z, then R^1/2 u, over omega."""
    closed = closed_response(plant, compensator, weights.disturbed)
    noise = sla.block_diag(square_root(weights.process), np.diag(np.sqrt(weights.sensor)))
    weight = np.concatenate([weights.output, np.sqrt(weights.input)])[:, None]
    return lambda omega: weight * (closed(omega) @ noise)
