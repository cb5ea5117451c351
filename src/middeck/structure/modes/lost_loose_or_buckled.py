"""Diagnosis of statics: where convergence was lost, and which joints are loose and why."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble_carried, inner_forces, split_tangent
from middeck.structure.assembly.linked import static_freedom
from middeck.structure.elements.rotations import skew
from middeck.structure.model.article import JointState
from middeck.structure.modes.motions.strain_shares import member_energy
from middeck.structure.rest.equilibrium import HALF_ROUND, Equilibrium, bushing_turns
from middeck.structure.rest.imbalance import imbalance_scale
from middeck.structure.rest.settle import ROUGH

HALF = 0.5
FELT = 2e-4  # relative change of omega^2: 1e-4 of a frequency, as for a mesh


class Lost(NamedTuple):
    """Fraction of the load at which convergence was lost, and the state there.

    ``frame`` is the least balanced: ``left`` says by how much, a node has moved by ``moved`` [m].
    """

    factor: float
    frame: str
    left: str
    moved: float


def where_lost(equilibrium: Equilibrium) -> Lost:
    """Load and state at which an equilibrium that did not converge was lost."""
    model = equilibrium.model
    last = {factor: residual for factor, residual, _ in equilibrium.history}
    factor = next((f for f, residual in last.items() if residual >= ROUGH), 1.0)
    gradient = assemble_carried(model, equilibrium.config, equilibrium.loads).gradient
    left = np.abs(static_freedom(model, equilibrium.config).within(gradient))
    worst = int(np.argmax(left / imbalance_scale(model, equilibrium.loads)))
    moved = np.linalg.norm(equilibrium.config.x - model.rest.x, axis=1).max()
    size = f"{left[worst]:.3g} {'N m' if model.tree.turns[worst] else 'N'}"
    return Lost(factor, model.frames[model.tree.frame_of(worst)], size, float(moved))


def gone_too_far(equilibrium: Equilibrium) -> list[str]:
    """A clause for each joint beyond its travel, and each bushing turned by more than a right angle."""
    at = equilibrium
    joints = zip(at.model.structure.joints, at.config.angle, strict=True)
    beyond = [joint.name for joint, x in joints if not joint.travel[0] <= x <= joint.travel[1]]
    turns = bushing_turns(at.model, at.environment, at.config, at.loads)
    return [f"; joint {name!r} went beyond its travel" for name in beyond] + [
        f"; bushing {name!r} has turned far, and bears no more than 180 deg"
        for name, turn in turns
        if turn > HALF_ROUND
    ]


def buckling_member(equilibrium: Equilibrium, shape: Float[np.ndarray, " coordinate"]) -> str | None:
    """The member that strains most in a growing mode; None where members hold under half of its energy.

    What buckles resists by strain of members; what topples, by devices and joints, or by nothing.
    """
    model, config, loads = equilibrium.model, equilibrium.config, equilibrium.loads
    parts = split_tangent(model, config, loads, inner_forces(model, config, loads))
    held = 0.5 * float(shape @ ((parts.material + parts.device) @ shape))
    released = 0.5 * float(shape @ ((parts.material + parts.device + parts.geometric) @ shape))
    bent = member_energy(equilibrium, shape[:, None])[0]
    if not len(bent) or bent.sum() < max(HALF * held, HALF * abs(released)):
        return None
    return model.structure.members[int(np.argmax(bent))].name


def loose_motions(equilibrium: Equilibrium, rigid: tuple[str, ...]) -> tuple[str, ...]:
    """One sentence for each of the ``rigid`` modes, by name, of an article that something should hold."""
    if not np.any(equilibrium.environment.gravity) and equilibrium.model.held is None:
        return ()
    turning = [
        f"gimbal {j.name.replace('_', ' ')}"
        for j in equilibrium.model.structure.joints
        if (j.state is JointState.FREE or (j.state is JointState.SPRUNG and j.stiffness == 0.0))
        and not j.slides
    ]
    reason = "; what it carries has its centre of mass on the axis, or the axis is upright: spring or lock it"
    return tuple(
        f"nothing holds {name!r} in {equilibrium.environment.title!r}: a mechanism in neutral balance"
        + reason * (name in turning)
        for name in rigid
    )


def moment_warnings(
    equilibrium: Equilibrium, lam: Float[np.ndarray, " mode"], shapes: Float[np.ndarray, "coordinate mode"]
) -> tuple[str, ...]:
    """Warnings where moments of fixed direction shift a frequency beyond the symmetric tangent.

    A turn t adds t x M/2 to what balances a moment M: half of the moment's spin, antisymmetric, for no
    potential has a moment of fixed direction (Ziegler 1968, Principles of Structural Stability, section 3).
    Between modes i and j it is a_ij, and shifts lambda_i by the sum of a_ij^2 / (lambda_j - lambda_i), which
    is of second order; where 2 |a_ij| exceeds the gap the two flutter.
    """
    model, moments = equilibrium.model, equilibrium.loads.push[:, 3:]
    if not np.any(moments):
        return ()
    turns = equilibrium.moves(shapes)[model.load_point, 3:]
    a = 0.5 * np.einsum("pim,pij,pjn->mn", turns, skew(moments), turns)
    gap = lam[None, :] - lam[:, None]
    np.fill_diagonal(gap, np.inf)
    close = np.abs(gap) <= 2.0 * np.abs(a)
    shift = np.abs(np.where(close, np.abs(a), a**2 / np.where(close, 1.0, gap)).sum(axis=1))
    felt = np.flatnonzero(shift > FELT * np.where(lam > 0.0, lam, np.inf))
    if not len(felt):
        return ()
    worst = int(felt[np.argmax(shift[felt] / lam[felt])])
    return (
        f"a moment of fixed direction is not conservative: of mode {worst} at "
        f"{np.sqrt(lam[worst]) / (2.0 * np.pi):.4g} Hz it may change the frequency by "
        f"{0.5 * shift[worst] / lam[worst]:.1g} beyond what is shown, and damp or excite modes close to each "
        "other; apply it by two forces on arms",
    )
