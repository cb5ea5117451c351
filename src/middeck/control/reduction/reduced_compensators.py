"""Compensators of lower order that stabilise the plants of the original."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.analysis.stability.stability import decide_loop
from middeck.control.h2.closed_cost import evaluate_cost
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import without_delays
from middeck.control.lqg.weights import LQGWeights
from middeck.control.reduction.balanced_projection import in_sizes
from middeck.control.reduction.method_search import Best, Tested, search_law
from middeck.control.reduction.methods import Method
from middeck.control.reduction.separation import Separation, separate_axis, subtract
from middeck.control.reduction.weighted_loop import (
    WeightedLoop,
    absorb,
    pose_loop,
    proper_law,
    response_in_loop,
)
from middeck.errors import ConfigError
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.state_units import settle_states
from middeck.systems.state_space.statespace import StateSpace, add, series
from middeck.values import record


@record(kw_only=True)
class ReducedCompensator(Compensator):
    """A compensator of lower order, with its errors against the original.

    Attributes:
        order: States.
        method: ``"performance"``, ``"stability"``, ``"coprime"`` or ``"balanced"``, as it was used.
        steps: Attempts and their outcomes, in words.
        hankel: Singular values by which states were chosen; what they measure depends on the method.
        bound: 2 (sum of those left out) for ``"balanced"``, None for the others.
        error: Largest gain of the difference K - K_r over all frequencies, in the sizes of the ports.
        loop_error: Largest gain of (K - K_r) G (I - K G)^-1, one for each plant. Below one it proves
            stability, if K and K_r have equally many unstable poles (Anderson and Liu 1989).
        stable: Whether the loop with each plant is stable, delays exact (`decide_stability`).
        cost_ratio: H2 cost of each plant relative to that with the original; ``inf`` where unstable with
            approximated delays.
    """

    order: int
    steps: tuple[str, ...]
    hankel: Float[np.ndarray, " value"]
    bound: float | None
    error: float
    loop_error: Float[np.ndarray, " plant"]
    stable: Bool[np.ndarray, " plant"]
    cost_ratio: Float[np.ndarray, " plant"]


@named_kinds
def reduce_compensator(
    compensator: Compensator,
    plants: Plant | Sequence[Plant],
    order: int,
    *,
    method: Method | Best = "performance",
    weights: LQGWeights | None = None,
    authority: float = 1.0,
    homotopy: bool = True,
    polish: bool = False,
) -> ReducedCompensator:
    """The compensator with ``order`` states, the loop with every plant kept stable wherever a way is found.

    ``method`` is tried first. Where it leaves a loop unstable, the remainder is withdrawn step by step while
    the compensator descends the H2 cost of the loops (a stability homotopy); where that is blocked, the other
    methods are tried likewise. ``steps`` of the result lists the attempts, ``stable`` the outcome: where all
    fail, the compensator of ``method`` is returned as unstable. A direct term is kept; poles on the axis
    (integral action) are kept exactly and count in the order.

    Args:
        compensator: The compensator, which must stabilise all ``plants``. States of an unstable part count in
            the order.
        plants: One or several; the first gives the typical sizes of u and y. Delays enter the design by Pade
            approximations of order 3; ``stable`` uses exact delays.
        order: States to be left.
        method: ``"performance"``, ``"stability"``, ``"coprime"`` or ``"balanced"``, see
            `middeck.control.reduction.methods`; or ``"best"``: all four, and of those that hold the
            compensator that costs least.
        weights, authority: Those of the original design, e.g. of `design_lqg`; by default typical sizes of
            the loop's signals under unit white noise on the group w are the weights.
        homotopy: Whether to try the homotopy; otherwise only ``method`` is applied.
        polish: Descend the cost also where the first result is stable. With ``weights`` of the design this
            gives the best compensator of that order that the descent finds (`design_multimodel` adds
            restarts); without them it redesigns for the typical sizes.

    Raises `ConfigError` for an order of less than one or no reduction, a compensator that does not hold a
    plant, unknown ports or methods.
    """
    known = (*get_args(Method), "best")
    if method not in known:
        raise ConfigError(f"no method {method!r}", hint=f"one of {', '.join(known)}")
    n = len(compensator.system.A)
    if not 0 < order < n:
        hint = f"from 1 to {n - 1}" if n > 1 else "it needs no reduction"
        raise ConfigError(f"an order of {order} for a compensator of {n} states", hint=hint)
    each = [plants] if isinstance(plants, Plant) else list(plants)
    if not each:
        raise ConfigError("no plant to reduce the compensator for", hint="the plant it was designed for")
    compensator = dataclasses.replace(compensator, dynamics=settle_states(compensator.system), applied=None)
    whole = [without_delays(plant) for plant in each]
    loops = [pose_loop(plant, compensator, weights, authority) for plant in whole]
    parts = separate_axis(_strictly_proper(compensator))
    fixed, left = parts.kept, order - len(parts.kept.A)
    if left < 1:
        raise ConfigError(
            f"order {order} is too low: {len(fixed.A)} poles on the axis are kept", hint=f"{len(fixed.A) + 1}"
        )
    # The rest is reduced in a loop that these poles are part of.
    loops = [dataclasses.replace(loop, model=absorb(loop.model, fixed)) for loop in loops]
    found = search_law(parts.rest, left, method, loops, homotopy=homotopy, polish=polish)
    return _report(compensator, each, loops, parts, found)


def _strictly_proper(compensator: Compensator) -> StateSpace:
    s = compensator.system
    return StateSpace(s.A, s.B, s.C, np.zeros(s.D.shape))


def _report(
    compensator: Compensator,
    plants: Sequence[Plant],
    loops: Sequence[WeightedLoop],
    parts: Separation,
    found: Tested,
) -> ReducedCompensator:
    law, candidate = found.law, found.candidate
    cut = law is candidate.law
    # After the first cut the remainder is known without the part kept in both.
    remainder = candidate.remainder if cut else subtract(parts.rest, law)
    joined = add(parts.kept, law)
    system = StateSpace(joined.A, joined.B, joined.C, compensator.system.D)
    smaller = Compensator(system, compensator.inputs, compensator.outputs)
    sizes = loops[0].output_size, loops[0].input_size
    whole = float(candidate.hankel.max(initial=0.0))
    peak = peak_gain(in_sizes(remainder, *sizes), beside=whole)
    return ReducedCompensator(
        dynamics=system,
        inputs=compensator.inputs,
        outputs=compensator.outputs,
        order=len(system.A),
        steps=found.steps,
        hankel=candidate.hankel,
        bound=candidate.bound if cut else None,
        error=peak.gain,
        loop_error=_loop_errors(parts.rest, remainder, loops),
        stable=_stable(smaller, plants),
        cost_ratio=_cost_ratios(parts.rest, law, loops),
        method=found.method,
    )


def _loop_errors(
    whole: StateSpace, remainder: StateSpace, loops: Sequence[WeightedLoop]
) -> Float[np.ndarray, " plant"]:
    found: list[float] = []
    for loop in loops:
        weighted = series(response_in_loop(loop.model, whole), remainder)
        sizes = loops[0].input_size, loops[0].input_size
        found.append(peak_gain(in_sizes(weighted, *sizes), beside=1.0).gain)  # below one it is stable
    return np.array(found)


def _stable(law: Compensator, plants: Sequence[Plant]) -> Bool[np.ndarray, " plant"]:
    return np.array([decide_loop(form_loop(plant, law)).stable for plant in plants], dtype=bool)


def _cost_ratios(
    whole: StateSpace, law: StateSpace, loops: Sequence[WeightedLoop]
) -> Float[np.ndarray, " plant"]:
    costs = [[evaluate_cost(loop.model, proper_law(k)).cost for loop in loops] for k in (law, whole)]
    return np.array(costs[0]) / np.array(costs[1])
