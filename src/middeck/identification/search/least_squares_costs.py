"""Nonlinear least squares on a frequency response, by Levenberg-Marquardt with analytic derivatives.

Least squares (`weighted`): the output vectors and the direct term are linear, so they are solved for
exactly at each step and only theta is searched (variable projection, Golub and Pereyra 1973, with
Kaufman's (1975) derivative). The outputs share nothing but theta, so each is a small problem of its own; its
transients, one for each experiment, are projected out first (`transient_projection`).

Logarithmic (`logarithmic`): log magnitude and phase, the cost of the paper's fit; nothing is linear then and
all unknowns are searched together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.levenberg_marquardt import Step, is_positive
from middeck.identification.problem.data import Data
from middeck.identification.problem.gram_blocks import Functions, weigh
from middeck.identification.problem.normal_equations import Solved, ZeroSum, solve_normal
from middeck.identification.problem.residual_and_slopes import Terms, build_terms, combined
from middeck.identification.problem.transient_projection import (
    TransientProjection,
    as_real,
    factors,
    solve_triangle,
)
from middeck.identification.problem.unknowns_layout import Layout

T = TypeVar("T")
# Linear unknowns are not solved for where one column is the rest up to this share: coinciding poles.
COINCIDENT = 1e-13
# Products in an output's normal equations below which forming them directly, by QR, takes less than to find
# few functions to form them from.
SMALL = 4e5
# Rounding of all residuals together, in deviations, above which they are formed by orthogonal columns: it
# would move the end of a search by as much.
ROUNDED = 0.02


def weighted(
    layout: Layout,
    data: Data,
    theta: Float[np.ndarray, " unknown"],
    below: float = np.inf,
    *,
    from_sums: bool = True,
) -> Step | None:
    """Half the sum of |weight (H - E)|^2, the linear unknowns solved for; None where it has no value.

    None as well where it is not ``below`` so much: most of the work is in derivatives that nobody needs then.
    Not ``from_sums``: with the Gram matrix of theta line by line, which costs more and rounds less.
    """
    terms = build_terms(layout, data, theta)
    if terms is None:
        return None
    solved = _solve(terms, below, from_sums=from_sums)
    if solved is None:
        return None
    cost = sum(one.cost for one in solved)
    if not cost < below:
        return None
    gradient = np.sum([one.gradient for one in solved], axis=0)
    gram = np.sum([one.gram for one in solved], axis=0)
    linear = np.concatenate([one.linear for one in solved])
    return Step(cost=cost, gradient=gradient, gram=gram, linear=linear, residual=_residual(data, solved))


def _residual(data: Data, solved: list[Solved]) -> Complex[np.ndarray, "output line column"] | None:
    """H - E, unweighted; None if a cost did not form it, or outputs are mixed."""
    left = [one.left for one in solved if one.left is not None]
    if data.mix is not None or len(left) < len(solved):
        return None
    return np.concatenate(left).mT / data.weight


def least_cost(
    layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]
) -> tuple[float, Float[np.ndarray, "output column"]] | None:
    """Cost and linear unknowns of `weighted` alone."""
    if by_normal_equations(layout, data):
        step = weighted(layout, data, theta)
        return None if step is None else (step.cost, step.linear)
    terms = build_terms(layout, data, theta)
    found = None if terms is None else _all_of(_by_columns(terms, o) for o in range(layout.outputs))
    if found is None:
        return None
    cost = sum(one.cost for one in found)
    return (cost, np.stack([one.linear for one in found])) if np.isfinite(cost) else None


def _solve(terms: Terms, below: float, *, from_sums: bool) -> list[Solved] | None:
    """All outputs: by normal equations from sums or else line by line where they pay, or by QR."""
    layout, data, solved = terms.layout, terms.data, None
    ways = (True, False) if from_sums else (False,)
    for sums in ways if by_normal_equations(layout, data) else ():
        shared = Functions(terms, from_sums=sums)
        each = (solve_normal(terms, shared, of) for of in weigh(terms, shared))
        solved = _all_of(each)
        if solved is not None and data.mix is None and _rounding(solved) > ROUNDED:
            break
        if solved is not None and (sums or is_positive(np.sum([one.gram for one in solved], axis=0))):
            return solved
    if data.mix is not None:
        return solved
    found = _all_of(_by_columns(terms, o) for o in range(layout.outputs))
    if found is None or not sum(one.cost for one in found) < below:
        return None
    return [one.solved(terms) for one in found]


def _rounding(solved: list[Solved]) -> float:
    return float(np.linalg.norm([one.rounding for one in solved]))


def _all_of(solved: Iterable[T | None]) -> list[T] | None:
    """All costs; None if one of them is None."""
    found: list[T] = []
    for one in solved:
        if one is None:
            return None
        found.append(one)
    return found


def by_normal_equations(layout: Layout, data: Data) -> bool:
    """Whether normal equations are faster, or needed (mixed outputs); they cannot project transients out."""
    if data.mix is not None:
        return True
    numbers = 2 * len(data.s) * data.H.shape[2]
    return data.transient is None and numbers * (layout.columns + layout.size) ** 2 > SMALL


@dataclass(frozen=True, kw_only=True, eq=False)
class _ByColumns:
    """Linear unknowns of one output, and its residual beside its columns ``A``, of the basis ``Q``."""

    output: int
    own: TransientProjection
    tied: ZeroSum
    A: Float[np.ndarray, "column number"]
    Q: Float[np.ndarray, "number free"]
    x: Float[np.ndarray, " column"]
    linear: Float[np.ndarray, " unknown"]
    residual: Float[np.ndarray, " number"]

    @property
    def cost(self) -> float:
        return 0.5 * float(self.residual @ self.residual)

    def solved(self, terms: Terms) -> Solved:
        """The solution with gradient and Gram matrix of the cost by theta."""
        G = self.own.removed(terms.slopes(self.linear, self.output))
        gained = self.tied.moved(self.x, self.A)
        if isinstance(gained, np.ndarray):
            G[: len(gained)] += gained
        J = G - (G @ self.Q) @ self.Q.T
        return Solved(linear=self.linear[None], cost=self.cost, gradient=-J @ self.residual, gram=J @ J.T)


def _by_columns(terms: Terms, output: int) -> _ByColumns | None:
    """Cost by columns; None if two columns coincide."""
    layout, data = terms.layout, terms.data
    own = TransientProjection(terms.B, data.weight[output])
    X = terms.columns(output)
    A, tied = own.removed(X), ZeroSum(layout, terms.point)
    free = tied.free(A)
    size = np.linalg.norm(free, axis=1)
    if not (np.isfinite(size).all() and size.all()):
        return None
    Q, R = factors(free / size[:, None])
    if np.abs(np.diag(R)).min() <= COINCIDENT or own.coincident(COINCIDENT):
        return None
    target = own.removed(data.H[output][None])[0]
    on_columns = Q.T @ target
    x = tied.whole(solve_triangle(R, on_columns) / size)
    t = own.unknowns(data.H[output] - combined(x, X))
    return _ByColumns(
        output=output,
        own=own,
        tied=tied,
        A=A,
        Q=Q,
        x=x,
        linear=np.concatenate([x, t.ravel()]),
        residual=target - Q @ on_columns,
    )


def logarithmic(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Step | None:
    """Half the sum of |weight log(H / E)|^2: log magnitude and phase; theta ends in the linear unknowns."""
    linear = theta[len(theta) - layout.outputs * layout.columns :].reshape(layout.outputs, layout.columns)
    shared = len(theta) - linear.size
    terms = build_terms(layout, data, theta[:shared])
    if terms is None:
        return None
    cost, gradient, gram = 0.0, np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    for o in range(layout.outputs):
        E = terms.response(linear[o], o)
        if not np.isfinite(E).all() or not E.all():
            return None
        G = terms.slopes(linear[o], o)
        J = as_real(np.concatenate([G, terms.columns(o)]) * (data.weight[o] / E)[None])
        residual = as_real((data.weight[o] * np.log(data.H[o] / E))[None])[0]
        own = np.r_[0:shared, shared + o * layout.columns : shared + (o + 1) * layout.columns]
        cost += 0.5 * float(residual @ residual)
        gradient[own] -= J @ residual
        gram[np.ix_(own, own)] += J @ J.T
    return Step(cost=cost, gradient=gradient, gram=gram, linear=linear) if np.isfinite(cost) else None
