"""What frequencies have beyond the linear estimate: unknowns that no test sees keep most of their spread.

To second order a frequency is bent by the unknowns, and where a test and a prediction are not bent alike, the
linear estimate errs, on one side: two inertias that torsion tells together but not apart, say. With
a_ij = phi_i'(K' - lambda_i M') phi_j (K', M' slopes by the unknowns),

    lambda_i'' = phi_i'(K'' - lambda_i M'' - 2 a_ii M') phi_i + 2 sum_j a_ij^2 / (lambda_i - lambda_j)

(Fox and Kapoor 1968, AIAA J. 6, once more differentiated). Modes close by are left out of the sum: measured
shapes say how these mix. K and M are taken as linear in each parameter, of elements that stay where they are
at rest: those that turn as an article sags would mix modes of its length into all others, which K'' undoes.
A suspension's stiffness is not linear: it goes with a cable's length and with a bounce by powers p^n (W / L,
m omega^2), whose K'' is (n - 1) K' / p. Their second derivatives with other unknowns, which may change W, are
left out: there are none where the suspension alone holds a mode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.modes.solve import Modes
from middeck.structure.sensitivity.parameters import Parameter, read_parameter
from middeck.updating.refinement.problem import linear_problem
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.surveys import NEIGHBOURS, set_up
from middeck.updating.unknowns.unknowns import Bound, product_slopes

# Lowest modes of which a bent one is made: those above are too far away to matter.
MODES = 40
# Exponents of parameters that a stiffness is not linear in.
POWERS = {"cable_length": -1.0, "bounce_hz": 2.0}


def frequency_curvature(
    modes: Modes, bound: Sequence[Bound], index: Int[np.ndarray, " mode"]
) -> Float[np.ndarray, "mode unknown unknown"]:
    """Second derivatives of ln f of some modes by the unknowns."""
    lam, count = modes.omega**2, min(len(modes.omega), max(MODES, int(index.max(initial=-1)) + 1))
    pairs = np.repeat(index, count), np.tile(np.arange(count), len(index))
    of, at = np.append(pairs[0], index), np.append(pairs[1], index)
    slopes = product_slopes(modes, bound, of, at, np.append(lam[pairs[0]], 0.0 * lam[index]), still=True)
    mixing = slopes[: len(pairs[0])].reshape(len(index), count, len(bound))
    own = mixing[np.arange(len(index)), index]
    inertia = (slopes[len(pairs[0]) :] - own) / lam[index, None]
    second, own_lam = _second_slopes(modes, bound, index, own), lam[index]
    with np.errstate(divide="ignore"):
        far = np.abs(np.log(modes.frequency_hz[:count] / modes.frequency_hz[index, None])) > NEIGHBOURS
    weight = np.divide(2.0, own_lam[:, None] - lam[:count], out=np.zeros(far.shape), where=far)
    turned = np.einsum("mja,mj,mjb->mab", mixing, weight, mixing)
    crossed = own[:, :, None] * inertia[:, None]
    bent = second[:, :, None] * np.eye(len(bound)) - crossed - np.swapaxes(crossed, 1, 2) + turned
    square = own[:, :, None] * own[:, None]
    curvature = 0.5 * (bent / own_lam[:, None, None] - square / own_lam[:, None, None] ** 2)
    powers = np.array([any(map(_power, b.parameters)) for b in bound], dtype=bool)
    curvature[:, powers[:, None] != powers] = 0.0
    return curvature


def _power(parameter: Parameter) -> float:
    """The exponent of a suspension's stiffness; zero for parameters that it is linear in."""
    return next((power for name, power in POWERS.items() if parameter.name.endswith(name)), 0.0)


def _second_slopes(
    modes: Modes, bound: Sequence[Bound], index: np.ndarray, own: Float[np.ndarray, "mode unknown"]
) -> Float[np.ndarray, "mode unknown"]:
    """phi_i'(K'' - lambda_i M'') phi_i by each unknown; ``own`` are those of K' and M'."""
    found = own * np.array([not b.unknown.added for b in bound])
    bent = [(k, Bound(b.unknown, (p,))) for k, b in enumerate(bound) for p in b.parameters if _power(p)]
    if not bent:
        return found
    slopes = product_slopes(modes, [b for _, b in bent], index, index, modes.omega[index] ** 2, still=True)
    rest = modes.equilibrium
    for (k, b), slope in zip(bent, slopes.T, strict=True):
        now = read_parameter(rest.model.structure, rest.environment, b.parameters[0])
        found[:, k] += (_power(now) - 1.0) * slope / (now.value if b.unknown.added else 1.0)
    return found


def bend_of(
    refined: Refined,
    root: Float[np.ndarray, "mode both"],
    curvature: Float[np.ndarray, "mode unknown unknown"],
) -> Float[np.ndarray, "2 mode"]:
    """Mean and deviation of what second order adds to predicted ln f of linear ``root`` and ``curvature``.

    Tests that are bent themselves move the estimate: what a prediction shares with them cancels. Nothing
    where friction of joints gives each measured mode an article of its own.
    """
    if any(c.survey.friction for c in refined.compared):
        return np.zeros((2, len(root)))
    found, unknowns = refined.estimate, refined.unknowns
    spread = np.array([u.spread for u in unknowns])
    tests = refined.compared, refined.statics, refined.fields
    problem = linear_problem(*tests, np.zeros(len(spread)), spread, refined.responses, refined.damped)
    noise = problem.std**2 + problem.rest * found.tau[problem.row_sort] ** 2
    gain = root @ found.root.T @ (np.hstack([problem.J, problem.S]).T / noise)
    left, row = curvature, 0
    for one in refined.compared:
        bound = set_up(refined.structure, one.survey.environment, one.survey.settings, unknowns).bound
        bent = frequency_curvature(one.modes, bound, one.pairs[:, 0])
        left = left - np.tensordot(gain[:, row : row + len(bent)], bent, 1)
        row += len(one.residual)
    own = found.root[: len(unknowns)]
    quadratic = np.einsum("ap,mab,bq->mpq", own, left, own, optimize=True)
    mean = 0.5 * np.trace(quadratic, axis1=1, axis2=2)
    return np.array([mean, np.sqrt(0.5 * np.sum(quadratic**2, axis=(1, 2)))])
