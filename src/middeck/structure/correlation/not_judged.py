"""Sentences on modes and criteria that a test leaves unjudged: modes below all that it measured or that its
sensors hardly see, criteria that apply to none."""

from collections.abc import Container, Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.correlation.effective_mass import measure_effective_mass
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.correlation.review_criteria import Criterion, Profile, Scope
from middeck.structure.eigenproblem.repeated import by_frequency
from middeck.structure.modes.solve import Modes

HIDDEN = 0.1
"""Noise of another mode, as a part of a mode's motion at the channels, both at unit modal mass: above it
orthogonalities by SEREP, whose limits are about this, say little of the mode."""


def flexible_modes(modes: Modes) -> Int[np.ndarray, " mode"]:
    """Modes of kind flexible."""
    return np.array([i for i, kind in enumerate(modes.kind) if kind == "flexible"], dtype=int)


def fundamental_modes(modes: Modes) -> Int[np.ndarray, " mode"]:
    """The lowest flexible mode, with those that have its frequency."""
    flexible = flexible_modes(modes)
    groups = by_frequency(modes.omega[flexible] ** 2)
    return flexible[groups[0]] if groups else flexible


def below_the_test(modes: Modes, measured: MeasuredModes, paired: Container[int]) -> list[str]:
    """One sentence on the model's flexible modes below all that was measured; empty for none."""
    low = measured.frequency_hz.min()
    below = [i for i in flexible_modes(modes) if modes.frequency_hz[i] < low and i not in paired]
    if not below:
        return []
    if below[1:]:
        lie = f"{len(below)} flexible modes lie below all that was measured, the lowest of them"
    else:
        lie = "a flexible mode lies below all that was measured:"
    return [f"{lie} {_called(modes, below[0])}"]


def hardly_seen(
    modes: Modes,
    measured: MeasuredModes,
    std: Float[np.ndarray, "channel mode"],
    pairs: Int[np.ndarray, "pair 2"],
    shape: Float[np.ndarray, "channel mode"],
) -> list[str]:
    """The paired mode whose ``shape`` at the channels is the smallest, if noise of another hides it."""
    ours, theirs = pairs.T
    size = np.linalg.norm(shape[:, ours], axis=0)
    relative = np.linalg.norm(std[:, theirs], axis=0) / np.linalg.norm(measured.shape[:, theirs], axis=0)
    noise = size * relative / np.sqrt(len(shape))
    least = int(size.argmin())
    noise[least] = 0.0
    most = int(noise.argmax())
    if noise[most] <= HIDDEN * size[least]:
        return []
    return [
        f"{_called(modes, int(ours[least]))} moves the sensors {size[most] / size[least]:.2g} times less "
        f"than {_called(modes, int(ours[most]))} at equal modal mass: noise of that is "
        f"{noise[most] / size[least]:.2g} times its motion, too much for orthogonalities by serep; measure "
        "where it moves, or leave it out of the survey"
    ]


def not_judged(modes: Modes, profile: Profile, criteria: Sequence[Criterion]) -> list[str]:
    """Why ``criteria`` apply to no pair: a sentence for each group of modes."""
    remarks: list[str] = []
    for group, some in groupby(sorted(criteria, key=lambda c: c.group.value), lambda c: c.group):
        what = ", ".join(dict.fromkeys(c.quantity.value for c in some))
        remarks.append(f"no pair is judged as {group.value} ({what}){_why(modes, profile, group)}")
    return remarks


def _why(modes: Modes, profile: Profile, group: Scope) -> str:
    if group is Scope.FUNDAMENTAL:
        return _fundamental(modes)
    if group is Scope.SIGNIFICANT:
        return _significant(modes, profile)
    return ""


def _fundamental(modes: Modes) -> str:
    lowest = fundamental_modes(modes)
    if not len(lowest):
        return ": the model has no flexible mode"
    return f": {_called(modes, lowest[0])} has no partner, so that this is not met"


def _significant(modes: Modes, profile: Profile) -> str:
    part = f"{100.0 * profile.significant_fraction:g} % of the effective mass"
    fraction = measure_effective_mass(modes).fraction.max(axis=1)
    large = np.flatnonzero(fraction > profile.significant_fraction)
    first = fundamental_modes(modes)
    others = [i for i in large if i not in first and modes.kind[i] == "flexible"]
    if others:
        return f": {_called(modes, others[0])} has more than {part}, but no partner"
    if len(large):
        have = dict.fromkeys("the fundamental" if i in first else f"{modes.kind[i]} modes" for i in large)
        return f": of the model only {' and '.join(have)} have more than {part}"
    return f": no mode of the model has more than {part}"


def _called(modes: Modes, i: int) -> str:
    return f"mode {i} {modes.name[i]!r} of {modes.frequency_hz[i]:.4g} Hz"
