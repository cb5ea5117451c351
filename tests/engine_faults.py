"""What goes wrong around an engine: one builder a kind, in any of its states, from a seed."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import signal
import struct
from collections.abc import Callable, Generator
from typing import Any

import numpy as np
import scipy.linalg

from engine_destabilising import scaled_rows, shifted_truth
from engine_rigs import design, nominal_article, pack, settings_of
from engine_upsets import ASKED, CLOCKS, DISKS, ENDS, Act, Upset, wait
from faked_clock import SupervisorByFakedClock, faked_clock
from middeck.realtime.engine.interface.settings import EngineSettings, SensorTest
from middeck.realtime.engine.interface.shared_file import LARGEST
from middeck.realtime.engine.rigs.linear_article import Fault, LinearArticle
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import encode_package
from middeck.values import record
from ungated import Supervisor

STATES = ("safe", "ready", "identify", "engaging", "control", "disengaging", "cross-fading")
"""Those of the engine, and with both slots in a fade."""
BEFORE = {"safe": 30, "identify": 40, "engaging": 60, "control": 300, "disengaging": 340, "cross-fading": 340}
"""Samples between the first command towards a state and the fault."""
LAST = {"disengaging": ("disengage", 0), "cross-fading": ("engage", 1)}
"""What is commanded last, 60 samples before it."""
ARTICLE = ("dm", "lab")
HOLDING, WITHIN = 1500, 300
"""Samples until the hold is verified and stays so, then until the fault may come."""
SINGLE, LONG = 1, 1 << 40


@record(kw_only=True)
class Ending:
    """How it ended.

    Attributes:
        state: Of the engine at the end.
        trips: Kinds of trips, in order.
        answers: Words of the answers to the commands of the fault.
        why: What is wrong with the end; empty where it is SAFE or correct completion.
    """

    state: str
    trips: tuple[str, ...]
    answers: tuple[str, ...]
    why: str


@functools.cache
def fault_settings() -> EngineSettings:
    """Those of the development model with a quick verification and a supervisor that must show its life."""
    return dataclasses.replace(settings_of(*ARTICLE), verify_s=0.3, heartbeat_s=0.1)


@functools.cache
def watched_settings() -> EngineSettings:
    """With sensors that no fault reaches and nothing else reads: what moves, and the torque that arrives."""
    plain = fault_settings()
    ports = [("true", port) for port in plain.inputs] + [("given", port) for port in plain.outputs]
    free = [SensorTest(port=dataclasses.replace(p, name=f"{what} {p.name}"), range=1e9) for what, p in ports]
    return dataclasses.replace(plain, sensors=(*plain.sensors, *free))


def watched(rig: LinearArticle) -> LinearArticle:
    """The article with these sensors. Torques are read in the sample after, from a state each."""
    (sensors, states), outputs = rig.C.shape, rig.B.shape[1]
    none = np.zeros((outputs, rig.G.shape[1]))
    rows = np.hstack([rig.C, np.zeros((sensors, outputs))])
    return dataclasses.replace(
        rig,
        A=scipy.linalg.block_diag(rig.A, np.zeros((outputs, outputs))),
        B=np.vstack([rig.B, np.eye(outputs)]),
        C=np.vstack([rows, rows, np.eye(states + outputs)[states:]]),
        G=np.vstack([rig.G, none]),
        x=np.concatenate([rig.x, np.zeros(outputs)]),
        sensor_noise=np.concatenate([rig.sensor_noise, np.zeros(sensors + outputs)]),
    )


def law(authority: float = 2.0):
    return design(*ARTICLE, authority)


@functools.cache
def good() -> ControllerPackage:
    return pack(law())


@functools.cache
def another() -> ControllerPackage:
    return pack(law(1.5))


def _faults(kind: str, value: Callable, channels: str = "sensor", length: int = LONG):
    """A fault of the article at a random channel: ``value`` of the random numbers and the settings."""

    def make(rng: np.random.Generator, start: int) -> tuple[Fault, ...]:
        settings = fault_settings()
        ports = len(settings.sensors if channels == "sensor" else settings.drives)
        k = int(rng.integers(ports))
        return (
            Fault(
                kind=kind, channel=k, start=start, end=start + length, value=float(value(rng, settings, k))
            ),
        )

    return make


def _other(rng, settings, k) -> int:
    return (k + 1 + int(rng.integers(len(settings.sensors) - 1))) % len(settings.sensors)


def _envelope(settings, k) -> float:
    sensor = settings.sensors[k]
    return sensor.envelope if np.isfinite(sensor.envelope) else sensor.range / 2.0


def _any_size(rng, settings, k) -> float:
    return 10.0 ** rng.uniform(-3.0, 0.0) * _envelope(settings, k)


def _beyond(rng, settings, k) -> float:
    return rng.choice([-3.0, 3.0]) * settings.sensors[k].range


RIG: dict[str, Callable] = {
    "sensor nan": _faults("sensor nan", lambda rng, s, k: 0.0, length=SINGLE),
    "sensor nan for long": _faults("sensor nan", lambda rng, s, k: 0.0),
    "sensor inf": _faults("sensor add", lambda rng, s, k: rng.choice([-np.inf, np.inf]), length=SINGLE),
    "sensor out of range": _faults("sensor add", _beyond),
    "sensor spike": _faults("sensor add", lambda rng, s, k: 1.5 * _envelope(s, k), length=SINGLE),
    "sensor bias": _faults("sensor add", lambda rng, s, k: rng.uniform(-0.3, 0.3) * _envelope(s, k)),
    "sensor stuck": _faults("sensor stuck", lambda rng, s, k: 0.0),
    "sensor drift": _faults("sensor drift", lambda rng, s, k: rng.uniform(-1.0, 1.0) * _envelope(s, k)),
    "sensor with swapped sign": _faults("sensor gain", lambda rng, s, k: -1.0),
    "sensor with wrong gain": _faults("sensor gain", lambda rng, s, k: rng.uniform(0.2, 5.0)),
    "sensor dead": _faults("sensor gain", lambda rng, s, k: 0.0),
    "sensor late": _faults("sensor late", lambda rng, s, k: rng.integers(5, 63)),
    "samples dropped": _faults("sensor drop", lambda rng, s, k: rng.uniform(0.1, 0.9)),
    "sensors swapped": _faults("sensor swap", _other),
    "sensor noisy": _faults("sensor noise", _any_size),
    "encoder wraps": _faults("encoder wrap", _any_size),
    "actuator dead": _faults("output dead", lambda rng, s, k: 0.0, "output"),
    "actuator reversed": _faults("output gain", lambda rng, s, k: -1.0, "output"),
    "actuator too strong": _faults("output gain", lambda rng, s, k: rng.uniform(2.0, 10.0), "output"),
    "actuator stuck": _faults("output stuck", lambda rng, s, k: 0.0, "output"),
    "actuator weak": _faults("output limit", lambda rng, s, k: 10.0 ** rng.uniform(-3.0, -1.0), "output"),
    "rig silent once": _faults("rig silent", lambda rng, s, k: 0.0, length=SINGLE),
    "rig silent for long": _faults("rig silent", lambda rng, s, k: 0.0),
    "rig dies": _faults("rig dies", lambda rng, s, k: 0.0),
}  # fmt: skip


@functools.cache
def shifted_article(sign: float) -> LinearArticle:
    return shifted_truth(np.random.default_rng(5), *ARTICLE, 0.05 * sign, 0.05 * sign, either=False)


ARTICLES = {"frequencies 5 % higher": 1.0, "frequencies 5 % lower": -1.0}


def _destabilising(rng) -> ControllerPackage:
    return _scaled(float(rng.choice([-3.0, -1.0])))


@functools.cache
def _scaled(gain: float) -> ControllerPackage:
    return pack(scaled_rows(law(), np.full(len(law().outputs), gain)))


@functools.cache
def _unstable() -> ControllerPackage:
    """Stabilised by no loop: a pole of its own that its estimate does not follow."""
    s = law().sampled
    spoilt = type(s)(1.02 * np.eye(len(s.A)), s.B, s.C, s.D, period_s=s.period_s)
    return pack(dataclasses.replace(law(), dynamics=spoilt, applied=None))


@functools.cache
def _good_bytes() -> bytes:
    return encode_package(good())


def _corrupted(rng) -> bytes:
    spoilt = bytearray(_good_bytes())
    spoilt[int(rng.integers(len(spoilt)))] ^= 1 << int(rng.integers(8))
    return bytes(spoilt)


def _hashed(data: bytes) -> bytes:
    return data[:-32] + hashlib.sha256(data[:-32]).digest()


def _nan(rng) -> bytes:
    """A coefficient that is no number, under a hash that fits."""
    data = bytearray(_good_bytes())
    at = 8 * int(rng.integers(len(data) // 16, len(data) // 8 - 8))
    data[at : at + 8] = struct.pack("<d", np.nan)
    return _hashed(bytes(data))


def _big_endian(rng) -> bytes:
    words = np.frombuffer(_good_bytes()[:-32], "<u8").astype(">u8").tobytes()
    return _hashed(words + bytes(32))


@functools.cache
def _other_ports(what: str) -> ControllerPackage:
    base = law()
    if what == "rate":
        s = base.sampled
        return pack(dataclasses.replace(base, dynamics=type(s)(s.A, s.B, s.C, s.D, period_s=0.004)))
    ports = list(base.inputs)
    ports[0] = dataclasses.replace(ports[0], **{what: "other"})
    return pack(dataclasses.replace(base, inputs=tuple(ports)))


def _resized(rng) -> bytes:
    """One of the sizes in the head is another, under a hash that fits."""
    data = bytearray(_good_bytes())
    at = 8 + 4 * int(rng.integers(2, 7))
    (old,) = struct.unpack_from("<I", data, at)
    struct.pack_into("<I", data, at, old + int(rng.integers(1, 1 << 30)))
    return _hashed(bytes(data))


PACKAGES: dict[str, Callable] = {
    "package destabilises": _destabilising,
    "package with too much gain": lambda rng: _scaled(float(rng.choice([30.0, 300.0]))),
    "compensator unstable": lambda rng: _unstable(),
    "package of wrong sizes": _resized,
    "package of another rate": lambda rng: _other_ports("rate"),
    "package for other names": lambda rng: _other_ports("name"),
    "package for other units": lambda rng: _other_ports("unit"),
    "package corrupted": _corrupted,
    "package truncated": lambda rng: _good_bytes()[: int(rng.integers(1, len(_good_bytes())))],
    "package too large": lambda rng: _good_bytes() + bytes(LARGEST),
    "package replayed": lambda rng: good(),
    "package with a NaN": _nan,
    "package big-endian": _big_endian,
    "package empty": lambda rng: b"",
    "package of noise": lambda rng: rng.bytes(int(rng.integers(96, 4096)) * 8),
}
SOUND = {"package destabilises", "package with too much gain", "compensator unstable", "package replayed"}
REFUSED = PACKAGES.keys() - SOUND
DESTROYS = ("package destabilises", "package with too much gain", "compensator unstable")
ACTS: dict[str, Act] = {**ASKED, **CLOCKS, **ENDS, **DISKS}
KINDS = (*RIG, *ARTICLES, *PACKAGES, *ACTS)
LATE = ("engine overruns for long", "engine stalls", "engine stopped and continued", "clock jumps")
OF_A_LAW = ("envelope", "growth", "band power", "effort", "command not finite")
TRIPS: dict[str, tuple[str, ...]] = {
    "crew STOP": ("stop",), "supervisor silent": ("heartbeat",), "rig silent once": ("no answer",),
    "rig silent for long": ("no answer",), "rig dies": ("rig dead",), "sensor nan": ("not finite",),
    "sensor nan for long": ("not finite",), "sensor inf": ("not finite",), "sensor out of range": ("range",),
    "sensor stuck": ("stuck",), "sensor dead": ("stuck", "band power"),
    "sensor spike": ("envelope", "band power"),
    **dict.fromkeys(LATE, ("lateness",)), **dict.fromkeys(DESTROYS, OF_A_LAW),
}  # fmt: skip
"""What must trip an engine that is not in SAFE yet, and by which of these. In SAFE nothing engages, and while
both slots fade they are busy."""
HARMLESS = REFUSED | DISKS.keys() | ARTICLES.keys() | {
    "records not read", "commands out of place", "commands repeated", "commands of another session",
    "engine late once", "engine overruns once", "calendar set", "actuator dead", "actuator weak",
    "package replayed",
}  # fmt: skip
"""What must trip none, where no excitation plays: that may trip by its own growth."""
EITHER = {
    "sensor bias": "a small one is within what normal operation moves, a large one is a step",
    "sensor drift": "it may not have come far when the run ends",
    "sensor with swapped sign": "with a moderate authority the loop stays stable without this sensor",
    "sensor with wrong gain": "from a fifth to five times",
    "sensor late": "from 10 to 126 ms",
    "samples dropped": "a tenth to nine tenths of them",
    "sensors swapped": "two that read much the same, or an angle and a rate",
    "sensor noisy": "from a thousandth of the envelope up to all of it",
    "encoder wraps": "the motion may not reach where it wraps",
    "actuator reversed": "the hold's loops are stable without this motor, a law's need not be",
    "actuator too strong": "from twice to ten times",
    "actuator stuck": "a torque within the limits that stands still",
}
"""What may trip and need not, by its size or channel, and why. Whether it does, the article is safe."""


OF_THE_DESIGN: dict[str, tuple[str, ...]] = {
    "sensor NaN": ("sensor nan", "sensor nan for long", "sensor inf"),
    "sensor spike": ("sensor spike", "sensor out of range"),
    "sensor stuck": ("sensor stuck", "sensor dead"),
    "sensor drift": ("sensor drift", "sensor bias", "sensor noisy"),
    "sensor of swapped sign": ("sensor with swapped sign", "sensor with wrong gain", "sensors swapped"),
    "sensor delayed": ("sensor late",),
    "sample dropped": ("samples dropped", "rig silent once", "rig silent for long"),
    "encoder wrap": ("encoder wraps",),
    "actuator saturated": ("actuator weak",),
    "actuator dead": ("actuator dead", "actuator stuck"),
    "actuator reversed": ("actuator reversed", "actuator too strong"),
    "frequencies off by 5 %": tuple(ARTICLES),
    "package destabilises": ("package destabilises", "package with too much gain"),
    "package too large": ("package too large",),
    "package of wrong size": ("package of wrong sizes", "package empty"),
    "package of wrong rate": (
        "package of another rate", "package for other names", "package for other units",
    ),
    "package corrupted": (
        "package corrupted", "package of noise", "package with a NaN", "package big-endian",
    ),
    "package truncated": ("package truncated",),
    "package replayed": ("package replayed",),
    "compensator unstable": ("compensator unstable",),
    "clock step": ("calendar set",),
    "clock jump": ("clock jumps",),
    "overrun": ("engine late once", "engine overruns once", "engine overruns for long"),
    "stall": ("engine stalls",),
    "SIGSTOP": ("engine stopped and continued",),
    "SIGKILL of the engine": ("engine killed", "engine told to end"),
    "SIGKILL of the supervisor": ("supervisor silent",),
    "SIGKILL of the rig": ("rig dies",),
    "ring overflow": ("records not read",),
    "disk full": ("disk full", "disk full for a while"),
    "disk read-only": ("disk read-only", "folder read-only"),
    "short write": ("disk takes short writes",),
    "bit flip in a stored block": ("bit flips in a stored block",),
    "expired and repeated commands": (
        "commands repeated", "commands of another session", "commands out of place",
    ),
    "STOP in each state": ("crew STOP",),
}  # fmt: skip
"""Faults by their names in the design, and what plays them here. Those of decks, crew and link come later."""


def table() -> list[str]:
    """The rows of the requirements' page."""
    rows = [f"| {name} | {', '.join(kinds)} |" for name, kinds in OF_THE_DESIGN.items()]
    return ["| fault | played as |", "| --- | --- |", *rows]


