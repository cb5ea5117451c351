"""Stability homotopy from a stabilising law to one of lower order, through stabilising laws.

K(a) = K_r + (1 - a) R with the remainder R = K - K_r of the first cut: at a = 0 it is K, at a = 1 it is K_r.
On the way K_r descends the H2 cost of the loops, which grows without bound at the stability limit, so that
the remainder can be withdrawn further (as multi-model designs grow their perturbation, see
`middeck.control.robust.search.continuation`).
"""

from __future__ import annotations

from collections.abc import Sequence

from middeck.control.h2.closed_cost import Law
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.reduction.methods import TruncatedLaw
from middeck.control.reduction.weighted_loop import absorb, proper_law
from middeck.control.robust.search.smooth_maximum import improve
from middeck.control.robust.search.starting_laws import stabilises
from middeck.systems.poles.stability import decays
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

SMALLEST_STEP = 1.0 / 256.0
"""Smallest fraction of the remainder withdrawn in a step; below it the homotopy counts as blocked."""
SHORT_OF_EDGE = 0.75
"""Fraction of a step taken: at the stability limit itself the cost is infinite."""
ON_THE_WAY, AT_THE_END = 25, 200
"""Steps of the descent at each stop, and once the remainder is gone."""
LOOSE, TIDY = 1e-3, 1e-6


@record
class Withdrawal:
    """Fraction of the remainder withdrawn, the law there, and the number of descents (``stops``)."""

    law: Law
    share: float
    stops: int


def withdraw_remainder(models: Sequence[GeneralizedPlant], candidate: TruncatedLaw) -> Withdrawal:
    """The law of the candidate's order at the end of the homotopy, or where it was blocked."""
    law, share, stops = proper_law(candidate.law), 0.0, 0

    def at(a: float) -> Sequence[GeneralizedPlant]:
        return models if a == 1.0 else [absorb(m, _times(candidate.remainder, 1.0 - a)) for m in models]

    if not decays(candidate.remainder) or not stabilises(at(0.0), law):
        return Withdrawal(law, 0.0, 0)
    while share < 1.0:
        step = 1.0 - share
        while not stabilises(at(share + step), law):
            step /= 2.0
            if step < SMALLEST_STEP:
                return Withdrawal(law, share, stops)
        share = 1.0 if share + step >= 1.0 else share + SHORT_OF_EDGE * step
        if share < 1.0:
            found = improve(law, at(share), [], power=1.0, tolerance=LOOSE, steps=ON_THE_WAY)
            law = law if found is None else found[0]
            stops += 1
    law = polish_law(models, law) or law
    return Withdrawal(law, share, stops)


def polish_law(models: Sequence[GeneralizedPlant], law: Law) -> Law | None:
    """The law at the end of a descent of the mean cost; None where it does not stabilise all models."""
    found = improve(law, models, [], power=1.0, tolerance=TIDY, steps=AT_THE_END)
    return None if found is None else found[0]


def _times(system: StateSpace, factor: float) -> StateSpace:
    return StateSpace(system.A, system.B, factor * system.C, factor * system.D)
