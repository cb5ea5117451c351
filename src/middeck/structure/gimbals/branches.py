"""How the modes of a structure move as one joint is stiffened: a rank-one change in modal coordinates.

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
from scipy.optimize import linear_sum_assignment

from middeck.errors import ConfigError
from middeck.structure.article import JointState
from middeck.structure.modes import Modes
from middeck.structure.plants.residual import residual_flexibility
from middeck.values import record

UNCOUPLED = 1e-9
"""Part of the largest joint angle of a mode below which a mode does not move the joint but by rounding."""
EQUAL = 1e-10
"""Relative distance of omega^2 below which modes are one subspace: one combination moves the joint."""
RUNGS = 25
"""Steps in a decade of stiffness, 10 % each, in which modes are followed: two that change places within one
cross; more slowly, they veer."""
CLEAR = 0.9
"""Mass product above which a mode is the one of the step before."""
PATIENCE = 2
"""Steps that a mode may wait for a clear product before the best one is taken."""
FIRST = 1e-3
"""Part of the lowest omega^2 by which the first step may move it."""
SPARE = 6
"""Further branches that are followed above the highest one wanted."""
BASIS = 30
"""Further poles in the basis of a damped solution; those above are a flexibility."""


@record
class JointSystem:
    """One joint of a structure in modal coordinates; only what moves the joint.

    Parameters
    ----------
    pole:
        omega^2 [rad^2/s^2], ascending and distinct.
    angle:
        Angle of the joint per unit of each mass-normalised mode, not zero.
    zeta:
        Damping ratio of each.
    mode:
        The mode of `Modes` each belongs to; of several at one frequency the one that turns the joint most.
    flexibility:
        Of all modes that are not kept [rad/(N m)].
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
        np.array([p[g[0]] for g in groups]),
        np.sqrt(weight),
        np.array([angle[g] ** 2 @ zeta[g] for g in groups]) / weight,
        np.array([g[np.argmax(np.abs(angle[g]))] for g in groups], dtype=int),
        float(residual_flexibility(modes, row, row, len(modes.omega))[0, 0]),
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


def follow_branches(
    system: JointSystem, stiffness: Float[np.ndarray, " value"], wanted: Int[np.ndarray, " branch"]
) -> tuple[Float[np.ndarray, "value branch"], Float[np.ndarray, "value pole branch"]]:
    """omega^2 and unit shapes, in the poles' coordinates, of the poles ``wanted`` at every ``stiffness``.

    They are followed by the mass product of their shapes along a ladder of stiffnesses that does not depend
    on those asked for.
    """
    count = min(len(system.pole), int(wanted.max(initial=0)) + 1 + SPARE)
    lam = np.zeros((len(stiffness), len(wanted)))
    shapes = np.zeros((len(stiffness), len(system.pole), len(wanted)))
    low = _keep_lowest(system, count)
    followed, waited = _solve(low, 0.0, count)[1], np.zeros(count, dtype=int)
    ladder = _ladder(low, count, float(stiffness.max(initial=0.0)))
    for i in np.argsort(stiffness, kind="stable"):
        while len(ladder) and ladder[0] <= stiffness[i]:
            found, ladder = _solve(low, float(ladder[0]), count)[1], ladder[1:]
            found = found[:, _match(followed, found)]
            alike = np.abs(np.sum(followed * found, axis=0))
            # On a rung within a crossing nothing can be told: wait for the next.
            renew = (alike > CLEAR) | (waited >= PATIENCE)
            followed = np.where(renew, found, followed)
            waited = np.where(renew, 0, waited + 1)
        values, found = _solve(system, float(stiffness[i]), count)
        own = _match(followed, found[: len(followed)])[wanted]
        lam[i], shapes[i] = values[own], found[:, own]
    return lam, shapes


