"""The engine's sample in Python around the reference law, for machines without a compiler."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.commands import REASONS
from middeck.realtime.engine.interface.settings import EngineSettings
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.reference import ReferenceLaw, SectionState, fade_at
from middeck.signals.ports import Port


class ReferenceLoop:
    """Sensors' ranges and envelopes, hold, law with its fade, limits, effort: one sample a call.

    It begins where the engine is after a reset, and holds outputs at zero from the sample of a trip on. Tests
    of stuck sensors and of spread, monitors, momentum, the adaptive gain and everything with a clock are the
    engine's alone: settings that ask for one of the former are refused.

    Attributes:
        wanted: What the law would add at full authority.
        trip, blamed: What tripped, empty for none; whether the package is to blame.

    Raises `ConfigError` for a package of another rate, or with a port that the settings lack, and for
    settings with tests that it does not run.
    """

    def __init__(self, package: ControllerPackage, settings: EngineSettings) -> None:
        if abs(package.period_s - settings.period_s) > 1e-9 * settings.period_s:
            raise ConfigError("a package of another sampling rate", hint=f"{1.0 / settings.period_s:g} Hz")
        _require_known_tests(settings)
        self.settings, self.ramp = settings, settings.fade_samples[0]
        ramp = max(package.ramp, self.ramp)
        self.law = ReferenceLaw(
            dataclasses.replace(package, ramp=ramp, vectors=None), fast=not package.single
        )
        self.inputs = _places(package.inputs, settings.inputs)
        self.outputs = _places(package.outputs, settings.outputs)
        self.hold = [(path.input, path.output, SectionState(path.section)) for path in settings.hold]
        self.sensors, self.good = _Sensors(settings), np.zeros(len(settings.sensors))
        self.limits = _Limits(
            np.array([drive.lower for drive in settings.drives]),
            np.array([drive.upper for drive in settings.drives]),
            np.array([drive.slew_rate for drive in settings.drives]) * settings.period_s,
        )
        self.last, self.effort, self.wanted = np.zeros((3, len(settings.drives)))
        seconds = settings.effort_s
        self.forget = -math.expm1(-settings.period_s / seconds) if seconds else 0.0
        self.top, self.engaged, self.count = 0, False, 0
        self.trip, self.blamed = "", False

    def begin(self, engaged: bool, share: float) -> str:
        """Rise to a share of full authority, or stand by; why not, where the hold still rises."""
        if engaged and self.hold and self.count < self.ramp:
            return REASONS["not ready"]
        self.engaged = self.law.engaged = engaged
        self.top = math.ceil(share * self.law.package.ramp)
        return ""

    def sample(self, y: Float[np.ndarray, " sensor"]) -> Float[np.ndarray, " output"]:
        """The outputs for the sensors ``y``."""
        if not self.trip:
            self._look(y)
        if self.trip:
            return np.zeros(len(self.last))
        held, command = self._held(y), self._command(y)
        if self.trip:
            return np.zeros(len(self.last))
        total = held.copy()
        total[self.outputs] += command
        u = self.limits.keep(total, self.last)
        whole = (u == total)[self.outputs]
        self._count_effort(u, command)
        self.law.commit(np.where(whole, command, (u - held)[self.outputs]))
        self.law.level = min(self.law.level, self.top)
        self.last, self.count = u, self.count + 1
        return u

    def _held(self, y: np.ndarray) -> np.ndarray:
        """The hold, which rises after a reset."""
        held, part = np.zeros(len(self.last)), min(self.count / self.ramp, 1.0)
        for sensor, output, section in self.hold:
            held[output] += section.step(y[sensor])
        return fade_at(part) * held

    def _command(self, y: np.ndarray) -> np.ndarray:
        """The law's command: zero while it stands by."""
        command = self.law.compute(y[self.inputs])
        self.wanted = np.zeros(len(self.last))
        self.wanted[self.outputs] = self.law.wanted
        if not np.isfinite(self.law.wanted).all():
            self._blame(
                "command not finite", self.law.package.outputs[0].name, float(self.law.wanted[0]), 0.0, True
            )
        return command if self.engaged else 0.0 * command

    def _look(self, y: np.ndarray) -> None:
        found = self.sensors.look(y)
        if found is not None:
            what, place, value, limit = found
            driven = abs(self.good[place]) > 0.5 * self.sensors.range[place]
            law = self.law.level > 0 and (what == "envelope" or (what == "range" and driven))
            self._blame(what, self.settings.inputs[place].name, value, limit, bool(law))
        self.good = y

    def _count_effort(self, u: np.ndarray, command: np.ndarray) -> None:
        share = self.limits.taken(u, self.last)
        if self.law.level > 0:
            own = _Limits(self.law.lower, self.law.upper, self.law.slew).taken(command, self.law.last)
            share[self.outputs] = np.maximum(share[self.outputs], own)
        self.effort += self.forget * (share**2 - self.effort)
        for i in np.flatnonzero(self.effort > self.settings.effort_share**2)[:1].tolist():
            name, root = self.settings.outputs[i].name, math.sqrt(self.effort[i])
            self._blame("effort", name, root, self.settings.effort_share, self.law.level > 0)

    def _blame(self, what: str, channel: str, value: float, limit: float, law: bool) -> None:
        at_s = self.count * self.settings.period_s
        self.trip = f"{what} {channel} at {at_s:.4g} s: {value:.4g}, limit {limit:.4g}"
        self.blamed = law


