"""Second-order sections: filters of a law's inputs, and the paths of its inner loop."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record

SMALLEST: dict[type[np.floating], float] = {np.float64: 2.0**-900, np.float32: 2.0**-100}
"""Below this a state of a law or section is zero: products of it would leave the normal numbers, where a
processor takes a hundred times as long."""


@record
class Section:
    """(b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2), run in the transposed second form.

    out = b0 in + s1; s1 = (b1 in - a1 out) + s2; s2 = b2 in - a2 out, in this order of rounding.

    >>> static_gain(-2.0).b.tolist()
    [-2.0, 0.0, 0.0]
    """

    b: Float[np.ndarray, "3"]
    a: Float[np.ndarray, "2"]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.b).all() and np.isfinite(self.a).all()):
            raise ConfigError("a section has a number that is not finite", hint="finite b and a")

    @property
    def stable(self) -> bool:
        """Whether both poles lie inside the unit circle (the triangle of a1 and a2)."""
        a1, a2 = self.a.tolist()
        return abs(a2) < 1.0 and abs(a1) < 1.0 + a2


def static_gain(gain: float) -> Section:
    """The section that multiplies."""
    return Section(np.array([gain, 0.0, 0.0]), np.zeros(2))


@record
class InputFilter:
    """A section in series with one input of the compensator; those of one input follow each other."""

    input: int
    section: Section


@record
class LoopPath:
    """A section from an input to an output, beside the compensator and never faded: a part of the PD loop."""

    input: int
    output: int
    section: Section
