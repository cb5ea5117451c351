"""Suspension, pendulum or flexible: the part of a mode's motion that strains nothing in the free article.

The rigid-body motions of the free article (turns of its free joints included) span a space of dimension n.
The part of a mode's kinetic energy that lies in it is its *rigid share*, 1 for a body that swings as a whole
and 0 for one that only bends; over all modes the rigid shares add up to n. It depends neither on a basis of
that space nor on frequencies. A suspension mode moves so, and something else than strain holds it: the first
bending of a beam on a stiff bushing to the ground moves like a rigid body by 99 %, but its energy is strain.

For a clamped article only motions that its clamps allow count: none, if it is built in. A mode that consists
of them is one of the suspension where devices or springs of the environment hold it, and a pendulum where its
weight does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble_carried, geometric_tangent
from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.freedom import allowed_motions
from middeck.structure.assembly.linked import dynamic_freedom
from middeck.structure.assembly.mass import carried_mass, drawn_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.places import transport
from middeck.structure.eigenproblem.eigen import all_cost_less, count_zero, solve_all, solve_lowest
from middeck.structure.eigenproblem.repeated import repeated, turn_apart
from middeck.structure.elements.frames import FrameTree, rigid_columns
from middeck.structure.elements.motion_since_drawn import uncarried
from middeck.structure.model.article import JointState
from middeck.structure.modes.motions.rigid_motions import rigid_motions
from middeck.structure.modes.motions.strain_shares import device_energy, strain_share
from middeck.structure.rest.equilibrium import Equilibrium

HALF = 0.5
HELD = ("suspension", "pendulum")
"""Kinds of modes that something else than strain holds."""
# A rigid share between these is neither: in one of its two neighbours the mode has at least half as much of
# itself as in the other.
UNDECIDED = (1.0 / 3.0, 2.0 / 3.0)
# Modes of one frequency are turned apart where their rigid shares can then differ by more than this.
SEPARABLE = 0.5
# Motions that have less than this part of their kinetic energy for themselves are others once more.
DEPENDENT = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Kinds:
    """omega^2 and shapes, those of one frequency turned apart; their rigid and strain shares, and kinds."""

    lam: Float[np.ndarray, " mode"]
    shapes: Float[np.ndarray, "coordinate mode"]
    rigid_share: Float[np.ndarray, " mode"]
    strain_share: Float[np.ndarray, " mode"]
    kind: tuple[str, ...]


def is_held(equilibrium: Equilibrium) -> bool:
    """Whether gravity or a device acts: otherwise no mode is one of a suspension."""
    loads = equilibrium.loads
    return bool(np.any(loads.gravity)) or len(loads.attach_point) + len(loads.ground.point) > 0


def find_kinds(
    equilibrium: Equilibrium,
    M: sp.csr_array,
    lam: Float[np.ndarray, " mode"],
    shapes: Float[np.ndarray, "coordinate mode"],
    rigid: int,
) -> Kinds:
    """Kinds of modes, the first ``rigid`` at zero: one of `HELD` where most moves rigidly without strain.

    The basis of modes of equal frequency is arbitrary. Where a suspension mode and a flexible one coincide,
    the basis that separates them is taken, and else the one of `turn_apart`, so that the result does not
    depend on rounding.
    """
    first = ("rigid",) * rigid
    tree = equilibrium.model.tree
    if not is_held(equilibrium):
        lam, shapes = _settled(tree, M, lam, shapes, [c for c in repeated(lam) if c[0] >= rigid])
        share = np.where(np.arange(len(lam)) < rigid, 1.0, 0.0)
        strained = strain_share(equilibrium, lam, shapes)
        return Kinds(
            lam=lam,
            shapes=shapes,
            rigid_share=share,
            strain_share=strained,
            kind=first + ("flexible",) * (len(lam) - rigid),
        )
    rows = M @ strainless_motions(equilibrium, M)
    shapes, groups = _apart(lam, shapes, rows.T @ shapes, rigid)
    lam, shapes = _settled(tree, M, lam, shapes, groups)
    seen = rows.T @ shapes
    share = np.clip(np.sum(seen**2, axis=0), 0.0, 1.0)
    share[:rigid] = 1.0
    strained = strain_share(equilibrium, lam, shapes)
    held = (share >= HALF) & ((strained < HALF) | (lam <= 0.0))  # nothing restores what falls over
    kind = np.where(held, _holders(equilibrium, lam, shapes, strained), "flexible")
    return Kinds(
        lam=lam,
        shapes=shapes,
        rigid_share=share,
        strain_share=strained,
        kind=first + tuple(kind[rigid:].tolist()),
    )


def _holders(
    equilibrium: Equilibrium, lam: np.ndarray, shapes: np.ndarray, strained: np.ndarray
) -> np.ndarray:
    """Support of each mode other than strain: the environment's devices or, if clamped, the weight."""
    if equilibrium.model.held is None:
        return np.full(len(lam), "suspension")
    by_weight = 0.5 * lam * (1.0 - strained) - device_energy(equilibrium, shapes)
    return np.where(by_weight > HALF * 0.5 * lam * (1.0 - strained), "pendulum", "suspension")


