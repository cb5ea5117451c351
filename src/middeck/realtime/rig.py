"""The linear simulated rig: "hardware" for ground experiments, a plant with hold, delay and sensor noise.

One tick of the computer, in this order: (1) the outputs are sampled, noise included; (2) the law computes
its output from this very sample; (3) law and excitation are added and issued as the torque command, held
until the next tick. All time lost on the way is the rig's own delay.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.events import RunEvents
from middeck.realtime.law import Law, check_law, place_law
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.systems.feedback import feedback
from middeck.systems.plant import Plant
from middeck.systems.sampling import sample_dynamics
from middeck.systems.simulation import find_periodic_state, simulate
from middeck.systems.stability import growth_rates, is_stable
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record


@record(kw_only=True)
class LinearRig:
    """A sampled test article.

    Parameters
    ----------
    sampled:
        From torque command to sampled output, delay included.
    sample_hz:
        Sampling rate.
    noise_rms:
        Rms of the white noise at each sampled output.
    inputs, outputs:
        Its ports.
    """

    sampled: SampledStateSpace
    sample_hz: float
    noise_rms: Float[np.ndarray, " output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


@record(kw_only=True)
class Run:
    """What came of a closed-loop experiment.

    Parameters
    ----------
    record:
        The excitation (not the whole torque) and the outputs with their noise; None if the run diverged.
    control:
        What the law added, in the same samples; None if the run diverged.
    cause:
        Why there is no record: frequency and growth of the mode that diverges; empty for a good run.
    torque:
        What the motors gave for law and excitation together, where the rig has motors.
    events:
        Which limits were reached how often, where the rig has limits.
    partial:
        What was taken until the run was stopped, if it was.
    """

    record: Record | None
    control: Float[np.ndarray, "period sample input"] | None
    cause: str
    torque: Float[np.ndarray, "period sample input"] | None = None
    events: RunEvents | None = None
    partial: Record | None = None


def build_linear_rig(
    plant: Plant, *, sample_hz: float, delay_s: float, noise_rms: Float[np.ndarray, " output"]
) -> LinearRig:
    """The rig of ``plant`` with a total delay from torque command to sampled output.

    Half a sample of ``delay_s`` is the hold's own; the rest is true delay, in front of the plant. Raises
    `ConfigError` if less than that is left.
    """
    sampled = sample_dynamics(plant.rational, 1.0 / sample_hz, pure_delay(sample_hz, delay_s))
    return LinearRig(
        sampled=sampled, sample_hz=sample_hz, noise_rms=noise_rms, inputs=plant.inputs, outputs=plant.outputs
    )


def pure_delay(sample_hz: float, delay_s: float) -> float:
    """What is left of a total delay [s] without half a sample of hold; `ConfigError` if it is negative."""
    pure = delay_s - 0.5 / sample_hz
    # A rounding error below zero is zero.
    if pure < -1e-12:
        raise ConfigError(
            f"a total delay of {delay_s} s is less than the hold's own {0.5 / sample_hz} s at {sample_hz} Hz",
            hint="sample faster",
        )
    return max(pure, 0.0)


def run_open_loop(
    rig: LinearRig,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
) -> Record:
    """``periods`` steady periods of the response to one repeated period of ``excitation``."""
    start = find_periodic_state(rig.sampled, excitation)
    clean, _ = simulate(rig.sampled, excitation, start)
    noise = rng.standard_normal((periods, *clean.shape)) * rig.noise_rms
    u = np.broadcast_to(excitation, (periods, *np.shape(excitation)))
    return Record(
        sample_hz=rig.sample_hz,
        u=u[None],
        y=(clean + noise)[None],
        inputs=rig.inputs,
        outputs=rig.outputs,
        periodic=True,
        held=True,
    )


def close_sampled_loop(plant: SampledStateSpace, law: SampledStateSpace) -> SampledStateSpace:
    """The loop u = excitation + law(y + noise) in the order of this module's docstring.

    Inputs: excitation, then noise; outputs: the measured outputs (noise included), then the law's. States:
    the plant's, then the law's. Raises `ConfigError` for sizes or periods that do not fit, or for a
    plant that answers a command within the same sample.
    """
    inputs, outputs = plant.B.shape[1], len(plant.C)
    check_law(law, inputs, outputs, plant.period_s)
    if np.any(plant.D):
        raise ConfigError(
            "the rig answers within the sample in which it is commanded", hint="give it a delay"
        )
    closed = feedback(plant, law, range(inputs), range(outputs))
    D = closed.D.copy()
    D[:outputs, inputs:] += np.eye(outputs)
    return dataclasses.replace(closed, D=D)


def run_closed_loop(
    rig: LinearRig,
    law: Law,
    excitation: Float[np.ndarray, "sample input"],
    *,
    periods: int,
    rng: np.random.Generator,
    settle: int = 1,
) -> Run:
    """``periods`` periods of the loop under a repeated ``excitation`` at the control's own inputs.

    The first of ``settle`` unrecorded periods begins in the steady state without noise, so that only the
    noise has to settle. A loop that is unstable by its eigenvalues gives a `Run` with a cause. Raises
    `ConfigError` for a law as `place_law`.
    """
    placed = place_law(law, rig.inputs, rig.outputs, 1.0 / rig.sample_hz)
    loop = close_sampled_loop(rig.sampled, placed)
    if not is_stable(loop):
        return Run(record=None, control=None, cause=_explain(loop))
    outputs = len(rig.outputs)
    quiet = np.hstack([excitation, np.zeros((len(excitation), outputs))])
    state = find_periodic_state(loop, quiet)
    rows: list[np.ndarray] = []
    for period in range(settle + periods):
        noise = rng.standard_normal((len(excitation), outputs)) * rig.noise_rms
        row, state = simulate(loop, np.hstack([excitation, noise]), state)
        rows += [row] if period >= settle else []
    samples = np.array(rows)
    u = np.broadcast_to(excitation, (periods, *np.shape(excitation)))
    taken = Record(
        sample_hz=rig.sample_hz,
        u=u[None],
        y=samples[None, ..., :outputs],
        inputs=rig.inputs,
        outputs=rig.outputs,
        periodic=True,
        held=True,
    )
    return Run(record=taken, control=samples[..., outputs:], cause="")


def _explain(loop: SampledStateSpace) -> str:
    rates = growth_rates(loop)
    worst = rates[int(np.argmax(np.real(rates)))]
    return (
        f"diverged: {abs(worst.imag) / (2.0 * np.pi):.3g} Hz grows by a factor e in {1.0 / worst.real:.3g} s"
    )
