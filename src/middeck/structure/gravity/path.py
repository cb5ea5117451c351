"""Modes followed while gravity changes: from 1-g to 0-g, to the Moon, or into a tilted laboratory.

The rest state is continued from place to place by Newton's method, never by a fresh descent, which could end
on another branch. Steps are shortened until each mode is clearly the same on both sides. Where the branch
loses its stability, the path ends there, with the mode that lost it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, EquilibriumError, UnstableEquilibriumError
from middeck.structure.assembly.energy import Assembly, assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mass import drawn_mass
from middeck.structure.elements.frames import Configuration
from middeck.structure.gravity.continuation import rest_near
from middeck.structure.gravity.crossings_and_veerings import Advance, Course, reorder, resolve_exchanges
from middeck.structure.gravity.gravity_levels import DeviceRule, GravityLevel, gravity_between, loads_in
from middeck.structure.gravity.path_events import EventKind, GravityEvent, PathState
from middeck.structure.gravity.tracking import HALF_SHAPE, spectrum_at, spectrum_of, track
from middeck.structure.gravity.turned_modes import turn_along
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.rest.settle import settle
from middeck.values import record

# Parts of the way between two places.
LONGEST_STEP = 1.0 / 20.0
# Below this step size, `resolve_exchanges` decides.
SHORTEST_STEP = 1e-4
# To this the end of a branch, and the loss of stability, are found.
FINEST = 1e-10
# A mode is surely the same when this, squared, of its shape is; steps grow again above EASY.
SURE = 0.9
EASY = 0.97
# Part of the gravity for which devices were tuned, at which they are released for orbit, or take hold.
RELEASE = 1e-3


@record(kw_only=True)
class GravityPath:
    """Modes along a path of gravities; a branch is a mode of the first station, wherever it goes.

    Attributes:
        places, reached: The places in order, and the station at each that was reached.
        name, kind: Name and kind of each branch, at the first station.
        s: Place of each station on the path: 0 at the first place, 1 at the second, and so on.
        gravity: Gravity at each station, in W [m/s^2].
        omega2: omega^2 [1/s^2] of each branch.
        match: Cross-orthogonality with the station before; 1 at the first.
        events: Crossings, veerings (see `exchanged`) and, last, what ended the path before its last place, if
            anything did.
        warnings: Warnings for the modes at the first station, whose names and kinds these are, and for
            branches that change their order unexplained; none where there are no modes.
    """

    structure: Structure
    environment: Environment
    rule: DeviceRule
    places: tuple[GravityLevel, ...]
    reached: tuple[int, ...]
    name: tuple[str, ...]
    kind: tuple[str, ...]
    s: Float[np.ndarray, " station"]
    gravity: Float[np.ndarray, "station 3"]
    omega2: Float[np.ndarray, "station branch"]
    match: Float[np.ndarray, "station branch"]
    events: tuple[GravityEvent, ...]
    warnings: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether the last place was reached."""
        return len(self.reached) == len(self.places)

    @property
    def frequency_hz(self) -> Float[np.ndarray, "station branch"]:
        """Natural frequencies [Hz]; of a mode that grows, minus its rate over 2 pi."""
        return np.sign(self.omega2) * np.sqrt(np.abs(self.omega2)) / (2.0 * np.pi)

    @property
    def size(self) -> Float[np.ndarray, " station"]:
        """Size of gravity [m/s^2]."""
        return np.linalg.norm(self.gravity, axis=1)

    @property
    def exchanged(self) -> Bool[np.ndarray, "station branch"]:
        """Whether a branch is past a veering: its shape is no longer that of its name."""
        past = np.zeros(self.omega2.shape, dtype=bool)
        for event in self.events:
            if event.kind is EventKind.VEERING:
                past[:, list(event.branch)] |= (self.s > event.s)[:, None]
        return past

    @property
    def doubtful(self) -> tuple[tuple[int, int], ...]:
        """(station, branch) whose shape has less than half in common with that a station before."""
        return tuple((int(i), int(j)) for i, j in np.argwhere(self.match < HALF_SHAPE))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Leg:
    """Constants of the path between two places, number ``k`` and the next."""

    full: Equilibrium
    free: Equilibrium
    mass: sp.csr_array
    loads_at: Callable[[np.ndarray], Loads]
    a: GravityLevel
    b: GravityLevel
    k: int

    def loads(self, s: float) -> Loads:
        """The loads at ``s``."""
        return self.loads_at(gravity_between(self.a, self.b, s - self.k))

    @property
    def release(self) -> float:
        """Part of the way from orbit, or to it, without devices: the same gravity on every path."""
        other = max(self.a.size, self.b.size)
        return min(RELEASE * float(np.linalg.norm(self.full.loads.gravity)) / other, 0.5)


