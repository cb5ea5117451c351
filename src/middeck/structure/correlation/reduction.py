"""The mass matrix of a model at the channels of a test: SEREP, Guyan, IRS (test-analysis models).

All three are M_r = T' M T, with T the motion of the model that goes with the channels' readings s, so that
L T = I for the rows L of the channels (SEREP: on the span of its modes).
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.residual_flexibility import moving_matrices
from middeck.values import record

# Shapes or channels whose condition is beyond this are the same to all measurement.
DEPENDENT = 1e8
# What a sparse solution may leave of L T = I.
SOLVED = 1e-6


class Reduction(Enum):
    """Reduction of the mass matrix to the channels."""

    SEREP = "serep"  # the chosen modes exactly, nothing else (O'Callahan, Avitabile and Riemer 1989)
    GUYAN = "guyan"  # static: what the channels do not see follows without inertia (Guyan 1965)
    IRS = "irs"  # Guyan and one correction for that inertia (O'Callahan 1989)


@record
class ReducedMass:
    """The mass at the channels, how it was reduced, and the condition of the chosen modes seen there.

    ``condition`` is the ratio of singular values of the modes' shapes at the channels, each of unit length: 1
    where the channels tell the modes apart as well as can be, large where they hardly do.
    """

    reduction: Reduction
    mass: Float[np.ndarray, "channel channel"]
    condition: float


def reduce_mass(
    modes: Modes,
    rows: sp.csr_array,
    reduction: Reduction = Reduction.SEREP,
    chosen: Sequence[int] | None = None,
) -> ReducedMass:
    """The mass of ``modes`` at the channels with the given ``rows`` (`sensor_rows`).

    ``chosen`` are the indices of the modes that the channels must tell apart, by default all. Raises
    `ConfigError` where they cannot (SEREP), where two channels read the same, or where a rigid motion leaves
    every channel at rest (Guyan, IRS).
    """
    index = np.arange(len(modes.omega)) if chosen is None else np.array(chosen, dtype=int)
    seen = np.asarray(rows @ modes.shapes[:, index])
    condition = _condition(seen)
    if reduction is Reduction.SEREP:
        if condition > DEPENDENT:
            channels, count = seen.shape
            raise ConfigError(
                f"{channels} channels cannot distinguish {count} modes (condition {condition:.1e})",
                where="reduction serep",
                hint="add sensors, correlate fewer modes, or reduce by guyan",
            )
        # T = Phi Phi_s^+, hence T' M T = Phi_s^+' Phi_s^+ for modes of unit mass.
        inverse = np.linalg.pinv(seen)
        return ReducedMass(reduction, np.asarray(inverse.T @ inverse), condition)
    T = _static(modes, rows, len(seen), improved=reduction is Reduction.IRS)
    mass = T.T @ (modes.mass @ T)
    return ReducedMass(reduction, 0.5 * (mass + mass.T), condition)


def _condition(seen: np.ndarray) -> float:
    if seen.shape[1] > seen.shape[0]:
        return float("inf")
    length = np.linalg.norm(seen, axis=0)
    return float(np.linalg.cond(seen / length)) if np.all(length > 0.0) else float("inf")


class _Held(NamedTuple):
    """The structure with its channels held: K bordered by the rows of the channels, factorised."""

    factor: spla.SuperLU
    scale: float

    def move(self, reading: np.ndarray) -> np.ndarray:
        """Displacement where the channels read ``reading`` and nothing else is loaded."""
        size = self.factor.shape[0] - len(reading)
        return self._solve(np.zeros((size, reading.shape[1])), reading)

    def load(self, force: np.ndarray) -> np.ndarray:
        """Displacement under ``force`` where the channels read nothing."""
        return self._solve(force, np.zeros((self.factor.shape[0] - len(force), force.shape[1])))

    def _solve(self, force: np.ndarray, reading: np.ndarray) -> np.ndarray:
        return self.factor.solve(np.vstack([force, self.scale * reading]))[: len(force)]


def _static(modes: Modes, rows: sp.csr_array, channels: int, improved: bool) -> np.ndarray:
    """T that makes the strain energy least for given readings; with ``improved`` the term of IRS.

    Where the channels are coordinates this is Guyan's [I; -K_oo^-1 K_os]; constraints allow any reading.
    """
    K, M, free = moving_matrices(modes, "a reduced mass")
    L = free.columns(rows)
    unit = np.eye(channels)
    _check_channels(L)
    rigid = [i for i, kind in enumerate(modes.kind) if kind == "rigid"]
    if rigid and _condition(np.asarray(rows @ modes.shapes[:, rigid])) > DEPENDENT:
        raise _mechanism(f"one of {', '.join(modes.name[i] for i in rigid)}")
    held = _hold(K, L)
    static = held.move(unit)
    if improved:
        inertia = M @ static
        static = static + held.load(inertia @ sla.solve(static.T @ inertia, static.T @ (K @ static)))
    error = float(np.abs(L @ static - unit).max())
    if not error < SOLVED:
        raise NumericalError(
            f"the static reduction misses its own readings by {error:.1e}", hint="reduce by serep"
        )
    return free.spread(static)


def _hold(K: sp.csr_array, L: sp.csr_array) -> _Held:
    scale = float(np.abs(K.diagonal()).max())
    bordered = sp.csc_array(sp.block_array([[K, scale * L.T], [scale * L, None]]))
    try:
        return _Held(spla.splu(bordered), scale)
    except RuntimeError:
        raise _mechanism("something") from None


def _check_channels(L: sp.csr_array) -> None:
    size, vectors = np.linalg.eigh((L @ L.T).toarray())
    if size[0] * DEPENDENT < size[-1]:
        alike = np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)
        raise ConfigError(
            f"channels {', '.join(map(str, alike))} (from 0) read the same motion",
            where="static reduction",
            hint="leave one of them out, or reduce by serep",
        )


def _mechanism(what: str) -> ConfigError:
    return ConfigError(
        f"with all channels held {what} still moves freely",
        where="static reduction",
        hint="add sensors that see it, or reduce by serep",
    )
