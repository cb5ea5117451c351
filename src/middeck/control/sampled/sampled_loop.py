"""Stability of a sampled loop, and its rms over all time, between samples too."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.analysis.stability.stability import decide_loop
from middeck.control.law.compensator import Compensator, arrange_ports
from middeck.control.law.rounding_of_results import measure_known
from middeck.control.lqg.weights import LQGWeights
from middeck.control.riccati.lyapunov import solve_discrete_lyapunov
from middeck.control.sampled.held_plant import HeldPlant, hold_plant
from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import all_decay, growth_rates
from middeck.systems.poles.state_units import settle_states
from middeck.systems.poles.verdict import may_cross
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.reached_states import reached_states
from middeck.systems.state_space.statespace import SampledStateSpace, poles, same_period
from middeck.values import record


@record(kw_only=True)
class SampledOutcome:
    """Stability and rms of a sampled loop; an unstable loop is an outcome, not an error.

    Attributes:
        stable: Whether the loop from sample to sample is stable (`decide_stability`).
        poles: Eigenvalues of that loop, z-plane.
        rms: Rms of each output z at all times, between samples too; ``inf`` for an unstable loop, and for
            one with a pole on the circle that noise drives, or may drive: not where exact zeros part them.
        rms_at_samples: Rms at the sampling instants alone (of the plant's state, without output delays).
        control_rms: Rms of each input u.
        metric: Norm of W rms: the square root of the cost's first part.
        cost: E[z' W^2 z + rho u' diag(input) u] at rho = 1 / authority.
    """

    stable: bool
    poles: Complex[np.ndarray, " state"]
    rms: Float[np.ndarray, " z"]
    rms_at_samples: Float[np.ndarray, " z"]
    control_rms: Float[np.ndarray, " u"]
    metric: float
    cost: float


@named_kinds
def measure_sampled_loop(
    plant: Plant, compensator: Compensator, weights: LQGWeights, authority: float
) -> SampledOutcome:
    """The loop of ``plant`` and a sampled compensator under the noises of ``weights``, delays and hold exact.

    The covariance at the samples solves a discrete Lyapunov equation; between the samples it is propagated
    under held inputs and averaged.

    Raises `ConfigError` for ports that differ from the groups u and y, weights that do not fit, and a
    compensator that reads its own input within the sample. Warns (`UserWarning`) where rounding of the
    matrices makes the rms uncertain (`measure_known`), and where the rms of a stable loop is infinite.
    """
    found = measure_known(
        "rms", lambda *both: measure_held(*both, weights, authority), _numbers, plant, compensator
    )
    if found.stable and np.isinf(found.metric):
        lead = found.poles[np.argmax(np.abs(found.poles))]
        frequency_hz = abs(np.angle(lead)) / (2.0 * np.pi * compensator.sampled.period_s)
        warnings.warn(
            f"rms is infinite: the pole at {frequency_hz:.6g} Hz neither decays nor grows beyond rounding. "
            "What noise does not drive may be left out of the plant",
            stacklevel=3,
        )
    return found


def _numbers(outcome: SampledOutcome) -> Float[np.ndarray, " number"]:
    return np.log(np.concatenate([outcome.rms, outcome.control_rms]))


def measure_held(
    plant: Plant, compensator: Compensator, weights: LQGWeights, authority: float
) -> SampledOutcome:
    """`measure_sampled_loop` without its check of rounding."""
    held = hold_plant(plant, weights, compensator.sampled.period_s)
    law = arrange_law(held, compensator)
    stable = decide_loop(form_loop(plant, compensator)).stable
    loop = _close(held, law)
    values = poles(loop)
    covariance = _covariance(held, law, loop) if stable else None
    if covariance is None:
        nz, nu = np.full(len(held.z), np.inf), np.full(len(held.inputs), np.inf)
        return SampledOutcome(
            stable=stable, poles=values, rms=nz, rms_at_samples=nz, control_rms=nu, metric=np.inf, cost=np.inf
        )
    n = len(held.system.A)
    mean = _mean_within(held, covariance)
    first = held.segments[0].start @ covariance @ held.segments[0].start.T
    rms, at_samples = (_rows_rms(held.performance, each) for each in (mean, first))
    control = np.sqrt(np.maximum(np.diag(covariance)[n:], 0.0))  # of an idle law rounding about zero
    metric = float(np.linalg.norm(weights.output * rms))
    cost = metric**2 + float(np.sum(weights.input * control**2)) / authority
    return SampledOutcome(
        stable=True,
        poles=values,
        rms=rms,
        rms_at_samples=at_samples,
        control_rms=control,
        metric=metric,
        cost=cost,
    )


def arrange_law(held: HeldPlant, compensator: Compensator) -> SampledStateSpace:
    """The compensator with its ports in the order of the plant's groups y and u.

    Raises `ConfigError` for other ports, another period, and a loop within the sample.
    """
    law = settle_states(arrange_ports(compensator, held.outputs, held.inputs).sampled)
    if not same_period(law.period_s, held.system.period_s):
        raise ConfigError(
            f"the compensator's period is {law.period_s} s, the plant is held over {held.system.period_s} s",
            hint="emulate(law, period_s), or hold the plant over the compensator's period",
        )
    if np.any(held.system.D) and np.any(law.D):
        raise ConfigError(
            "algebraic loop: plant and compensator both respond within the sample",
            hint="give the plant its true delay, or use the predictor form, which has no direct term",
        )
    return law


def _close(held: HeldPlant, law: SampledStateSpace) -> SampledStateSpace:
    """From sensor noise to the inputs u; states: the held plant's, then the compensator's."""
    nu, ny = law.D.shape
    closed = feedback(held.system, law, range(nu), range(ny))
    return closed.select(range(nu, nu + ny), range(ny, ny + nu))


def _covariance(
    held: HeldPlant, law: SampledStateSpace, loop: SampledStateSpace
) -> Float[np.ndarray, "all all"] | None:
    """Covariance of the held plant's states and the inputs issued, at the samples; None where unbounded."""
    sensor = np.diag(held.sensor)
    n = len(held.system.A)
    noise = loop.B @ sensor @ loop.B.T
    noise[:n, :n] += held.noise
    X = _driven_covariance(loop, noise)
    if X is None:
        return None
    seen = np.vstack([np.eye(n, len(X)), loop.C])
    covariance = seen @ X @ seen.T
    covariance[n:, n:] += law.D @ sensor @ law.D.T
    return covariance


def _driven_covariance(loop: SampledStateSpace, noise: np.ndarray) -> Float[np.ndarray, "state state"] | None:
    """Covariance of the states reached by noise; None if a pole of theirs does not decay beyond rounding."""
    driven = reached_states(loop.A, np.diag(noise) > 0.0)
    own, X = np.ix_(driven, driven), np.zeros_like(noise)
    part = dataclasses.replace(loop, A=loop.A[own], B=loop.B[driven], C=loop.C[:, driven])
    if not all_decay(growth_rates(part), part.period_s) or may_cross(part):
        return None
    found = solve_discrete_lyapunov(part.A.T, noise[own])
    if found is None:
        return None
    X[own] = found
    return X


def _mean_within(held: HeldPlant, covariance: np.ndarray) -> Float[np.ndarray, "held held"]:
    """Covariance of (x, inputs in force), mean over the period."""
    total = np.zeros_like(held.generator)
    for segment in held.segments:
        start = segment.start @ covariance @ segment.start.T
        total += spread_noise(held.generator, start, segment.duration_s).covariance
    total /= held.system.period_s
    x = len(held.dwell)
    total[:x, :x] += held.dwell
    return total


def _rows_rms(rows: np.ndarray, covariance: np.ndarray) -> Float[np.ndarray, " row"]:
    # A negative square is rounding about zero.
    return np.sqrt(np.maximum(np.sum((rows @ covariance) * rows, axis=1), 0.0))
