"""Exact motion of a plant between samples under held inputs with true delays and white noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import driven_ports, measured_ports
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import LQGWeights, require_size
from middeck.control.sampled.period import Between, Segment, follow_period
from middeck.control.sampled.placed_delays import place_delays
from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, name_states, subsystem
from middeck.systems.sampling.delayed_sampling import tidy_samples
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

MOST_LATE = 200
"""Largest delay in periods (half a second at 400 Hz); a design costs the cube of the states."""


@record(kw_only=True)
class HeldPlant:
    """A plant under held inputs: between samples, and from sample to sample.

    Attributes:
        system: From u to y. States: the plant's, then past inputs (input by input, the latest first), then
            waiting measurements. y[k] is taken at the instant at which u[k] is issued.
        noise: Covariance added to the states by white process noise in one period.
        sensor: Variance of the noise on each sampled measurement: its intensity over the period.
        generator, segments: d/dt (x, inputs in force) = generator (x, inputs in force) within each segment.
        performance: z from (x, inputs in force).
        dwell: Mean covariance of x within the period due to the noise of this period alone.
        inputs, outputs, z: Ports u, y and z.
        state_names: Mode or part of each state of ``system``.
        inert: Uncontrollable and unobservable modes, left out.
    """

    system: SampledStateSpace
    noise: Float[np.ndarray, "state state"]
    sensor: Float[np.ndarray, " y"]
    generator: Float[np.ndarray, "held held"]
    segments: tuple[Segment, ...]
    performance: Float[np.ndarray, "z held"]
    dwell: Float[np.ndarray, "x x"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    z: tuple[Port, ...]
    state_names: tuple[str, ...]
    inert: tuple[str, ...]


def hold_plant(plant: Plant, weights: LQGWeights, period_s: float) -> HeldPlant:
    """The plant with its inputs held over ``period_s``, under the noises of ``weights``.

    Delays are exact where each path is delayed by its input's delay plus its output's; further delays of
    single paths are approximated (`approximation_order`).

    Raises `ConfigError` for a period that is not positive, for weights that do not fit, and for white noise
    that reaches z or y directly: its samples are infinite.
    """
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"sampling period of {period_s} s", hint="positive and finite")
    _check_delays(plant, period_s)
    timed = place_delays(plant, weights.disturbed, weights.process)
    part = partition_modes(timed.plant)
    active = part.active
    _check(active, weights)
    control = subsystem(active, active.u, (*active.z, *active.y))
    noise = subsystem(active, weights.disturbed, active.y)
    between = Between(
        A=control.A,
        B=control.B,
        V=noise.B @ weights.process @ noise.B.T,
        C=control.C[len(active.z) :],
        D=control.D[len(active.z) :],
        late_in=tidy_samples(timed.input_s / period_s),
        late_out=tidy_samples(timed.output_s / period_s),
        period_s=period_s,
    )
    system, added, segments = follow_period(between)
    names = name_states(active)
    m = control.B.shape[1]
    generator = np.vstack([np.hstack([control.A, control.B]), np.zeros((m, len(names) + m))])
    nz = len(active.z)
    return HeldPlant(
        system=system,
        noise=added,
        sensor=weights.sensor / period_s,
        generator=generator,
        segments=segments,
        performance=np.hstack([control.C[:nz], control.D[:nz]]),
        dwell=spread_noise(control.A, between.V, period_s).dwell / period_s,
        inputs=driven_ports(active),
        outputs=measured_ports(active),
        z=tuple(active.outputs[i] for i in active.output_indices(active.z)),
        state_names=(*names, *("delay",) * (len(system.A) - len(names))),
        inert=part.inert,
    )


def _check_delays(plant: Plant, period_s: float) -> None:
    longest = float(plant.delay_s.max(initial=0.0))
    if longest > MOST_LATE * period_s:
        raise ConfigError(
            f"a delay of {longest:g} s is {longest / period_s:.0f} periods of {period_s:g} s, a state each",
            hint=f"at most {MOST_LATE} periods: sample slower, and check that the delay is in seconds",
        )


def _check(plant: Plant, weights: LQGWeights) -> None:
    require_size("output weights", len(weights.output), plant.z)
    require_size("input weights", len(weights.input), plant.u)
    require_size("sensor intensities", len(weights.sensor), plant.y)
    root = weights.process != 0.0
    for group, what in ((plant.z, "a performance output"), (plant.y, "a measurement")):
        if np.any(subsystem(plant, weights.disturbed, group).D @ root):
            raise ConfigError(
                f"process noise reaches {what} directly: a sample of white noise is infinite",
                hint="put a filter between them: filter_measurements, or a coloured disturbance",
            )
