"""Modes of a structure as one joint is stiffened: a rank-one change in modal coordinates.

With p = omega^2 and w the joint's angle in each mode, stiffness k at the joint turns omega^2 into the roots
of

    1 + k sum_j w_j^2 / (p_j - lambda) = 0,

one between each two neighbouring p (Golub 1973, SIAM Review 15, section 5), each with the shape
w_j / (p_j - lambda). Modes that are not kept are joined as a flexibility R in series with the element, which
is what they are far below their own frequencies: k / (1 + k R) in place of k.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.errors import ConfigError
from middeck.structure.model.article import JointState
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.residual_flexibility import residual_flexibility
from middeck.values import record

UNCOUPLED = 1e-9
"""Joint angle of a mode, relative to the largest of any, below which it is rounding."""
EQUAL = 1e-10
"""Relative distance of omega^2 below which modes are one subspace: one combination moves the joint."""
BASIS = 30
"""Further poles in the basis of a damped solution; those above are a flexibility."""


@record(kw_only=True)
class JointSystem:
    """One joint of a structure in modal coordinates; only what moves the joint.

    Attributes:
        pole: omega^2 [rad^2/s^2], ascending and distinct.
        angle: Angle of the joint per unit of each mass-normalised mode, not zero.
        zeta: Damping ratio of each.
        mode: The mode of `Modes` each belongs to; of several at one frequency the one that turns the joint
            most.
        flexibility: Flexibility of all modes that are not kept [rad/(N m)].
    """

    pole: Float[np.ndarray, " pole"]
    angle: Float[np.ndarray, " pole"]
    zeta: Float[np.ndarray, " pole"]
    mode: Int[np.ndarray, " pole"]
    flexibility: float


def build_joint_system(modes: Modes, joint: str, zeta: Float[np.ndarray, " mode"]) -> JointSystem:
    """The joint ``joint`` in the modal coordinates of ``modes``, with their damping ratios.

    Raises `ConfigError` for a joint that there is not, or one that is locked or driven: it does not move.
    """
    row = _joint_row(modes, joint)
    angle = (row @ modes.shapes)[0]
    kept = np.flatnonzero(np.abs(angle) > UNCOUPLED * np.abs(angle).max(initial=0.0))
    if not len(kept):
        raise ConfigError(f"no mode that was kept moves joint {joint!r}", hint="solve for more modes")
    p = modes.omega**2
    # Close neighbours fall into one group: a new one begins where the gap is wide.
    new = np.diff(p[kept], prepend=-np.inf) > EQUAL * p[kept]
    new[0] = True
    group = np.cumsum(new) - 1
    groups = [kept[group == g] for g in range(group[-1] + 1)]
    weight = np.array([np.sum(angle[g] ** 2) for g in groups])
    return JointSystem(
        pole=np.array([p[g[0]] for g in groups]),
        angle=np.sqrt(weight),
        zeta=np.array([angle[g] ** 2 @ zeta[g] for g in groups]) / weight,
        mode=np.array([g[np.argmax(np.abs(angle[g]))] for g in groups], dtype=int),
        flexibility=float(residual_flexibility(modes, row, row, len(modes.omega))[0, 0]),
    )


def _joint_row(modes: Modes, joint: str) -> Float[np.ndarray, "1 coordinate"]:
    model = modes.equilibrium.model
    known = {j.name: (i, j.state) for i, j in enumerate(model.structure.joints)}
    moving = [n for n, (_, state) in known.items() if state in (JointState.FREE, JointState.SPRUNG)]
    if joint not in moving:
        what = f"joint {joint!r} is {known[joint][1].value}" if joint in known else f"no joint {joint!r}"
        raise ConfigError(what, hint=f"a joint that moves: {', '.join(moving) or 'there is none'}")
    row = np.zeros((1, model.tree.size))
    row[0, 6 * model.tree.roots + known[joint][0]] = 1.0
    return row


def keep_lowest(system: JointSystem, count: int) -> JointSystem:
    """The lowest ``count`` poles and `BASIS` more; those above as flexibility."""
    n = min(len(system.pole), count + BASIS)
    above = float(np.sum(system.angle[n:] ** 2 / system.pole[n:]))
    return JointSystem(
        pole=system.pole[:n],
        angle=system.angle[:n],
        zeta=system.zeta[:n],
        mode=system.mode[:n],
        flexibility=system.flexibility + above,
    )


def solve_undamped(
    system: JointSystem, stiffness: float, count: int
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, "pole mode"]]:
    """The ``count`` lowest omega^2 with ``stiffness`` at the joint, and their unit shapes in the poles."""
    k = stiffness / (1.0 + stiffness * system.flexibility)
    p, weight = system.pole, system.angle**2
    count = min(count, len(p))
    if k == 0.0:
        return p[:count], np.eye(len(p), count)
    low = p[:count].copy()
    high = np.append(p, p[-1] + k * np.sum(weight))[1 : count + 1]
    middle = low
    while True:  # all bisected at once
        last, middle = middle, 0.5 * (low + high)
        if np.array_equal(last, middle):
            break
        with np.errstate(divide="ignore"):  # a root at a pole, to rounding
            above = 1.0 + k * np.sum(weight / (p - middle[:, None]), axis=1) > 0.0
        high, low = np.where(above, middle, high), np.where(above, low, middle)
    return middle, _shapes(system, middle)


def _shapes(system: JointSystem, s_squared: np.ndarray) -> np.ndarray:
    """Columns w/(p - lambda), of unit length."""
    gap = system.pole[:, None] - s_squared
    nearest = np.argmin(np.abs(gap), axis=0)
    close = gap[nearest, np.arange(len(nearest))]
    with np.errstate(invalid="ignore", divide="ignore"):  # a root at a pole: that mode alone
        y = system.angle[:, None] * close / gap
    y[nearest, np.arange(len(nearest))] = system.angle[nearest]
    return y / np.linalg.norm(y, axis=0)


def joint_receptance(system: JointSystem, omega: Float[np.ndarray, " line"]) -> Complex[np.ndarray, " line"]:
    """Angle per torque [rad/(N m)] of the joint without its element at ``omega`` [rad/s]."""
    s = 1j * np.asarray(omega, dtype=float)[:, None]
    d = s**2 + 2.0 * system.zeta * np.sqrt(system.pole) * s + system.pole
    return np.sum(system.angle**2 / d, axis=1) + system.flexibility