def endings() -> list[str]:
    """What ends how, as rows of that page."""
    ends = {kind: f"SAFE, by {' or '.join(trips)}" for kind, trips in TRIPS.items()}
    ends |= dict.fromkeys(HARMLESS, "completion, without a trip")
    ends |= {kind: f"either: {why}" for kind, why in EITHER.items()} | dict.fromkeys(
        ENDS, "an end of its own"
    )
    rows = [f"| {kind} | {ends[kind]} |" for kind in KINDS]
    return ["| kind | right ending where the engine is not in SAFE |", "| --- | --- |", *rows]


def play(kind: str, state: str, seed: int, **options: Any) -> Ending:
    """Bring an engine into ``state``, let ``kind`` happen, wait, and finish what was begun."""
    settings, rng = watched_settings(), np.random.default_rng([seed, KINDS.index(kind), STATES.index(state)])
    start = HOLDING + int(rng.integers(5, WITHIN))
    faults = RIG[kind](rng, start) if kind in RIG else ()
    plain = shifted_article(ARTICLES[kind]) if kind in ARTICLES else nominal_article(*ARTICLE)
    rig = watched(dataclasses.replace(plain, faults=faults, seed=int(rng.integers(1 << 30))))
    wave = 0.02 * rng.standard_normal((200, len(settings.drives)))
    ring = 64 if kind == "records not read" else 2048
    given = {"waveform": wave, "ring": ring, "pretrip_s": 2.0, "by_clock": kind in CLOCKS, **options}
    with engine_in(state, start, rig, settings, **given) as engine:
        engine.events()
        before = engine.state
        upset = (_load(kind) if kind in PACKAGES else ACTS.get(kind, wait))(engine, rng)
        trips = tuple(event.kind for event in engine.events() if event.trips)
        finished = [] if kind in ENDS else _finish(engine, before)
        records = np.concatenate([upset.records, *finished])
        why = upset.why or _complaint(engine, kind, before, records, trips, faults, upset.answers)
        ending = Ending(state=engine.state, trips=trips, answers=upset.answers, why=why)
    code = engine.process.returncode
    sound = code == (-signal.SIGKILL if kind == "engine killed" else 0)
    return ending if sound or ending.why else dataclasses.replace(ending, why=f"ended with code {code}")