class _Limits(NamedTuple):
    """Limits of outputs: magnitude to either side, and change in a sample."""

    lower: np.ndarray
    upper: np.ndarray
    slew: np.ndarray

    def keep(self, total: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Slew, then size."""
        return np.clip(np.clip(total, last - self.slew, last + self.slew), self.lower, self.upper)

    def taken(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Share of the limit on u's side, or of the slew: what saturates is at one."""
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.where(u > 0.0, u / self.upper, np.where(u < 0.0, u / self.lower, 0.0))
        return np.maximum(size, np.abs(u - last) / self.slew)


class _Sensors:
    """Finite, range and envelope of a sample, in the engine's order."""

    def __init__(self, settings: EngineSettings) -> None:
        names = [port.name for port in settings.inputs]
        self.range, self.envelope, self.coast = (
            np.array([getattr(sensor, name) for sensor in settings.sensors])
            for name in ("range", "envelope", "coast_s")
        )
        self.rate = [names.index(s.rate) if s.rate else k for k, s in enumerate(settings.sensors)]

    def look(self, y: np.ndarray) -> tuple[str, int, float, float] | None:
        """The fault, its place, the value and its limit; None for no fault."""
        for i in np.flatnonzero(~(np.abs(y) <= self.range))[:1].tolist():
            if np.isfinite(y[i]):
                return "range", i, float(y[i]), float(self.range[i])
            return "not finite", i, float(y[i]), 0.0
        size = np.hypot(y, self.coast * y[self.rate])
        for i in np.flatnonzero(size > self.envelope)[:1].tolist():
            return "envelope", i, float(size[i]), float(self.envelope[i])
        return None


def _places(ports: tuple[Port, ...], there: tuple[Port, ...]) -> list[int]:
    known = {(port.name, port.unit): k for k, port in enumerate(there)}
    lacking = [port.name for port in ports if (port.name, port.unit) not in known]
    if lacking:
        raise ConfigError(
            f"a port that the computer lacks, or has in another unit: {', '.join(lacking)}",
            hint=", ".join(f"{port.name} [{port.unit}]" for port in there),
        )
    return [known[port.name, port.unit] for port in ports]


def _require_known_tests(settings: EngineSettings) -> None:
    """Nothing that the settings guard may go unguarded."""
    asked = {
        "monitors": settings.monitors,
        "test of stuck sensors": any(sensor.stuck_s for sensor in settings.sensors),
        "test of spread": settings.spreads,
        "limit of momentum": any(math.isfinite(drive.momentum) for drive in settings.drives),
        "adaptive gain": settings.adaptive is not None,
    }
    lacking = [what for what, there in asked.items() if there]
    if lacking:
        raise ConfigError(
            f"the reference law in Python has no {', '.join(lacking)}, which the settings ask for",
            where="trial",
            hint="the engine: a C compiler (cc), and a package that it takes; or settings without them",
        )
