"""Unknowns that move masses without the inertias of the same bodies, where that decides the estimate.

Frequencies are ratios of stiffness to mass: they leave the scale of both open. Where every mass is unknown,
an inertia that stays as drawn fixes it, as sharply as the frequencies were measured.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.structure.sensitivity.parameters import ModelParameter, list_parameters
from middeck.updating.refinement.bayesian_estimate import estimate_at, most_probable, unlikely
from middeck.updating.refinement.refine import Refined, problem_of
from middeck.updating.residuals.surveys import Compared, compare
from middeck.updating.unknowns.unknowns import Bound
from middeck.values import record

MASS, INERTIA = ".mass", ".inertia."
# A deviation that is so many times larger where inertias move with their masses depends on the inertias.
LARGER = 3.0
# So many times likelier tests are no chance, nor are they often with other errors of a model.
LIKELIER = 20.0


@record(kw_only=True)
class FixedInertias:
    """Bodies whose masses alone ``unknowns`` move, and the unknown that their inertias determine most.

    Attributes:
        larger: Factor on its deviation if the inertias are in proportion to the masses.
        fits: Whether all tests are then likelier by more than chance.
    """

    unknowns: tuple[str, ...]
    bodies: tuple[str, ...]
    determined: str
    larger: float
    fits: bool


def fixed_inertias(refined: Refined) -> FixedInertias | None:
    """None where no unknown moves a mass alone, or where neither deviation nor fit depends on it."""
    moved = [_inertias(refined, c) for c in refined.compared]
    bodies = dict.fromkeys(p.name.split(INERTIA)[0] for own in moved for b in own for p in b.parameters)
    if not bodies:
        return None
    problem = problem_of(refined, refined.compared, refined.statics, refined.fields)
    J, first = problem.J.copy(), 0
    for c, bound in zip(refined.compared, moved, strict=True):
        alone = c.paired._replace(added=())
        J[first : first + len(c.rows)] += compare(c.free, c.survey, bound, alone).slope
        first += len(c.rows)
    along, tau = dataclasses.replace(problem, J=J), refined.estimate.tau
    larger = estimate_at(along, tau).x_std / refined.estimate.x_std
    gain = unlikely(problem, tau) - unlikely(along, most_probable(along, tau))
    most, fits = int(np.argmax(larger)), bool(gain > np.log(LIKELIER))
    if larger[most] < LARGER and not fits:
        return None
    named = {b.unknown.name for own in moved for b in own if b.parameters}
    return FixedInertias(
        unknowns=tuple(u.name for u in refined.unknowns if u.name in named),
        bodies=tuple(bodies),
        determined=refined.unknowns[most].name,
        larger=float(larger[most]),
        fits=fits,
    )


def _inertias(refined: Refined, compared: Compared) -> tuple[Bound, ...]:
    """Inertias that no unknown moves, under the unknowns that multiply the masses of their bodies."""
    survey = compared.survey
    place = survey.set_up(refined.structure, refined.unknowns)
    taken = {p.name for b in place.bound for p in b.parameters}
    still = [
        p
        for p in list_parameters(place.structure, place.environment)
        if INERTIA in p.name and p.value and p.name not in taken
    ]
    return tuple(Bound(b.unknown, _beside(b, still)) for b in place.bound)


def _beside(bound: Bound, still: list[ModelParameter]) -> tuple[ModelParameter, ...]:
    """Parameters of ``still`` on bodies whose masses ``bound`` multiplies."""
    own = () if bound.unknown.added else {p.name for p in bound.parameters}
    return tuple(p for p in still if p.name.split(INERTIA)[0] + MASS in own)
