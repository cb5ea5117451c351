"""Unstabilisable modes by name (Popov, Belevitch and Hautus test)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import NotStabilisableError
from middeck.systems.poles.rounding import ROUNDINGS, poles_with_rounding
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.balancing import balance

RANK_FLOOR = 1e-10
"""Singular values of [A - lambda I, B] below this, relative to A (to A - I, how far a sampled system moves
within a period), count as zero: a million times rounding, ten million times below the weakest rigid mode of a
structure (1e-3)."""
MIXED_FLOOR = 1e-13
"""The same of mixed states, at the poles as they are computed: up to a condition of 1e5 values of what is
reached were above 1e-12, of what is not below 3e-14. Of a sampled one also the least floor, relative to A."""
CANDIDATE = 1e-6
"""How far left of the axis (relative to A) an eigenvalue may be computed and still be examined, on the axis:
double poles at the origin are known to the square root of rounding only."""
CIRCLE = 1e-7
"""The same for modulus one; less, since at 1 kHz a mode of 0.03 Hz and 1 % is only 2e-6 inside."""
SPREAD = 3
"""Names that share what is not reached, from which on the states are mixed."""
AS_FAR = ", as far as rounding of these states shows"
HIDDEN = "in mixed states rounding may hide what is reached and seen: modal ones, or of like sizes, decide"


def unreachable_states(
    A: Float[np.ndarray, "state state"],
    B: Float[np.ndarray, "state input"],
    *,
    only_axis: bool = False,
    sampled: bool = False,
    mixed: bool = False,
) -> Float[np.ndarray, " state"]:
    """Participation of each state in uncontrollable modes that do not decay (0: none).

    The squared row norms of an orthonormal basis of the left null spaces of [A - lambda I, B], one
    lambda per group of equal eigenvalues with real part >= 0 (``only_axis``: = 0), or for a ``sampled``
    system with modulus >= 1 (= 1). For ``mixed`` states each lambda counts that rounding may have moved from
    there: neighbours within `CANDIDATE` are other modes.

    >>> unreachable_states(np.diag([0.0, -1.0]), np.array([[0.0], [1.0]]))
    array([1., 0.])
    """
    if not len(A):
        return np.zeros(0)
    unit = _even_units(A) if sampled else balance(A)[1]
    share = _unreachable_in(unit, A, B, only_axis, sampled, mixed)
    if mixed or not share.any():
        return share
    # Balanced units hide a free body whose stiffness is rounding: they make its link as weak as that.
    return share if _unreachable_in(np.ones(len(A)), A, B, only_axis, sampled, mixed).any() else 0.0 * share


def _unreachable_in(
    unit: np.ndarray, A: np.ndarray, B: np.ndarray, only_axis: bool, sampled: bool, mixed: bool
) -> Float[np.ndarray, " state"]:
    """As `unreachable_states`, judged in these units."""
    share, rest = np.zeros(len(A)), float(sampled) * np.eye(len(A))
    balanced, drive = A * unit / unit[:, None], B / unit[:, None]
    whole = float(np.linalg.norm(balanced, 2))
    size = min(whole, float(np.linalg.norm(balanced - rest, 2))) or 1.0
    length = np.linalg.norm(drive, axis=0)
    drive = size * drive[:, length > 0.0] / length[length > 0.0]
    close = CIRCLE if sampled else CANDIDATE * size
    marginal = _outside_circle if sampled else _right_of_axis
    if mixed:
        poles, floor = _may_move_on(balanced), MIXED_FLOOR * size
    else:
        values = np.linalg.eigvals(balanced).astype(complex)
        poles = _one_of_each(marginal(values, close, only_axis), close)
        floor = max(RANK_FLOOR * size, MIXED_FLOOR * whole)
    for pole in poles:
        U, s, _ = np.linalg.svd(np.hstack([balanced - pole * np.eye(len(A)), drive]))
        share += np.sum(np.abs(U[:, s <= floor]) ** 2, axis=1)
    return share


def _even_units(A: np.ndarray) -> Float[np.ndarray, " state"]:
    """Balanced units of each strongly connected part of a sampled system, which drives the others as strongly
    as it moves itself (from 1, at rest).

    Those of the whole would have no end where one part drives another and is not driven: a unit of 1e16 of
    a delay that has decayed within the period hides from B every other state.
    """
    unit = np.ones(len(A))
    done: list[int] = []
    for part in strong_components(A):
        inside, own = balance(A[np.ix_(part, part)])
        drives = float(np.abs(A[done][:, part] * own / unit[done, None]).max(initial=0.0))
        moves = float(np.linalg.norm(inside - np.eye(len(part)), 2))
        unit[part] = own * np.exp2(np.round(np.log2(moves / drives))) if moves * drives > 0.0 else own
        done.extend(part)
    return unit


def _may_move_on(A: np.ndarray) -> list[complex]:
    """Poles, as computed, that are not left of the axis by more than rounding; upper half plane."""
    values, rounding = poles_with_rounding(A)
    return list(values[(np.imag(values) >= 0.0) & (np.real(values) >= -ROUNDINGS * rounding)])


def _right_of_axis(values: np.ndarray, close: float, only_axis: bool) -> np.ndarray:
    """Poles with real part >= 0, those near the axis moved onto it."""
    real = np.real(values)
    kept = (real >= -close) & (real <= (close if only_axis else np.inf))
    return np.maximum(real[kept], 0.0) + 1j * np.imag(values[kept])


def _outside_circle(values: np.ndarray, close: float, only_axis: bool) -> np.ndarray:
    """Poles with modulus >= 1, those near the circle moved onto it."""
    modulus = np.abs(values)
    kept = (modulus >= 1.0 - close) & (modulus <= (1.0 + close if only_axis else np.inf))
    return values[kept] / np.minimum(modulus[kept], 1.0)


def _one_of_each(values: np.ndarray, close: float) -> list[complex]:
    """One of each group of equal poles, upper half plane."""
    found: list[complex] = []
    for pole in values:
        if pole.imag >= 0.0 and all(abs(pole - other) >= close for other in found):
            found.append(complex(pole))
    return found


def require_reachable(
    A: Float[np.ndarray, "state state"],
    B: Float[np.ndarray, "state input"],
    names: Sequence[str] = (),
    *,
    only_axis: bool = False,
    sampled: bool = False,
    mixed: bool = False,
    complaint: str = "no input reaches it",
    hint: str = "give it an actuator (of a filter, a sensor), or leave it out if no port reaches or sees it",
) -> None:
    """Raise `NotStabilisableError` naming the unstabilisable modes (``names``: one per state)."""
    share = unreachable_states(A, B, only_axis=only_axis, sampled=sampled, mixed=mixed)
    if not share.any():
        return
    labels = list(names) or [f"state {i}" for i in range(len(A))]
    total: dict[str, float] = {}
    for label, part in zip(labels, share, strict=True):
        total[label] = total.get(label, 0.0) + float(part)
    # A tenth: name every part of a mode spread over several names, but no traces of rounding.
    blamed = tuple(label for label, part in total.items() if part > 0.1)
    listed = not mixed and len(blamed) < SPREAD
    raise NotStabilisableError(
        f"{complaint}, and it does not decay{'' if listed else AS_FAR}: "
        f"{_modes_named(blamed, round(float(share.sum())))}",
        hint=hint if listed else f"{hint}; {HIDDEN}",
        modes=blamed,
        shares=share,
    )


def _modes_named(blamed: tuple[str, ...], directions: int) -> str:
    """The modes; combinations of them where more take part than are uncontrollable."""
    names = ", ".join(blamed)
    if directions >= len(blamed):
        return names
    return f"a combination of {names}" if directions == 1 else f"{directions} combinations of {names}"
