"""The gate: no package runs before every step has passed, on paper, on models and on a rig."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple, Self

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain, ProvedGain
from middeck.realtime.engine.interface.settings import EngineSettings, hash_hold
from middeck.realtime.gate.adaptive import GainProof, misfit, prove_gain
from middeck.realtime.gate.cross_fade import check_cross_fade
from middeck.realtime.gate.gain_recovery import check_recovery_at_gains, stable_at_every_gain
from middeck.realtime.gate.package_with_hold import drives_of, with_drives, with_hold
from middeck.realtime.gate.recovery_step import check_recovery
from middeck.realtime.gate.steps_on_rig import (
    GateRig,
    GateTrials,
    check_dry_run,
    check_engagement,
    check_shadow_run,
)
from middeck.realtime.gate.steps_without_rig import (
    GateMargins,
    GateStep,
    check_blacklist,
    check_error_bound,
    check_interface,
    check_model,
    check_poles,
    check_vectors,
)
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import hash_law, hash_package
from middeck.systems.plants.plant import Plant
from middeck.values import record

ONE_GAIN = (
    "the law is unstable by itself, or not proved to be stable at every gain, and its recovery from limits "
    "is proved at one gain only"
)
NO_HOLD = hashlib.sha256().hexdigest()


@record(kw_only=True)
class GateVerdict:
    """The verdict of the gate on one package.

    Attributes:
        sha256: Of the package: the verdict is of these bytes and no others.
        law: SHA-256 of what computes (`hash_law`), by which a blacklist knows it under any name.
        name: Name of the package.
        models: Names of the models that it was tried on.
        steps: In order; after one that is not passed the later ones are not taken.
        left_out: Steps that were not asked for; whether such a verdict counts is for its user to decide.
        tripped: The trip that the package is to blame for, with which it goes on the blacklist; empty for
            none.
        gain: The adaptive gain that was asked for; None for none.
        proofs: What is proved of it on each model; empty where its steps were not taken.
        hold: SHA-256 of the hold that was closed beside it (`hash_hold`).
        engaged: SHA-256 of the package that it is to relieve; empty for none.
    """

    sha256: str
    law: str
    name: str
    models: tuple[str, ...]
    steps: tuple[GateStep, ...]
    left_out: tuple[str, ...] = ()
    tripped: str = ""
    gain: AdaptiveGain | None = None
    proofs: tuple[GainProof, ...] = ()
    hold: str = NO_HOLD
    engaged: str = ""

    @property
    def proved_gain(self) -> ProvedGain | None:
        """What an engine with this hold needs to adapt the gain of this package; None where it must not."""
        gain = self.gain
        if gain is None or not (self.passed and self.proofs and all(proof.proved for proof in self.proofs)):
            return None
        return ProvedGain(
            package=self.sha256, hold=self.hold, minimum=gain.minimum, maximum=gain.maximum, rate=gain.rate
        )

    @property
    def passed(self) -> bool:
        """Whether every step was."""
        return all(step.passed for step in self.steps)


def examine_package(
    package: ControllerPackage,
    models: Mapping[str, Plant],
    margins: GateMargins | None = None,
    *,
    gain: AdaptiveGain | None = None,
    trials: GateTrials | None = None,
    rig: GateRig | None = None,
    blacklist: Mapping[str, str] | None = None,
    settings: EngineSettings | None = None,
    engaged: ControllerPackage | None = None,
    log: Callable[[GateStep], object] | None = None,
    on_trip: Callable[[str, str], object] | None = None,
) -> GateVerdict:
    """Blacklist, interface, poles, test vectors, bound of the error; the loop with each model; then runs.

    What is not known of a loop is not passed.

    Args:
        models: Plants by name, as on board, without the engine's hold.
        margins: What the loop with each must keep at every fade.
        gain: An adaptive gain, whose loop with each must be proved over all its values and moves
            (`prove_gain`), and recover from limits at each of eleven (`check_recovery_at_gains`).
        trials: Dry runs on every model too; and on a ``rig`` a shadow run, then engagement at a share of full
            authority and at all of it. Without them the gate is on paper.
        blacklist: Reasons by SHA-256 (`hash_law`) of laws that have tripped.
        settings: Of the engine that is to run it; if left out, those of a ``rig``: a hold is closed on every
            model, limits of the drives count, and what it does not run is not passed. Without them the
            package is for any computer, and is tried alone.
        engaged: The package that it is to relieve: their cross-fade is tried on every model
            (`check_cross_fade`), with ``trials`` also to their share. Without it that fade is not judged; the
            one from the hold alone always is. With a ``gain`` it is refused: of two laws at once none is
            proved.
        log: Told of each step as it ends, before the next begins (`files.GateLog`).
        on_trip: Told of the law (`hash_law`) that is to blame for a trip, and of the trip, before its step is
            logged: what stops the gate then leaves the law on a blacklist.

    Raises `ConfigError` without a model, as a package that was tried on nothing has passed nothing, and for
    a rig whose engine has another hold than ``settings``.
    """
    if not models:
        raise ConfigError("no model to try the package on", hint="plants by name, as on board")
    if rig is not None and settings is not None and hash_hold(rig.settings) != hash_hold(settings):
        raise ConfigError("the rig's engine has another hold", hint="the settings of the same engine")
    engine = rig.settings if settings is None and rig is not None else settings
    case = _Case(
        package,
        models,
        margins or GateMargins(),
        gain,
        trials,
        rig,
        blacklist or {},
        engine,
        engaged,
        on_trip,
    )
    steps, found = _Steps(log), _Found([], [])
    for stage in _stages(case, found):
        steps += stage
        if not all(step.passed for step in steps):
            break
    left_out = ("dry run", "shadow run", "engagement")[0 if trials is None else 1 if rig is None else 3 :]
    return GateVerdict(
        sha256=hash_package(package), law=hash_law(package), name=package.name, models=tuple(models),
        steps=tuple(steps), left_out=left_out, tripped="".join(found.trips), gain=gain,
        proofs=tuple(found.proofs), hold=NO_HOLD if engine is None else hash_hold(engine),
        engaged="" if engaged is None else hash_package(engaged),
    )  # fmt: skip


class _Case(NamedTuple):
    """What `examine_package` was given, with the engine whose hold is closed."""

    package: ControllerPackage
    models: Mapping[str, Plant]
    margins: GateMargins
    gain: AdaptiveGain | None
    trials: GateTrials | None
    rig: GateRig | None
    blacklist: Mapping[str, str]
    engine: EngineSettings | None
    engaged: ControllerPackage | None
    on_trip: Callable[[str, str], object] | None


class _Found(NamedTuple):
    """What stages find besides steps."""

    proofs: list[GainProof]
    trips: list[str]


class _Steps(list[GateStep]):
    """Steps as they are taken: what adds several must not take the next before the last is told."""

    def __init__(self, log: Callable[[GateStep], object] | None) -> None:
        super().__init__()
        self._log = log

    def __iadd__(self, steps: Iterable[GateStep]) -> Self:
        for step in steps:
            self.append(step)
            if self._log is not None:
                self._log(step)
        return self


def _stages(case: _Case, found: _Found) -> Iterator[Iterable[GateStep]]:
    """The stages that were asked for: each is asked for its steps where all before it have passed."""
    package, models, gain, trials = case.package, case.models, case.gain, case.trials
    yield [check_blacklist(hash_law(package), case.blacklist)]
    held, unfit = _beside_hold(package, case.engine)
    yield _on_paper(case, held, unfit or check_interface(held, models))
    yield (check_model(held, name, plant, case.margins) for name, plant in models.items())
    yield _recoveries(case, held)
    if case.engaged is not None:
        yield _cross_fades(case, case.engaged)
    if gain is not None:
        yield _prove_each(held, gain, models, found.proofs)
        beside = held is not package
        yield (
            check_recovery_at_gains(held, gain, name, plant, held=beside) for name, plant in models.items()
        )
    if trials is not None:
        yield (check_dry_run(package, name, plant, trials, case.engine) for name, plant in models.items())
    if trials is not None and case.rig is not None:
        yield [check_shadow_run(package, case.rig, trials)]
        yield [_engage(case, case.rig, trials, found.trips)]


def _on_paper(case: _Case, held: ControllerPackage, interface: GateStep) -> Iterator[GateStep]:
    yield interface
    yield check_poles(held)
    yield check_vectors(case.package)
    yield check_error_bound(case.package, _what_fades(case))
    if case.gain is not None:
        yield _check_gain(case.package, case.gain)


def _what_fades(case: _Case) -> str:
    """What takes a part of the law's commands beyond its own ramp."""
    cross_fade = "" if case.engaged is None else f"the cross-fade from {case.engaged.name}"
    by_rig = "the rig's engine" if case.rig else ""
    return "an adaptive gain" if case.gain is not None else cross_fade or by_rig


