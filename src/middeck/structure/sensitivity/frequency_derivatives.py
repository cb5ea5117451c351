"""Derivatives of natural frequencies in named parameters, the shift of the rest state included.

For a mode of unit mass  dlambda = phi'(dK - lambda dM) phi,  lambda = omega^2  (Fox and Kapoor 1968, AIAA J.
6), with dK and dM total: by the parameter itself, and by the way that the rest state goes
(`sensitivity.rest`). Modes of equal frequency have derivatives in every direction only as a space; those of
the frequencies are the eigenvalues of Phi'(dK - lambda dM) Phi (Ojalvo 1988, AIAA J. 26), one set for
each parameter.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.arguments import named_kinds
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.eigenproblem.repeated import by_frequency
from middeck.structure.modes.solve import Modes
from middeck.structure.modes.stiff_members import check_beside_modes
from middeck.structure.sensitivity.element_derivatives import element_gradients
from middeck.structure.sensitivity.links_and_components import Tied
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import derivative
from middeck.structure.sensitivity.rest import MovedRest, move_rest
from middeck.structure.sensitivity.stiff_member_derivatives import soften_modes
from middeck.structure.sensitivity.tree_derivatives import tree_gradients
from middeck.values import record, require_kind


@record
class FrequencySensitivities:
    """Derivatives of the lowest frequencies, one row a parameter.

    Attributes:
        frequency_hz: The frequencies [Hz] themselves.
        d_lambda: Derivatives of omega^2 [rad^2/s^2 per unit of the parameter]. Within a group in ascending
            order, whichever mode each of them belongs to: those along the parameter, of which only the
            group's mean is linear.
        groups: Modes, by number, that have one frequency.
    """

    parameters: tuple[ModelParameter, ...]
    frequency_hz: Float[np.ndarray, " mode"]
    d_lambda: Float[np.ndarray, "parameter mode"]
    groups: tuple[tuple[int, ...], ...]

    @property
    def d_hz(self) -> Float[np.ndarray, "parameter mode"]:
        """Derivatives of the frequencies [Hz per unit]; not a number where omega = sqrt(lambda) is zero."""
        omega = 2.0 * np.pi * np.where(self.frequency_hz > 0.0, self.frequency_hz, np.nan)
        return self.d_lambda / (4.0 * np.pi * omega)

    @property
    def relative(self) -> Float[np.ndarray, "parameter mode"]:
        """Logarithmic sensitivities d ln f / d ln p.

        Not a number where either of them is zero.
        """
        values = np.array([p.value if p.value != 0.0 else np.nan for p in self.parameters])
        return self.d_hz * values[:, None] / np.where(self.frequency_hz > 0.0, self.frequency_hz, np.nan)


@named_kinds
def differentiate_frequencies(
    modes: Modes, parameters: Sequence[ModelParameter], count: int | None = None
) -> FrequencySensitivities:
    """Derivatives of the lowest ``count`` frequencies (all by default) in every parameter.

    Exact to rounding: no differences are taken. With a member too stiff for that, they are those of the same
    article with the member softer, to 1e-5 (`stiff_member_derivatives`). Raises `NumericalError` where the
    rest state itself has no derivative, or where a softer member changes one of these frequencies.
    """
    for parameter in parameters:
        hint = "find_parameters(structure, environment, names) makes them of names"
        require_kind(parameter, ModelParameter, "parameter", hint)
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    groups = tuple(tuple(group.tolist()) for group in by_frequency(modes.omega[:count] ** 2))
    softer, article = soften_modes(modes, count, "derivatives of frequencies")
    pairs = _pairs(modes, groups)
    moved = move_rest(article.rest, article.parameters(parameters))
    values = article.scales(parameters)[:, None] * _whole(softer, moved, pairs)
    d_lambda = np.zeros((len(parameters), count))
    for group in groups:
        inside = [k for k, i in enumerate(pairs.left) if i in group]
        small = np.zeros((len(parameters), len(group), len(group)))
        i, j = pairs.left[inside] - group[0], pairs.right[inside] - group[0]
        small[:, i, j] = small[:, j, i] = values[:, inside]
        d_lambda[:, group] = np.linalg.eigvalsh(small)
    return FrequencySensitivities(tuple(parameters), modes.frequency_hz[:count], d_lambda, groups)


def differentiate_products(
    modes: Modes,
    parameters: Sequence[ModelParameter],
    left: Int[np.ndarray, " pair"],
    right: Int[np.ndarray, " pair"],
    lam: Float[np.ndarray, " pair"],
    *,
    still: bool = False,
) -> Float[np.ndarray, "parameter pair"]:
    """phi_l'(dK - lambda dM) phi_r of pairs of modes, each at its lambda [rad^2/s^2 per unit].

    ``still``: as if elements stayed where they are at rest. Raises `NumericalError` as
    `differentiate_frequencies`.
    """
    check_beside_modes(modes, "derivatives of frequencies")
    return _whole(modes, move_rest(modes.equilibrium, parameters), _Pairs(left, right, lam), still=still)


class _Pairs(NamedTuple):
    """Modes of one group, two by two, and the lambda between them."""

    left: np.ndarray
    right: np.ndarray
    lam: np.ndarray


def _pairs(modes: Modes, groups: tuple[tuple[int, ...], ...]) -> _Pairs:
    pairs = [p for g in groups for p in itertools.combinations_with_replacement(g, 2)]
    left, right = np.array(pairs, dtype=int).reshape(-1, 2).T
    return _Pairs(left, right, 0.5 * (modes.omega[left] ** 2 + modes.omega[right] ** 2))


def _whole(
    modes: Modes, moved: MovedRest, pairs: _Pairs, *, still: bool = False
) -> Float[np.ndarray, "parameter pair"]:
    """phi_i'(dK - lambda dM) phi_j: by the parameters themselves, and by the way the rest state moves."""
    at = modes.equilibrium, modes.shapes, *pairs
    out = _explicit(moved, modes.shapes, pairs)
    if np.any(moved.motion) and not still:
        out = out + moved.motion.T @ (element_gradients(*at) + tree_gradients(*at))
    return out + _of_ties(modes, moved, pairs)


