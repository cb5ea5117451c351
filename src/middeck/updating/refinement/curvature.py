"""Frequencies beyond the linear estimate: unknowns that no test sees keep most of their spread.

To second order a frequency is bent by the unknowns, and where a test and a prediction are not bent alike, the
linear estimate errs, on one side: two inertias that torsion tells together but not apart, say. With
a_ij = phi_i'(K' - lambda_i M') phi_j (K', M' slopes by the unknowns),

    lambda_i'' = phi_i'(K'' - lambda_i M'' - 2 a_ii M') phi_i + 2 sum_j a_ij^2 / (lambda_i - lambda_j)

(Fox and Kapoor 1968, AIAA J. 6, once more differentiated). Modes close by are left out of the sum: measured
shapes say how these mix. K and M are those of elements that stay where they are at rest: those that turn as
an article sags would mix modes of its length into all others, which K'' undoes. They are linear in most
parameters, each beside the others. Where they are not (a factor on sections that have unknowns of their own;
the square of a centre of mass, and its product with the mass; W / L of a cable and m omega^2 of a bounce),
K'' and M'' are differences of K' and M', with shapes and rest state as they are. By dimensions and directions
ln f is taken as linear: they are known to millimetres, and would strain elements that stay where they are.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.assembly.mesh import mesh_structure
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.suspension_tuning import environment_loads, tune_suspension
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.updating.residuals.surveys import NEIGHBOURS
from middeck.updating.unknowns.unknowns import Bound, change, product_slopes

# Lowest modes of which a bent one is made: those above are too far away to matter.
MODES = 40
# Ends of parameters that stiffness or mass is not linear in: of a body, of a suspension.
CENTRE, HUNG = (".cg.x", ".cg.y", ".cg.z"), ("cable_length", "bounce_hz")
PART = 3  # keys of where a parameter stands that say which part it is of
# Units of dimensions and angles; a direction has none.
GEOMETRY = ("m", "rad", "")
# Step of an unknown for a difference of slopes.
STEP = 1e-5


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
    bent = second - crossed - np.swapaxes(crossed, 1, 2) + turned
    square = own[:, :, None] * own[:, None]
    bends = np.array([not any(map(_is_geometry, b.parameters)) for b in bound], dtype=bool)
    found = 0.5 * (bent / own_lam[:, None, None] - square / own_lam[:, None, None] ** 2)
    return np.where(np.outer(bends, bends), found, 0.0)


def _is_geometry(parameter: ModelParameter) -> bool:
    """Whether it says where or which way parts are, and neither where their mass is nor what cables are."""
    of_mass = parameter.scales or parameter.name.endswith((*CENTRE, *HUNG))
    return parameter.unit in GEOMETRY and not of_mass


def _second_slopes(
    modes: Modes, bound: Sequence[Bound], index: np.ndarray, own: Float[np.ndarray, "mode unknown"]
) -> Float[np.ndarray, "mode unknown unknown"]:
    """phi_i'(K'' - lambda_i M'') phi_i by each two unknowns; ``own`` are those of K' and M'."""
    linear = np.diag([float(not b.unknown.added) for b in bound])
    found = own[:, :, None] * linear
    for k, near in _bent_together(bound):
        beside = _with_unknown(modes, bound[k])
        some = [bound[j] for j in near]
        slopes = product_slopes(beside, some, index, index, modes.omega[index] ** 2, still=True)
        found[:, k, near] = found[:, near, k] = (slopes - own[:, near]) / STEP
    return found


def _bent_together(bound: Sequence[Bound]) -> Iterator[tuple[int, list[int]]]:
    """Unknowns that K and M are not linear in, or not apart from others; and which these may be.

    Those of the same parts, itself among them; by the loads of cables all have to do with all.
    """
    parts = [{spot[:PART] for p in b.parameters for spot in p.spots} for b in bound]
    shared = Counter(spot for b in bound for p in b.parameters for spot in p.spots)
    for k, one in enumerate(bound):
        hung = any(p.name.endswith(HUNG) for p in one.parameters)
        if hung or any(
            p.name.endswith(CENTRE) or (p.scales and any(shared[spot] > 1 for spot in p.spots))
            for p in one.parameters
        ):
            yield k, [j for j, own in enumerate(parts) if hung or own & parts[k]]


def _with_unknown(modes: Modes, one: Bound) -> Modes:
    """The same shapes and rest state of an article in which ``one`` is a step on, its suspension tuned."""
    rest = modes.equilibrium
    structure, environment = change(rest.model.structure, rest.environment, (one,), np.array([STEP]))
    model = mesh_structure(structure, environment.clamps)
    tuned = tune_suspension(model, environment)
    loads = environment_loads(model, environment, tuned)
    beside = dataclasses.replace(rest, model=model, environment=environment, suspension=tuned, loads=loads)
    return dataclasses.replace(modes, equilibrium=beside)
