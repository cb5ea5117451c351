"""The engine's sample in Python around the reference law, for machines without a compiler."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.engine.settings import LEAST_RAMP, EngineSettings
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.reference import ReferenceLaw, SectionState
from middeck.signals.ports import Port


class ReferenceLoop:
    """Sensors' ranges and envelopes, hold, law with its fade, limits, effort: one sample a call.

    It holds outputs at zero from the sample of a trip on. Tests of stuck sensors and of spread, monitors,
    momentum and everything with a clock are the engine's alone.

    Attributes:
        wanted: What the law would add at full authority.
        trip, blamed: What tripped, empty for none; whether the package is to blame.

    Raises `ConfigError` for a package of another rate, or with a port that the settings lack.
    """

    def __init__(self, package: ControllerPackage, settings: EngineSettings) -> None:
        if abs(package.period_s - settings.period_s) > 1e-9 * settings.period_s:
            raise ConfigError("a package of another sampling rate", hint=f"{1.0 / settings.period_s:g} Hz")
        ramp = max(package.ramp, settings.samples(settings.ramp_s), LEAST_RAMP)
        self.settings = settings
        self.law = ReferenceLaw(
            dataclasses.replace(package, ramp=ramp, vectors=None), fast=not package.single
        )
        self.inputs = _places(package.inputs, settings.inputs)
        self.outputs = _places(package.outputs, settings.outputs)
        self.hold = [(path.input, path.output, SectionState(path.section)) for path in settings.hold]
        self.range, self.envelope = (
            np.array([getattr(sensor, name) for sensor in settings.sensors]) for name in ("range", "envelope")
        )
        self.lower, self.upper, slew = (
            np.array([getattr(drive, name) for drive in settings.drives])
            for name in ("lower", "upper", "slew_rate")
        )
        self.slew, self.last = slew * settings.period_s, np.zeros(len(settings.drives))
        self.wanted = np.zeros(len(settings.drives))
        self.top, self.engaged, self.count = 0, False, 0
        half = settings.samples(settings.effort_s) // 2
        self.half, self.effort, self.before = half, np.zeros(len(self.last)), np.zeros(len(self.last))
        self.trip, self.blamed = "", False

    def begin(self, engaged: bool, share: float) -> None:
        """Rise to a share of full authority, or stand by."""
        self.engaged = self.law.engaged = engaged
        self.top = math.ceil(share * self.law.package.ramp)

    def sample(self, y: Float[np.ndarray, " sensor"]) -> Float[np.ndarray, " output"]:
        """The outputs for the sensors ``y``."""
        if not self.trip:
            self._look(y)
        if self.trip:
            return np.zeros(len(self.last))
        held = np.zeros(len(self.last))
        for sensor, output, section in self.hold:
            held[output] += section.step(y[sensor])
        command = self.law.compute(y[self.inputs]) if self.engaged else self._standing_by(y)
        self.wanted = np.zeros(len(self.last))
        self.wanted[self.outputs] = self.law.wanted
        total = held.copy()
        total[self.outputs] += command
        near = np.clip(total, self.last - self.slew, self.last + self.slew)
        u = np.clip(near, self.lower, self.upper)
        self.law.commit((u - held)[self.outputs])
        self.law.level = min(self.law.level, self.top)
        self._count_effort(u)
        self.last, self.count = u, self.count + 1
        return u

    def _standing_by(self, y: np.ndarray) -> np.ndarray:
        return 0.0 * self.law.compute(y[self.inputs])

    def _look(self, y: np.ndarray) -> None:
        for what, wrong, limit in (
            ("not finite", ~np.isfinite(y), 0.0 * self.range),
            ("range", np.abs(y) > self.range, self.range),
            ("envelope", np.abs(y) > self.envelope, self.envelope),
        ):
            for i in np.flatnonzero(wrong)[:1].tolist():
                self._blame(
                    what, self.settings.inputs[i].name, float(y[i]), float(limit[i]), what == "envelope"
                )
                return

    def _count_effort(self, u: np.ndarray) -> None:
        if not self.half:
            return
        self.effort += (u <= self.lower) | (u >= self.upper)
        share = (self.effort + self.before) / (2.0 * self.half)
        for i in np.flatnonzero(share > self.settings.effort_share)[:1].tolist():
            self._blame(
                "effort", self.settings.outputs[i].name, float(share[i]), self.settings.effort_share, True
            )
        if (self.count + 1) % self.half == 0:
            self.before, self.effort = self.effort, np.zeros(len(u))

    def _blame(self, what: str, channel: str, value: float, limit: float, law: bool) -> None:
        at_s = self.count * self.settings.period_s
        self.trip = f"{what} {channel} at {at_s:.4g} s: {value:.4g}, limit {limit:.4g}"
        self.blamed = law and (self.engaged or self.law.level > 0)


def _places(ports: tuple[Port, ...], there: tuple[Port, ...]) -> list[int]:
    known = {(port.name, port.unit): k for k, port in enumerate(there)}
    lacking = [port.name for port in ports if (port.name, port.unit) not in known]
    if lacking:
        raise ConfigError(
            f"a port that the computer lacks, or has in another unit: {', '.join(lacking)}",
            hint=", ".join(f"{port.name} [{port.unit}]" for port in there),
        )
    return [known[port.name, port.unit] for port in ports]
