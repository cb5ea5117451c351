"""A simulated test article as hardware: torque commands in, samples out, and everything between that is real.

rig = build_hardware_rig(plant, motors={"pri_rel_z": Motor(5.0)}, sensors={"pri_in_z": Gyro(noise=2e-4)},
                         sample_hz=500.0, delay_s=0.01)
run = run_hardware_open_loop(rig, excitation, periods=3, rng=rng)

The order of a tick is that of `middeck.realtime.rig`. With neither limits nor real sensors it is that rig.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.computer import build_computer, integrators
from middeck.realtime.hybrid import (
    HybridBlock,
    HybridState,
    HybridSystem,
    Readout,
    simulate_hybrid,
    start_hybrid,
)
from middeck.realtime.hybrid_plant import HybridPlant, build_hybrid_plant
from middeck.realtime.motors import EXACT, Motor, gather_motors
from middeck.realtime.rig import LinearRig, pure_delay
from middeck.realtime.sensors import Encoder, Gyro, Sampler, Sensor, sensor_lag
from middeck.systems.joint_simulation import JointElements
from middeck.systems.plant import Plant
from middeck.systems.ports import Port
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record

BLOCK = 2048  # ticks simulated in one go; nothing depends on it


@record
class HardwareRig:
    """A sampled test article with its motors, sensors and joints; see `build_hardware_rig`."""

    plant: HybridPlant
    motors: tuple[Motor, ...]
    sensors: tuple[Sensor, ...]
    joints: tuple[JointElements, ...]
    sample_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


def build_hardware_rig(
    plant: Plant,
    *,
    motors: Mapping[str, Motor],
    sensors: Mapping[str, Sensor],
    sample_hz: float,
    delay_s: float,
    joints: Sequence[JointElements] = (),
    steps: int = 1,
) -> HardwareRig:
    """The rig of ``plant``, commanded at ``motors`` and read by ``sensors``: its ports are in their order.

    Parameters
    ----------
    motors, sensors:
        By the name of the plant's input, and of its output: an angle, of which a gyro reads the rate.
    delay_s:
        From torque command to sampled angle, for every sensor: half a sample of hold and the low-frequency
        lag of its filters are in it, the rest is true delay. What has no filter waits for the slowest.
    joints:
        Friction and gaps, at any joint of the plant; those need not be commanded.
    steps:
        Internal steps in a tick; more of them follow stiff joints closer, see `NonlinearRig`.

    Raises
    ------
    ConfigError
        If the filters alone are later than ``delay_s``; for unknown ports, a joint twice, no step, or a plant
        that answers a command at once.
    """
    if steps < 1:
        raise ConfigError(f"{steps} internal steps in a tick", hint="one or more")
    if not (0.0 < sample_hz < np.inf and 0.0 <= delay_s < np.inf):
        raise ConfigError(
            f"{sample_hz} samples a second, late by {delay_s} s", hint="a positive rate, a delay from zero"
        )
    if not motors or not sensors:
        raise ConfigError("a rig without motor or sensor", hint="name an input and an output of the plant")
    names = [j.torque for j in joints]
    if len(set(names)) < len(names):
        raise ConfigError("two entries for one joint", hint="put its elements in one tuple")
    lags = np.array([sensor_lag(s) for s in sensors.values()])
    slowest = float(lags.max(initial=0.0))
    late = pure_delay(sample_hz, delay_s)
    if late < slowest:
        raise ConfigError(
            f"a total delay of {delay_s} s is less than hold and filters take, "
            f"{slowest + 0.5 / sample_hz:.4g} s",
            hint="sample faster, or filter higher",
        )
    continuous = build_hybrid_plant(
        plant, inputs=tuple(motors), sensors=tuple(sensors.items()), joints=joints,
        period_s=1.0 / sample_hz, command_delay_s=late - slowest, wait_s=slowest - lags, steps=steps,
    )  # fmt: skip
    inputs = tuple(plant.inputs[i] for i in plant.input_indices(tuple(motors)))
    outputs = tuple(plant.outputs[i] for i in plant.output_indices(tuple(sensors)))
    return HardwareRig(
        continuous, tuple(motors.values()), tuple(sensors.values()), tuple(joints), sample_hz, inputs, outputs
    )


def connect_law(rig: HardwareRig, law: SampledStateSpace | None) -> HybridSystem:
    """The rig with a law in its computer, or with none."""
    period_s = 1.0 / rig.sample_hz
    return HybridSystem(
        rig.plant,
        build_computer(rig.sensors, law, len(rig.inputs), period_s),
        gather_motors(rig.motors, period_s),
        _readout(rig.sensors, period_s),
        rig.joints,
    )


def stream_hardware(
    rig: HardwareRig,
    law: SampledStateSpace | None,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    *,
    rest_s: float = 0.0,
) -> Iterator[HybridBlock]:
    """Run the rig on ``excitation`` as it comes, in constant memory; the law is off while it rests.

    With ``rest_s`` above zero the gyros' biases are measured at rest first, for that long.
    """
    start = measure_bias(rig, law, rest_s, rng)
    return simulate_hybrid(connect_law(rig, law), excitation, rng, start)


def measure_bias(
    rig: HardwareRig, law: SampledStateSpace | None, rest_s: float, rng: np.random.Generator
) -> HybridState:
    """Switch on and rest for ``rest_s``: where a run with ``law`` begins, gyro biases drawn and measured.

    The mean of the readings is taken for the bias and will be subtracted before the computer adds them up.
    """
    readout = _readout(rig.sensors, 1.0 / rig.sample_hz)
    bias = readout.bias * rng.standard_normal(len(rig.outputs))
    begin = start_hybrid(connect_law(rig, law), bias)
    ticks = round(rest_s * rig.sample_hz)
    if ticks < 1 or not readout.gyro.any():
        return begin
    idle = connect_law(rig, None)
    total = np.zeros(len(rig.outputs))
    state = start_hybrid(idle, bias)
    for block in simulate_hybrid(idle, cut_blocks(np.zeros((ticks, len(rig.inputs)))), rng, state):
        total += block.readings.sum(axis=0)
        state = block.state
    return HybridState(
        state.x, begin.computer, state.issued, state.momentum, state.joints, state.bias,
        np.where(readout.gyro, total / ticks, 0.0),
    )  # fmt: skip


def cut_blocks(
    excitation: Float[np.ndarray, "sample input"], size: int = BLOCK
) -> Iterator[Float[np.ndarray, "sample input"]]:
    """``excitation`` in blocks of ``size`` samples; the last may be shorter."""
    return (excitation[k : k + size] for k in range(0, len(excitation), size))


def linearise_rig(rig: HardwareRig) -> LinearRig:
    """The same rig without limits, steps, joints' torques and noise: for eigenvalues, not for a design.

    States: the continuous part's, then commands on their way, the latest first; and of a plant with
    rigid-body modes the sums of the gyros' samples, each a pole at one. Otherwise the sums are rows of the
    other states, see `gyro_sums`, and that pole, which nothing moves, is left out.
    """
    m, period_s = len(rig.inputs), 1.0 / rig.sample_hz
    A, B, read = _without_sums(rig)
    sums = integrators(rig.sensors, period_s)
    rows = gyro_sums(rig)
    p, n = len(rig.outputs), len(sums.A)
    if rows is not None:
        sampled = SampledStateSpace(A, B, sums.C @ rows + sums.D @ read, np.zeros((p, m)), period_s)
    else:
        sampled = SampledStateSpace(
            np.block([[A, np.zeros((len(A), n))], [sums.B @ read, sums.A]]),
            np.vstack([B, np.zeros((n, m))]),
            np.hstack([sums.D @ read, sums.C]),
            np.zeros((p, m)),
            period_s,
        )
    return LinearRig(sampled, rig.sample_hz, np.zeros(p), rig.inputs, rig.outputs)


def gyro_sums(rig: HardwareRig) -> Float[np.ndarray, "gyro state"] | None:
    """The sum of each gyro's samples as a row L of the other linear states; None with rigid-body modes.

    The sum s[k+1] = s[k] + T r[k] of a reading r = c x is L x with L (A - I) = T c, but for a constant. For
    L B = T c (A - I)^-1 B is the rate's gain at zero frequency: zero, for the angle comes to rest.
    """
    A, _, read = _without_sums(rig)
    left = A - np.eye(len(A))
    # 1e12: the frequency of the slowest mode in cycles a sample, squared, far above rounding.
    if len(A) and np.linalg.cond(left) > 1e12:
        return None
    return np.linalg.solve(left.T, (integrators(rig.sensors, 1.0 / rig.sample_hz).B @ read).T).T


def _without_sums(rig: HardwareRig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and the readings of the continuous part, followed by commands on their way."""
    plant, m = rig.plant, len(rig.inputs)
    states, depth = plant.angle.shape[1], plant.late + 1
    transition, window = np.eye(states), np.zeros((states, 2 * m))
    for step, drive in zip(plant.step, plant.drive, strict=True):
        transition, window = step[:states] @ transition, step[:states] @ window + drive[:states]
    size = states + depth * m
    A, B = np.zeros((size, size)), np.zeros((size, m))
    A[:states, :states] = transition
    for age, gain in ((depth, window[:, :m]), (depth - 1, window[:, m:])):
        if age:
            A[:states, states + (age - 1) * m : states + age * m] = gain
        else:
            B[:states] = gain
    B[states : states + m] = np.eye(m)
    for age in range(1, depth):
        here = states + age * m
        A[here : here + m, here - m : here] = np.eye(m)
    return A, B, np.hstack([plant.read, np.zeros((len(plant.read), depth * m))])


def _readout(sensors: Sequence[Sensor], period_s: float) -> Readout:
    step, reach, noise, bias, walk = np.zeros((5, len(sensors)))
    reach[:], step[:] = np.inf, EXACT
    for i, sensor in enumerate(sensors):
        match sensor:
            case Sampler():
                noise[i] = sensor.noise_rms
            case Encoder():
                step[i] = sensor.step
            case Gyro():
                step[i], reach[i] = sensor.resolution or EXACT, sensor.range
                bias[i], walk[i] = sensor.bias, sensor.bias_walk * np.sqrt(period_s)
                if np.isinf(sensor.anti_alias_hz):
                    noise[i] = sensor.noise / np.sqrt(period_s)
    gyro = np.array([isinstance(s, Gyro) for s in sensors], dtype=bool)
    return Readout(step, reach, noise, bias, walk, gyro)
