"""Steps of the gate that need a computer: dry run on a model, shadow run and engagement on a rig."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.rigs.linear_article import LinearArticle, linear_article
from middeck.realtime.engine.trials.trial import AnyRig, Stage, Trial, run_trial
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_without_rig import GateStep
from middeck.realtime.package.package import ControllerPackage
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.values import record

ENVELOPE = 0.9
SETTLE_S = 1.0
"""Beyond the rise of a hold and its verification, before a package engages on a rig."""
NOT_DECIDED = (ConfigError, DataError, NumericalError)


@record(kw_only=True)
class GateTrials:
    """Durations, disturbances and limits of a package's trials on a computer.

    Attributes:
        dry_s, shadow_s, engage_s: Seconds on each model, in shadow, and engaged at each of two shares.
        disturbance: Rms of white noise added at each output in a dry run, as a share of its limit.
        noise: Rms of white noise at each input in a dry run, as a share of its range.
        rms: Largest rms of each input in the second half of a dry run, as a share of its range.
        peak: Largest magnitude of each command, as a share of its limit.
        share: Share of full authority, at which it engages first.
        seed: Seed of the noise.

    Raises `ConfigError` for times and shares out of their range.
    """

    dry_s: float = 10.0
    shadow_s: float = 10.0
    engage_s: float = 5.0
    disturbance: float = 0.01
    noise: float = 1e-4
    rms: float = 1.0 / 3.0
    peak: float = 0.9
    share: float = 0.25
    seed: int = 1

    def __post_init__(self) -> None:
        times = (self.dry_s, self.shadow_s, self.engage_s)
        shares = (self.rms, self.peak, self.share)
        if not (
            all(0.0 < t < math.inf for t in times)
            and all(0.0 < s <= 1.0 for s in shares)
            and all(0.0 <= rms < math.inf for rms in (self.disturbance, self.noise))
        ):
            raise ConfigError(
                f"trials of {times} s, shares {shares}, disturbance {self.disturbance}, noise {self.noise}",
                where="GateTrials",
                hint="positive times, shares above 0 up to 1, noise from 0",
            )


@record
class GateRig:
    """The rig that a package is tried on, and the settings of the engine that drives it.

    Attributes:
        rig: A linear article, one behind UDP, converters, or a rig in Python.
        settings: Ports, hold, trips.
        real_time: In real time, else in lockstep.
        program: An engine built with a driver (`build_engine`); the plain one if it is left out.
    """

    rig: AnyRig
    settings: EngineSettings
    real_time: bool = False
    program: Path | None = None


def package_settings(package: ControllerPackage, engine: EngineSettings | None = None) -> EngineSettings:
    """Settings of an engine with the ports, ranges and limits of ``package``, and no hold.

    With the settings of an ``engine`` its hold is there too, with its ports, and outputs have its limits. A
    motion trips at `ENVELOPE` of a range: what grows is the package's fault, what jumps a sensor's.

    Raises `ConfigError` for a package with an input without a range, or an output without a limit, and for
    one that the engine does not run.
    """
    held = package if engine is None else with_hold(package, engine)
    drives = tuple(
        Drive(port=port, lower=float(low), upper=float(high))
        for port, low, high in zip(held.outputs, held.lower, held.upper, strict=True)
    )
    if engine is not None:
        drives = tuple(
            dataclasses.replace(engine.drives[engine.drive(port.name)], momentum=math.inf)
            for port in held.outputs
        )
    return EngineSettings(
        period_s=package.period_s,
        sensors=tuple(
            SensorTest(port=port, range=float(reach), envelope=ENVELOPE * float(reach))
            for port, reach in zip(held.inputs, held.input_range, strict=True)
        ),
        drives=drives,
        hold=held.paths if engine is not None else (),
    )


def check_dry_run(
    package: ControllerPackage,
    name: str,
    plant: Plant,
    trials: GateTrials,
    engine: EngineSettings | None = None,
) -> GateStep:
    """Engaged on ``plant`` with noise, in lockstep: no trip, rms and peaks below their limits.

    With the settings of an ``engine`` beside its hold, and the package's own command below its limits too.
    """
    step, engine = f"dry run {name}", engine if engine is not None and engine.hold else None
    try:
        # A trip is a refusal, whatever SAFE would fall back on.
        settings = dataclasses.replace(package_settings(package, engine), verify_s=0.0)
        top = np.array([max(drive.upper, -drive.lower) for drive in settings.drives])
        reach = np.array([sensor.range for sensor in settings.sensors])
        article = _noisy_article(settings, plant, trials, top, reach)
        risen = (Stage("standby", settings.rise_s),) if settings.hold else ()
        trial = run_trial(package, settings, article, (*risen, Stage("engage", trials.dry_s)))
    except NOT_DECIDED as error:
        return GateStep(name=step, passed=False, said=f"not decided: {error.what}")
    rms = np.sqrt(np.mean(trial.y[len(trial.y) // 2 :] ** 2, axis=0)) if len(trial.y) else 0.0
    peak = np.abs(trial.u).max(axis=0, initial=0.0)
    faults = [
        *_beyond(settings.inputs, "has an rms of", rms, reach, trials.rms),
        *_beyond(settings.outputs, "peaks at", peak, top, trials.peak),
    ]
    if engine is not None:
        own = np.abs(trial.wanted[:, : len(package.outputs)]).max(axis=0, initial=0.0)
        most = np.maximum(package.upper, -package.lower)
        faults += _beyond(package.outputs, "would get", own, most, trials.peak)
    return _step(step, trial, faults, f"{trials.dry_s:g} s, peak {np.max(peak / top):.1%} of the limit")


def _noisy_article(
    settings: EngineSettings, plant: Plant, trials: GateTrials, top: np.ndarray, reach: np.ndarray
) -> LinearArticle:
    drives, reads = [port.name for port in settings.outputs], [port.name for port in settings.inputs]
    return linear_article(
        plant,
        settings.period_s,
        drives,
        reads,
        disturbed=drives,
        disturbance_rms=(trials.disturbance * top).tolist(),
        sensor_noise=(trials.noise * reach).tolist(),
        seed=trials.seed,
    )


def _beyond(
    ports: Sequence[Port], what: str, found: np.ndarray | float, most: np.ndarray, share: float
) -> list[str]:
    """Sentences for what exceeds ``share`` of ``most``, or is no number."""
    found = np.broadcast_to(found, len(ports))
    return [
        f"{port.name} {what} {value:.3g} {port.unit}, allowed are {share:.3g} of {limit:.3g} {port.unit}"
        for port, value, limit in zip(ports, found, most, strict=True)
        if not value <= share * limit
    ]


def check_shadow_run(package: ControllerPackage, bench: GateRig, trials: GateTrials) -> GateStep:
    """Run it in standby on the rig's sensors, outputs discarded: its commands must keep its limits."""
    try:
        trial = _on(bench, package, (Stage("standby", trials.shadow_s),))
    except NOT_DECIDED as error:
        return GateStep(name="shadow run", passed=False, said=f"not decided: {error.what}")
    names = [port.name for port in bench.settings.outputs]
    places = [names.index(port.name) for port in package.outputs if port.name in names]
    wanted = np.abs(trial.wanted[:, places]).max(axis=0, initial=0.0)
    top = np.minimum(package.upper, -package.lower)
    if trial.refused or len(wanted) != len(top):
        return _step("shadow run", trial, [], "")
    faults = _beyond(package.outputs, "would get", wanted, top, trials.peak)
    said = f"{trials.shadow_s:g} s, peak {np.max(wanted / top):.1%} of the limit"
    return _step("shadow run", trial, faults, said)