class _Stop(NamedTuple):
    """Why a path ends: the last good station, and the first bad one, if there is a state at all."""

    good: PathState
    bad: PathState | None


@named_kinds
def follow_gravity(
    structure: Structure,
    environment: Environment,
    places: Sequence[GravityLevel] | None = None,
    *,
    devices: DeviceRule = DeviceRule.KEPT,
    count: int = 26,
) -> GravityPath:
    """Follow the ``count`` lowest modes from place to place; by default from ``environment`` to orbit.

    The devices of ``environment`` are tuned in its own gravity; elsewhere they obey ``devices``. On the way
    to a place without gravity they are released at a thousandth of that; on the way from one they take hold
    there, and the article first settles under them. Clamps hold all the way, in orbit too, and the forces of
    a load case act all the way.

    An unstable rest state ends the path as a value: the last of ``events`` says where, and which mode. Raises
    `ConfigError` for places that do not differ and `EquilibriumError` where ``environment`` cannot hold the
    article, or the first place has no rest state.
    """
    places = tuple(
        places or (GravityLevel(environment.title, environment.gravity), GravityLevel("orbit", np.zeros(3)))
    )
    _check(structure, environment, places)
    orbit = dataclasses.replace(Environment.orbit(), clamps=environment.clamps)
    full = solve_equilibrium(structure, environment)
    # A path that does not reach 0-g needs no rest state there: loads may lack a support.
    free = full if all(place.size for place in places) else solve_equilibrium(structure, orbit)
    loads_at = loads_in(full, devices)
    at_first = places[0].gravity
    path = partial(GravityPath, structure=structure, environment=environment, rule=devices, places=places)
    try:
        modes = solve_modes(_settled(full, loads_at(at_first)) if np.any(at_first) else free, count)
    except UnstableEquilibriumError as error:
        return _no_path(path, error, at_first)
    mass = drawn_mass(full.model)
    legs = [
        _Leg(full=full, free=free, mass=mass, loads_at=loads_at, a=a, b=b, k=k)
        for k, (a, b) in enumerate(itertools.pairwise(places))
    ]
    rest, match = modes.equilibrium, np.ones(len(modes.omega))
    first = PathState(
        s=0.0,
        gravity=at_first,
        config=rest.config,
        spectrum=spectrum_of(modes),
        match=match,
        tension=rest.tension,
        least=0.0,
    )
    stations, stop, arrived = [first], None, 1
    for leg in legs:
        more, stop = _follow_leg(leg, stations[-1])
        stations += more
        if stop is not None:
            break
        arrived += 1
    stations, events, order, path_warnings = _resolve_runs(stations, legs, modes.name)
    if stop is not None:
        stop = _Stop(reorder(stop.good, order), stop.bad and reorder(stop.bad, order))
        events.append(_ending(stop, full.suspension.name, modes.name))
    reached = np.searchsorted([x.s for x in stations], np.arange(arrived))
    return path(
        reached=tuple(map(int, reached)),
        name=modes.name,
        kind=modes.kind,
        s=np.array([x.s for x in stations]),
        gravity=np.array([x.gravity for x in stations]),
        omega2=np.array([x.spectrum.lam for x in stations]),
        match=np.array([x.match for x in stations]),
        events=tuple(events),
        warnings=(*modes.warnings, *path_warnings),
    )


