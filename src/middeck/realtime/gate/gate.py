"""The gate on paper: no package goes on to a rig before every step has passed."""

from __future__ import annotations

from collections.abc import Mapping

from middeck.errors import ConfigError
from middeck.realtime.gate.adaptive import AdaptiveGain, GainProof, misfit, prove_gain
from middeck.realtime.gate.steps import (
    GateMargins,
    GateStep,
    check_error_bound,
    check_interface,
    check_model,
    check_poles,
    check_vectors,
)
from middeck.realtime.package.binary import hash_package
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plant import Plant
from middeck.values import record


@record(kw_only=True)
class GateVerdict:
    """What the gate found of one package.

    Attributes:
        sha256: Of the package: the verdict is of these bytes and no others.
        name: Of the package.
        models: Names of the models that it was tried on.
        steps: In order; after one that is not passed the later ones are not taken.
        gain: The adaptive gain that was asked for; None for none.
        proofs: What is proved of it on each model; empty where its steps were not taken.
    """

    sha256: str
    name: str
    models: tuple[str, ...]
    steps: tuple[GateStep, ...]
    gain: AdaptiveGain | None = None
    proofs: tuple[GainProof, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every step was."""
        return all(step.passed for step in self.steps)


def examine_package(
    package: ControllerPackage,
    models: Mapping[str, Plant],
    margins: GateMargins | None = None,
    gain: AdaptiveGain | None = None,
) -> GateVerdict:
    """Interface, poles, test vectors, bound of the error; then the loop with each model at every fade.

    With an adaptive ``gain`` also the proof of each loop over all its values and moves (`prove_gain`).
    What is not known of a loop is not passed. These are the steps that need no rig; dry run, shadow run and
    engagement at reduced gain belong to the computer that runs the package. Raises `ConfigError` without a
    model: a package that was tried on nothing has passed nothing.
    """
    if not models:
        raise ConfigError("no model to try the package on", hint="plants by name, as on board")
    steps = [
        check_interface(package, models),
        check_poles(package),
        check_vectors(package),
        check_error_bound(package),
    ]
    if gain is not None:
        steps.append(_check_gain(package, gain))
    proofs: tuple[GainProof, ...] = ()
    if all(step.passed for step in steps):
        least = margins or GateMargins()
        steps += [check_model(package, name, plant, least) for name, plant in models.items()]
    if gain is not None and all(step.passed for step in steps):
        proofs = prove_gain(package, gain, models)
        steps += [
            GateStep(name=f"adaptive gain {proof.model}", passed=proof.proved, said=proof.said)
            for proof in proofs
        ]
    return GateVerdict(
        sha256=hash_package(package), name=package.name, models=tuple(models), steps=tuple(steps),
        gain=gain, proofs=proofs,
    )  # fmt: skip


def _check_gain(package: ControllerPackage, gain: AdaptiveGain) -> GateStep:
    fault = misfit(package, gain)
    low, high = gain.band_hz
    watched = f"from {gain.minimum:g} to {gain.maximum:g} by {gain.sensor} from {low:g} to {high:g} Hz"
    return GateStep(name="adaptive gain", passed=not fault, said=fault or watched)
