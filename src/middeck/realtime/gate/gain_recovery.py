"""Recovery from limits under an adaptive gain: limits are reached at every gain, not at one alone."""

import dataclasses

import numpy as np

from middeck.errors import NumericalError
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.gate.gain_loop import GainLoop
from middeck.realtime.gate.gain_proof import prove_interval
from middeck.realtime.gate.recovery_step import check_recovery
from middeck.realtime.gate.steps_without_rig import GateStep
from middeck.realtime.package.core import Core
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plants.plant import Plant

GAINS = 11
"""As many as fades are tried; between them nothing is proved of limits."""


def at_gain(package: ControllerPackage, gain: float) -> ControllerPackage:
    """The package, in double precision, whose own command is ``gain`` times that of ``package``.

    A law learns how far what is applied is from what it asked for at a gain of one: that ``gain`` times its
    command acts moves its states by (``gain`` - 1) E c.
    """
    core, moved = package.core, (gain - 1.0) * package.core.E
    C, D = gain * core.C, gain * core.D
    core = Core(A=core.A + moved @ core.C, B=core.B + moved @ core.D, C=C, D=D, E=core.E, pairs=None)
    return dataclasses.replace(
        package, core=core, unstable=package.unstable or core.radius >= 1.0,
        single=False, error_bound=None, error_bound_own=False, vectors=None,
    )  # fmt: skip


def stable_at_every_gain(package: ControllerPackage, gain: AdaptiveGain) -> bool:
    """Whether the law's own poles are proved to lie inside the unit circle at every gain of ``gain``."""
    core = package.core
    if not core.drives:
        return core.radius < 1.0
    a, b, c = np.abs(core.A), np.abs(core.E), np.abs(core.C)
    alone = GainLoop(
        A=core.A - core.E @ core.C, B=core.E, C=core.C, D=np.zeros((core.C.shape[0],) * 2),
        size_A=a + b @ c, size_B=b, size_C=c, period_s=package.period_s,
    )  # fmt: skip
    try:
        return prove_interval(alone, gain.minimum, gain.maximum, 0.0).constant < 1.0
    except NumericalError:
        return False


def check_recovery_at_gains(
    package: ControllerPackage, gain: AdaptiveGain, name: str, plant: Plant, *, held: bool
) -> GateStep:
    """`check_recovery` of the law at eleven gains from ``minimum`` to ``maximum``."""
    step = f"recovery {name} at gains from {gain.minimum:g} to {gain.maximum:g}"
    for g in np.linspace(gain.minimum, gain.maximum, GAINS):
        found = check_recovery(at_gain(package, float(g)), name, plant, held=held, alone=None)
        if not found.passed:
            return GateStep(name=step, passed=False, said=f"at a gain of {g:.4g}: {found.said}")
    return GateStep(name=step, passed=True, said=f"nothing grows at limits at any of {GAINS} gains")
