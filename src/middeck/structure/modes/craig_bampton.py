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

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, NumericalError
from middeck.structure.assembly.energy import assemble, assemble_carried, geometric_tangent
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.factorisation import Factor, order, positive_factor
from middeck.structure.assembly.linked import dynamic_coordinates, dynamic_freedom, static_closing
from middeck.structure.assembly.mass import carried_mass
from middeck.structure.assembly.mesh import Model, mesh_structure
from middeck.structure.assembly.places import transport
from middeck.structure.assembly.strain import strain_energies
from middeck.structure.eigenproblem.eigen import ROUNDING, Eigenpairs, all_cost_less, solve_pairs
from middeck.structure.eigenproblem.rigid_or_rounding import separate_rigid
from middeck.structure.elements.frames import Configuration, placed, rigid_columns
from middeck.structure.elements.motion_since_drawn import carried_by, carried_step
from middeck.structure.model.article import DamperPlace, JointState, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import WAYS, Component, require_component
from middeck.structure.model.environment import Environment
from middeck.structure.modes.motions.dampers import damper_matrix
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.values import record

# Residual vectors with less than this part of the energy of a whole answer are combinations of others, or
# rounding.
DEPENDENT = 1e-10
# Part of a row of links that a motion of the boundary may leave open.
TIED = 1e-7
# Modes asked for at first where a frequency limits them.
FIRST = 16


@record(kw_only=True)
class Reduced:
    """An article as a component.

    Attributes:
        component: The component.
        fixed_hz: Frequencies [Hz] of its fixed-interface modes.
        residual: Number of coordinates that residuals added.
        next_hz: First frequency left out; infinite where none is.
        warnings: Damping of the article that the component has not.
    """

    component: Component
    fixed_hz: Float[np.ndarray, " mode"]
    residual: int
    next_hz: float
    warnings: tuple[str, ...] = ()


