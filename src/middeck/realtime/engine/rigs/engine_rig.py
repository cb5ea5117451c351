"""What an engine drives, as seen from Python: sensors in, outputs out, one sample after another."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError


class EngineRig(ABC):
    """A rig of an engine: `read`, then `write`, once a sample; the Python side of ``source/rig.h``.

    `ServedRig` runs one in a process of its own, which the engine reaches over UDP. It goes there by pickle,
    and so it begins its run with the first `read`.
    """

    @abstractmethod
    def read(self) -> Float[np.ndarray, " sensor"]:
        """Sensors now, in the engine's order and units; NaN for one that gives nothing."""

    def readings(self) -> Float[np.ndarray, " sensor"]:
        """The result of `read`; raises `DataError` where that is no array of real numbers."""
        y = np.asarray(self.read())
        if y.dtype.kind not in "fiub":
            what = f"the rig reads numbers of type {y.dtype}"
            raise DataError(what, where=type(self).__name__, hint="real numbers, one for each sensor")
        return y

    @abstractmethod
    def write(self, u: Float[np.ndarray, " output"]) -> None:
        """Outputs from now to the next sample."""

    def close(self) -> None:
        """Let go of what the rig holds; its outputs are at zero already."""
        return
