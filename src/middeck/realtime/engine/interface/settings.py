"""Settings of an engine: ports, what holds the article, what trips, and how commands fade."""

import functools
import hashlib
import math

import numpy as np

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.header import constants, layout
from middeck.realtime.engine.interface.monitors import LONGEST_S, Monitor
from middeck.realtime.package.filter_sections import LoopPath
from middeck.realtime.package.package import check_ports
from middeck.signals.ports import Port
from middeck.values import record

LEAST_RAMP = 150
"""Samples of the shortest fade: its steepest step moves a command by at most 1 % of its limit."""


HERE = "engine settings"
LARGEST = 1e100
"""Magnitude whose square is still a number."""


@record(kw_only=True)
class SensorTest:
    """A sensor and the limits of its samples.

    Attributes:
        port: Name and unit.
        range: Magnitude that no healthy sensor gives; one sample beyond it trips.
        envelope: Amplitude of the motion that trips: the root of value^2 + (coast_s rate)^2.
        rate: Name of the sensor of its rate, in its unit per second; "" for none.
        coast_s: How far the safe state lets it go on for a unit of its rate: 1 / omega of what swings,
            inertia / damping of what is only damped.
        stuck_s: Time of one and the same value that no healthy sensor gives; 0 for no test.
    """

    port: Port
    range: float
    envelope: float = math.inf
    rate: str = ""
    coast_s: float = 0.0
    stuck_s: float = 0.0

    def __post_init__(self) -> None:
        _require(
            0.0 < self.range <= LARGEST and self.envelope > 0.0 and 0.0 <= self.stuck_s <= LONGEST_S,
            f"sensor {self.port.name}: range {self.range}, envelope {self.envelope}, stuck_s {self.stuck_s}",
            f"a range up to {LARGEST:g}, an envelope > 0, a stuck_s from zero to {LONGEST_S:g} s",
        )
        _require(
            0.0 <= self.coast_s <= LONGEST_S and (self.coast_s == 0.0 or self.rate != ""),
            f"sensor {self.port.name}: coast_s {self.coast_s} with the rate {self.rate!r}",
            "a finite time from zero, and the name of a rate sensor",
        )


@record(kw_only=True)
class Drive:
    """An output and its limits.

    Attributes:
        port: Name and unit.
        lower, upper: Limits, which contain zero.
        slew_rate: Most that it changes in a second.
        momentum: Magnitude of its integral that trips where more is asked for: what a torque wheel may store.
            A reset does not forget it, and in SAFE nothing adds to it.
        stored: That integral when the engine starts, from the wheel's speed or from `Supervisor.momentum` of
            the engine before: an engine cannot know it. Required where ``momentum`` is finite.
    """

    port: Port
    lower: float
    upper: float
    slew_rate: float = math.inf
    momentum: float = math.inf
    stored: float | None = None

    def __post_init__(self) -> None:
        _require(
            -LARGEST <= self.lower <= 0.0 <= self.upper <= LARGEST and self.lower < self.upper,
            f"output {self.port.name}: limits of {self.lower} to {self.upper}",
            "finite, zero between them",
        )
        _require(
            self.slew_rate > 0.0 and self.momentum > 0.0,
            f"output {self.port.name}: slew rate {self.slew_rate}, momentum {self.momentum}",
            "> 0",
        )
        _require(
            self.momentum == math.inf if self.stored is None else abs(self.stored) <= LARGEST,
            f"output {self.port.name}: momentum {self.momentum} counted from {self.stored}",
            "stored: what the wheel holds at the start, 0.0 for one at rest",
        )


@record
class Spread:
    """Two sensors that read one thing, how far they may be apart, and for how long."""

    first: str
    second: str
    limit: float
    seconds: float


