"""Whether a system is stable, and whether rounding of its matrices leaves that open."""

import warnings

import numpy as np

from middeck.systems.poles.rounding import EPS, ROUNDINGS, is_vague, moving_poles
from middeck.systems.poles.stability import growth_limits, growth_rates, none_grows
from middeck.systems.poles.state_units import balance_states
from middeck.systems.state_space.statespace import LinearSystem

OPEN = "rounding of the matrices alone may take a root across the axis"
CURE = "states of like sizes, as modal ones"


def is_stable(system: LinearSystem) -> bool:
    """True where no pole grows faster than `growth_limits`; a system without states is stable.

    False with a warning where rounding leaves that open (`warn_if_open`).

    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> is_stable(StateSpace([[0.1]], [[1.0]], [[1.0]], [[0.0]]))
    False
    """
    return not warn_if_open(system) and none_grows(growth_rates(system), system.period_s)


def warn_if_open(system: LinearSystem, *parts: LinearSystem, stacklevel: int = 3) -> bool:
    """`is_open`, with a warning (`UserWarning`): the system does not then count as stable."""
    found = is_open(system, *parts)
    if found:
        what = f"stability is undecided, and counts as lost: {OPEN}; {CURE}, would decide"
        warnings.warn(what, stacklevel=stacklevel)
    return found


def is_open(system: LinearSystem, *parts: LinearSystem) -> bool:
    """Whether rounding may take a pole of ``system`` across the limit of growth.

    Never where no pole of the ``parts`` that it was joined from (itself by default) `is_vague`: from these
    its poles are known even where they nearly coincide, as those of a mode and of its estimate.
    """
    return any(map(is_vague, parts or (system,))) and may_cross(system)


def may_cross(system: LinearSystem, roundings: float = ROUNDINGS) -> bool:
    """Whether ``roundings`` take a pole across the limit of growth, integrators at rest apart.

    To first order, then, for the poles that this finds near, by the resolvent: rounding moves poles that
    nearly coincide by its root, no further.
    """
    (poles, rounding), chain = moving_poles(system)
    if not len(poles):
        return len(chain) > 2 or len(set(chain)) > 1  # no free bodies
    blur, angle, period_s = roundings * rounding, np.angle(poles), system.period_s
    if period_s is None:
        size, limit = np.real(poles), growth_limits(poles)
        beside = limit + 1j * np.imag(poles)
    else:
        size, limit = np.abs(poles), np.exp(period_s * growth_limits(1j * angle / period_s, period_s))
        beside = limit * np.exp(1j * angle)
    near = (size - blur <= limit) & (size + blur > limit)
    if chain:
        return bool(near.any())
    A = balance_states(system).A
    return any(is_reached(A, s, roundings) for s in beside[near & (np.imag(poles) >= 0.0)])


def is_reached(A: np.ndarray, point: complex, roundings: float) -> bool:
    """Whether so many roundings of the entries of A may move a pole to the point: not if |R| |A| is small.

    R = (point - A)^-1, magnitudes by entries (Rump 1999, SIAM Review 41, "Ill-conditioned matrices are
    componentwise near to singularity").
    """
    try:
        most = np.abs(np.linalg.eigvals(np.abs(np.linalg.inv(point * np.eye(len(A)) - A)) @ np.abs(A))).max()
    except np.linalg.LinAlgError:
        return True
    return bool(roundings * EPS * most >= 1.0)