def check_engagement(package: ControllerPackage, bench: GateRig, trials: GateTrials) -> tuple[GateStep, str]:
    """Engaged on a rig at a share, then fully, without a trip; and the trip that is the package's fault."""
    stages = Stage("engage", trials.engage_s, trials.share), Stage("engage", trials.engage_s)
    if bench.settings.hold:  # SAFE is to have one that is verified to fall back on
        stages = (Stage("standby", bench.settings.verify_s + bench.settings.rise_s + SETTLE_S), *stages)
    try:
        trial = _on(bench, package, stages)
    except NOT_DECIDED as error:
        return GateStep(name="engagement", passed=False, said=f"not decided: {error.what}"), ""
    said = f"{trials.engage_s:g} s at {trials.share:g} of full authority, then as long at full authority"
    return _step("engagement", trial, [], said), trial.trip if trial.blamed else ""


def _on(bench: GateRig, package: ControllerPackage, stages: tuple[Stage, ...]) -> Trial:
    return run_trial(
        package, bench.settings, bench.rig, stages, real_time=bench.real_time, program=bench.program
    )


def _step(name: str, trial: Trial, faults: list[str], said: str) -> GateStep:
    found = [f"trip: {trial.trip}"] if trial.trip else faults
    found = [f"refused: {trial.refused}"] if trial.refused else found
    return GateStep(name=name, passed=not found, said=f"{'; '.join(found) or said} ({trial.computer})")
