"""Whether a system in other states, or with fewer, has the response of the original.

Rounding of mixed states may hide a body: its modes then come out at other frequencies, or its integrators
count as moved by nothing.
"""

from __future__ import annotations

import numpy as np

from middeck.systems.poles.resolvent import by_solving
from middeck.systems.state_space.statespace import LinearSystem, poles

SAME = 1e-3
"""Relative change from which on a response is another: it is far below where rounding mistook nothing."""
ABOUT = np.array([0.9, 1.0, 1.1])
"""Lines about each one between two poles, which may lie on a zero."""
AT_REST = 1e-5
"""Poles slower than this part of the fastest count as at rest: their rounding does not count."""


def responds_otherwise(found: LinearSystem, given: LinearSystem) -> bool:
    """Whether the responses differ between the poles of ``found``; without poles, nothing is compared.

    >>> from middeck.systems.state_space.statespace import StateSpace
    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> responds_otherwise(lag, StateSpace([[-1.0]], [[1.0]], [[2.0]], [[0.0]]))
    True
    """
    most = np.inf if found.period_s is None else np.pi / found.period_s
    rates = np.abs(np.asarray(poles(found)))
    rates = rates[rates < most]
    size = np.unique(rates[rates > AT_REST * rates.max(initial=0.0)])
    if not len(size):
        return False
    between = np.sqrt(size[1:] * size[:-1])
    centre = np.concatenate([[0.5 * size[0]], between, [min(2.0 * size[-1], 0.9 * most)]])
    lines = 1j * centre[:, None] * ABOUT
    points = lines if found.period_s is None else np.exp(lines * found.period_s)
    G, H = (by_solving(one)(points.ravel()).reshape(len(lines), -1) for one in (given, found))
    return bool(np.any(np.linalg.norm(G - H, axis=1) > SAME * np.linalg.norm(G, axis=1)))
