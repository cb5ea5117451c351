"""Events of modes on a path of gravities: crossings, veerings, and the ends of a stable branch."""

from __future__ import annotations

from enum import Enum

import numpy as np
from jaxtyping import Float

from middeck.structure.elements.frames import Configuration
from middeck.structure.gravity.tracking import Spectrum
from middeck.values import record


class EventKind(Enum):
    """Kind of an event; the last four end a path."""

    CROSSING = "crossing"  # two modes change their order and keep their shapes
    VEERING = "veering"  # two modes keep their order and exchange their shapes
    UNSTABLE_START = "unstable start"  # the rest state at the first place is not stable
    UNSTABLE = "loss of stability"  # omega^2 of a mode passes through zero
    NO_REST = "no rest state"  # the branch ends: a limit point, as of a snap-through
    SLACK = "slack device"  # it would have to push


@record(kw_only=True)
class GravityEvent:
    """One event.

    Attributes:
        s, gravity: Place on the path, as in `GravityPath`.
        branch, name: The modes concerned, or the slack devices by name alone.
        frequency_hz: Mean frequency of two modes [Hz]; for a growing mode minus its rate over 2 pi.
        gap_hz: Least distance of two veering modes [Hz], otherwise zero.
    """

    kind: EventKind
    s: float
    gravity: Float[np.ndarray, "3"]
    branch: tuple[int, ...]
    name: tuple[str, ...]
    frequency_hz: float
    gap_hz: float

    @property
    def ends(self) -> bool:
        """Whether the event ends the path."""
        return self.kind not in (EventKind.CROSSING, EventKind.VEERING)

    @property
    def sentence(self) -> str:
        """The event in words."""
        at = f"at g = {np.linalg.norm(self.gravity):.6g} m/s^2"
        names = " and ".join(repr(n) for n in self.name)
        match self.kind:
            case EventKind.CROSSING:
                return f"{names} cross {at}, at {self.frequency_hz:.4g} Hz"
            case EventKind.VEERING:
                return f"{names} veer {at}: {self.gap_hz:.3g} Hz apart at {self.frequency_hz:.4g} Hz"
            case EventKind.UNSTABLE_START:
                return f"{names} is unstable where the path begins, {at}; follow it from its other end"
            case EventKind.UNSTABLE:
                return f"{names} loses stability {at}"
            case EventKind.NO_REST:
                return f"no rest state continues the branch beyond {at[3:]}; the softest mode is {names}"
            case EventKind.SLACK:
                return f"the device {names} goes slack {at}"


@record(kw_only=True)
class PathState:
    """A rest state on a path, the modes that are followed, and the least omega^2 of all."""

    s: float
    gravity: np.ndarray
    config: Configuration
    spectrum: Spectrum
    match: np.ndarray
    tension: np.ndarray
    least: float
