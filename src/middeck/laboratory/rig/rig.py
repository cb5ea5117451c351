"""The simulated rig: torque commands in, samples out, and the active hardware between.

rig = build_rig(plant, sample_hz=500.0, delay_s=0.01, motors={"pri_rel_z": Motor(5.0)},
                sensors={"pri_in_z": Gyro(noise=2e-4)})
run = run_open_loop(rig, excitation, periods=3, rng=rng)

One tick of the computer, in this order: (1) the outputs are sampled, noise included; (2) the compensator
computes its output from this very sample; (3) this and the excitation are added and issued as the torque
command, held until the next tick. All time lost on the way is the rig's own delay.
"""

import functools
from collections.abc import Mapping, Sequence

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.laboratory.rig.parts.converters import Readout, gather_readout
from middeck.laboratory.rig.parts.motors import Motor, MotorBank, gather_motors
from middeck.laboratory.rig.parts.sensors import Sampler, Sensor, sensor_lag
from middeck.laboratory.rig.plant.ageing import Ageing, plan_ageing
from middeck.laboratory.rig.plant.drifting_modes import Drift, age_plant
from middeck.laboratory.rig.plant.hybrid_plant import HybridPlant, Wiring, build_hybrid_plant
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.values import record


@record(kw_only=True)
class Rig:
    """A sampled test article with its motors, sensors and joints; see `build_rig`."""

    plant: HybridPlant
    motors: tuple[Motor, ...]
    sensors: tuple[Sensor, ...]
    joints: tuple[JointElements, ...]
    sample_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    ageing: Ageing | None

    @property
    def period_s(self) -> float:
        """A tick [s]."""
        return 1.0 / self.sample_hz

    @functools.cached_property
    def linear(self) -> bool:
        """Whether no nonlinear part is active: motors without limits, samplers, no joints and no drift."""
        plain = all(m == Motor() for m in self.motors) and all(isinstance(s, Sampler) for s in self.sensors)
        return plain and not self.joints and self.ageing is None

    @functools.cached_property
    def bank(self) -> MotorBank:
        """The limits of all motors."""
        return gather_motors(self.motors, self.period_s)

    @functools.cached_property
    def readout(self) -> Readout:
        """Steps, ranges and errors of all converters and encoders."""
        return gather_readout(self.sensors, self.period_s)


@named_kinds
def build_rig(
    plant: Plant,
    *,
    sample_hz: float,
    delay_s: float,
    motors: Mapping[str, Motor] | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    joints: Sequence[JointElements] = (),
    substeps: int = 1,
    drifts: Sequence[Drift] = (),
    age_s: float = 0.0,
) -> Rig:
    """The rig of ``plant``, commanded at ``motors`` and read by ``sensors``: its ports are in their order.

    Args:
        delay_s: Delay [s] from torque command to sampled output of every sensor: half a sample of hold and
            the low-frequency lag of its filters are in it, the rest is true delay. A sample without a filter
            waits for the slowest.
        motors, sensors: Motors by the plant's input, and sensors by its output: an angle, of which a gyro
            reads the rate. If left out: all inputs with motors without limits, and all outputs sampled
            without noise.
        joints: Friction and gaps, at any joint of the plant; those need not be commanded.
        substeps: Integration steps, of length h, in a tick. They lower the frequency w of a mode that the
            joints' elements alone would hold by (w h)^2/12 of itself; without elements the rig is exact.
        drifts, age_s: Modes that drift while it runs, and how old the plant is whenever it is switched on;
            ``plant`` is as new.

    Raises `ConfigError` if the filters alone take more than ``delay_s``; for unknown ports, a joint twice, no
    substep, or an output that responds at once to the command computed from its own sample; for drifts as
    `age_plant`.
    """
    if substeps != int(substeps) or substeps < 1:
        raise ConfigError(f"{substeps} substeps in a tick", hint="a whole number from one")
    if not (0.0 < sample_hz < np.inf and 0.0 <= delay_s < np.inf):
        raise ConfigError(
            f"{sample_hz} samples a second, a delay of {delay_s} s", hint="a positive rate, a delay from zero"
        )
    motors = {p.name: Motor() for p in plant.inputs} if motors is None else motors
    sensors = {p.name: Sampler() for p in plant.outputs} if sensors is None else sensors
    if not motors or not sensors:
        raise ConfigError("a rig without motor or sensor", hint="name an input and an output of the plant")
    lags = np.array([sensor_lag(s) for s in sensors.values()])
    slowest, hold = float(lags.max()), 0.5 / sample_hz
    pure = delay_s - hold - slowest
    # A rounding error below zero is zero.
    if pure < -1e-12:
        raise ConfigError(
            f"a total delay of {delay_s} s is less than hold and filters take, {hold + slowest:.4g} s",
            hint="sample faster, or filter higher",
        )
    wiring = Wiring(
        inputs=tuple(motors), sensors=tuple(sensors.items()), joints=tuple(joints), period_s=1.0 / sample_hz,
        substeps=int(substeps), command_delay_s=max(pure, 0.0), wait_s=slowest - lags,
    )  # fmt: skip
    return Rig(
        plant=build_hybrid_plant(age_plant(plant, drifts, age_s), wiring),
        motors=tuple(motors.values()),
        sensors=tuple(sensors.values()),
        joints=tuple(joints),
        sample_hz=sample_hz,
        inputs=tuple(plant.inputs[i] for i in plant.input_indices(tuple(motors))),
        outputs=tuple(plant.outputs[i] for i in plant.output_indices(tuple(sensors))),
        ageing=plan_ageing(plant, drifts, age_s, wiring),
    )
