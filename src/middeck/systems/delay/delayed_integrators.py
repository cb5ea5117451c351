"""Integrators under delays that are not sums: each kept once, with the integrators that the delays add.

With R_k / s^k from inputs to outputs and P(s) = 1 + p_1 s + p_2 s^2 + ... for the delay of each path, of size
p_1 = -tau, each path is

    sum over k of  R_k (s^-k + p_1 s^(1-k) + ... + p_(k-1) / s)  +  R_k s^-k (P - 1 - ... - p_(k-1) s^(k-1)).

With P = D + C (s - A)^-1 B the last term has the states of P and the output R_k C A^-k: no pole at the
origin. The rest has as many integrators as its residues require. Where outputs read one force on a free body
with different delays, their difference is the force integrated once, which needs its own state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.systems.poles.integrators import realise_residues
from middeck.systems.state_space.statespace import StateSpace, add


def approximate_delayed_integrators(
    residues: Float[np.ndarray, "chain output input"],
    still: StateSpace,
    direct: Float[np.ndarray, "output input"],
    banks: Sequence[StateSpace],
) -> tuple[StateSpace, int]:
    """The sum of R_k / s^k and ``direct``, each path times its P; and the number of integrators, its first
    states.

    ``banks`` hold P to each output, input by input. ``still`` has the same residues; where it has more states
    than they require it is kept whole, so that a design can refuse its uncontrollable or unobservable states.
    """
    delayed = np.array(residues)
    behind: list[StateSpace] = []
    for i, bank in enumerate(banks):
        rest = direct[:, [i]] * bank.C
        seen = bank.C
        for k in range(len(residues)):
            seen = np.linalg.solve(bank.A.T, seen.T).T  # C A^-(k + 1)
            rest = rest + residues[k][:, [i]] * seen
            # The coefficient of s^(k + 1) in P is -C A^-(k + 2) B; of s^0 it is one.
            further = -np.linalg.solve(bank.A.T, seen.T).T @ bank.B
            count = len(residues) - k - 1
            delayed[:count, :, i] += further.T * residues[k + 1 :, :, i]
        drive = np.arange(len(banks))[None] == i
        behind.append(StateSpace(bank.A, bank.B * drive, rest, direct[:, [i]] * bank.D * drive))
    unmoved = len(still.A) > len(realise_residues(residues).A)
    integrals = add(still, realise_residues(delayed - residues)) if unmoved else realise_residues(delayed)
    whole = integrals
    for each in behind:
        whole = add(whole, each)
    return whole, len(integrals.A)