def _load(kind: str) -> Act:
    """Load a package of this kind into the second slot, which is busy while it fades, and engage it."""

    def act(engine: Supervisor, rng: np.random.Generator) -> Upset:
        runs = bool(_slots(engine) & 0b0100)
        loaded = engine.load(PACKAGES[kind](rng), slot=1).word
        engaged = engine.command("engage", slot=1, values=[1.0]).word
        why = "" if (loaded == "busy") == runs else f"{loaded} where the slot runs: {runs}"
        return Upset(records=wait(engine, rng).records, answers=(loaded, engaged), why=why)

    return act


@contextlib.contextmanager
def engine_in(
    state: str,
    start: int,
    rig: LinearArticle,
    settings: EngineSettings,
    *,
    by_clock: bool = False,
    **options: Any,
) -> Generator[Supervisor]:
    """An engine that is in ``state`` at sample ``start``; of 100 rigs the first whose hold allows it."""
    for seed in range(rig.seed, rig.seed + 100):
        with _started(settings, dataclasses.replace(rig, seed=seed), by_clock, options) as engine:
            if reach(engine, state, start):
                fading = state == "cross-fading"
                assert (engine.state, engine.sample) == ("engaging" if fading else state, start)
                assert not fading or _slots(engine) == 0b1101
                yield engine
                return


