"""The same article at many gimbal angles: rest states, holding torques, modes followed over a grid, plants.

A free axis is held at its angle by a constant torque and free to move about it. With the payload past the
horizontal that is not stable: the torque holds, but does not hold still. Such a point is a value like any
other, with a negative omega^2, and the angle where stability is lost is found between its neighbours.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from middeck.errors import ConfigError, EquilibriumError, UnstableEquilibriumError
from middeck.structure.article import Damping, Joint, JointState, Structure
from middeck.structure.assembly import assemble, mass_matrix
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.gravity.tracking import HALF_SHAPE, SPARE, Spectrum, solve_spectrum, spectrum_of, track
from middeck.structure.modes import Modes, solve_modes
from middeck.structure.naming import HALF, name_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rigid import rigid_motions
from middeck.structure.statics import static_coordinates
from middeck.systems.plant import Plant
from middeck.values import record

# Between two points a mode is surely the same when this, squared, of its shape is; else the way is halved.
SURE = 0.9
HALVINGS = 4
# An angle at which stability is lost is found to this [rad].
FINEST = 1e-9


@record
class StabilityLimit:
    """Where, between two neighbours of the grid, a branch of the family begins to grow.

    ``angle`` [rad] is that of ``joint``, ``at`` those of all swept joints; ``name`` is what the branch is
    there, ``unstable`` the point beyond.
    """

    joint: str
    angle: float
    at: Float[np.ndarray, " joint"]
    branch: int
    name: str
    unstable: int

    @property
    def sentence(self) -> str:
        """In words."""
        return f"{self.name!r} loses stability at {self.joint} = {np.degrees(self.angle):.6g} deg"


@record
class GimbalFamily:
    """Members of a family; points are all combinations of the angles, the last joint's running fastest.

    Parameters
    ----------
    joints, grid:
        Swept joints, and the angles [rad] of each.
    angle:
        Of the swept joints at each point [rad].
    holding_torque:
        What the motors of the swept joints hold [N m]; not a number where there is no rest state.
    torque_limit:
        Of the swept joints' motors [N m], infinite where the article gives none.
    name, kind:
        Of each branch, a mode followed over the grid, at point ``origin``.
    omega2:
        omega^2 [1/s^2] of each branch, negative where it grows; not a number without a rest state.
    match:
        Cross-orthogonality of each branch with itself at the neighbour from which it was followed.
    rests:
        Rest states; None where there is none.
    plants:
        None where the rest state is not stable, or no ports were asked for.
    trouble:
        Of each point why it has no rest state or is not stable; empty where all is well.
    limits:
        Where stability is lost between neighbours.
    """

    joints: tuple[str, ...]
    grid: tuple[tuple[float, ...], ...]
    angle: Float[np.ndarray, "point joint"]
    holding_torque: Float[np.ndarray, "point joint"]
    torque_limit: Float[np.ndarray, " joint"]
    name: tuple[str, ...]
    kind: tuple[str, ...]
    origin: int
    omega2: Float[np.ndarray, "point branch"]
    match: Float[np.ndarray, "point branch"]
    rests: tuple[Equilibrium | None, ...]
    plants: tuple[Plant | None, ...]
    trouble: tuple[str, ...]
    limits: tuple[StabilityLimit, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of angles of each joint; ``family.omega2.reshape(*family.shape, -1)`` is on the grid."""
        return tuple(map(len, self.grid))

    @property
    def frequency_hz(self) -> Float[np.ndarray, "point branch"]:
        """Natural frequencies [Hz]; of a mode that grows, minus its rate over 2 pi."""
        return np.sign(self.omega2) * np.sqrt(np.abs(self.omega2)) / (2.0 * np.pi)

    @property
    def stable(self) -> tuple[bool, ...]:
        """Whether each point has a stable rest state."""
        return tuple(not trouble for trouble in self.trouble)

    @property
    def overloaded(self) -> tuple[tuple[int, str], ...]:
        """(point, joint) where the motor would have to hold more than its limit."""
        over = np.argwhere(np.abs(self.holding_torque) > self.torque_limit)
        return tuple((int(p), self.joints[j]) for p, j in over)

    @property
    def doubtful(self) -> tuple[tuple[int, int], ...]:
        """(point, branch) where less than half of a shape is what it was at the neighbour."""
        return tuple((int(p), int(b)) for p, b in np.argwhere(self.match < HALF_SHAPE))


class _Member(NamedTuple):
    """One point, solved; ``modes`` only if it is stable."""

    rest: Equilibrium
    modes: Modes | None
    spectrum: Spectrum
    trouble: str


class _Followed(NamedTuple):
    member: _Member
    spectrum: Spectrum
    match: np.ndarray


