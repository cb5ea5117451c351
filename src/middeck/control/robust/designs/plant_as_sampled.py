"""A sampled plant in the w-plane, where a compensator sampled by Tustin's rule becomes continuous.

The inverse of Tustin's rule s = (2/T) (z - 1)/(z + 1) maps the exactly sampled plant to a continuous one
(Franklin, Powell and Workman 1998, section 7.4). Its loop with the continuous compensator has the mapped
poles of the sampled loop at any rate, so that a sampling rate is one more model of a design. The factor 1 +
(w T/2)^2 on spectra, which matters beyond half the rate only, is left out.
"""

import numpy as np

from middeck.control.law.partition import partition_modes
from middeck.control.robust.verification.sampled_loops import delay_at_the_hold
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, subsystem
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.state_space.statespace import StateSpace


def plant_as_sampled(plant: Plant, period_s: float) -> Plant:
    """The plant seen by a compensator sampled by Tustin's rule every ``period_s``, delay and hold exact.

    Disturbances are held over a period too and keep their intensity; their direct term to z (at half the
    rate) is left out, because white noise would make the cost infinite. Ports outside the groups y and z are
    dropped.

    Raises `ConfigError` where an input both disturbs and controls, or a mode lies at half the rate.

    >>> from middeck.signals.ports import Port
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> plant = Plant(dynamics=lag, inputs=(Port("u", "N"),), outputs=(Port("y", "m"),), w=(), u=("u",),
    ...     z=(), y=("y",))
    >>> round(float(plant_as_sampled(plant, 0.1).system.A[0, 0]), 4)  # -tanh(T/2) / (T/2)
    -0.9992
    """
    rest, delay_s = delay_at_the_hold(plant, period_s)
    active = partition_modes(rest).active
    shared = sorted(set(active.w) & set(active.u))
    if shared:
        raise ConfigError(f"{', '.join(shared)} is a disturbance and a control", hint="use separate ports")
    outputs = tuple(p for p in active.outputs if p.name in (*active.z, *active.y))
    inputs = tuple(p for p in active.inputs if p.name not in active.u)
    commands = tuple(p for p in active.inputs if p.name in active.u)
    rows = [p.name for p in outputs]
    slow = sample_dynamics(subsystem(active, [p.name for p in commands], rows), period_s, delay_s)
    noise = sample_dynamics(subsystem(active, [p.name for p in inputs], rows), period_s)
    B = np.zeros((len(slow.A), len(inputs) + len(commands)))
    B[: len(noise.A), : len(inputs)], B[:, len(inputs) :] = noise.B, slow.B
    system = _without_tustin(slow.A, B, slow.C, np.hstack([noise.D, slow.D]), period_s)
    D = system.D.copy()
    D[[n in active.z for n in rows], : len(inputs)] = 0.0
    return Plant(
        dynamics=StateSpace(system.A, system.B, system.C, D), inputs=(*inputs, *commands), outputs=outputs,
        w=active.w, u=active.u, z=active.z, y=active.y,
    )  # fmt: skip


def _without_tustin(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, period_s: float
) -> StateSpace:
    """The continuous system that Tustin's rule maps to this one."""
    unit, root = np.eye(len(A)), 2.0 / np.sqrt(period_s)
    if np.linalg.norm(unit + A, -2) < 1e-12:
        raise ConfigError(
            f"a mode lies at half the sample rate of {1.0 / period_s:g} Hz", hint="choose another rate"
        )
    inverse = np.linalg.inv(unit + A)
    into, out = root * inverse @ B, root * C @ inverse
    return StateSpace((2.0 / period_s) * (A - unit) @ inverse, into, out, D - C @ into / root)
