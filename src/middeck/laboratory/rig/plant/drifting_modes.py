"""Hardware that changes with time: chosen modes drift in frequency."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.values import record


@record
class Drift:
    """Named modes whose frequencies drift linearly, by ``percent`` at the age ``age_s`` [s]."""

    modes: tuple[str, ...]
    percent: float
    age_s: float

    def __post_init__(self) -> None:
        if not (0.0 < self.age_s < math.inf and math.isfinite(self.percent)):
            raise ConfigError(
                f"a drift by {self.percent} % within {self.age_s} s",
                where="Drift",
                hint="finite, in an age above zero",
            )

    def factor(self, age_s: float) -> float:
        """Factor on the frequencies at ``age_s``.

        >>> Drift(("a",), -2.0, 100.0).factor(50.0)
        0.99
        """
        return 1.0 + 0.01 * self.percent * age_s / self.age_s


def age_plant(plant: Plant, drifts: Sequence[Drift], age_s: float) -> Plant:
    """The plant at ``age_s``; damping ratios and shapes are unchanged. Without drifts it is ``plant``.

    Raises `ConfigError` for a plant that is not modal, an unknown mode, or a frequency that would not be
    positive.
    """
    if not 0.0 <= age_s < math.inf:
        raise ConfigError(f"an article {age_s} s old", where="Drift", hint="finite, from zero")
    if not drifts:
        return plant
    modal = modal_part(plant)
    omega = np.array(modal.omega)
    for drift in drifts:
        for name in drift.modes:
            if name not in modal.names:
                raise ConfigError(f"no mode {name!r}", where="Drift", hint=f"one of {', '.join(modal.names)}")
            omega[modal.names.index(name)] *= drift.factor(age_s)
    ends_s = drift_end(modal, drifts)
    if age_s >= ends_s:
        raise ConfigError(
            f"at an age of {age_s:g} s a drift has brought a frequency to zero",
            where="Drift",
            hint=f"an age below {ends_s:g} s",
        )
    return dataclasses.replace(plant, dynamics=dataclasses.replace(modal, omega=omega))


def drift_end(modal: ModalSystem, drifts: Sequence[Drift]) -> float:
    """Age [s] at which the first drift has brought a frequency to zero; ``inf`` if none ever does."""
    moving = {name for name, w in zip(modal.names, modal.omega, strict=True) if w > 0.0}
    ends = [-100.0 * d.age_s / d.percent for d in drifts if d.percent < 0.0 and moving & set(d.modes)]
    return min(ends, default=math.inf)


def nearest_modes(plant: Plant, frequency_hz: float) -> tuple[str, ...]:
    """Names of the two modes of a modal plant nearest to a frequency, the lowest first."""
    modal = modal_part(plant)
    near = np.argsort(np.abs(modal.omega / (2.0 * np.pi) - frequency_hz), kind="stable")[:2]
    return tuple(modal.names[i] for i in sorted(near))


def modal_part(plant: Plant) -> ModalSystem:
    """The modes of a plant; `ConfigError` for one that is not modal."""
    if plant.modal is None:
        raise ConfigError(
            "only a plant in modal form has modes that can drift",
            where="Drift",
            hint="build_plant of an article without spinning wheels",
        )
    return plant.modal
