"""The compensator in a package: four matrices, dense or in modal blocks, and the path of applied commands."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record


@record(kw_only=True)
class Core:
    """c = C x + D y, then x = A x + B y + E e, where e is the command really applied less the one asked for.

    With E = 0 the law does not know that it is limited. An observer has its input matrix there (less the
    injection of the plant's direct term), and so it estimates from the torque really applied (Åström and
    Wittenmark 1997, section 9.4).

    Attributes:
        pairs: None for a dense A. Else A is modal: so many blocks of two states, the first states of all
            blocks, then their second states, then states that stand alone. A is zero but for its diagonal,
            and the two numbers that couple the states of a block.
    """

    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state input"]
    C: Float[np.ndarray, "output state"]
    D: Float[np.ndarray, "output input"]
    E: Float[np.ndarray, "state output"]
    pairs: int | None

    def __post_init__(self) -> None:
        for name in "ABCDE":
            if not np.isfinite(getattr(self, name)).all():
                raise ConfigError(
                    f"{name} has a number that is not finite", where="Core", hint="finite numbers"
                )
        if self.pairs is None:
            return
        if not 0 <= 2 * self.pairs <= len(self.A):
            raise ConfigError(
                f"{self.pairs} blocks for {len(self.A)} states", where="Core", hint="two states each"
            )
        if np.any(self.A[~modal_pattern(len(self.A), self.pairs)]):
            raise ConfigError(
                "A is not modal: it couples states of different blocks", where="Core", hint="pairs=None"
            )

    @functools.cached_property
    def radius(self) -> float:
        """The largest magnitude of a pole; 0 without states."""
        p = self.pairs
        if p is None:
            return float(np.abs(np.linalg.eigvals(self.A)).max(initial=0.0))
        first, second, alone = slice(0, p), slice(p, 2 * p), slice(2 * p, None)
        diagonal = np.diag(self.A)
        blocks = np.empty((p, 2, 2))
        blocks[:, 0, 0], blocks[:, 1, 1] = diagonal[first], diagonal[second]
        blocks[:, 0, 1], blocks[:, 1, 0] = np.diag(self.A[first, second]), np.diag(self.A[second, first])
        poles = [*np.linalg.eigvals(blocks).ravel(), *diagonal[alone]]
        return float(np.abs(poles).max(initial=0.0))

    @property
    def drives(self) -> bool:
        """Whether the applied command has a path."""
        return bool(np.any(self.E))


def modal_pattern(states: int, pairs: int) -> np.ndarray:
    """Where A may have numbers."""
    allowed = np.eye(states, dtype=bool)
    first = np.arange(pairs)
    allowed[first, first + pairs] = allowed[first + pairs, first] = True
    return allowed
