"""Whether a system is stable, and whether rounding of its matrices leaves that open."""

from __future__ import annotations

import warnings

import numpy as np

from middeck.systems.poles.rounding import ROUNDINGS, is_vague, moving_poles
from middeck.systems.poles.stability import growth_limits, growth_rates, none_grows
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


def warn_if_open(system: LinearSystem, *parts: LinearSystem) -> bool:
    """`is_open`, which it warns of (`UserWarning`): the system is then not to count as stable."""
    found = is_open(system, *parts)
    if found:
        warnings.warn(f"stability is undecided, and counts as lost: {OPEN}; {CURE}, would tell", stacklevel=3)
    return found


def is_open(system: LinearSystem, *parts: LinearSystem) -> bool:
    """Whether rounding may take a pole of ``system`` across the limit of growth.

    Never where no pole of the ``parts`` that it was joined from (itself by default) `is_vague`: from these
    its poles are known even where they nearly coincide, as those of a mode and of its estimate.
    """
    return any(map(is_vague, parts or (system,))) and may_cross(system)


def may_cross(system: LinearSystem, roundings: float = ROUNDINGS) -> bool:
    """Whether ``roundings`` take a pole across the limit of growth, integrators at rest apart."""
    (poles, rounding), chain = moving_poles(system)
    if not len(poles):
        return len(chain) > 2 or len(set(chain)) > 1  # no free bodies
    blur = roundings * rounding
    if system.period_s is None:
        size, limit = np.real(poles), growth_limits(poles)
    else:
        rates = 1j * np.angle(poles) / system.period_s
        size, limit = np.abs(poles), np.exp(system.period_s * growth_limits(rates, system.period_s))
    return bool(np.any((size - blur <= limit) & (size + blur > limit)))
