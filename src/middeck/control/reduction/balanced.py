"""Balanced truncation and residualisation; poles that do not decay are kept exactly.

The error is at most twice the sum of the Hankel singular values left out (Enns 1984, 23rd IEEE CDC; Glover
1984, Int. J. Control 39; of residualisation Liu and Anderson 1989, Int. J. Control 50). The actual error is
computed too, see `middeck.systems.norms.peak_gain`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.reduction.gramian import factor_gramians
from middeck.control.reduction.projection import balance, bound_of, check_order, project, settle_order
from middeck.control.reduction.result import Reduction, Rest
from middeck.control.reduction.separation import separate_unstable, subtract
from middeck.errors import ConfigError
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.state_space.statespace import StateSpace, add

Sizes = Float[np.ndarray, " port"]


def reduce_balanced(
    system: StateSpace,
    order: int | None = None,
    *,
    bound: float | None = None,
    rest: Rest = "truncate",
    input_size: Sizes | None = None,
    output_size: Sizes | None = None,
) -> Reduction:
    """The system with fewer states: the least controllable and observable ones are removed.

    Args:
        system: Any; the poles that do not decay are kept as they are and count in the order.
        order: States to be left; fewer where equal singular values would be parted, or where there are no
            more.
        bound: Instead of an order: the fewest states whose bound is at most this.
        rest: ``"truncate"`` (the limit at high frequency stays) or ``"residualise"`` (the static gain stays).
        input_size, output_size: Typical size of each port, in which gains, singular values and errors count;
            one unless given.

    Raises `ConfigError` for an order below the number of poles that do not decay, sizes that do not fit, or
    both an order and a bound.

    >>> two = StateSpace(np.diag([-1.0, -9.0]), np.ones((2, 1)), np.array([[1.0, 0.01]]), np.zeros((1, 1)))
    >>> small = reduce_balanced(two, 1)
    >>> small.order, small.error <= small.bound
    (1, True)
    """
    sized = in_sizes(system, input_size, output_size)
    parts = separate_unstable(sized)
    coordinates = balance(factor_gramians(parts.rest))
    hankel, kept = coordinates.hankel, len(parts.kept.A)
    k = settle_order(hankel, check_order(order, kept, len(system.A)), bound)
    reduced = project(parts.rest, coordinates, k, rest)
    peak = peak_gain(subtract(parts.rest, reduced))
    whole = out_of_sizes(add(parts.kept, reduced), input_size, output_size)
    method = "balanced truncation" if rest == "truncate" else "balanced residualisation"
    return Reduction(
        system=whole,
        order=len(whole.A),
        method=method,
        kept=kept,
        hankel=hankel,
        bound=bound_of(hankel, len(reduced.A)),
        error=peak.gain,
        error_omega=peak.omega,
    )


def in_sizes(system: StateSpace, input_size: Sizes | None, output_size: Sizes | None) -> StateSpace:
    """The system with its ports scaled to their sizes."""
    outputs, inputs = system.D.shape
    u, y = _check_size(input_size, inputs, "input"), _check_size(output_size, outputs, "output")
    return StateSpace(system.A, system.B * u, system.C / y[:, None], system.D * u / y[:, None])


def out_of_sizes(system: StateSpace, input_size: Sizes | None, output_size: Sizes | None) -> StateSpace:
    """The system with its ports scaled back to their units."""
    outputs, inputs = system.D.shape
    u, y = _check_size(input_size, inputs, "input"), _check_size(output_size, outputs, "output")
    return in_sizes(system, 1.0 / u, 1.0 / y)


def _check_size(size: Sizes | None, count: int, side: str) -> Sizes:
    if size is None:
        return np.ones(count)
    size = np.asarray(size, dtype=float)
    if size.shape != (count,) or not np.all((size > 0.0) & np.isfinite(size)):
        raise ConfigError(
            f"{side} sizes {size.tolist()} for {count} ports", hint="one positive number for each port"
        )
    return size
