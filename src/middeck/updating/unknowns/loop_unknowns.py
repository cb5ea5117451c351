"""Unknowns of the loop beside the article: its delay, and the gains of its sensors and motors."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.values import record

LOOP = "loop."
DELAY, SENSOR, MOTOR = "loop.delay_s", "loop.sensor_gain.", "loop.motor_gain."


def check_loop_unknown(name: str, parameters: Sequence[str], added: bool) -> None:
    """Raise `ConfigError` for a name that no loop has, and a factor where a sum is meant, or a sum."""
    where = f"unknown {name!r}"
    for parameter in parameters:
        if not parameter.startswith(LOOP):
            what = "parameters of the loop and of the article together"
            raise ConfigError(what, where=where, hint="an unknown for each")
        if parameter != DELAY and not parameter.startswith((SENSOR, MOTOR)):
            raise ConfigError(
                f"a loop has no {parameter}", where=where, hint=f"{DELAY}, {SENSOR}NAME or {MOTOR}NAME"
            )
        if added != (parameter == DELAY):
            what = "is added to, in seconds" if parameter == DELAY else "is a factor"
            raise ConfigError(
                f"{parameter} {what}", where=where, hint=f"added = {str(parameter == DELAY).lower()}"
            )


@record
class LoopSlopes:
    """Which unknowns move the delay, and the gain of each output and input: one or zero."""

    delay: Float[np.ndarray, " unknown"]
    output: Float[np.ndarray, "output unknown"]
    input: Float[np.ndarray, "input unknown"]

    @property
    def any(self) -> np.ndarray:
        """Whether each unknown moves anything here."""
        return (np.vstack([self.delay, self.output, self.input]) != 0.0).any(axis=0)


def loop_slopes(
    unknowns: Sequence[Sequence[str]], inputs: Sequence[str], outputs: Sequence[str]
) -> LoopSlopes:
    """Derivatives by unknowns, named by their parameters; an angle and its rate are one sensor's."""
    sensors = [f"{SENSOR}{name.removesuffix(RATE)}" for name in outputs]
    motors = [f"{MOTOR}{name}" for name in inputs]

    def moved(names: Sequence[str]) -> np.ndarray:
        rows = [[any(fnmatchcase(n, p) for p in own) for own in unknowns] for n in names]
        return np.array(rows, dtype=float).reshape(len(names), len(unknowns))

    return LoopSlopes(moved([DELAY])[0], moved(sensors), moved(motors))
