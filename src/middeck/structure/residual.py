"""Static completeness: what the modes that are left out give at low frequency (MacNeal 1971, Rubin 1975).

A mode far above the band answers a force at once, by 1/omega^2. The sum over all that are left out is the
flexibility of the whole less that of the kept ones. Where the structure is free, its flexibility is that of
its elastic part: forces balanced by the inertia of the rigid motion they cause, displacements without any
rigid motion (both in the metric of the mass: "inertia relief"). No singular matrix is inverted: as many
coordinates as there are rigid modes are held, which costs the balanced forces nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.assembly import assemble
from middeck.structure.modes import Modes
from middeck.structure.port_rows import input_rows, output_rows
from middeck.structure.statics import dynamic_coordinates
from middeck.systems.ports import Port
from middeck.values import record

# A gain below this part of the sum of the absolute terms that cancel in it is that of an uncoupled pair.
COUPLED = 1e-10


@record
class StaticGainComparison:
    """Low-frequency gains, undamped, of everything and of the kept modes without and with the residual.

    Parameters
    ----------
    frequency_hz:
        Where they are taken: zero, or with rigid modes a frequency far below the first flexible one.
    full:
        Gain of the whole structure, every mode included, by a direct solution; a rate's without its factor j.
    truncated, completed:
        Gain of the kept modes alone, and with the residual flexibility.
    truncated_error, completed_error:
        Their relative errors; not a number for a pair that is not coupled.
    """

    frequency_hz: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    full: Float[np.ndarray, "output input"]
    truncated: Float[np.ndarray, "output input"]
    completed: Float[np.ndarray, "output input"]
    truncated_error: Float[np.ndarray, "output input"]
    completed_error: Float[np.ndarray, "output input"]


def residual_flexibility(
    modes: Modes,
    force: Float[np.ndarray, "input coordinate"],
    reading: Float[np.ndarray, "output coordinate"],
    count: int,
) -> Float[np.ndarray, "output input"]:
    """``reading`` (K^-1 - sum phi phi' / omega^2) ``force`` over the lowest ``count`` modes.

    Symmetric where both rows are the same (Maxwell). With rigid modes K^-1 is the flexibility of the elastic
    part. Raises `ConfigError` where ``count`` leaves rigid modes out: their answer is not static.
    """
    rigid = int(np.sum(modes.omega == 0.0))
    if count < rigid:
        raise ConfigError(
            f"{count} modes kept of {rigid} rigid ones: what is left out has no static answer",
            hint=f"keep {rigid} modes or more, or static=False",
        )
    active = dynamic_coordinates(modes.equilibrium.model)
    K, M = _matrices(modes, active)
    shapes = modes.shapes[active]
    x = _solve_elastic(K, M, shapes[:, :rigid], force[:, active].T)
    kept = shapes[:, rigid:count]
    x -= kept @ ((kept.T @ force[:, active].T) / modes.omega[rigid:count, None] ** 2)
    return reading[:, active] @ x


def compare_static_gain(
    modes: Modes,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
    frequency_hz: float | None = None,
) -> StaticGainComparison:
    """What leaving out the modes beyond ``count`` does to low-frequency gains, without and with the residual.

    At 0 Hz; where there are rigid modes, at a tenth of the lowest frequency that is not zero, or at
    ``frequency_hz``. Raises `ConfigError` for 0 Hz with rigid modes, and where `residual_flexibility` does.
    """
    rigid = modes.omega == 0.0
    if frequency_hz is None:
        frequency_hz = float(0.1 * modes.frequency_hz[~rigid].min()) if np.any(rigid) else 0.0
    if np.any(rigid) and not frequency_hz > 0.0:
        raise ConfigError("a free structure has no gain at 0 Hz", hint="a frequency_hz above zero")
    omega, count = 2.0 * np.pi * frequency_hz, min(count, len(modes.omega))
    drive, read = input_rows(modes.equilibrium, inputs), output_rows(modes.equilibrium, outputs)
    C = read.position + omega * read.rate - omega**2 * read.acceleration
    active = dynamic_coordinates(modes.equilibrium.model)
    K, M = _matrices(modes, active)
    x = _factor(sp.csc_array(K - omega**2 * M))(drive.force[:, active].T)
    full, size = C[:, active] @ x, np.abs(C[:, active]) @ np.abs(x)
    shapes = modes.shapes[:, :count]
    modal = (shapes.T @ drive.force.T) / (modes.omega[:count] ** 2 - omega**2)[:, None]
    truncated = C @ shapes @ modal
    completed = truncated + residual_flexibility(modes, drive.force, read.position, count)
    scale = np.where(np.abs(full) > COUPLED * size, np.abs(full), np.nan)
    errors = (np.abs(gain - full) / scale for gain in (truncated, completed))
    return StaticGainComparison(frequency_hz, drive.ports, read.ports, full, truncated, completed, *errors)


def _matrices(modes: Modes, active: np.ndarray) -> tuple[sp.csr_array, sp.csr_array]:
    equilibrium = modes.equilibrium
    K = assemble(equilibrium.model, equilibrium.config, equilibrium.loads).tangent
    return K[active][:, active], modes.mass[active][:, active]


def _solve_elastic(
    K: sp.csr_array, M: sp.csr_array, rigid: np.ndarray, force: np.ndarray
) -> Float[np.ndarray, "coordinate input"]:
    """Displacements under ``force`` less its rigid part, without any rigid motion."""
    balanced = force - M @ (rigid @ (rigid.T @ force))
    free = np.ones(len(force), dtype=bool)
    free[_statically_determinate(rigid)] = False
    solve = _factor(sp.csc_array(K[free][:, free]))
    x = np.zeros_like(force)
    for _ in range(2):  # once more for what rounding has left
        x[free] += solve((balanced - K @ x)[free])
        x -= rigid @ (rigid.T @ (M @ x))
    return x


def _statically_determinate(rigid: np.ndarray) -> np.ndarray:
    """Coordinates that, held, stop every rigid mode: the pivots of a rank-revealing QR (Golub 1965)."""
    if not rigid.shape[1]:
        return np.zeros(0, dtype=int)
    _, pivots = cast("tuple[Any, np.ndarray]", sla.qr(rigid.T, mode="r", pivoting=True))
    return pivots[: rigid.shape[1]]


def _factor(K: sp.csc_array) -> Any:
    """Solver of a symmetric K by sparse LU with a symmetric order; about as much fill as Cholesky's."""
    factors: Any = spla.splu(
        K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=1e-3, options={"SymmetricMode": True}
    )
    return factors.solve
