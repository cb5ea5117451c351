"""Sampled loops on many plants: true delays, held inputs, covariance at the sampling instants."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.analysis.stability.stability import decide_loop
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import pade_order, phase_of_modes
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.batch import row_rms, same_shapes, warn_of_lost
from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.errors import ConfigError, NumericalError
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, subsystem
from middeck.systems.poles.rounding import is_vague
from middeck.systems.poles.stability import growth_limits
from middeck.systems.sampling.sampling import sample_dynamics, tustin
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

GRID = 1e-6
"""Fraction of a period to which delays are rounded: at most 1.6e-6 rad at half the rate."""
DOUBLINGS = 60


@record(kw_only=True)
class _SampledLoop:
    """x+ = A x + noise of covariance Q; rows give the weighted outputs and the weighted inputs."""

    A: Float[np.ndarray, "state state"]
    Q: Float[np.ndarray, "state state"]
    outputs: Float[np.ndarray, "z state"]
    inputs: Float[np.ndarray, "u state"]
    input_noise: Float[np.ndarray, " u"]


def sampled_outcomes(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights, rate_hz: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether each loop is stable, the rms of its weighted outputs and of its weighted inputs.

    Sensor noise is averaged over a period: variance = intensity / period. A plant that rounding leaves
    undecided counts as lost, with a warning.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise ConfigError(f"rate of {rate_hz} Hz", hint="positive and finite")
    period = 1.0 / rate_hz
    law = tustin(compensator.system, period)
    held, vague = dataclasses.replace(compensator, dynamics=law), is_vague(law)
    known = [i for i, p in enumerate(plants) if (p.modal and not vague) or _is_known(p, held)]
    warn_of_lost(sorted({*range(len(plants))} - {*known}), len(plants))
    loops = {i: _sampled_loop(plants[i], law, weights, period) for i in known}
    stable = np.zeros(len(plants), dtype=bool)
    rms, control = np.full(len(plants), np.inf), np.full(len(plants), np.inf)
    for alike in same_shapes([loop.A.shape for loop in loops.values()]):
        group = [known[k] for k in alike]
        values, X = sampled_covariances(
            np.array([loops[i].A for i in group]), np.array([loops[i].Q for i in group])
        )
        # A root at z = 1 drifts: its side of the circle is rounding.
        limits = growth_limits(1j * np.angle(values) / period, period)
        stable[group] = np.all(np.abs(values) < np.exp(-limits * period), axis=1)
        rms[group] = np.linalg.norm(row_rms(np.array([loops[i].outputs for i in group]), X), axis=1)
        moved = row_rms(np.array([loops[i].inputs for i in group]), X)
        noise = np.array([loops[i].input_noise for i in group])
        control[group] = np.sqrt(np.sum(moved**2 + noise, axis=1))
    return stable, rms, control


def _is_known(plant: Plant, law: Compensator) -> bool:
    try:
        decide_loop(form_loop(plant, law))
    except NumericalError:
        return False
    return True


def _sampled_loop(plant: Plant, law: SampledStateSpace, weights: LQGWeights, period: float) -> _SampledLoop:
    active, held_delay = delay_at_the_hold(plant, period)
    active = partition_modes(active).active
    held = sample_dynamics(subsystem(active, active.u, (*active.z, *active.y)), period, held_delay)
    noise = subsystem(active, weights.disturbed, active.y)
    n, size = len(noise.A), len(held.A)
    Q = np.zeros((size, size))
    Q[:n, :n] = spread_noise(noise.A, noise.B @ weights.process @ noise.B.T, period).covariance
    sensor = (np.diag(weights.sensor) + noise.D @ weights.process @ noise.D.T) / period
    nz = len(active.z)
    return _close(held, law, Q, sensor, nz, weights)


def _close(
    held: SampledStateSpace,
    law: SampledStateSpace,
    Q: np.ndarray,
    sensor: np.ndarray,
    nz: int,
    weights: LQGWeights,
) -> _SampledLoop:
    nu, ny = law.D.shape
    closed = feedback(held, law, range(nu), range(nz, nz + ny))
    into = closed.B[:, nu:]
    noise = into @ sensor @ into.T
    noise[: len(Q), : len(Q)] += Q
    W, R = weights.output[:, None], np.sqrt(weights.input)[:, None]
    through = closed.D[nz + ny :, nu:]
    return _SampledLoop(
        A=closed.A,
        Q=noise,
        outputs=W * closed.C[:nz],
        inputs=R * closed.C[nz + ny :],
        input_noise=weights.input * np.sum((through @ sensor) * through, axis=1),
    )


def delay_at_the_hold(plant: Plant, period_s: float) -> tuple[Plant, float]:
    """Split off the delay common to all measurements or commands, to be applied exactly behind the hold.

    Delays of measurements and of commands are equivalent to a compensator. Further delays of single paths are
    approximated with an order that keeps every mode's phase, or dropped where far below a period, because
    such fast states would only cost digits.
    """
    if not plant.delayed:
        return plant, 0.0
    delay_s = plant.delay_s.copy()
    rows, columns = plant.output_indices(plant.y), plant.input_indices(plant.u)
    shared = sorted(set(plant.y) & set(plant.z)), sorted(set(plant.u) & set(plant.w))
    of_y = 0.0 if shared[0] else float(delay_s[rows].min(initial=np.inf))
    delay_s[rows] -= of_y
    of_u = 0.0 if shared[1] else float(delay_s[:, columns].min(initial=np.inf))
    delay_s[:, columns] -= of_u
    grid = GRID * period_s
    rest = dataclasses.replace(plant, delay_s=np.maximum(grid * np.round(delay_s / grid), 0.0))
    return approximate_delays(rest, pade_order(phase_of_modes(rest))), of_y + of_u


def sampled_covariances(
    A: Float[np.ndarray, "loop state state"], Q: Float[np.ndarray, "loop state state"]
) -> tuple[Complex[np.ndarray, "loop state"], Float[np.ndarray, "loop state state"]]:
    """Poles, and the X of X = A X A' + Q by doubling (Smith 1968; ``inf`` where unstable)."""
    values = np.linalg.eigvals(A).astype(complex)
    X = np.full(A.shape, np.inf)
    stable = np.abs(values).max(axis=1, initial=0.0) < 1.0
    power, total = A[stable], Q[stable]
    for _ in range(DOUBLINGS if stable.any() else 0):
        more = power @ total @ np.swapaxes(power, 1, 2)
        total = total + more
        power = power @ power
        if np.linalg.norm(more) <= 1e-15 * np.linalg.norm(total):
            break
    X[stable] = total
    return values, X
