"""Recovery from limits under an adaptive gain: limits are reached at every gain, not at one alone."""

import dataclasses

import numpy as np

from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.gate.steps_on_paper import GateStep, check_recovery
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plants.plant import Plant

GAINS = 11
"""As many as fades are tried; between them nothing is proved of limits."""


def check_recovery_at_gains(
    package: ControllerPackage, gain: AdaptiveGain, name: str, plant: Plant, *, held: bool
) -> GateStep:
    """`check_recovery` of the law at eleven gains from ``minimum`` to ``maximum``.

    The law u = g (C x + D y) learns what is applied of that.
    """
    step = f"recovery {name} at gains from {gain.minimum:g} to {gain.maximum:g}"
    for g in np.linspace(gain.minimum, gain.maximum, GAINS):
        core = dataclasses.replace(package.core, C=g * package.core.C, D=g * package.core.D)
        scaled = dataclasses.replace(package, core=core, vectors=None)
        found = check_recovery(scaled, name, plant, held=held, alone=None)
        if not found.passed:
            return GateStep(name=step, passed=False, said=f"at a gain of {g:.4g}: {found.said}")
    return GateStep(name=step, passed=True, said=f"nothing grows at limits at any of {GAINS} gains")