def kinds_by_rank(equilibrium: Equilibrium, kind: tuple[str, ...]) -> tuple[str, ...]:
    """The 1993 paper's convention: the n lowest modes, n the number of rigid-body modes in orbit.

    ``kind`` marks the modes at zero, which count among them.
    """
    rigid = kind.count("rigid")
    held = _rigid_in_orbit(equilibrium) - rigid if is_held(equilibrium) else 0
    tied = len(equilibrium.loads.attach_point) + len(equilibrium.loads.ground.point) > 0
    hung = equilibrium.model.held is None or tied
    kinds = ("rigid",) * rigid + ("suspension" if hung else "pendulum",) * held
    return (kinds + ("flexible",) * (len(kind) - len(kinds)))[: len(kind)]


def undecided(
    rigid_share: Float[np.ndarray, " mode"], strain_share: Float[np.ndarray, " mode"]
) -> np.ndarray:
    """Numbers of the modes that are neither suspension nor flexible."""
    flexible = (rigid_share <= UNDECIDED[0]) | (strain_share >= UNDECIDED[1])
    held = (rigid_share >= UNDECIDED[1]) & (strain_share <= UNDECIDED[0])
    return np.flatnonzero(~flexible & ~held)


def _apart(
    lam: np.ndarray, shapes: np.ndarray, seen: np.ndarray, rigid: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Modes of one frequency turned until their rigid shares are as far apart as can be, rigid ones first;
    the groups of them that stay alike."""
    groups: list[np.ndarray] = []
    for cluster in (c for c in repeated(lam) if c[0] >= rigid):
        shares, turn = np.linalg.eigh(seen[:, cluster].T @ seen[:, cluster])
        if shares[-1] - shares[0] <= SEPARABLE:
            groups.append(cluster)
            continue
        shapes = shapes.copy()
        shapes[:, cluster] = shapes[:, cluster] @ turn[:, ::-1]
        held = int(np.sum(shares > 0.5 * (shares[0] + shares[-1])))
        groups += [cluster[:held], cluster[held:]]
    return shapes, groups


def _settled(
    tree: FrameTree, M: sp.csr_array, lam: np.ndarray, shapes: np.ndarray, groups: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Each group of modes with one frequency, in the one basis that its kinetic energy names."""
    lam, shapes = lam.copy(), shapes.copy()
    for group in groups:
        lam[group] = lam[group].mean()
        shapes[:, group] = turn_apart(tree, M, shapes[:, group])
    return lam, shapes


def strainless_motions(equilibrium: Equilibrium, M: sp.csr_array) -> Float[np.ndarray, "coordinate motion"]:
    """Motions that strain nothing, about the rest state; mass-orthonormal."""
    model = equilibrium.model
    if in_one_piece(model):
        motions, _ = rigid_motions(equilibrium, M)
        moving = [j for j in model.structure.joints if j.state in (JointState.FREE, JointState.SPRUNG)]
        free = [j.state is JointState.FREE or j.stiffness == 0.0 for j in moving]
        motions = motions[:, np.concatenate([np.ones(6, dtype=bool), np.array(free, dtype=bool)])]
        motions = allowed_motions(model.held, motions)
    else:
        motions = _null_space(equilibrium)
    size = np.sqrt(np.einsum("im,im->m", motions, M @ motions))
    motions = motions[:, size > 0.0] / size[size > 0.0]
    own, turn = np.linalg.eigh(motions.T @ (M @ motions))
    new = own > DEPENDENT
    return motions @ (turn[:, new] / np.sqrt(own[new]))


def _null_space(equilibrium: Equilibrium) -> np.ndarray:
    """Modes of the strain alone that are at zero."""
    model, config, free = (
        equilibrium.model,
        equilibrium.config,
        dynamic_freedom(equilibrium.model, equilibrium.config),
    )
    strain = assemble_carried(model, config, no_loads()).tangent - geometric_tangent(
        model, config, no_loads()
    )
    K, M = free.matrix(strain), free.matrix(carried_mass(model, config, equilibrium.loads))
    soft = uncarried(config.since_drawn, len(free.active))[free.active]
    small = all_cost_less(K)
    pairs = solve_all(K, M, soft, sharp=0) if small else solve_lowest(K, M, count_zero(K, M, soft) or 1, soft)
    if pairs is None:
        return np.zeros((model.tree.size, 0))
    still = np.abs(pairs.lam) <= pairs.noise
    return transport(config, model.tree) @ free.spread(pairs.shapes[:, still])


def in_one_piece(model: Model) -> bool:
    """Whether members join all nodes: strainless motions are then those of one body and its free joints."""
    structure = model.structure
    return (
        not structure.springs
        and not structure.bushings
        and not structure.components
        and not structure.links
        and all(
            min(m.section.EA, m.section.GJ, m.section.EI_y, m.section.EI_z) > 0.0 for m in structure.members
        )
    )


def _rigid_in_orbit(equilibrium: Equilibrium) -> int:
    """Number of rigid-body modes of the same structure, free and undeformed.

    What members join to one piece has six, and one for each free joint; springs can add mechanisms or take
    joints away, and then the modes of no stiffness are counted.
    """
    model = equilibrium.model
    free = dynamic_freedom(model, model.rest)
    if in_one_piece(model):
        whole = rigid_columns(model.tree, model.rest, model.rest.x.mean(axis=0))
        return allowed_motions(model.held, whole).shape[1] + sum(
            joint.state is JointState.FREE for joint in model.structure.joints
        )
    slack = dataclasses.replace(no_loads(), tension=0.0)
    K = assemble_carried(model, model.rest, slack).tangent
    M = drawn_mass(model)
    soft = uncarried(model.rest.since_drawn, len(free.active))[free.active]
    return count_zero(free.matrix(K), free.matrix(M), soft)


SHOWN = 6
CURE = "keep the two apart by a softer suspension (bounce_hz, cable_length) or a stiffer article"


def kind_warnings(
    equilibrium: Equilibrium,
    omega: Float[np.ndarray, " mode"],
    kind: tuple[str, ...],
    names: Callable[[], tuple[str, ...]],
    rigid_share: Float[np.ndarray, " mode"],
    strain_share: Float[np.ndarray, " mode"],
) -> tuple[str, ...]:
    """One sentence for all such modes: their frequencies, what depends on their kind, and what to do."""
    damping = equilibrium.model.structure.damping
    ranked = kinds_by_rank(equilibrium, kind) if damping.by_rank else kind
    doubted = set(undecided(rigid_share, strain_share).tolist()) | {
        m for m in range(len(kind)) if ranked[m] != kind[m]
    }
    if not doubted:
        return ()
    ratio = {k: damping.suspension if k in HELD else damping.flexible for k in set(ranked)}
    loosely = "suspension" if equilibrium.model.held is None else "rigid motion"
    rows: list[str] = []
    name = names()
    for m in sorted(doubted):
        called = f"mode {m} {name[m]!r} at {omega[m] / (2.0 * np.pi):.4g} Hz"
        shares = f"its strain share is {strain_share[m]:.0%} and {rigid_share[m]:.0%} of its motion is rigid"
        rows.append(
            f"{called} is damped as {ranked[m]} ({ratio[ranked[m]]:g}) by rank, but {shares}, which makes it "
            f"{kind[m]}"
            if damping.by_rank
            else f"{called} is part {loosely}, part flexible: {shares}, so that it counts as {kind[m]}"
        )
    listed = "; ".join(rows[:SHOWN]) + (f"; and {len(rows) - SHOWN} more modes" if len(rows) > SHOWN else "")
    if damping.by_rank:
        return (
            f"{listed}. A ratio of the wrong kind makes a peak wrong in height; "
            'damping.rule = "shares" weighs both ratios by energy',
        )
    return (
        f"{listed}. Name, damping ratio and partner in orbit of such a mode are uncertain; {CURE}, or give "
        "it its own ratio ([damping.mode])",
    )
