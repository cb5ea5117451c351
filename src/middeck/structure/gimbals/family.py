"""The same article at many gimbal angles: rest states, holding torques, modes followed over a grid, plants.

A free axis is held at its angle by a constant torque and free to move about it. With the payload past the
horizontal that is not stable: the torque holds, but does not hold still. Such a point is a value like any
other, with a negative omega^2, and the angle where stability is lost is found between its neighbours.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, EquilibriumError, UnstableEquilibriumError
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration
from middeck.structure.elements.springs_and_cables import SpringLaw
from middeck.structure.gravity.continuation import rest_near
from middeck.structure.gravity.tracking import HALF_SHAPE, SPARE, Spectrum, spectrum_at, spectrum_of, track
from middeck.structure.model.article import Joint, JointState, Structure
from middeck.structure.model.connectivity import REDRAW, turned_by_redrawing
from middeck.structure.model.environment import Environment
from middeck.structure.modes.names.kinds import find_kinds
from middeck.structure.modes.names.naming import name_modes
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.systems.plants.plant import Plant
from middeck.values import record

# Between two points a mode is surely the same when this, squared, of its shape is; else the way is halved.
SURE = 0.9
HALVINGS = 4
# An angle at which stability is lost is found to this [rad].
FINEST = 1e-9
# Part of its scale that an omega^2 has left where it passes through zero; more on both sides is a jump.
PASSED = 1e-3


@record(kw_only=True)
class StabilityLimit:
    """A limit, between two neighbours of the grid, from which a branch of the family grows.

    ``angle`` [rad] is that of ``joint``, ``at`` those of all swept joints; ``unstable`` is the point beyond,
    ``name`` what the mode that grows is at that point, the same as in its ``diagnosis``. Where ``jumps``, no
    omega^2 passes through zero: a sprung axis has several rest states there, and the one that is found
    changes from a stable to an unstable one. ``no_rest`` says why there is no rest state just beyond the
    angle; empty where there is one.
    """

    joint: str
    angle: float
    at: Float[np.ndarray, " joint"]
    branch: int
    name: str
    unstable: int
    jumps: bool = False
    no_rest: str = ""

    @property
    def sentence(self) -> str:
        """The limit in words."""
        if self.no_rest:
            return f"no rest state beyond {self.joint} = {np.degrees(self.angle):.6g} deg: {self.no_rest}"
        if self.jumps:
            return (
                f"the rest state jumps at {self.joint} = {np.degrees(self.angle):.6g} deg, to another one "
                f"where {self.name!r} grows: a sprung axis has several"
            )
        return f"{self.name!r} loses stability at {self.joint} = {np.degrees(self.angle):.6g} deg"


@record(kw_only=True)
class GimbalFamily:
    """Members of a family; points are all combinations of the angles, the last joint's running fastest.

    Attributes:
        joints, grid: Swept joints, and the angles [rad] of each.
        angle: Angle of the swept joints at each point [rad].
        holding_torque: Torque of the swept joints' motors at rest [N m]; not a number where there is no rest
            state.
        torque_limit: Torque limit of the swept joints' motors [N m], infinite where the article gives none.
        name, kind: Name and kind of each branch, a mode followed over the grid, at point ``origin``.
        omega2: omega^2 [1/s^2] of each branch, negative where it grows; not a number without a rest state.
        match: Cross-orthogonality of each branch with itself at the neighbour from which it was followed.
        rests: Rest states; None where there is none.
        plants: None where the rest state is not stable, or no ports were asked for.
        diagnosis: Why each point has no rest state or is not stable; empty where all is well.
        limits: Where stability is lost between neighbours.
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
    diagnosis: tuple[str, ...]
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
        return tuple(not diagnosis for diagnosis in self.diagnosis)

    @property
    def doubtful(self) -> tuple[tuple[int, int], ...]:
        """(point, branch) whose shape has less than half in common with that at the neighbour."""
        return tuple((int(p), int(b)) for p, b in np.argwhere(self.match < HALF_SHAPE))