def sweep_gimbals(
    structure: Structure,
    environment: Environment,
    angles: Mapping[str, Sequence[float]],
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    count: int = 26,
    damping: Damping | None = None,
) -> GimbalFamily:
    """``structure`` in ``environment`` at all combinations of ``angles`` [rad], by joint.

    Every point is what `solve_equilibrium` makes of the article with its axes there: devices are tuned anew,
    as a crew would for each set-up. The ``count`` lowest modes of the stable point nearest to the nominal
    angles are followed over the grid, with points between where shapes change fast. With ``inputs`` and
    ``outputs`` each stable point has the plant of `build_plant`.

    Raises `ConfigError` for a joint that there is not or whose spring decides its angle, for angles that do
    not ascend or that lie outside of its travel, and `UnstableEquilibriumError` where no point is stable.
    """
    joints = _checked(structure, angles)
    grid = tuple(tuple(map(float, angles[j.name])) for j in joints)
    at = np.array(list(itertools.product(*grid)))
    names = tuple(j.name for j in joints)

    def solve(here: np.ndarray) -> _Member:
        return _solve(_turned(structure, names, here), environment, count)

    members = [_attempt(solve, here) for here in at]
    origin = _origin(members, at, np.array([j.angle for j in joints]))
    followed = _follow(members, at, origin, solve, count)
    start = members[origin]
    assert isinstance(start, _Member)
    modes = start.modes
    assert modes is not None
    name = modes.name[:count]
    lam = np.full((len(at), len(name)), np.nan)
    match = np.full_like(lam, np.nan)
    torque = np.full(at.shape, np.nan)
    index = [[j.name for j in structure.joints].index(n) for n in names]
    for p, found in followed.items():
        lam[p], match[p] = found.spectrum.lam, found.match
        torque[p] = found.member.rest.holding_torque[index]
    limits = _limits(grid, at, followed, solve, names)
    ported = bool(inputs) and bool(outputs)
    return GimbalFamily(
        joints=names,
        grid=grid,
        angle=at,
        holding_torque=torque,
        torque_limit=np.array([j.torque_limit for j in joints]),
        name=name,
        kind=modes.kind[:count],
        origin=origin,
        omega2=lam,
        match=match,
        rests=tuple(m.rest if isinstance(m, _Member) else None for m in members),
        plants=tuple(
            build_plant(m.modes, inputs=inputs, outputs=outputs, count=count, damping=damping)
            if ported and isinstance(m, _Member) and m.modes is not None
            else None
            for m in members
        ),
        trouble=tuple(m.trouble if isinstance(m, _Member) else m for m in members),
        limits=limits,
    )


def _checked(structure: Structure, angles: Mapping[str, Sequence[float]]) -> list[Joint]:
    """The swept joints, in the order given."""
    known = {j.name: j for j in structure.joints}
    if not angles:
        raise ConfigError("no joint to turn", where="angles", hint=f"one of {', '.join(known)}")
    for name, values in angles.items():
        joint = known.get(name)
        if joint is None or joint.slides or joint.state is JointState.SPRUNG:
            turning = [n for n, j in known.items() if not j.slides and j.state is not JointState.SPRUNG]
            reason = "there is not" if joint is None else "rests where its spring and its load put it"
            raise ConfigError(f"joint {name!r} {reason}", where="angles", hint=f"one of {', '.join(turning)}")
        at = np.asarray(values, dtype=float)
        if at.ndim != 1 or not len(at) or not np.all(np.isfinite(at)) or np.any(np.diff(at) <= 0.0):
            raise ConfigError(f"the angles of joint {name!r} do not ascend", where="angles", hint="in rad")
        low, high = joint.travel
        outside = at[(at < low) | (at > high)]
        if len(outside):
            raise ConfigError(
                f"joint {name!r} cannot go to {np.degrees(outside[0]):.6g} deg",
                where="angles",
                hint=f"its travel is {np.degrees(low):.6g} to {np.degrees(high):.6g} deg",
                outside=tuple(map(float, outside)),
            )
    return [known[name] for name in angles]


def _turned(structure: Structure, names: tuple[str, ...], at: np.ndarray) -> Structure:
    """The structure with those joints at those angles, a driven one commanded there."""
    angle = dict(zip(names, map(float, at), strict=True))
    joints = tuple(
        dataclasses.replace(j, angle=angle[j.name], target=angle[j.name]) if j.name in angle else j
        for j in structure.joints
    )
    return dataclasses.replace(structure, joints=joints)


def _solve(structure: Structure, environment: Environment, count: int) -> _Member:
    rest = solve_equilibrium(structure, environment)
    try:
        modes = solve_modes(rest, count + SPARE)
    except UnstableEquilibriumError as error:
        return _Member(rest, None, _signed_spectrum(rest, count), error.what)
    return _Member(rest, modes, spectrum_of(modes), "")


def _signed_spectrum(rest: Equilibrium, count: int) -> Spectrum:
    at = assemble(rest.model, rest.config, rest.loads)
    unbalanced = float(np.abs(at.gradient[static_coordinates(rest.model)]).max(initial=0.0))
    M = mass_matrix(rest.model, rest.config, rest.loads)
    return solve_spectrum(rest.model, at.tangent, M, count, unbalanced)


def _attempt(solve: Callable[[np.ndarray], _Member], here: np.ndarray) -> _Member | str:
    """The member, or in words why there is none."""
    try:
        return solve(here)
    except EquilibriumError as error:
        return error.what