@record(kw_only=True)
class EngineSettings:
    """Settings of an engine beside its packages.

    Attributes:
        period_s: From sample to sample.
        sensors, drives: Ports with their limits, in the order of a sample's numbers.
        hold: The loop that holds the article, by places in ``sensors`` and ``drives``: what packages call an
            inner loop, and what SAFE falls back on once it is verified.
        monitors, spreads, adaptive: Band power and growth; sensors that must agree; an adaptive gain, which
            the gate has to have proved.
        effort_s, effort_share: Rms of the share that an output takes of its limit, or a compensator of its
            own, in size or in slew, which trips: a sine that reaches its limit has 0.71. The root of a mean
            that forgets with this time; 0 s for no test.
        verify_s: Time of holding, alone and without a trip, after which the hold is verified.
        ramp_s: Least time of a fade; `LEAST_RAMP` samples at least.
        leave_s: Longest time in which a compensator that leaves fades out, whatever its own ramp; twice
            ``ramp_s`` at least.
        safe_ramp_s: From the command at a trip to the hold or to zero.
        heartbeat_s: Silence of the supervisor that trips; 0 for no test.
        late_s, late_most: Lateness that counts, and how many samples in a row may be late.
        answer_s: Patience with a rig over UDP in lockstep.
        processor, priority: In real time: processor to stay on, and FIFO priority; None for none.

    Raises `ConfigError` for what does not fit.
    """

    period_s: float
    sensors: tuple[SensorTest, ...]
    drives: tuple[Drive, ...]
    hold: tuple[LoopPath, ...] = ()
    monitors: tuple[Monitor, ...] = ()
    spreads: tuple[Spread, ...] = ()
    adaptive: AdaptiveGain | None = None
    effort_s: float = 0.5
    effort_share: float = 0.6
    verify_s: float = 2.0
    ramp_s: float = 0.5
    leave_s: float = 5.0
    safe_ramp_s: float = 0.02
    heartbeat_s: float = 0.2
    late_s: float = 0.0005
    late_most: int = 2
    answer_s: float = 10.0
    processor: int | None = None
    priority: int | None = None

    def __post_init__(self) -> None:
        _require(
            1e-6 <= self.period_s <= LONGEST_S, f"a period of {self.period_s} s", f"1e-6 to {LONGEST_S:g} s"
        )
        for side, ports in (("sensors", self.inputs), ("outputs", self.outputs)):
            check_ports(side, ports, HERE)
        self._check_hold()
        self._check_watches()
        self._check_times()

    def _check_hold(self) -> None:
        most = constants()["SECTIONS"]
        _require(len(self.hold) <= most, f"a hold of {len(self.hold)} paths", f"{most} at most")
        for path in self.hold:
            _require(
                path.input in range(len(self.sensors)) and path.output in range(len(self.drives)),
                f"a hold from sensor {path.input} to output {path.output}",
                "places in sensors and drives",
            )
            _require(path.section.stable, "a hold with an unstable section", "poles inside the unit circle")

    def _check_watches(self) -> None:
        names = [port.name for port in self.inputs]
        for what, count in (("monitors", len(self.all_monitors)), ("spreads", len(self.spreads))):
            most = constants()[what.upper()]
            _require(count <= most, f"{count} {what}", f"{most} at most")
        if self.adaptive is not None:
            self.sensor(self.adaptive.sensor)
        for sensor in self.sensors:
            _require(
                sensor.rate in ("", *names),
                f"sensor {sensor.port.name}: no rate sensor {sensor.rate!r}",
                f"one of {', '.join(names)}",
            )
        for spread in self.spreads:
            _require(
                spread.first != spread.second
                and 0.0 <= spread.limit < math.inf
                and 0.0 < spread.seconds <= LONGEST_S,
                f"sensors {spread.first} and {spread.second} apart by {spread.limit} for {spread.seconds} s",
                f"two, a finite limit from zero, a time up to {LONGEST_S:g} s",
            )

    def _check_times(self) -> None:
        names = (
            "effort_s",
            "verify_s",
            "ramp_s",
            "leave_s",
            "safe_ramp_s",
            "heartbeat_s",
            "late_s",
            "answer_s",
        )
        for name in names:
            value = getattr(self, name)
            _require(0.0 <= value <= LONGEST_S, f"{name} of {value} s", f"0 to {LONGEST_S:g} s")
        share = f"an effort_share of {self.effort_share}, which nothing exceeds from 1 on"
        _require(0.0 < self.effort_share < 1.0, share, "above 0, below 1; effort_s = 0 for none")
        for name, value, most in (
            ("late_most", self.late_most, 1 << 31),
            ("processor", self.processor or 0, 1 << 20),
        ):
            whole = 0 <= value < most and value == int(value)
            _require(whole, f"{name} of {value}", f"a whole number from 0, below {most}")

    @property
    def inputs(self) -> tuple[Port, ...]:
        """The ports that it reads."""
        return tuple(sensor.port for sensor in self.sensors)

    @property
    def outputs(self) -> tuple[Port, ...]:
        """The ports that it drives."""
        return tuple(drive.port for drive in self.drives)

    @functools.cached_property
    def _words(self) -> np.ndarray:
        return _encoded(self)  # every start of an engine asks for them

    @property
    def all_monitors(self) -> tuple[Monitor, ...]:
        """``monitors``, then that of the adaptive gain."""
        return (*self.monitors, *([] if self.adaptive is None else [self.adaptive.monitor]))

    @property
    def rise_s(self) -> float:
        """From a reset to the whole hold, beside which a compensator may engage."""
        return max(self.ramp_s, LEAST_RAMP * self.period_s)

    @property
    def fade_samples(self) -> tuple[int, int]:
        """The least samples of a fade, and the most in which a compensator leaves."""
        least = max(self.samples(self.ramp_s), LEAST_RAMP)
        return least, max(self.samples(self.leave_s), 2 * least)

    def samples(self, seconds: float) -> int:
        """``seconds`` in whole samples, rounded up."""
        return math.ceil(seconds / self.period_s - 1e-6)

    def sensor(self, name: str) -> int:
        """Place of a sensor; raises `ConfigError` for another name."""
        return _place(name, "sensor", self.inputs)

    def drive(self, name: str) -> int:
        """Place of an output, which may have the name of a sensor; raises `ConfigError` for another name."""
        return _place(name, "output", self.outputs)


