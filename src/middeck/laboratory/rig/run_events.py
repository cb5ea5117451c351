"""Events of a run besides its samples: saturation, full rotors, clipped readings, a stop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.laboratory.rig.rig import Rig
from middeck.laboratory.rig.ticks.state import RigBlock
from middeck.signals.ports import Port, port_indices
from middeck.values import record

FULL = 1.0 - 1e-9  # share of a limit from which it counts as reached, for rounding


@record(kw_only=True)
class RunEvents:
    """Shares of the ticks in which a limit was reached, settling included.

    Attributes:
        saturated, slewed, rotor_full: Each input at its torque limit, at its slew limit, with its rotor at
            full speed.
        clipped: Each output at the end of its converter's range.
        peak_speed_rad_s: Largest rotor speed of each input; zero without a rotor.
        stopped_s: When the run was stopped, from its beginning; None where it was not.
    """

    saturated: Float[np.ndarray, " input"]
    slewed: Float[np.ndarray, " input"]
    rotor_full: Float[np.ndarray, " input"]
    clipped: Float[np.ndarray, " output"]
    peak_speed_rad_s: Float[np.ndarray, " input"]
    stopped_s: float | None = None


@record
class StopRule:
    """Stops a run at the first sample of output ``name``, as measured, beyond ``limit`` to either side."""

    name: str
    limit: float

    def __post_init__(self) -> None:
        if not self.limit > 0.0:
            raise ConfigError(f"a stop of {self.name!r} at {self.limit}", where="StopRule", hint="above zero")


def stop_limits(rules: Sequence[StopRule], outputs: Sequence[Port]) -> Float[np.ndarray, " output"]:
    """The tightest limit of each output, infinite without a rule; `ConfigError` for an unknown output."""
    limits = np.full(len(outputs), np.inf)
    for rule in rules:
        at = port_indices(outputs, [rule.name], "output")[0]
        limits[at] = min(limits[at], rule.limit)
    return limits


def find_stop(measured: Float[np.ndarray, "sample output"], limits: np.ndarray) -> tuple[int, int] | None:
    """The first sample beyond its limit, and the number of its output; None if all stay within."""
    beyond = np.abs(measured) > limits
    if not beyond.any():
        return None
    sample = int(np.argmax(beyond.any(axis=1)))
    return sample, int(np.argmax(beyond[sample]))


class EventCounter:
    """Adds up the events of a run, block by block."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._ticks = rig, 0
        m, p = len(rig.inputs), len(rig.outputs)
        self._saturated, self._slewed, self._full = np.zeros((3, m))
        self._clipped, self._speed = np.zeros(p), np.zeros(m)

    def add(self, block: RigBlock, before: Float[np.ndarray, " input"]) -> None:
        """Count one block; ``before`` is the torque issued just before it."""
        motors, readout = self._rig.bank, self._rig.readout
        torque = block.torque
        self._ticks += len(torque)
        at_limit = (torque >= motors.upper * FULL) | (torque <= motors.lower * FULL)
        self._saturated += at_limit.sum(axis=0)
        step = np.abs(np.diff(torque, axis=0, prepend=before[None]))
        self._slewed += (step >= motors.slew * FULL).sum(axis=0)
        full = np.abs(block.momentum) >= motors.momentum * FULL
        self._full += full.sum(axis=0)
        self._clipped += (np.abs(block.readings) >= readout.range * FULL).sum(axis=0)
        for i, motor in enumerate(self._rig.motors):
            if motor.rotor is not None:
                impulse = float(np.abs(block.momentum[:, i]).max(initial=0.0)) * self._rig.period_s
                self._speed[i] = max(self._speed[i], impulse / motor.rotor.inertia)

    def total(self, stopped_s: float | None = None) -> RunEvents:
        """Totals of all events counted."""
        ticks = max(self._ticks, 1)
        return RunEvents(
            saturated=self._saturated / ticks,
            slewed=self._slewed / ticks,
            rotor_full=self._full / ticks,
            clipped=self._clipped / ticks,
            peak_speed_rad_s=self._speed,
            stopped_s=stopped_s,
        )