def _recoveries(case: _Case, held: ControllerPackage) -> Iterator[GateStep]:
    alone, sums = case.package, ()
    if case.engine is not None and case.engine.hold:
        alone, sums = held, drives_of(held, case.engine)
    elif case.engine is not None:
        alone = with_drives(case.package, case.engine)
    beside = held is not case.package
    for name, plant in case.models.items():
        yield check_recovery(held, name, plant, held=beside, alone=alone, sums=sums)


def _cross_fades(case: _Case, engaged: ControllerPackage) -> Iterable[GateStep]:
    if case.gain is not None:
        return [_refuse_cross_fade(engaged)]
    share = 1.0 if case.trials is None else case.trials.share
    return check_cross_fade(engaged, case.package, case.models, case.margins, case.engine, share)


def _prove_each(
    held: ControllerPackage, gain: AdaptiveGain, models: Mapping[str, Plant], proofs: list[GainProof]
) -> Iterator[GateStep]:
    """Add the proof on each model to ``proofs``."""
    for name, plant in models.items():
        (proof,) = prove_gain(held, gain, {name: plant})
        proofs.append(proof)
        yield GateStep(name=f"adaptive gain {name}", passed=proof.proved, said=proof.said)


def _engage(case: _Case, rig: GateRig, trials: GateTrials, trips: list[str]) -> GateStep:
    """Who is to blame for a trip is told before the step is logged."""
    step, tripped = check_engagement(case.package, rig, trials)
    trips.append(tripped)
    if tripped and case.on_trip is not None:
        case.on_trip(hash_law(case.package), tripped)
    return step


def _beside_hold(
    package: ControllerPackage, engine: EngineSettings | None
) -> tuple[ControllerPackage, GateStep | None]:
    """The package beside the engine's hold, or why that engine does not run it."""
    if engine is None:
        return package, None
    try:
        return with_hold(package, engine), None
    except ConfigError as error:
        return package, GateStep(name="interface", passed=False, said=f"{error.what}: {error.hint}")


def _refuse_cross_fade(engaged: ControllerPackage) -> GateStep:
    said = (
        "of two laws at once no adaptive gain is proved, and the engine refuses it: disengage one before the "
        "other engages, and ask for this verdict without it"
    )
    return GateStep(name=f"cross-fade from {engaged.name}", passed=False, said=said)


def _check_gain(package: ControllerPackage, gain: AdaptiveGain) -> GateStep:
    fault = misfit(package, gain)
    if not fault and (package.unstable or not stable_at_every_gain(package, gain)):
        fault = ONE_GAIN
    low, high = gain.band_hz
    watched = f"from {gain.minimum:g} to {gain.maximum:g} by {gain.sensor} from {low:g} to {high:g} Hz"
    return GateStep(name="adaptive gain", passed=not fault, said=fault or watched)