def hash_hold(settings: EngineSettings) -> str:
    """SHA-256 of the hold: names and coefficients of its paths, in order; that of nothing without one."""
    longest, found = constants()["NAME"], b""
    for path in settings.hold:
        for port in (settings.inputs[path.input], settings.outputs[path.output]):
            found += port.name.encode().ljust(longest, b"\0")
        found += np.concatenate([path.section.b, path.section.a]).astype("<f8").tobytes()
    return hashlib.sha256(found).hexdigest()


def time_to_rest(settings: EngineSettings) -> float:
    """Longest time [s] in which SAFE, the fall of the hold and the slew limits bring all outputs to zero."""
    turn = max((drive.upper - drive.lower) / drive.slew_rate for drive in settings.drives)
    return settings.safe_ramp_s + settings.rise_s + turn


def encode_settings(settings: EngineSettings) -> np.ndarray:
    """The shared record of ``settings``; clock, rig and port of the rig are left to who starts it."""
    return settings._words.copy()


def _encoded(settings: EngineSettings) -> np.ndarray:
    words = np.zeros((), layout("settings"))
    words["inputs"], words["outputs"] = len(settings.sensors), len(settings.drives)
    words["period_s"] = settings.period_s
    for field, ports in (("sensor", settings.inputs), ("output", settings.outputs)):
        words[field][: len(ports)] = [port.name.encode() for port in ports]
        words[f"{field}_unit"][: len(ports)] = [port.unit.encode() for port in ports]
    _encode_limits(words, settings)
    monitors = settings.all_monitors
    for k, monitor in enumerate(monitors):
        output = monitor.side == "output"
        place = (
            len(settings.sensors) + settings.drive(monitor.channel)
            if output
            else settings.sensor(monitor.channel)
        )
        monitor.encode(words["monitor"][k : k + 1], place, settings.period_s)
    for k, spread in enumerate(settings.spreads):
        first, second = settings.sensor(spread.first), settings.sensor(spread.second)
        words["spread"][k] = (first, second, spread.limit, settings.samples(spread.seconds))
    for k, path in enumerate(settings.hold):
        words["path"][k] = (path.input, path.output, (np.concatenate([path.section.b, path.section.a]),))
    words["monitors"], words["spreads"] = len(monitors), len(settings.spreads)
    words["paths"] = len(settings.hold)
    _encode_times(words, settings)
    return words


def _encode_limits(words: np.ndarray, settings: EngineSettings) -> None:
    for k, sensor in enumerate(settings.sensors):
        words["range"][k], words["envelope"][k] = sensor.range, sensor.envelope
        words["stuck"][k] = settings.samples(sensor.stuck_s)
        words["rate"][k] = settings.sensor(sensor.rate) if sensor.rate else -1
        words["coast"][k] = sensor.coast_s
    for k, drive in enumerate(settings.drives):
        words["lower"][k], words["upper"][k] = drive.lower, drive.upper
        words["slew"][k] = drive.slew_rate * settings.period_s
        words["momentum"][k], words["stored"][k] = drive.momentum, drive.stored or 0.0


def _encode_times(words: np.ndarray, settings: EngineSettings) -> None:
    gain = settings.adaptive
    words["adaptive"] = (-1, 0.0, 0.0, 0.0, 1.0, 0.0)
    if gain is not None:
        step = gain.rate * settings.period_s
        words["adaptive"] = (
            len(settings.monitors), gain.quiet_rms, gain.loud_rms, gain.minimum, gain.maximum, step
        )  # fmt: skip
    words["effort_forget"] = -math.expm1(-settings.period_s / settings.effort_s) if settings.effort_s else 0.0
    words["effort_share"] = settings.effort_share
    words["verify"] = settings.samples(settings.verify_s)
    words["ramp"], words["leave"] = settings.fade_samples
    words["safe_ramp"] = settings.samples(settings.safe_ramp_s)
    words["heartbeat"] = settings.samples(settings.heartbeat_s)
    words["late_ns"], words["late_most"] = round(1e9 * settings.late_s), settings.late_most
    words["answer_ms"] = round(1e3 * settings.answer_s)
    words["processor"] = -1 if settings.processor is None else settings.processor
    words["priority"] = settings.priority or 0


def _place(name: str, side: str, ports: tuple[Port, ...]) -> int:
    names = [port.name for port in ports]
    _require(name in names, f"no {side} {name!r}", f"one of {', '.join(names)}")
    return names.index(name)


def _require(holds: bool, what: str, hint: str) -> None:
    if not holds:
        raise ConfigError(what, where=HERE, hint=hint)