def _keep_lowest(system: JointSystem, count: int) -> JointSystem:
    """The lowest ``count`` poles and `BASIS` more, those above as flexibility."""
    n = min(len(system.pole), count + BASIS)
    above = float(np.sum(system.angle[n:] ** 2 / system.pole[n:]))
    return JointSystem(
        system.pole[:n], system.angle[:n], system.zeta[:n], system.mode[:n], system.flexibility + above
    )


def _ladder(system: JointSystem, count: int, highest: float) -> Float[np.ndarray, " rung"]:
    """Powers of ten by `RUNGS`, from where no mode has changed yet."""
    pole = system.pole[:count]
    least = FIRST * float(pole[pole > 0.0].min(initial=np.inf)) / float(np.max(system.angle**2))
    if not 0.0 < least < highest:
        return np.zeros(0)
    return 10.0 ** (np.arange(np.floor(RUNGS * np.log10(least)), RUNGS * np.log10(highest)) / RUNGS)


def _match(old: np.ndarray, new: np.ndarray) -> Int[np.ndarray, " branch"]:
    """For each column of ``old`` the column of ``new`` that is most like it, one to one."""
    return linear_sum_assignment(np.abs(old.T @ new), maximize=True)[1]


def _solve(system: JointSystem, stiffness: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The ``count`` lowest roots, all bisected at once, and their unit shapes."""
    k = stiffness / (1.0 + stiffness * system.flexibility)
    p, weight = system.pole, system.angle**2
    if k == 0.0:
        return p[:count], np.eye(len(p), count)
    low = p[:count].copy()
    high = np.append(p, p[-1] + k * np.sum(weight))[1 : count + 1]
    middle = low
    while True:
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


def solve_damped(
    system: JointSystem,
    shapes: Float[np.ndarray, "pole branch"],
    stiffness: complex,
    viscous: float,
) -> Complex[np.ndarray, " branch"]:
    """Eigenvalues s [rad/s] of the modes that look like the undamped ``shapes``, all damping included.

    ``stiffness`` is complex, k + j loss; the modal damping is on the diagonal, the joint's where it is. The
    basis goes `BASIS` poles beyond the highest of ``shapes``; the flexibility of those above is wrong by the
    square of the frequency ratio times what it changes.
    """
    low = _keep_lowest(system, int(np.argmax(np.abs(shapes), axis=0).max(initial=0)) + 1)
    w, pole, n = low.angle, low.pole, len(low.pole)
    series = 1.0 + stiffness * low.flexibility
    # States (q, q'/scale): a matrix of frequencies, not of their squares, rounds to 1e-16 of the highest.
    scale = np.where(pole > 0.0, np.sqrt(pole), 1.0)
    hold = np.diag(pole / scale) + stiffness / series * np.outer(w / scale, w)
    drag = np.diag(2.0 * low.zeta * np.sqrt(pole))
    drag = drag + viscous / series**2 * np.outer(w / scale, w * scale)
    s, vectors = _eig(np.block([[np.zeros((n, n)), np.diag(scale)], [-hold, -drag]]))
    # Of each pair the one above the real axis: below it a complex stiffness would feed the motion.
    upper = np.argsort(-np.imag(s), kind="stable")[:n]
    q = vectors[:n, upper]
    alike = np.abs(shapes[:n].T @ (q / np.linalg.norm(q, axis=0)))
    return s[upper][linear_sum_assignment(alike, maximize=True)[1]]


def _eig(A: np.ndarray) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, "n n"]]:
    values, vectors = np.linalg.eig(A)
    return values.astype(complex), vectors.astype(complex)


def joint_receptance(system: JointSystem, omega: Float[np.ndarray, " line"]) -> Complex[np.ndarray, " line"]:
    """Angle per torque [rad/(N m)] of the joint without its element at ``omega`` [rad/s]."""
    s = 1j * np.asarray(omega, dtype=float)[:, None]
    d = s**2 + 2.0 * system.zeta * np.sqrt(system.pole) * s + system.pole
    return np.sum(system.angle**2 / d, axis=1) + system.flexibility