def _origin(members: list[_Member | str], at: np.ndarray, nominal: np.ndarray) -> int:
    """The stable point nearest to the nominal angles."""
    nearest = np.argsort(np.linalg.norm(at - nominal, axis=1), kind="stable")
    for p in nearest:
        member = members[p]
        if isinstance(member, _Member) and member.modes is not None:
            return int(p)
    first = members[nearest[0]]
    raise UnstableEquilibriumError(
        f"no point of the grid has a stable rest state: {first if isinstance(first, str) else first.trouble}",
        where="angles",
        hint="a grid that reaches to where the payload hangs below its axes",
    )


def _follow(
    members: list[_Member | str],
    at: np.ndarray,
    origin: int,
    solve: Callable[[np.ndarray], _Member],
    count: int,
) -> dict[int, _Followed]:
    """Branches at every point that has a rest state, each from the nearest that has been reached."""
    start = members[origin]
    assert isinstance(start, _Member)
    lowest = Spectrum(start.spectrum.lam[:count], start.spectrum.shapes[:, :count], start.spectrum.mass)
    done = {origin: _Followed(start, lowest, np.ones(len(lowest.lam)))}
    for p in np.argsort(np.linalg.norm(at - at[origin], axis=1), kind="stable"):
        member = members[p]
        if p in done or isinstance(member, str):
            continue
        near = min(done, key=lambda q, p=p: float(np.linalg.norm(at[q] - at[p])))
        done[int(p)] = _step(done[near], at[near], member, at[p], solve, HALVINGS)
    return done


def _step(
    here: _Followed,
    start: np.ndarray,
    member: _Member,
    end: np.ndarray,
    solve: Callable[[np.ndarray], _Member],
    halvings: int,
) -> _Followed:
    """Branches from ``here`` to ``member``, by way of the middle where a shape changes much."""
    found = track(here.spectrum, member.spectrum)
    there = _Followed(member, found.spectrum, found.match)
    if not halvings or found.match.min(initial=1.0) >= SURE:
        return there
    between = _attempt(solve, 0.5 * (start + end))
    if isinstance(between, str):
        return there
    middle = _step(here, start, between, 0.5 * (start + end), solve, halvings - 1)
    last = _step(middle, 0.5 * (start + end), member, end, solve, halvings - 1)
    return _Followed(member, last.spectrum, np.minimum(middle.match, last.match))


def _limits(
    grid: tuple[tuple[float, ...], ...],
    at: np.ndarray,
    followed: dict[int, _Followed],
    solve: Callable[[np.ndarray], _Member],
    joints: tuple[str, ...],
) -> tuple[StabilityLimit, ...]:
    """For each two neighbours and each branch whose omega^2 changes sign between them."""
    number = np.arange(len(at)).reshape(tuple(map(len, grid)))
    limits: list[StabilityLimit] = []
    for axis, joint in enumerate(joints):
        lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
        for p, q in (pair for line in lines for pair in itertools.pairwise(map(int, line))):
            if p not in followed or q not in followed:
                continue
            a, b = followed[p].spectrum.lam, followed[q].spectrum.lam
            for branch in map(int, np.flatnonzero((a < 0.0) != (b < 0.0))):
                good, bad = (q, p) if a[branch] < 0.0 else (p, q)
                angle, there = _zero(followed[good], at[good], at[bad], axis, branch, solve)
                where = at[good].copy()
                where[axis] = angle
                limits.append(StabilityLimit(joint, angle, where, branch, _name(there, branch), bad))
    return tuple(limits)


def _zero(
    good: _Followed,
    start: np.ndarray,
    end: np.ndarray,
    axis: int,
    branch: int,
    solve: Callable[[np.ndarray], _Member],
) -> tuple[float, _Followed]:
    """The angle at which omega^2 of a branch passes through zero (Brent 1973), and the modes there."""
    done = {float(start[axis]): good}

    def omega2(angle: float) -> float:
        if angle not in done:
            near, here = start.copy(), start.copy()
            near[axis] = min(done, key=lambda known: abs(known - angle))
            here[axis] = angle
            done[angle] = _step(done[float(near[axis])], near, solve(here), here, solve, HALVINGS)
        return float(done[angle].spectrum.lam[branch])

    found = cast("float", brentq(omega2, float(start[axis]), float(end[axis]), xtol=FINEST))
    return float(found), done[min(done, key=lambda known: abs(known - found))]


def _name(followed: _Followed, branch: int) -> str:
    """What the branch is where it is lost, which far from its origin may be another motion than there.

    By the part of its mass that moves rigidly; of a potential energy that vanishes there are no shares.
    """
    rest, M = followed.member.rest, followed.spectrum.mass
    shape = followed.spectrum.shapes[:, branch]
    motions, _ = rigid_motions(rest, M)
    moved = motions.T @ (M @ shape)
    rigid = moved @ np.linalg.lstsq(motions.T @ (M @ motions), moved, rcond=None)[0]
    kind = "suspension" if rigid > HALF else "flexible"
    K = assemble(rest.model, rest.config, rest.loads).tangent
    return name_modes(rest, M, K, shape[:, None], (kind,), ())[0][0]