def _no_path(
    path: Callable[..., GravityPath], error: UnstableEquilibriumError, gravity: np.ndarray
) -> GravityPath:
    """One that ends where it begins."""
    nothing = np.zeros((0, 0))
    start = GravityEvent(
        kind=EventKind.UNSTABLE_START,
        s=0.0,
        gravity=gravity,
        branch=(),
        name=(str(error.data["mode"]),),
        frequency_hz=-float(error.data["growth"]) / (2.0 * np.pi),
        gap_hz=0.0,
    )
    return path(
        reached=(),
        name=(),
        kind=(),
        s=np.zeros(0),
        gravity=np.zeros((0, 3)),
        omega2=nothing,
        match=nothing,
        events=(start,),
    )


def _resolve_runs(
    stations: Sequence[PathState], legs: Sequence[_Leg], names: tuple[str, ...]
) -> tuple[list[PathState], list[GravityEvent], np.ndarray, list[str]]:
    """Exchanges between one visit to orbit and the next; branches renamed in one run stay so in all."""
    steps = [np.linalg.norm(leg.b.gravity - leg.a.gravity) for leg in legs]
    come = np.concatenate([[0.0], np.cumsum(steps)])

    def advance(before: PathState, s: float) -> PathState | None:
        return _advance(legs[min(int(s), len(legs) - 1)], before, s)

    done: list[PathState] = []
    events: list[GravityEvent] = []
    order, path_warnings = np.arange(len(names)), list[str]()
    for heavy, group in itertools.groupby(stations, key=lambda x: bool(np.any(x.gravity))):
        run = [reorder(x, order) for x in group]
        if heavy:
            found = resolve_exchanges(run, Course(advance, come), names)
            run, order = found.stations, order[found.order]
            events += found.events
            path_warnings += [
                f"{names[i]!r} and {names[j]!r} change their order, and no crossing of these two alone was "
                "found: three or more modes come close together there, and beyond it their names may be "
                "exchanged"
                for i, j in found.unexplained
            ]
        done += run
    return done, events, order, path_warnings


def _check(structure: Structure, environment: Environment, places: tuple[GravityLevel, ...]) -> None:
    if not np.any(environment.gravity):
        raise ConfigError(
            "a path of gravities needs an environment with gravity, for which its devices are tuned",
            where=f"environment {environment.title!r}",
            hint="give the laboratory; orbit can be a place on the path",
        )
    still = any(np.array_equal(a.gravity, b.gravity) for a, b in itertools.pairwise(places))
    if len(places) < 2 or still:
        names = ", ".join(place.name for place in places)
        raise ConfigError(
            f"a path needs two places or more, each unlike the one before, not {names}",
            where="places",
            hint="earth,moon,orbit",
        )
    for a, b in itertools.pairwise(places):
        gravity_between(a, b, 0.5)  # refuses opposite ones
    if any(np.any(load.moment) for load in structure.loads):
        raise ConfigError(
            "a moment of fixed direction has no potential, whose modes a path could follow",
            where=f"structure {structure.title!r}",
            hint="apply it by two forces with offsets; forces and added masses may stay",
        )


def _settled(full: Equilibrium, loads: Loads) -> Equilibrium:
    """The rest state under ``loads``, by descent from the undeformed structure."""
    if loads == full.loads:
        return full
    found = settle(full.model, loads)
    return dataclasses.replace(
        full,
        environment=dataclasses.replace(full.environment, gravity=loads.gravity),
        config=found.config,
        loads=loads,
        residual=found.residual,
        history=found.history,
        tension=found.assembly.tension,
        enough=found.enough,
        stable=found.stable,
    )


def _advance(leg: _Leg, before: PathState, s: float) -> PathState | None:
    """From a station to a near ``s`` along the branch; None where there is no rest state to hang in."""
    try:
        loads = leg.loads(s)
    except EquilibriumError:  # a device that is tuned anew would have to push
        return None
    found = rest_near(leg.full.model, before.config, loads, leg.mass)
    return None if found is None else _station(leg, before, s, loads, *found)


def _station(
    leg: _Leg, before: PathState, s: float, loads: Loads, config: Configuration, at: Assembly
) -> PathState:
    model = leg.full.model
    spectrum = spectrum_at(model, config, loads, len(before.match), at)
    found = track(turn_along(before.spectrum, model, before.config, config)[0], spectrum)
    least = float(spectrum.lam.min(initial=0.0))
    return PathState(
        s=s,
        gravity=loads.gravity,
        config=config,
        spectrum=found.spectrum,
        match=found.match,
        tension=at.tension,
        least=least,
    )