def _slots(engine: Supervisor) -> int:
    """Which slots run and are in control, as the last record has it: two bits each."""
    return int(engine.file.ring["slots"][(engine.sample - 1) % len(engine.file.ring)])


@contextlib.contextmanager
def _started(
    settings: EngineSettings, rig: LinearArticle, by_clock: bool, options: dict[str, Any]
) -> Generator[Supervisor]:
    if not by_clock:
        with Supervisor(settings, rig, **options) as engine:
            yield engine
        return
    patient = dataclasses.replace(settings, heartbeat_s=2.0)  # fewer looks of the supervisor, which take time
    with faked_clock() as clock, SupervisorByFakedClock(patient, rig, clock=clock, **options) as engine:
        yield engine


def reach(engine: Supervisor, state: str, start: int) -> bool:
    """Bring it there; False where its hold is not verified when that is asked for."""

    def run_to(sample: int) -> None:
        engine.run(sample - engine.sample, keep=False)

    assert engine.load(good()).done
    assert state != "cross-fading" or engine.load(another(), slot=1).done
    assert engine.reset().done
    run_to(start - BEFORE.get(state, 0))
    if not engine.file.status["hold_verified"]:
        return False
    if state == "safe":
        engine.stop()
    elif state == "identify":
        assert engine.command("excite", values=[0.0]).done
    elif state != "ready":
        assert engine.command("engage", values=[1.0]).done
    if state in LAST:
        run_to(start - 60)
        word, slot = LAST[state]
        assert engine.command(word, slot=slot, values=[1.0]).done
    run_to(start)
    return True


