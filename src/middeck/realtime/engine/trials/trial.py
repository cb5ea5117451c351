"""A package on a rig in stages, by the engine, or by the reference law where no compiler is at hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.commands import Event
from middeck.realtime.engine.interface.settings import EngineSettings
from middeck.realtime.engine.process.launch import DriverRig, RigChoice, UdpRig
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from middeck.realtime.engine.trials.reference_loop import ReferenceLoop
from middeck.realtime.engine.trials.served_rig import ServedRig
from middeck.realtime.engine.trials.udp_client import FOREIGN, SILENT, START_IT, UPDATE_IT, RigClient
from middeck.realtime.generate.compiler import find_compiler
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import hash_law
from middeck.values import record

AnyRig = RigChoice | EngineRig
Computer = Literal["auto", "engine", "reference"]
SETTLE_S = 0.1
"""By the clock: until a rig answers in time."""
PIECE_S = 0.5
"""Of a stage, between two looks at whether it has tripped."""
PATIENCE = 10.0
"""How much longer than at rest one waits for a hold while noise sets the article in motion."""
OVERFLOW = "its commands overflow"
"""While it stands by, which stops it without a trip."""
ENGINE, REFERENCE = "engine", "reference law in Python"


@record
class Stage:
    """So many seconds in standby, its outputs discarded, or engaged up to a share of full authority."""

    word: Literal["standby", "engage"]
    seconds: float
    share: float = 1.0


@record(kw_only=True)
class Trial:
    """The outcome of a trial.

    Attributes:
        computer: `ENGINE` or `REFERENCE`.
        y, u, wanted: Sensors, outputs as written, and what the law would command at full authority, a row a
            sample, in the order of the settings.
        refused: Why the computer did not take the package; empty where it did.
        trip: What tripped, where, and by how much; empty for none.
        blamed: Whether the package is to blame for the trip: its law goes on a blacklist.
    """

    computer: str
    y: Float[np.ndarray, "sample sensor"]
    u: Float[np.ndarray, "sample output"]
    wanted: Float[np.ndarray, "sample output"]
    refused: str = ""
    trip: str = ""
    blamed: bool = False


def run_trial(
    package: ControllerPackage,
    settings: EngineSettings,
    rig: AnyRig,
    stages: Sequence[Stage],
    *,
    computer: Computer = "auto",
    real_time: bool = False,
    program: Path | None = None,
) -> Trial:
    """Run ``package`` on ``rig`` from a reset, stage after stage, up to a trip.

    Args:
        settings: Settings of the engine; every port of the package is among its ports.
        rig: A linear article, one behind UDP, converters, or a rig in Python, which is served to the engine.
        computer: ``"auto"`` is the engine where a compiler is at hand and the package is for it: in double
            precision and without an inner loop of its own; else the reference law.
        real_time: In real time; the reference law runs in lockstep only.
        program: An engine built with a driver.

    Raises `ConfigError` where the reference law cannot drive the rig: converters, or by the clock.
    """
    if computer == "auto":
        fits = not (package.single or package.paths)
        computer = "engine" if fits and find_compiler() is not None else "reference"
    if computer == "engine":
        if isinstance(rig, EngineRig):
            with ServedRig(rig) as served:
                return _by_engine(package, settings, served, stages, real_time, program)
        return _by_engine(package, settings, rig, stages, real_time, program)
    if real_time:
        raise ConfigError(
            "the reference law has no clock", where="trial", hint="a C compiler, for the engine"
        )
    return _by_reference(package, settings, _in_python(rig, settings), stages)


def _by_engine(
    package: ControllerPackage,
    settings: EngineSettings,
    rig: RigChoice,
    stages: Sequence[Stage],
    real_time: bool,
    program: Path | None,
) -> Trial:
    # It is what a gate finds out: there is no verdict yet.
    with Supervisor(settings, rig, real_time=real_time, program=program, admitted="ungated") as engine:
        taken = engine.run(settings.samples(SETTLE_S) if real_time else 0)
        first = len(taken)
        answers = [engine.load(package)]
        answers += [engine.reset()] if answers[0].done else []
        for stage in stages if answers[-1].done else ():
            values = [stage.share] if stage.word == "engage" else []
            if stage.word == "engage":
                taken = np.concatenate([taken, *_until_verified(engine)])
            if engine.state != "safe":
                answers.append(engine.command(stage.word, values=values))
                taken = np.concatenate([taken, *_up_to_a_trip(engine, stage.seconds)])
        trips = [event for event in engine.events() if event.trips]
        blamed = hash_law(package) in engine.blacklist()
        return Trial(
            computer=ENGINE,
            y=taken["y"][first:],
            u=taken["u"][first:],
            wanted=taken["wanted_0"][first:],
            refused=next((answer.reason for answer in answers if not answer.done), ""),
            trip=_in_words(trips[0], settings.period_s) if trips else OVERFLOW if blamed else "",
            blamed=blamed,
        )


def _up_to_a_trip(engine: Supervisor, seconds: float) -> Iterator[np.ndarray]:
    last, piece = engine.sample + engine.settings.samples(seconds), engine.settings.samples(PIECE_S)
    while engine.sample < last and engine.state != "safe":
        yield engine.run(min(piece, last - engine.sample))


def _until_verified(engine: Supervisor) -> Iterator[np.ndarray]:
    """Samples until the hold is verified, where there is one that can be."""
    settings, piece = engine.settings, engine.settings.samples(0.1)
    last = engine.sample + settings.samples(PATIENCE * (settings.verify_s + settings.rise_s))
    while settings.hold and settings.verify_s > 0.0 and engine.state == "ready" and engine.sample < last:
        if engine.file.status["hold_verified"]:
            return
        yield engine.run(piece)


def _in_words(event: Event, period_s: float) -> str:
    where = f"{event.kind} {event.channel}".strip() + f" at {event.sample * period_s:.4g} s"
    if event.kind in ("rig dead", "no answer"):
        return f"{where}: {SILENT}; {START_IT}"
    if event.kind == "other format":
        return f"{where}: {FOREIGN}; {UPDATE_IT}"
    return f"{where}: {event.value:.4g}, limit {event.limit:.4g}"


def _by_reference(
    package: ControllerPackage, settings: EngineSettings, rig: EngineRig, stages: Sequence[Stage]
) -> Trial:
    loop = ReferenceLoop(package, settings)
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    refused = ""
    try:
        for stage in stages:
            refused = refused or loop.begin(stage.word == "engage", stage.share)
            for _ in range(settings.samples(stage.seconds)):
                y = rig.readings()
                if np.shape(y) != (len(settings.sensors),):
                    raise DataError(SILENT, hint=START_IT)  # as the engine takes such an answer for none
                u = loop.sample(y)
                rig.write(u)
                rows.append((y, u, loop.wanted))
                if loop.trip:
                    break
            if loop.trip:
                break
        rig.write(np.zeros(len(settings.drives)))
    except DataError as error:
        loop.trip, loop.blamed = f"{error.what}; {error.hint}", False
    finally:
        rig.close()
    shape = (0, len(settings.sensors)), (0, len(settings.drives)), (0, len(settings.drives))
    y, u, wanted = (
        np.array(part) if rows else np.zeros(empty)
        for part, empty in zip(zip(*rows, strict=True) if rows else shape, shape, strict=True)
    )
    return Trial(
        computer=REFERENCE, y=y, u=u, wanted=wanted, refused=refused, trip=loop.trip, blamed=loop.blamed
    )


def _in_python(rig: AnyRig, settings: EngineSettings) -> EngineRig:
    if isinstance(rig, DriverRig):
        raise ConfigError(
            "converters have a driver in C", where="reference law", hint="a C compiler, for the engine"
        )
    if isinstance(rig, LinearArticle):
        return SteppedArticle(rig)
    if isinstance(rig, UdpRig):
        return RigClient(rig, len(settings.drives), answer_s=settings.answer_s)
    return rig