@named_kinds
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
        count: Number of fixed-interface modes kept.
        upto_hz: Or the frequency up to which they are; three times that of interest is usual.
        residual: Nodes with six residual attachment modes each.
        recover: Nodes whose motion the component's outputs give.
        name: Name of the component; by default ``component``.

    The component's own axes are those of W. Raises `ConfigError` for what the article does not have, for
    both or none of ``count`` and ``upto_hz``, and for wheels: a component has no momentum.
    """
    if structure.wheels:
        raise ConfigError(
            f"wheel {structure.wheels[0].name!r}: a component keeps no momentum",
            where="reduction",
            hint="take the wheels out here, and give them to the article that takes the component, at its "
            "boundary",
        )
    if (count is None) == (upto_hz is None) or (count or 0) < 0 or (upto_hz or 0.0) < 0.0:
        hint = "give one of count and upto_hz, from 0 on"
        raise ConfigError(f"{count} modes up to {upto_hz} Hz", where="reduction", hint=hint)
    nodes = [node.name for node in structure.nodes]
    if not boundary or len(set(boundary)) < len(boundary):
        raise ConfigError("a boundary of no nodes, or of one twice", where="boundary", hint=", ".join(nodes))
    for what, names in (("boundary", boundary), ("residual", residual), ("recover", recover)):
        unknown = [name for name in names if name not in nodes]
        if unknown:
            raise ConfigError(f"no node {unknown[0]!r}", where=what, hint=f"nodes are {', '.join(nodes)}")

    def of_nodes(names: Sequence[str]) -> np.ndarray:
        return (6 * np.array([nodes.index(n) for n in names], dtype=int)[:, None] + np.arange(6)).ravel()

    at = solve_equilibrium(structure, Environment.orbit())
    held = _held(structure, at, boundary)
    free = [i for i, joint in enumerate(structure.joints) if joint.state is JointState.FREE]
    rows = np.concatenate([of_nodes(boundary), 6 * held.model.tree.roots + np.array(free, dtype=int)])
    motions, own = _independent(held, rows)
    in_world = transport(held.config, held.model.tree)
    loaded = (in_world @ motions)[of_nodes(residual)]
    columns, cut, kept = _basis(held, motions, _as_body(held)[own], len(rows), loaded, count, upto_hz)
    inner = motions @ columns
    moved = in_world @ inner
    mass = inner.T @ (carried_mass(*held) @ inner)
    component = Component(
        name=name or "component",
        grids=tuple(boundary),
        frames=tuple(boundary),
        positions=held.config.x[[nodes.index(b) for b in boundary]],
        stiffness=_stiffness(held, inner, len(rows)),
        mass=0.5 * (mass + mass.T),
        damping=_dampers(at, moved),
        outputs=tuple(f"{node} {way}" for node in recover for way in WAYS),
        recovery=moved[of_nodes(recover)] if recover else None,
        next_hz=kept[-1],
        left_out=0.5 * (cut + cut.T) if np.isfinite(kept[-1]) else None,
    )
    return Reduced(
        component=require_component(component),
        fixed_hz=kept[0],
        residual=kept[1],
        next_hz=kept[2],
        warnings=tuple(_losses_left_out(structure)),
    )


def _dampers(at: Equilibrium, motions: np.ndarray) -> np.ndarray | None:
    """Viscous damping of what moves inside; None where no damper does."""
    damping = damper_matrix(at, at.model.structure.damping, motions)
    return 0.5 * (damping + damping.T) if np.any(damping) else None


def _losses_left_out(structure: Structure) -> Iterator[str]:
    """Damping that no viscous matrix of the coordinates has, and dampers of the environment."""
    lossy = [name for name, eta in structure.damping.loss_factor if eta != 0.0]
    if lossy:
        yield (
            f"the loss factors of {len(lossy)} members ({lossy[0]!r} first) are not in the component: a "
            "matrix of dampers has none; give the article that takes it a ratio of its own ([damping])"
        )
    damping = structure.damping
    if damping.flexible or damping.suspension or damping.rigid or damping.table or damping.by_mode:
        yield (
            "the damping ratios of the article's modes are not in the component, which has other modes: give "
            "the article that takes it a ratio of its own ([damping])"
        )
    away = [damper.at for damper in structure.damping.dampers if damper.place is DamperPlace.DEVICE]
    if away:
        yield (
            f"the dampers of the environment at {', '.join(away)} are not in the component: give them to the "
            "article that takes it, which has the attach points"
        )


class _Held(NamedTuple):
    """The article at rest with its boundary and its free joints held, in carried coordinates.

    The boundary is carried by nothing, so that its coordinates are those of W, and what is soft keeps its
    digits beside what is stiff.
    """

    model: Model
    config: Configuration
    loads: Loads

    def work(self, motions: np.ndarray) -> np.ndarray:
        """Stiffness on a few ``motions``: strains are squared, so that it rounds by the square of theirs."""
        return strain_energies(*self, motions) + motions.T @ (geometric_tangent(*self) @ motions)


def _held(structure: Structure, at: Equilibrium, boundary: Sequence[str]) -> _Held:
    locked = [
        dataclasses.replace(joint, state=JointState.LOCKED) if joint.state is JointState.FREE else joint
        for joint in structure.joints
    ]
    model = mesh_structure(
        dataclasses.replace(structure, joints=tuple(locked)), [Clamp(node=name) for name in boundary]
    )
    since, drawn = at.config.since_drawn, model.rest.since_drawn
    assert since is not None
    assert drawn is not None
    return _Held(model, placed(carried_by(since, drawn.carrier), at.config.angle), at.loads)


def _as_body(held: _Held) -> np.ndarray:
    """Motions as one body in carried coordinates."""
    roots, at = held.model.tree.roots, held.config
    assert at.since_drawn is not None
    columns = rigid_columns(held.model.tree, at, at.x.mean(axis=0))
    for k in range(6):
        step = columns[: 6 * roots, k].reshape(roots, 6)
        columns[: 6 * roots, k] = carried_step(at.since_drawn, at.x, step).ravel()
    return columns


def _stiffness(held: _Held, motions: np.ndarray, boundary: int) -> np.ndarray:
    """Stiffness on the ``motions``, the first of them static ones of the ``boundary``."""
    stiffness, size = held.work(motions), np.abs(transport(held.config, held.model.tree) @ motions)
    # Static motions of the boundary do no work on motions of the interior alone: what is left is rounding.
    stiffness[:boundary, boundary:] = stiffness[boundary:, :boundary] = 0.0
    # One boundary node holds nothing: its stiffness is what cancels there, and would be neither sign.
    terms = ROUNDING * np.sqrt(np.einsum("im,im->m", size, abs(assemble(*held).tangent) @ size))
    cancels = ROUNDING * (size.T @ (abs(geometric_tangent(*held)) @ size))
    stiffness[np.abs(stiffness) < np.outer(terms, terms) + cancels] = 0.0
    return 0.5 * (stiffness + stiffness.T)


def _independent(held: _Held, rows: np.ndarray) -> tuple[sp.csr_array, np.ndarray]:
    """How all coordinates follow ``rows``, those of the boundary, and others inside; and which these are."""
    model, config = held.model, held.config
    unit = sp.csr_array(sp.eye_array(model.tree.size))
    if model.links is None:
        own = np.concatenate([rows, np.flatnonzero(dynamic_coordinates(model))])
        return sp.csr_array(unit[:, own]), own
    state, close = static_closing(model, config)
    C = state.jacobian @ transport(config, model.tree)
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
    own = np.concatenate([rows, np.flatnonzero(close.independent)])
    return sp.csr_array(sp.hstack([boundary, close.basis])), own


def _basis(
    held: _Held,
    motions: sp.csr_array,
    as_body: np.ndarray,
    boundary: int,
    loaded: sp.csr_array,
    count: int | None,
    upto_hz: float | None,
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, int, float]]:
    """Static motions and interior vectors in the coordinates of ``motions``, those of the ``boundary`` first;
    what it lacks of modes left out (`Component.left_out`); fixed frequencies, how many residuals, and the
    next frequency. ``as_body`` are motions as one body in these, ``loaded`` what residuals load."""
    whole = assemble_carried(*held).tangent, carried_mass(*held)
    K, M = (sp.csr_array(motions.T @ A @ motions) for A in whole)
    if order(K) == boundary:
        return np.eye(boundary), np.zeros((boundary, boundary)), (np.zeros(0), 0, np.inf)
    Kii, Mii = (sp.csr_array(A[boundary:][:, boundary:]) for A in (K, M))
    pairs, kept, above = _fixed_modes(held, Kii, Mii, count, upto_hz)
    factor = positive_factor(Kii)
    if factor is None:
        raise NumericalError(
            "with its boundary held the softest motion of the article is rounding beside its stiffest member",
            where="boundary",
            hint="rigid links in place of the stiffest members, or more boundary nodes",
        )
    psi = -factor.solve(K[boundary:][:, :boundary].toarray())
    psi += (as_body[boundary:] - psi @ as_body[:boundary]) @ np.linalg.pinv(as_body[:boundary])
    # Without what rounding of their solution left in them of the softest modes.
    work, soft = held.work(motions @ _columns(psi, pairs.shapes)), pairs.shapes
    psi = psi - soft @ np.linalg.solve(work[boundary:, boundary:], work[boundary:, :boundary])
    lam, shapes = pairs.lam[:kept], pairs.shapes[:, :kept]
    chi = _residuals(factor, lam, shapes, loaded[:, boundary:].toarray().T)
    vectors, added = _modal_form(Kii, Mii, shapes, chi)
    # What acceleration of the boundary does inside, at rest, less the share of the vectors that are kept.
    excited = M[boundary:][:, :boundary].toarray() + Mii @ psi
    by_kept = vectors.T @ excited
    k = np.einsum("im,im->m", vectors, Kii @ vectors)
    cut = excited.T @ factor.solve(excited) - (by_kept.T / k) @ by_kept
    return _columns(psi, vectors), cut, (np.sqrt(lam) / (2.0 * np.pi), added, above)


def _columns(psi: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    boundary = psi.shape[1]
    out = np.eye(boundary + len(psi), boundary + vectors.shape[1])
    out[boundary:, :boundary], out[boundary:, boundary:] = psi, vectors
    return out


def _fixed_modes(
    held: _Held, K: sp.csr_array, M: sp.csr_array, count: int | None, upto_hz: float | None
) -> tuple[Eigenpairs, int, float]:
    """Modes with the boundary held, how many are kept, and the frequency [Hz] of the one after them."""
    if not M.data.any():
        return Eigenpairs(np.zeros(0), np.zeros((order(K), 0)), np.zeros(0)), 0, np.inf
    wanted = max(FIRST, 0 if count is None else count + 1)
    while True:
        pairs = solve_pairs(K, M, wanted)
        if pairs is None:
            raise NumericalError(
                "a motion inside has neither mass nor stiffness",
                where="reduction",
                hint="give it a mass or a spring, or leave it out",
            )
        pairs = separate_rigid(*held, pairs, dynamic_freedom(held.model, held.config))
        _check_held(held, pairs)
        hz = np.sqrt(pairs.lam) / (2.0 * np.pi)
        kept = count if count is not None else int(np.sum(hz <= (upto_hz or 0.0)))
        if all_cost_less(K, wanted) or kept < len(hz):
            kept = min(kept, len(hz))
            return pairs, kept, float(hz[kept]) if kept < len(hz) else np.inf
        wanted *= 2


def _check_held(held: _Held, pairs: Eigenpairs) -> None:
    """Refuse what moves, or grows, with the boundary held: energies are compared with their own rounding."""
    if np.all(pairs.lam > pairs.noise):
        return
    m = int(np.argmin(pairs.lam - pairs.noise))
    model, free = held.model, dynamic_freedom(held.model, held.config)
    shape = transport(held.config, model.tree) @ free.spread(pairs.shapes[:, m])
    moved = np.linalg.norm(shape[: 6 * model.tree.roots].reshape(-1, 6)[:, :3], axis=1)
    grows = pairs.lam[m] < -pairs.noise[m]
    raise NumericalError(
        f"with its boundary held the article is still {'unstable' if grows else 'loose'}, most at "
        f"{model.frames[int(np.argmax(moved))]!r}",
        where="boundary",
        hint="more boundary nodes, or springs at its joints",
    )


def _residuals(factor: Factor, lam: np.ndarray, shapes: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Static responses to unit loads less those of kept modes, over the root of the energy of the whole."""
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