def _follow_leg(leg: _Leg, start: PathState) -> tuple[list[PathState], _Stop | None]:
    """The stations after ``start``, and why they end early, if they do."""
    stations = [start]
    hung = len(leg.full.suspension.name)
    if leg.a.size == 0.0:
        held = _take_hold(leg, start, leg.k + leg.release)
        if held is None or _is_bad(held, hung):
            return [], _Stop(start, held)
        stations.append(held)
    end = leg.k + 1.0 - (leg.release if leg.b.size == 0.0 else 0.0)
    more, stop = _follow_ramp(stations[-1], partial(_advance, leg), end, hung)
    stations += more
    if stop is None and leg.b.size == 0.0:  # released
        loads, config = leg.free.loads, leg.free.config
        at = assemble_carried(leg.full.model, config, loads)
        stations.append(_station(leg, stations[-1], leg.k + 1.0, loads, config, at))
    return stations[1:], stop


def _take_hold(leg: _Leg, start: PathState, s: float) -> PathState | None:
    """First rest state on the devices, by descent, as the article may turn far in the least gravity."""
    loads = leg.loads(s)
    found = settle(leg.full.model, loads)
    if found.residual >= found.enough:
        return None
    return _station(leg, start, s, loads, found.config, found.assembly)


def _follow_ramp(
    start: PathState, advance: Advance, end: float, hung: int
) -> tuple[list[PathState], _Stop | None]:
    """Stations up to ``end`` in steps short enough for each mode to be clearly the same."""
    stations, step = [start], LONGEST_STEP
    while stations[-1].s < end:
        here = stations[-1]
        s = end if here.s + step > end - FINEST else here.s + step
        new = advance(here, s)
        if new is None and step < FINEST:
            return stations[1:], _Stop(here, None)
        if new is not None and _is_bad(new, hung):
            stop = _bisect(here, new, advance, hung)
            return [*stations[1:], *([stop.good] if stop.good.s > here.s else [])], stop
        if new is None or (new.match.min() < SURE and step > SHORTEST_STEP):
            step *= 0.5
            continue
        stations.append(new)
        step = min(2.0 * step, LONGEST_STEP) if new.match.min() > EASY else step
    return stations[1:], None


def _is_bad(station: PathState, hung: int) -> bool:
    """Unstable, or with a device that would have to push."""
    return station.least < 0.0 or bool(np.any(station.tension[:hung] <= 0.0))


def _bisect(good: PathState, bad: PathState, advance: Advance, hung: int) -> _Stop:
    while bad.s - good.s > FINEST:
        middle = advance(good, 0.5 * (good.s + bad.s))
        if middle is None:
            return _Stop(good, None)
        if _is_bad(middle, hung):
            bad = middle
        else:
            good = middle
    return _Stop(good, bad)


def _ending(stop: _Stop, devices: tuple[str, ...], names: tuple[str, ...]) -> GravityEvent:
    good, bad = stop
    last = (good if bad is None else bad).spectrum.lam
    # Where a branch turns back its mode has not got to zero yet; what nothing holds has been there all along.
    held = np.where((last == 0.0) & (bad is None), np.inf, last)
    softest = int(np.argmin(held))
    branch, name = (softest,), (names[softest],)
    if bad is None:
        kind = EventKind.NO_REST
    elif bad.least < 0.0:
        kind = EventKind.UNSTABLE
        if last[softest] >= 0.0:
            branch, name = (), ("a mode above those followed",)
    else:
        kind, branch = EventKind.SLACK, ()
        name = tuple(n for n, pull in zip(devices, bad.tension, strict=False) if pull <= 0.0)
    f = float(np.sqrt(max(good.spectrum.lam[softest], 0.0))) / (2.0 * np.pi) if branch else 0.0
    return GravityEvent(
        kind=kind, s=good.s, gravity=good.gravity, branch=branch, name=name, frequency_hz=f, gap_hz=0.0
    )
