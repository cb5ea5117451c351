"""Methods to reduce a compensator; none guarantees a stable loop, so each result is checked.

- performance: balanced in the loop, all states, by noise and cost (weights of both sides, Anderson and Liu
  1989, IEEE TAC 34, "Controller reduction: concepts and approaches");
- stability: the weight G (I - K G)^-1 behind K, none before it (the same, one-sided): what does not decay is
  kept, and a weighted error below one proves stability;
- coprime: the normalised right coprime factors of K are reduced, which are stable whatever K is, by the error
  in the gap (Meyer 1990, IEEE TAC 35, "Fractional balanced reduction: model reduction via fractional
  representation");
- balanced: K alone, as if there were no loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.control.reduction.balanced_projection import (
    balance,
    bound_of,
    check_order,
    in_sizes,
    out_of_sizes,
    project,
    settle_order,
)
from middeck.control.reduction.gramian import GramianFactors, factor_gramians, restrict
from middeck.control.reduction.separation import separate_unstable, subtract
from middeck.control.reduction.weighted_loop import WeightedLoop, gramians_in_loop, proper_law, seen_at_y
from middeck.control.riccati.continuous import solve_riccati
from middeck.systems.state_space.statespace import StateSpace, add
from middeck.values import record

Method = Literal["performance", "stability", "coprime", "balanced"]

MIRROR = 1e-2
"""Damping ratio given to a mirrored pole that lies on the axis."""


@record
class TruncatedLaw:
    """A compensator K_r of lower order, its ``remainder`` K - K_r, and the singular values of its choice."""

    law: StateSpace
    remainder: StateSpace
    hankel: Float[np.ndarray, " value"]
    bound: float | None


def find_candidate(
    system: StateSpace, order: int, method: Method, loops: Sequence[WeightedLoop]
) -> TruncatedLaw:
    """The strictly proper ``system`` with ``order`` states or, where singular values coincide, fewer."""
    if method == "performance":
        return _in_loop(system, order, loops)
    if method == "coprime":
        return _by_factors(system, order, loops[0])
    return _of_what_decays(system, order, loops, weighted=method == "stability")


def find_start(system: StateSpace, order: int, loops: Sequence[WeightedLoop]) -> TruncatedLaw | None:
    """A truncation with a decaying remainder for any K, the start of a homotopy; None where no state may go.

    Poles of K that do not decay are kept, the rest is balanced in the loop; poles made unstable are mirrored
    at the axis. It need not be good: together with its remainder it equals K.
    """
    parts = separate_unstable(system)
    kept = len(parts.kept.A)
    if order < kept:
        return None
    whole = proper_law(add(parts.kept, parts.rest))
    factors = gramians_in_loop([loop.model for loop in loops], whole)
    own = GramianFactors(*(restrict(f, slice(kept, None)) for f in (factors.reach, factors.see)))
    coordinates = balance(own)
    k = settle_order(coordinates.hankel, order - kept)
    reduced = _mirrored(project(parts.rest, coordinates, k))
    law = add(parts.kept, reduced)
    return TruncatedLaw(law, subtract(parts.rest, reduced), coordinates.hankel, None)


def _mirrored(system: StateSpace) -> StateSpace:
    parts = separate_unstable(system)
    grows = parts.kept
    if not len(grows.A):
        return system
    off_axis = MIRROR * float(np.linalg.norm(grows.A, 2)) * np.eye(len(grows.A))
    return add(StateSpace(-grows.A - off_axis, grows.B, grows.C, grows.D), parts.rest)


def _in_loop(system: StateSpace, order: int, loops: Sequence[WeightedLoop]) -> TruncatedLaw:
    coordinates = balance(gramians_in_loop([loop.model for loop in loops], proper_law(system)))
    k = settle_order(coordinates.hankel, order)
    law = project(system, coordinates, k)
    return TruncatedLaw(law, subtract(system, law), coordinates.hankel, None)


def _of_what_decays(
    system: StateSpace, order: int, loops: Sequence[WeightedLoop], *, weighted: bool
) -> TruncatedLaw:
    sizes = loops[0].output_size, loops[0].input_size
    sized = in_sizes(system, *sizes)
    parts = separate_unstable(sized)
    kept = len(parts.kept.A)
    count = check_order(order, kept, len(system.A))
    factors = factor_gramians(parts.rest)
    if weighted:
        whole = proper_law(out_of_sizes(add(parts.kept, parts.rest), *sizes))
        seen = seen_at_y([loop.model for loop in loops], whole, loops[0].output_size)
        factors = GramianFactors(factors.reach, restrict(seen.see, slice(kept, None)))
    coordinates = balance(factors)
    reduced = project(parts.rest, coordinates, settle_order(coordinates.hankel, count))
    bound = None if weighted else bound_of(coordinates.hankel, len(reduced.A))
    return TruncatedLaw(
        out_of_sizes(add(parts.kept, reduced), *sizes),
        out_of_sizes(subtract(parts.rest, reduced), *sizes),
        coordinates.hankel,
        bound,
    )


def _by_factors(system: StateSpace, order: int, loop: WeightedLoop) -> TruncatedLaw:
    """Reduce the normalised coprime factors of K = N M^-1 together; both have the states of K."""
    sizes = loop.output_size, loop.input_size
    sized = in_sizes(system, *sizes)
    feedback = -solve_riccati(
        sized.A, sized.B, sized.C.T @ sized.C, np.eye(sized.B.shape[1]), complaint="no measurement moves it"
    ).gain
    C = np.vstack([sized.C, feedback])
    factors = StateSpace(sized.A + sized.B @ feedback, sized.B, C, np.zeros((len(C), sized.B.shape[1])))
    coordinates = balance(factor_gramians(factors))
    k = settle_order(coordinates.hankel, order)
    small = project(factors, coordinates, k)
    N, F = small.C[: len(sized.C)], small.C[len(sized.C) :]
    law = out_of_sizes(StateSpace(small.A - small.B @ F, small.B, N, sized.D), *sizes)
    return TruncatedLaw(law, subtract(system, law), coordinates.hankel, None)