def _finish(engine: Supervisor, before: str) -> list[np.ndarray]:
    """Complete what goes on; a loop in SAFE stays there."""
    if engine.state == "safe":
        return [engine.run(60)]
    engine.command("disengage")
    engine.command("silence")
    return [engine.run(60) for _ in range(6)]


def _complaint(engine, kind, before, records, trips, faults, answers) -> str:
    """What is wrong with an end, or nothing."""
    settings = engine.settings
    limits = np.array([drive.upper for drive in settings.drives])
    if not np.isfinite(records["u"]).all() or np.any(np.abs(records["u"]) > limits):
        return "an output beyond its limit"
    why = _complaint_of_the_article(records, limits, faults)
    if why:
        return why
    if kind in REFUSED and answers[0] == "done":
        return "a package accepted that must be refused"
    busy = kind in DESTROYS and answers[0] == "busy"
    if (kind in HARMLESS or busy) and before != "identify" and trips:
        return f"tripped by {trips}"
    if before != "safe" and not busy and kind in TRIPS and not set(trips[:1]) & set(TRIPS[kind]):
        return f"not tripped by {TRIPS[kind]}"
    if kind in DESTROYS and trips and not engine.blacklist():
        return "a law that tripped is not on the blacklist"
    if kind in ("sensor stuck", "sensor dead") and not records["unhealthy"][-1] >> faults[0].channel & 1:
        return "a sensor that stands still and is not found out of order, whatever tripped first"
    if kind in ENDS:
        return ""
    if engine.state == "safe":
        return _safe_complaint(engine, before, trips)
    if before == "safe":
        return f"left SAFE for {engine.state} by itself"
    return "" if engine.state == "ready" else f"ends in {engine.state}"