class _Member(NamedTuple):
    """One point, solved; ``modes`` only if it is stable."""

    rest: Equilibrium
    modes: Modes | None
    spectrum: Spectrum
    diagnosis: str


class _Followed(NamedTuple):
    member: _Member
    spectrum: Spectrum
    match: np.ndarray


class _Place(NamedTuple):
    """A rest state on the way between two points; at the points themselves theirs."""

    config: Configuration
    loads: Loads
    spectrum: Spectrum


@named_kinds
def sweep_gimbals(
    structure: Structure,
    environment: Environment,
    angles: Mapping[str, Sequence[float]],
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    count: int = 26,
) -> GimbalFamily:
    """``structure`` in ``environment`` at all combinations of ``angles`` [rad], by joint.

    Every point is a solution of `solve_equilibrium` with the axes at these angles: devices are tuned again,
    as a crew would for each set-up. The ``count`` lowest modes of the stable point nearest to the nominal
    angles are followed over the grid, with points between where shapes change fast. With ``inputs`` and
    ``outputs`` each stable point has the plant of `build_plant`.

    Raises `ConfigError` for an unknown or sprung joint, for one whose ties would be drawn anew, and for
    angles that do not ascend or lie outside its travel, and `UnstableEquilibriumError` where no point is
    stable.
    """
    joints = _checked(structure, environment, angles)
    grid = tuple(tuple(map(float, angles[j.name])) for j in joints)
    at = np.array(list(itertools.product(*grid)))
    names = tuple(j.name for j in joints)

    def solve(here: np.ndarray) -> _Member:
        return _solve(_turned(structure, names, here), environment, count)

    members = [_attempt(solve, here) for here in at]
    origin = _origin(members, at, np.array([j.angle for j in joints]))
    followed = _follow(members, at, origin, count)
    start = members[origin]
    assert isinstance(start, _Member)
    assert start.modes is not None
    name = start.modes.name[:count]
    lam = np.full((len(at), len(name)), np.nan)
    match = np.full_like(lam, np.nan)
    torque = np.full(at.shape, np.nan)
    index = [[j.name for j in structure.joints].index(n) for n in names]
    for p, found in followed.items():
        lam[p], match[p] = found.spectrum.lam, found.match
        torque[p] = found.member.rest.holding_torque[index]
    return GimbalFamily(
        joints=names,
        grid=grid,
        angle=at,
        holding_torque=torque,
        torque_limit=np.array([j.torque_limit for j in joints]),
        name=name,
        kind=start.modes.kind[:count],
        origin=origin,
        omega2=lam,
        match=match,
        rests=tuple(m.rest if isinstance(m, _Member) else None for m in members),
        plants=tuple(_plant(m, inputs, outputs, count) for m in members),
        diagnosis=tuple(m.diagnosis if isinstance(m, _Member) else m for m in members),
        limits=_limits(grid, at, followed, solve, names),
    )


def _plant(member: _Member | str, inputs: Sequence[str], outputs: Sequence[str], count: int) -> Plant | None:
    if not (inputs and outputs) or not isinstance(member, _Member) or member.modes is None:
        return None
    return build_plant(member.modes, inputs=inputs, outputs=outputs, count=count)


def _checked(
    structure: Structure, environment: Environment, angles: Mapping[str, Sequence[float]]
) -> list[Joint]:
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
        if redrawn := turned_by_redrawing(structure, name, environment.bushings):
            raise ConfigError(redrawn, where="angles", hint=REDRAW)
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
    except UnstableEquilibriumError:
        spectrum = spectrum_at(rest.model, rest.config, rest.loads, count)
        return _Member(rest, None, spectrum, _growth(rest, spectrum))
    return _Member(rest, modes, spectrum_of(modes), "")


def _growth(rest: Equilibrium, spectrum: Spectrum) -> str:
    """The fastest growing mode, by the name in its stability limit."""
    worst = int(np.argmin(spectrum.lam))
    name, rate = _name(rest, spectrum, worst), np.sqrt(-spectrum.lam[worst])
    return f"the rest state is not stable: mode {name!r} grows at {rate:.4g} rad/s"