def mode_multipliers(modes: Modes, count: int) -> Float[np.ndarray, "row mode"]:
    """Forces of links in the lowest modes, in balance with (K - lambda M) phi."""
    rest = modes.equilibrium
    shapes, lam = modes.shapes[:, :count], modes.omega[:count] ** 2
    load = assemble(rest.model, rest.config, rest.loads).tangent @ shapes - (modes.mass @ shapes) * lam
    links = Tied.at(rest.model, rest.config, dynamic_coordinates(rest.model))
    return links.multipliers(load)


def _of_ties(modes: Modes, moved: MovedRest, pairs: _Pairs) -> Float[np.ndarray, "parameter pair"]:
    """Contributions of links and components, explicit and by the motion of the rest state."""
    model = modes.equilibrium.model
    if model.links is None and not model.components:
        return np.zeros((len(moved.ties), len(pairs.lam)))
    count = int(max(pairs.left.max(initial=-1), pairs.right.max(initial=-1))) + 1
    shapes, held = modes.shapes[:, :count], mode_multipliers(modes, count)
    out = []
    for tie in moved.ties:
        across = held.T @ (tie.slope @ shapes)
        stiffness = shapes.T @ (tie.stiffness @ shapes) + across + across.T
        inertia = shapes.T @ (tie.mass @ shapes)
        out.append(stiffness[pairs.left, pairs.right] - pairs.lam * inertia[pairs.left, pairs.right])
    return np.array(out).reshape(len(moved.ties), len(pairs.lam))


def _explicit(moved: MovedRest, shapes: np.ndarray, pairs: _Pairs) -> Float[np.ndarray, "parameter pair"]:
    out = np.zeros((len(moved.patches), len(pairs.lam)))
    for at, potential in moved.still:
        own = np.concatenate(at.raft.coordinates)
        phi = np.zeros((len(own), shapes.shape[1]))
        phi[own] = shapes[np.concatenate([moved.patches[p].coordinates for p in at.which])]
        K, M = potential.tangent.copy(), mass_matrix(at.raft.model, at.config, at.loads)
        K.data, M.data = derivative(K.data), derivative(M.data)
        change = (K @ phi)[:, pairs.right] - (M @ phi)[:, pairs.right] * pairs.lam
        work = phi[:, pairs.left] * change
        for p, coordinates in zip(at.which, at.raft.coordinates, strict=True):
            out[p] = work[coordinates].sum(axis=0)
    return out
