"""What an engine drives, as seen from Python: sensors in, outputs out, one sample after another."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float


class EngineRig(ABC):
    """A rig of an engine: `read`, then `write`, once a sample; the Python side of ``source/rig.h``.

    `ServedRig` runs one in a process of its own, which the engine reaches over UDP. It goes there by pickle,
    and so it begins its run with the first `read`.
    """

    @abstractmethod
    def read(self) -> Float[np.ndarray, " sensor"]:
        """Sensors now, in the engine's order and units; NaN for one that gives nothing."""

    @abstractmethod
    def write(self, u: Float[np.ndarray, " output"]) -> None:
        """Outputs from now to the next sample."""

    def close(self) -> None:
        """Let go of what the rig holds; its outputs are at zero already."""
        return
