"""Reduction of an article to a component: constraint, fixed-interface and residual attachment modes.

With the boundary b, the interior i and the article at rest in orbit,

    [u_b]   [ I      0    0   ] [u_b]
    [u_i] = [ Psi   Phi   Chi ] [ q ]

Psi = -K_ii^-1 K_ib are the static motions of the boundary, Phi the lowest modes of the interior with the
boundary held (Craig and Bampton 1968, AIAA J. 6), Chi what the modes left out answer statically to unit loads
at some nodes (residual attachment modes: MacNeal 1971, Computers and Structures 1; Rubin 1975, AIAA J. 13).
Psi and Phi keep the stiffness and the mass as one body exactly. Phi and Chi together are brought to modal
form, so that K_qq is diagonal and M_qq one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.factorisation import Factor, order, positive_factor
from middeck.structure.assembly.linked import close_links, dynamic_coordinates
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration
from middeck.structure.model.article import JointState, Structure
from middeck.structure.model.component import WAYS, Component, require_component
from middeck.structure.model.environment import Environment
from middeck.structure.modes.eigenproblem.eigen import all_cost_less, solve_pairs
from middeck.structure.rest.equilibrium import solve_equilibrium

# Residual vectors with less than this part of the energy of a whole answer are combinations of others, or
# rounding.
DEPENDENT = 1e-10
# Part of a row of links that a motion of the boundary may leave open.
TIED = 1e-7
# Modes asked for at first where a frequency limits them.
FIRST = 16


class Reduced(NamedTuple):
    """A component; frequencies [Hz] of its fixed-interface modes, and how many coordinates residuals added.

    ``next_hz`` is the first frequency left out: infinite where none is.
    """

    component: Component
    fixed_hz: Float[np.ndarray, " mode"]
    residual: int
    next_hz: float


def reduce_structure(
    structure: Structure,
    boundary: Sequence[str],
    *,
    count: int | None = None,
    upto_hz: float | None = None,
    residual: Sequence[str] = (),
    recover: Sequence[str] = (),
    name: str = "",
) -> Reduced:
    """The article in orbit as a component on the nodes ``boundary``, by Craig and Bampton's method.

    Args:
        structure: The article. Angles of its free joints remain too, ahead of the modal coordinates.
        boundary: Its nodes that remain.
        count: How many fixed-interface modes are kept.
        upto_hz: Or the frequency up to which they are; three times that of interest is usual.
        residual: Nodes with six residual attachment modes each.
        recover: Nodes whose motion the component's outputs give.
        name: Of the component; by default ``component``.

    The component's own axes are those of W. Raises `ConfigError` for what the article does not have, for
    both or none of ``count`` and ``upto_hz``, and for wheels: a component has no momentum.
    """
    _check_asked(structure, count, upto_hz)
    nodes = [node.name for node in structure.nodes]
    _check_nodes(nodes, boundary, residual, recover)

    def of_nodes(names: Sequence[str]) -> np.ndarray:
        return (6 * np.array([nodes.index(n) for n in names], dtype=int)[:, None] + np.arange(6)).ravel()

    at = solve_equilibrium(structure, Environment.orbit())
    model = at.model
    free = [i for i, joint in enumerate(model.structure.joints) if joint.state is JointState.FREE]
    rows = np.concatenate([of_nodes(boundary), 6 * model.tree.roots + np.array(free, dtype=int)])
    inside = dynamic_coordinates(model)
    inside[rows] = False
    motions = _independent(model, at.config, rows, inside)
    whole = assemble(model, at.config, at.loads).tangent, mass_matrix(model, at.config, at.loads)
    K, M = (sp.csr_array(motions.T @ A @ motions) for A in whole)
    basis = _basis(K, M, len(rows), motions[of_nodes(residual)], count, upto_hz)
    inner = np.eye(len(basis.static) + len(rows), len(rows) + basis.vectors.shape[1])
    inner[len(rows) :, : len(rows)], inner[len(rows) :, len(rows) :] = basis.static, basis.vectors
    mass = inner.T @ (M @ inner)
    component = Component(
        name=name or "component",
        grids=tuple(boundary),
        frames=tuple(boundary),
        positions=at.config.x[[nodes.index(b) for b in boundary]],
        stiffness=_stiffness(K, inner, len(rows)),
        mass=0.5 * (mass + mass.T),
        outputs=tuple(f"{node} {way}" for node in recover for way in WAYS),
        recovery=(motions @ inner)[of_nodes(recover)] if recover else None,
    )
    return Reduced(require_component(component), basis.fixed_hz, basis.added, basis.next_hz)


def _check_asked(structure: Structure, count: int | None, upto_hz: float | None) -> None:
    if structure.wheels:
        raise ConfigError(
            f"wheel {structure.wheels[0].name!r}: a component keeps no momentum",
            where="reduction",
            hint="take the wheels out here, and give them to the article that takes the component, at its "
            "boundary",
        )
    if (count is None) == (upto_hz is None) or (count or 0) < 0 or (upto_hz or 0.0) < 0.0:
        raise ConfigError(
            f"{count} modes up to {upto_hz} Hz",
            where="reduction",
            hint="give one of count and upto_hz, from 0 on",
        )


def _stiffness(K: sp.csr_array, inner: np.ndarray, boundary: int) -> np.ndarray:
    """Stiffness on the motions ``inner``, the first of them static ones of the ``boundary``."""
    stiffness = inner.T @ (K @ inner)
    # Static motions of the boundary do no work on motions of the interior alone: what is left is rounding.
    stiffness[:boundary, boundary:] = stiffness[boundary:, :boundary] = 0.0
    # One boundary node holds nothing: its stiffness is what cancels there, and would be neither sign.
    held, static = stiffness[:boundary, :boundary], np.abs(inner[:, :boundary])
    held[np.abs(held) < order(K) * np.finfo(float).eps * (static.T @ (abs(K) @ static))] = 0.0
    return 0.5 * (stiffness + stiffness.T)


def _check_nodes(
    nodes: Sequence[str], boundary: Sequence[str], residual: Sequence[str], recover: Sequence[str]
) -> None:
    if not boundary or len(set(boundary)) < len(boundary):
        raise ConfigError("a boundary of no nodes, or of one twice", where="boundary", hint=", ".join(nodes))
    for what, names in (("boundary", boundary), ("residual", residual), ("recover", recover)):
        unknown = [name for name in names if name not in nodes]
        if unknown:
            raise ConfigError(f"no node {unknown[0]!r}", where=what, hint=f"nodes are {', '.join(nodes)}")


def _independent(model: Model, config: Configuration, rows: np.ndarray, inside: np.ndarray) -> sp.csr_array:
    """How all coordinates follow ``rows``, those of the boundary, and those ``inside`` that links leave."""
    unit = sp.csr_array(sp.eye_array(model.tree.size))
    if model.links is None:
        return sp.csr_array(unit[:, np.concatenate([rows, np.flatnonzero(inside)])])
    state, close = close_links(model, config, inside)
    C = state.jacobian
    boundary = sp.csr_array(unit[:, rows] + sp.csr_array(close.follow(C[:, rows].toarray())))
    # And of a row that the boundary has no part in, which is rounding there.
    left, scale = abs(C @ boundary).sum(axis=1), abs(C) @ (1.0 + abs(boundary).sum(axis=1))
    worst = int(np.argmax(left - TIED * scale))
    if left[worst] > TIED * scale[worst]:
        raise ConfigError(
            f"{state.rows.label[worst]} ties nodes of the boundary, or free joints, to each other: "
            "in a component each moves by itself",
            where="boundary",
            hint="leave out what follows others, and give the link to the article that takes the component",
        )
    return sp.csr_array(sp.hstack([boundary, close.basis]))


class _Basis(NamedTuple):
    """Static motions, interior vectors, fixed frequencies, how many residuals, and the next frequency."""

    static: np.ndarray
    vectors: np.ndarray
    fixed_hz: np.ndarray
    added: int
    next_hz: float


def _basis(
    K: sp.csr_array,
    M: sp.csr_array,
    boundary: int,
    loaded: sp.csr_array,
    count: int | None,
    upto_hz: float | None,
) -> _Basis:
    """The first coordinates are those of the ``boundary``; ``loaded`` has the motions that residuals load."""
    if order(K) == boundary:
        return _Basis(np.zeros((0, boundary)), np.zeros((0, 0)), np.zeros(0), 0, np.inf)
    Kii, Mii = (sp.csr_array(A[boundary:][:, boundary:]) for A in (K, M))
    factor = positive_factor(Kii)
    if factor is None:
        raise _loose()
    psi = -factor.solve(K[boundary:][:, :boundary].toarray())
    lam, shapes, above = _fixed_modes(Kii, Mii, count, upto_hz)
    chi = _residuals(factor, lam, shapes, loaded[:, boundary:].toarray().T)
    vectors, added = _modal_form(Kii, Mii, shapes, chi)
    return _Basis(psi, vectors, np.sqrt(lam) / (2.0 * np.pi), added, above)


def _loose() -> NumericalError:
    return NumericalError(
        "with its boundary held the article is still loose, or unstable",
        where="boundary",
        hint="more boundary nodes, or springs at its joints",
    )


def _fixed_modes(
    K: sp.csr_array, M: sp.csr_array, count: int | None, upto_hz: float | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """The lowest modes with the boundary held, and the frequency [Hz] of the one after them."""
    wanted = FIRST if count is None else count + 1
    while True:
        pairs = solve_pairs(K, M, wanted)
        if pairs is None:
            raise NumericalError("a motion inside has neither mass nor stiffness", where="reduction")
        if np.any(pairs.lam <= pairs.noise):  # the pivots of what is loose may round to either sign
            raise _loose()
        hz = np.sqrt(np.maximum(pairs.lam, 0.0)) / (2.0 * np.pi)
        kept = count if count is not None else int(np.sum(hz <= (upto_hz or 0.0)))
        if all_cost_less(K, wanted) or kept < len(hz):
            kept = min(kept, len(hz))
            return pairs.lam[:kept], pairs.shapes[:, :kept], float(hz[kept]) if kept < len(hz) else np.inf
        wanted *= 2


def _residuals(factor: Factor, lam: np.ndarray, shapes: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Static answers to unit loads less those of the modes kept, over the root of the energy of the whole."""
    loads = loads[:, np.any(loads, axis=0)]
    whole = factor.solve(loads)
    size = np.sqrt(np.einsum("im,im->m", whole, loads))
    return (whole - shapes @ ((shapes.T @ loads) / lam[:, None])) / size


def _modal_form(
    K: sp.csr_array, M: sp.csr_array, shapes: np.ndarray, chi: np.ndarray
) -> tuple[np.ndarray, int]:
    """Modes and residuals as modes of the space that they span; how many the residuals added."""
    if not chi.shape[1]:
        return shapes, 0
    for _ in range(2):  # apart from the modes to the last digit
        chi = chi - shapes @ (shapes.T @ (M @ chi))
    share, turn = np.linalg.eigh(chi.T @ (K @ chi))
    chi = chi @ turn[:, share > DEPENDENT]
    if not chi.shape[1]:
        return shapes, 0
    k, m = chi.T @ (K @ chi), chi.T @ (M @ chi)
    mu, turn = sla.eigh(0.5 * (m + m.T), 0.5 * (k + k.T))
    moved = mu > len(mu) * np.finfo(float).eps * max(mu[-1], 1e-300)
    own = chi @ turn[:, moved] / np.sqrt(mu[moved])
    return np.hstack([shapes, own[:, ::-1]]), int(np.sum(moved))