def _attempt(solve: Callable[[np.ndarray], _Member], here: np.ndarray) -> _Member | str:
    """The member, or the reason why there is none."""
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
    why = first if isinstance(first, str) else first.diagnosis
    raise UnstableEquilibriumError(
        f"no point of the grid has a stable rest state: {why}",
        where="angles",
        hint="a grid that reaches to where the payload hangs below its axes",
    )


def _follow(members: list[_Member | str], at: np.ndarray, origin: int, count: int) -> dict[int, _Followed]:
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
        done[int(p)] = _step(done[near], member)
    return done


def _step(here: _Followed, member: _Member) -> _Followed:
    """The branches of ``here`` at another member."""
    start, end = _place(here.member), _place(member)
    return _Followed(member, *_track_way(here.member.rest.model, here.spectrum, start, end, HALVINGS))


def _place(member: _Member) -> _Place:
    return _Place(member.rest.config, member.rest.loads, member.spectrum)


def _track_way(
    model: Model, reference: Spectrum, start: _Place, end: _Place, halvings: int
) -> tuple[Spectrum, np.ndarray]:
    """``reference``, of the place ``start``, at ``end``; by way of the middle where a shape changes much."""
    found = track(reference, end.spectrum)
    if not halvings or found.match.min(initial=1.0) >= SURE:
        return found.spectrum, found.match
    middle = _middle(model, start, end, len(reference.lam))
    if middle is None:
        return found.spectrum, found.match
    half, first = _track_way(model, reference, start, middle, halvings - 1)
    whole, last = _track_way(model, half, middle, end, halvings - 1)
    return whole, np.minimum(first, last)


def _middle(model: Model, start: _Place, end: _Place, count: int) -> _Place | None:
    """Half way in the angles and in what devices are tuned to: near enough to identify each mode.

    To tune them there would cost five times as much, and end at the same two points.
    """
    a, b = start.loads, end.loads
    law = SpringLaw(
        0.5 * (a.law.preload + b.law.preload),
        0.5 * (a.law.stiffness + b.law.stiffness),
        0.5 * (a.law.length + b.law.length),
    )
    loads = dataclasses.replace(a, anchor=0.5 * (a.anchor + b.anchor), law=law, mass=0.5 * (a.mass + b.mass))
    angle = 0.5 * (start.config.angle + end.config.angle)
    near = rest_near(model, dataclasses.replace(start.config, angle=angle), loads)
    return near and _Place(near[0], loads, spectrum_at(model, near[0], loads, count))


def _limits(
    grid: tuple[tuple[float, ...], ...],
    at: np.ndarray,
    followed: dict[int, _Followed],
    solve: Callable[[np.ndarray], _Member],
    joints: tuple[str, ...],
) -> tuple[StabilityLimit, ...]:
    """Stability limits between neighbours, for each mode that grows at one of the two only.

    Neighbours may have been reached from the origin by different ways, and then the branch of one number is
    not the same at both. What is the same is how many modes grow.
    """
    number = np.arange(len(at)).reshape(tuple(map(len, grid)))
    limits: list[StabilityLimit] = []
    for axis, joint in enumerate(joints):
        lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
        for p, q in (pair for line in lines for pair in itertools.pairwise(map(int, line))):
            if p not in followed or q not in followed:
                continue
            growing = [int(np.sum(followed[i].member.spectrum.lam < 0.0)) for i in (p, q)]
            good, bad = (p, q) if growing[0] < growing[1] else (q, p)
            for rank in range(min(growing), max(growing)):
                found = _zero(followed[good], followed[bad].member, at[good], at[bad], axis, rank, solve)
                where = at[good].copy()
                where[axis] = found.angle
                limits.append(
                    StabilityLimit(joint=joint, at=where, unstable=bad, **dataclasses.asdict(found))
                )
                if found.no_rest:  # the modes of higher rank have no rest state there either
                    break
    return tuple(limits)


@dataclass(frozen=True, kw_only=True)
class _Limit:
    """What `StabilityLimit` says of one loss."""

    angle: float
    branch: int
    name: str
    jumps: bool
    no_rest: str


