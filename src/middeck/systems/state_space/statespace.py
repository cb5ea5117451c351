"""Linear systems as four real matrices, continuous or sampled by type."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import ClassVar, Self, TypeVar

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.values import record


@record
class _Matrices:
    """Four real matrices, and what they answer in continuous as in sampled time."""

    # Fields whose rounding may move what is computed from the system.
    rounded: ClassVar[tuple[str, ...]] = ("A", "B", "C")
    # Matrices know none; modes do.
    state_names: ClassVar[tuple[str, ...]] = ()
    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state input"]
    C: Float[np.ndarray, "output state"]
    D: Float[np.ndarray, "output input"]

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs."""
        return len(self.C), self.B.shape[1]

    def select(self, inputs: Sequence[int], outputs: Sequence[int]) -> Self:
        """The system from some of its inputs to some of its outputs, by their numbers.

        >>> gain_system(np.array([[1.0, 2.0], [3.0, 4.0]])).select((1,), (1, 0)).D.tolist()
        [[4.0], [2.0]]
        """
        columns, rows = list(inputs), list(outputs)  # a tuple would be taken for one row and one column
        D = self.D[np.ix_(rows, columns)]
        return dataclasses.replace(self, B=self.B[:, columns], C=self.C[rows], D=D)

    def scale_inputs(self, scale: Float[np.ndarray, " input"]) -> Self:
        """The system with each input multiplied by its ``scale``."""
        return dataclasses.replace(self, B=self.B * scale, D=self.D * scale)


@record
class StateSpace(_Matrices):
    """Continuous system x' = A x + B u, y = C x + D u."""

    period_s: ClassVar[None] = None

    def as_statespace(self) -> StateSpace:
        """The system itself, as of a `ModalSystem` its state space."""
        return self


@record
class SampledStateSpace(_Matrices):
    """Sampled system x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], at ``period_s``."""

    period_s: float = dataclasses.field(kw_only=True)


LinearSystem = StateSpace | SampledStateSpace
"""Either kind, where the computation is the same or depends on the system's period."""
System = TypeVar("System", bound=LinearSystem)


def same_period(one_s: float, other_s: float) -> bool:
    """Whether two periods [s] are equal up to rounding."""
    return abs(one_s - other_s) <= 1e-12 * one_s


def gain_system(D: Float[np.ndarray, "output input"]) -> StateSpace:
    """A system without states: y = D u."""
    outputs, inputs = np.shape(D)
    return StateSpace(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), D)


def series(first: System, second: System) -> System:
    """``second`` driven by ``first``: y = second(first(u)); states ordered (first, second)."""
    A = np.block([[first.A, np.zeros((len(first.A), len(second.A)))], [second.B @ first.C, second.A]])
    B = np.vstack([first.B, second.B @ first.D])
    C = np.hstack([second.D @ first.C, second.C])
    return dataclasses.replace(first, A=A, B=B, C=C, D=second.D @ first.D)


def add(first: StateSpace, second: StateSpace) -> StateSpace:
    """Parallel connection, outputs added; states ordered (first, second)."""
    return StateSpace(
        np.asarray(scipy.linalg.block_diag(first.A, second.A)),
        np.vstack([first.B, second.B]),
        np.hstack([first.C, second.C]),
        first.D + second.D,
    )


def dual(system: StateSpace) -> StateSpace:
    """The system whose transfer matrix is the transpose."""
    return StateSpace(system.A.T, system.C.T, system.B.T, system.D.T)


def poles(system: LinearSystem) -> Complex[np.ndarray, " state"]:
    """Eigenvalues of A (rad/s for a continuous system, z-plane for a sampled one)."""
    return np.linalg.eigvals(system.A).astype(complex)