def _complaint_of_the_article(records: np.ndarray, limits: np.ndarray, faults: tuple[Fault, ...]) -> str:
    """What is wrong with the torques that arrived, and with how it moved, whatever its sensors said."""
    plain = fault_settings()
    sensors, outputs = len(plain.sensors), len(limits)
    true, given = records["y"][:, sensors : 2 * sensors], records["y"][1:, 2 * sensors :]
    fresh = (np.diff(records["sequence"]) == 1) & np.any(np.diff(records["y"], axis=0) != 0.0, axis=1)
    sound = np.ones(outputs, bool)
    for fault in faults:
        if fault.kind.startswith("output"):
            sound[fault.channel] = False
            limits = limits * np.where(
                sound, 1.0, max(1.0, fault.value if fault.kind == "output gain" else 1.0)
            )
    if np.any((given != records["u"][:-1])[np.ix_(fresh, sound)]):
        return "another torque arrived than is recorded"
    if np.any(np.abs(given[fresh]) > limits):
        return "a torque beyond the limit arrived"
    if sound.all():  # else SAFE's own torque may go astray
        for k, sensor in enumerate(plain.sensors):
            if np.any(np.abs(true[:, k]) > 2.0 * sensor.envelope):
                return (
                    f"{sensor.port.name} at {np.abs(true[:, k]).max() / sensor.envelope:.2f} of its envelope"
                )
    return ""


def _safe_complaint(engine, before, trips) -> str:
    if before != "safe" and not trips and engine.trip == 0:
        return "in SAFE without a trip"
    if engine.command("reset", values=[engine.trip + 1.0]).word != "wrong trip":
        return "a reset that names another trip"
    lost = any(event.kind == "hold lost" for event in engine.events())
    if lost or not engine.file.status["hold_verified"]:
        last = engine.run(engine.settings.samples(engine.settings.safe_ramp_s) + 1)[-1]
        if np.any(last["u"]):
            return "neither the hold nor zero"
    kept = engine.pretrip()
    return (
        ""
        if kept["trip"][-1] != 0 and np.all(np.diff(kept["sequence"]) == 1)
        else "the ring before the trip is not frozen"
    )