def _zero(
    good: _Followed,
    bad: _Member,
    start: np.ndarray,
    end: np.ndarray,
    axis: int,
    rank: int,
    solve: Callable[[np.ndarray], _Member],
) -> _Limit:
    """The angle at which the omega^2 of one more mode passes through zero (Brent 1973), its branch and name.

    The ``rank``-th omega^2 from below, without modes at rest, is continuous in the angle even where modes
    cross; times the sizes of all others that are followed it is also smooth where modes veer. Where a trial
    in between has no rest state, bisection finds the last angle that is as good as the good end.
    """
    first, last = float(start[axis]), float(end[axis])
    done = {first: good.member, last: bad}
    rest = min(int(np.sum(m.spectrum.lam == 0.0)) for m in done.values())

    scale = good.member.spectrum.lam[_swinging(good.member.spectrum, rest)][: len(good.spectrum.lam) - rest]

    def member(angle: float) -> _Member:
        if angle not in done:
            here = start.copy()
            here[axis] = angle
            done[angle] = solve(here)
        return done[angle]

    def omega2(angle: float) -> float:
        spectrum = member(angle).spectrum
        lam = spectrum.lam[_swinging(spectrum, rest)][: len(scale)]
        return float(np.sign(lam[rank]) * np.prod(np.abs(lam / scale)))

    no_rest = ""
    try:
        found = float(cast("float", brentq(omega2, first, last, xtol=FINEST)))
        sides = (found, found - FINEST, found + FINEST)
        jumps = all(abs(omega2(angle)) > PASSED for angle in sides)
    except EquilibriumError:
        found, beyond, no_rest = _last_rest(member, rank, first, last)
        jumps = not no_rest and all(abs(omega2(angle)) > PASSED for angle in (found, beyond))
    way = sorted(done, key=lambda angle: abs(angle - first))
    nearest = min(done, key=lambda known: abs(known - found))
    here = good
    for angle in way[1 : way.index(nearest) + 1]:
        here = _step(here, done[angle])
    lost = done[nearest].spectrum.shapes[:, _swinging(done[nearest].spectrum, rest)[rank]]
    alike = np.abs(here.spectrum.shapes.T @ (here.spectrum.mass @ lost))
    # One loss, one name: that of the mode at the point beyond, where `diagnosis` speaks of it.
    name = _name(bad.rest, bad.spectrum, int(_swinging(bad.spectrum, rest)[rank]))
    return _Limit(angle=found, branch=int(np.argmax(alike)), name=name, jumps=jumps, no_rest=no_rest)


def _last_rest(
    member: Callable[[float], _Member], rank: int, good: float, bad: float
) -> tuple[float, float, str]:
    """The last angle with a rest state in which ``rank`` modes at most grow, the next beyond, and why that
    has no rest state; empty where it has one."""
    why = ""
    while abs(bad - good) > FINEST:
        middle = 0.5 * (good + bad)
        try:
            holds, reason = bool(np.sum(member(middle).spectrum.lam < 0.0) <= rank), ""
        except EquilibriumError as error:
            holds, reason = False, error.what
        if holds:
            good = middle
        else:
            bad, why = middle, reason
    return good, bad, why


def _swinging(spectrum: Spectrum, rest: int) -> np.ndarray:
    """Modes by omega^2 from below, the ``rest`` nearest to zero left out."""
    swings = np.argsort(np.abs(spectrum.lam), kind="stable")[rest:]
    return swings[np.argsort(spectrum.lam[swings], kind="stable")]


def _name(rest: Equilibrium, spectrum: Spectrum, mode: int) -> str:
    """Name of a mode that grows: far from the origin it may be another motion than there.

    By the part of its mass that moves rigidly; of a potential energy that vanishes there are no shares.
    """
    M, shape = spectrum.mass, spectrum.shapes[:, mode]
    kind = find_kinds(rest, M, spectrum.lam[[mode]], shape[:, None], 0).kind
    return name_modes(rest, M, spectrum.lam[[mode]], shape[:, None], kind, ())[0]
