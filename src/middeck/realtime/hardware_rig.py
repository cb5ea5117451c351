"""A simulated test article as hardware: torque commands in, samples out, and everything between that is real.

rig = build_hardware_rig(plant, motors={"pri_rel_z": Motor(5.0)}, sensors={"pri_in_z": Gyro(noise=2e-4)},
                         sample_hz=500.0, delay_s=0.01)
run = run_hardware_open_loop(rig, excitation, periods=3, rng=rng)

The order of a tick is that of `middeck.realtime.rig`. With neither limits nor real sensors it is that rig.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.joints.simulation import JointElements
from middeck.realtime.ageing import Ageing, plan_ageing, simulate_ageing
from middeck.realtime.computer import build_computer
from middeck.realtime.drift import Drift, age_plant
from middeck.realtime.hybrid import simulate_hybrid
from middeck.realtime.hybrid_plant import HybridPlant, Wiring, build_hybrid_plant
from middeck.realtime.hybrid_state import HybridBlock, HybridState, HybridSystem, start_hybrid
from middeck.realtime.law import Law, place_law
from middeck.realtime.motors import Motor, gather_motors
from middeck.realtime.readout import gather_readout
from middeck.realtime.rig import pure_delay
from middeck.realtime.sensors import Sensor, sensor_lag
from middeck.signals.ports import Port
from middeck.systems.plant import Plant
from middeck.systems.statespace import SampledStateSpace
from middeck.values import record

BLOCK = 2048  # ticks simulated in one go; nothing depends on it


@record(kw_only=True)
class HardwareRig:
    """A sampled test article with its motors, sensors and joints; see `build_hardware_rig`."""

    plant: HybridPlant
    motors: tuple[Motor, ...]
    sensors: tuple[Sensor, ...]
    joints: tuple[JointElements, ...]
    sample_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    ageing: Ageing | None = None


def build_hardware_rig(
    plant: Plant,
    *,
    motors: Mapping[str, Motor],
    sensors: Mapping[str, Sensor],
    sample_hz: float,
    delay_s: float,
    joints: Sequence[JointElements] = (),
    steps: int = 1,
    drifts: Sequence[Drift] = (),
    age_s: float = 0.0,
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
    drifts, age_s:
        Modes that drift while it runs, and how old the plant is whenever it is switched on; ``plant`` is as
        new.

    Raises
    ------
    ConfigError
        If the filters alone take more than ``delay_s``; for unknown ports, a joint twice, no step, or a plant
        that answers a command at once; for drifts as `age_plant`.
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
    wiring = Wiring(
        inputs=tuple(motors),
        sensors=tuple(sensors.items()),
        joints=tuple(joints),
        period_s=1.0 / sample_hz,
        steps=steps,
        command_delay_s=late - slowest,
        wait_s=slowest - lags,
    )
    continuous = build_hybrid_plant(age_plant(plant, drifts, age_s), wiring)
    inputs = tuple(plant.inputs[i] for i in plant.input_indices(tuple(motors)))
    outputs = tuple(plant.outputs[i] for i in plant.output_indices(tuple(sensors)))
    return HardwareRig(
        plant=continuous,
        motors=tuple(motors.values()),
        sensors=tuple(sensors.values()),
        joints=tuple(joints),
        sample_hz=sample_hz,
        inputs=inputs,
        outputs=outputs,
        ageing=plan_ageing(plant, drifts, age_s, wiring),
    )


def law_on_rig(rig: HardwareRig, law: Law | None) -> SampledStateSpace | None:
    """`place_law` on the rig's ports, or no law."""
    return None if law is None else place_law(law, rig.inputs, rig.outputs, 1.0 / rig.sample_hz)


def connect_law(rig: HardwareRig, law: SampledStateSpace | None) -> HybridSystem:
    """The rig with a law in its computer, or with none."""
    period_s = 1.0 / rig.sample_hz
    return HybridSystem(
        plant=rig.plant,
        computer=build_computer(rig.sensors, law, len(rig.inputs), period_s),
        motors=gather_motors(rig.motors, period_s),
        readout=gather_readout(rig.sensors, period_s),
        joints=rig.joints,
    )


def simulate_rig(
    rig: HardwareRig,
    law: SampledStateSpace | None,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    start: HybridState,
) -> Iterator[HybridBlock]:
    """`simulate_hybrid` of the rig with a law or none, drifting if it drifts."""
    system = connect_law(rig, law)
    if rig.ageing is None:
        return simulate_hybrid(system, excitation, rng, start)
    return simulate_ageing(system, rig.ageing, excitation, rng, start)


def stream_hardware(
    rig: HardwareRig,
    law: Law | None,
    excitation: Iterable[Float[np.ndarray, "sample input"]],
    rng: np.random.Generator,
    *,
    rest_s: float = 0.0,
) -> Iterator[HybridBlock]:
    """Run the rig on ``excitation`` as it comes, in constant memory; the law is off while it rests.

    With ``rest_s`` above zero the gyros' biases are measured at rest first, for that long. Raises
    `ConfigError` for a law as `place_law`.
    """
    placed = law_on_rig(rig, law)
    return simulate_rig(rig, placed, excitation, rng, measure_bias(rig, placed, rest_s, rng))


def measure_bias(
    rig: HardwareRig, law: SampledStateSpace | None, rest_s: float, rng: np.random.Generator
) -> HybridState:
    """Switch on and rest for ``rest_s``: where a run with ``law`` begins, gyro biases drawn and measured.

    The mean of the readings is taken for the bias and will be subtracted before the computer adds them up.
    Raises `ConfigError` for a rest that is negative or has no end.
    """
    if not 0.0 <= rest_s < np.inf:
        raise ConfigError(f"a rest of {rest_s} s", hint="finite, from zero")
    readout = gather_readout(rig.sensors, 1.0 / rig.sample_hz)
    bias = readout.bias * rng.standard_normal(len(rig.outputs))
    begin = start_hybrid(connect_law(rig, law), bias)
    ticks = round(rest_s * rig.sample_hz)
    if ticks < 1 or not readout.gyro.any():
        return dataclasses.replace(begin, tick=ticks)
    total = np.zeros(len(rig.outputs))
    state = start_hybrid(connect_law(rig, None), bias)
    for block in simulate_rig(rig, None, cut_blocks(np.zeros((ticks, len(rig.inputs)))), rng, state):
        total += block.readings.sum(axis=0)
        state = block.state
    trim = np.where(readout.gyro, total / ticks, 0.0)
    return dataclasses.replace(state, computer=begin.computer, trim=trim)


def cut_blocks(
    excitation: Float[np.ndarray, "sample input"], size: int = BLOCK
) -> Iterator[Float[np.ndarray, "sample input"]]:
    """``excitation`` in blocks of ``size`` samples; the last may be shorter."""
    return (excitation[k : k + size] for k in range(0, len(excitation), size))
