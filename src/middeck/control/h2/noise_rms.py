"""The rms of a loop under process and sensor noise with exact delays: an integral over all frequencies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex

from middeck.control.analysis.closed_response import closed_response
from middeck.control.analysis.delayed_roots import find_open_poles
from middeck.control.analysis.loop import approximate_halves, close_channels, form_loop
from middeck.control.analysis.stability import decide_loop
from middeck.control.h2.generalized_plant import generalize, square_root
from middeck.control.law.compensator import Compensator
from middeck.control.lqg import LQGWeights
from middeck.systems.plant import Plant, remove_delays
from middeck.systems.rms import response_rms
from middeck.systems.stability import GROWTH_LIMIT
from middeck.systems.statespace import poles
from middeck.values import record

FAR = 1e5
"""The integral ends at so many times the fastest pole; what is left falls with the square of frequency and is
taken from its last value, which errs by 1 / FAR^2 of it."""
REST = 1e-4
"""And it begins at this part of the slowest pole, below which all is flat to its square: nearer to rest a
plant that integrates outweighs the loop's own return by more than numbers hold."""


@record
class NoiseOutcome:
    """What a loop does under noise.

    Parameters
    ----------
    stable:
        By `decide_stability`, delays exact.
    rms, control_rms:
        (E[z' W^2 z])^1/2 and (E[u' R u])^1/2; ``inf`` where a root does not decay, and where white noise
        comes through a direct term.
    """

    stable: bool
    rms: float
    control_rms: float


def integrate_noise(plant: Plant, compensator: Compensator, weights: LQGWeights) -> NoiseOutcome:
    """Outputs and commands under the process and sensor noise of ``weights``, delays exact.

    Stability is decided first (`decide_stability`); then |T|^2 is integrated by adaptive quadrature.

    Raises `ConfigError` for ports that do not exist, weights that do not fit, and process noise that reaches
    z directly; `NumericalError` where stability cannot be decided.
    """
    generalize(remove_delays(plant), weights, 1.0)  # it refuses what has no cost
    loop = form_loop(plant, compensator)
    found = decide_loop(loop)
    if not found.stable or found.margin <= GROWTH_LIMIT:
        return NoiseOutcome(found.stable, np.inf, np.inf)
    peaks = np.append(poles(close_channels(approximate_halves(loop))), found.pole)
    fastest = np.abs(np.concatenate([find_open_poles(loop), [found.pole]]))
    top = FAR * float(fastest[np.isfinite(fastest)].max(initial=1.0))
    low = REST * float(np.abs(peaks).min(initial=top))
    respond, outputs = _noise_response(plant, compensator, weights), len(weights.output)
    unit = np.eye(respond(np.ones(1)).shape[2])
    band = response_rms(respond, peaks, unit, (low / (2.0 * np.pi), top / (2.0 * np.pi)))
    first, *last = respond(np.array([low, top, 10.0 * top]))
    square = band**2 + np.sum(low * np.abs(first) ** 2 + top * np.abs(last[0]) ** 2, axis=1) / np.pi
    # Where a response does not fall any more from the last line on, white noise comes through.
    level = np.linalg.norm(last, axis=2)
    square[(level[1] > 0.5 * level[0]) & (level[1] > 0.0)] = np.inf
    return NoiseOutcome(True, float(np.sqrt(square[:outputs].sum())), float(np.sqrt(square[outputs:].sum())))


def _noise_response(
    plant: Plant, compensator: Compensator, weights: LQGWeights
) -> Callable[[np.ndarray], Complex[np.ndarray, "line e noise"]]:
    """From unit white noise (process, then sensor) to W z, then R^1/2 u, over omega."""
    closed = closed_response(plant, compensator, weights.disturbed)
    noise = sla.block_diag(square_root(weights.process), np.diag(np.sqrt(weights.sensor)))
    weight = np.concatenate([weights.output, np.sqrt(weights.input)])[:, None]
    return lambda omega: weight * (closed(omega) @ noise)
