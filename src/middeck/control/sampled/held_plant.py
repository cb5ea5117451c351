"""Exact motion of a plant between samples under held inputs with true delays and white noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import driven_ports, measured_ports
from middeck.control.law.delay_order import approximation_order
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import LQGWeights, require_sizes, require_states
from middeck.control.sampled.period import Between, Segment, follow_period
from middeck.control.sampled.quadratic_integrals import spread_noise
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import SAME_DELAY_S, approximate_delays
from middeck.systems.plants.plant import Plant, name_states, remove_delays, subsystem
from middeck.systems.sampling.delayed_sampling import split_delays, tidy_samples
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

MOST_PERIODS = 200
"""Largest delay in periods (half a second at 400 Hz); a design costs the cube of the states."""


@record(kw_only=True)
class HeldPlant:
    """A plant under held inputs: between samples, and from sample to sample.

    Attributes:
        system: System from u to y. States: the plant's, then past inputs (by input, the latest first), then
            waiting measurements. y[k] is taken at the instant at which u[k] is issued.
        noise: Covariance added to the states by white process noise in one period.
        sensor: Variance of the noise on each sampled measurement: its intensity over the period.
        generator, segments: d/dt (x, inputs in force) = generator (x, inputs in force) within each segment.
        performance: z from (x, inputs in force).
        dwell: Mean covariance of x within the period due to the noise of this period alone.
        inputs, outputs, z: Ports u, y and z.
        state_names: Mode or part of each state of ``system``.
        unit: Units of the states of ``system``: in those of the plant they are unit * x.
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
    unit: Float[np.ndarray, " state"]
    inert: tuple[str, ...]


def hold_plant(plant: Plant, weights: LQGWeights, period_s: float) -> HeldPlant:
    """The plant with its inputs held over ``period_s``, under the noises of ``weights``.

    Delays are exact where each path is delayed by its input's delay plus its output's; further delays of
    single paths are approximated (`approximation_order`).

    Raises `ConfigError` for a period that is not positive, for weights that do not fit, for white noise that
    reaches z or y directly, whose samples are infinite, and for a plant without states.
    """
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"sampling period of {period_s} s", hint="positive and finite")
    _check_delays(plant, period_s)
    timed = place_delays(plant, weights.disturbed, weights.process)
    part = partition_modes(timed.plant)
    active = part.active
    _check(active, weights)
    require_states(len(active.system.A))
    control = subsystem(active, active.u, (*active.z, *active.y))
    noise = subsystem(active, weights.disturbed, active.y)
    between = Between(
        A=control.A,
        B=control.B,
        V=noise.B @ weights.process @ noise.B.T,
        C=control.C[len(active.z) :],
        D=control.D[len(active.z) :],
        delay_in=tidy_samples(timed.input_s / period_s),
        delay_out=tidy_samples(timed.output_s / period_s),
        period_s=period_s,
    )
    system, added, segments = follow_period(between)
    names = name_states(active)
    m = control.B.shape[1]
    generator = np.vstack([np.hstack([control.A, control.B]), np.zeros((m, len(names) + m))])
    nz = len(active.z)
    unit = np.ones(len(system.A))
    if part.unit is not None:
        unit[: len(names)] = part.unit
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
        unit=unit,
        inert=part.inert,
    )


def _check_delays(plant: Plant, period_s: float) -> None:
    longest = float(plant.delay_s.max(initial=0.0))
    if longest > MOST_PERIODS * period_s:
        raise ConfigError(
            f"a delay of {longest:g} s is {longest / period_s:.0f} periods of {period_s:g} s, a state each",
            hint=f"at most {MOST_PERIODS} periods: sample slower, and check that the delay is in seconds",
        )


def _check(plant: Plant, weights: LQGWeights) -> None:
    require_sizes(weights, plant)
    root = weights.process != 0.0
    for group, what in ((plant.z, "a performance output"), (plant.y, "a measurement")):
        if np.any(subsystem(plant, weights.disturbed, group).D @ root):
            raise ConfigError(
                f"process noise reaches {what} directly: a sample of white noise is infinite",
                hint="put a filter between them: filter_measurements, or a coloured disturbance",
            )


@record
class TimedPlant:
    """A plant with delayed inputs u and measurements y; the earliest measurement has no delay."""

    plant: Plant
    input_s: Float[np.ndarray, " u"]
    output_s: Float[np.ndarray, " y"]


def place_delays(plant: Plant, disturbed: Sequence[str], process: Float[np.ndarray, "w w"]) -> TimedPlant:
    """The plant with its delays at u and y, under white noise of intensity ``process`` on ``disturbed``.

    White noise and mean squares are invariant under a shift of time: delays of disturbances and of z drop
    out, and the delay common to all measurements moves to the inputs. Exact where each path is delayed by its
    input's delay plus its output's; further delays of single paths are approximated, with the order that the
    fastest mode needs.

    Raises `ConfigError` for correlated disturbances with different delays.
    """
    inside = remove_delays(plant)
    u, w = inside.input_indices(inside.u), inside.input_indices(disturbed)
    y, z = inside.output_indices(inside.y), inside.output_indices(inside.z)
    inputs, outputs = list(dict.fromkeys([*u, *w])), list(dict.fromkeys([*y, *z]))
    split = split_delays(plant.delay_s[np.ix_(outputs, inputs)])
    delay_in, delay_out = (
        dict(zip(inputs, split.input_s, strict=True)),
        dict(zip(outputs, split.output_s, strict=True)),
    )
    _check_disturbances(process, np.array([delay_in[i] for i in w]))
    if np.any(split.rest_s > SAME_DELAY_S):
        rest = np.zeros_like(plant.delay_s)
        rest[np.ix_(outputs, inputs)] = split.rest_s
        delayed = dataclasses.replace(plant, delay_s=rest)
        inside = approximate_delays(delayed, approximation_order(delayed))
    of_u, of_y = np.array([delay_in[i] for i in u]), np.array([delay_out[o] for o in y])
    common = float(of_y.min(initial=np.inf)) if len(of_y) else 0.0
    return TimedPlant(inside, of_u + common, of_y - common)


def _check_disturbances(process: np.ndarray, delay: np.ndarray) -> None:
    apart = np.abs(delay[:, None] - delay[None]) > SAME_DELAY_S
    if np.any(apart & (process != 0.0)):
        raise ConfigError(
            "correlated disturbances have different delays",
            hint="a diagonal process intensity, or one delay for these inputs",
        )
