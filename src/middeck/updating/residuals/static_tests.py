"""Static tests beside the article as drawn: sag, tilt and reactions under load cases.

A model's members are wrong by more than their numbers: ribs that slip, a clamp that gives. Statically that is
a relative error of their strains e, delta e = E e. E is d_j on each of the directions of the tests' strains
(orthonormal in strain energy), d_j ~ N(0, tau^2), and as much again, but independent, on the rest. So load
levels of one kind share their error, and a case that strains the article otherwise shares the part of its
strain along theirs. Such an error need not be proportional: d_j may change with the size of the strains,
which the levels of the tests show, and becomes less certain beyond.

Beside that each reading has an error of its own, of the rig or of the model, in parts of the full scale of
its gauge; and so has the reading of the unloaded article, which all readings of one series share.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.assembly.strain import member_strains
from middeck.structure.model.article import LoadCase, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.load_case import apply_load_case
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.sensitivity.parameters import read_parameter
from middeck.structure.sensitivity.rest import RestMotion, differentiate_rest, yield_further
from middeck.updating.residuals.gauges import Gauge, lengths, read, slopes
from middeck.updating.residuals.surveys import SetUp, set_up
from middeck.updating.unknowns.unknowns import Bound, Unknown, bind, change
from middeck.values import record

# Singular value over the largest below which strains are not those of the tests: the error cannot be seen
# there, and several independent ones would make its estimate small.
PRESENT = 0.01
# Change of an error while strains grow by a factor of e: a relative error of a wing's sag, taken as one of
# its members' yielding, grows by that where the wing bends far.
GROWTH = 0.3
# Share of a direction's largest part that is zero.
ROUNDING = 1e-9
# Stiffness, over an element's largest, that is rounding.
STIFF = 1e-12


@record(kw_only=True)
class StaticTest:
    """Readings of gauges under one load case.

    Attributes:
        value: One a gauge, in its unit; their ``std`` say how well.
        load_case: One of the article's by name, or one of the test's own; None is the article by itself.
        since_unloaded: Whether the values are less those in the same set-up without the load case, as gauges
            that are set to zero there read them. Else they are since drawn: without any load or weight.
        series: Tests of one series count from one unloaded reading, and share its error; its own if empty.
        settings: As of `Survey`.

    Raises `ConfigError` for no gauge, another number of values, a value that is not finite, a deviation that
    is not positive, and for changes since unloaded of no load case.
    """

    name: str
    environment: Environment
    gauges: tuple[Gauge, ...]
    value: Float[np.ndarray, " gauge"]
    load_case: LoadCase | str | None = None
    since_unloaded: bool = True
    series: str = ""
    settings: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        where = f"static test {self.name!r}"
        if not self.gauges or len(self.gauges) != len(self.value) or not np.all(np.isfinite(self.value)):
            raise ConfigError(
                f"{len(self.value)} values for {len(self.gauges)} gauges",
                where=where,
                hint="one finite value for each gauge, and one gauge at least",
            )
        for gauge in self.gauges:
            if not gauge.std > 0.0:
                raise ConfigError(
                    f"gauge {gauge.name!r} does not state how well it reads",
                    where=where,
                    hint=f"its standard deviation, in {gauge.unit}",
                )
        check_zero(self.load_case, self.since_unloaded, where)


def check_zero(load_case: LoadCase | str | None, since_unloaded: bool, where: str) -> None:
    """Raise `ConfigError` for readings since unloading of an article that is not loaded."""
    if load_case is None and since_unloaded:
        raise ConfigError(
            "a change since unloaded, of no load case", where=where, hint="since drawn, or with a load case"
        )


class Loaded(NamedTuple):
    """Rest states under a load case and, where readings count from there, without it."""

    rest: Equilibrium
    unloaded: Equilibrium | None

    def states(self) -> Iterator[tuple[float, Equilibrium]]:
        """Rest states whose sum a reading is, each with its sign."""
        yield 1.0, self.rest
        if self.unloaded is not None:
            yield -1.0, self.unloaded

    def value(self, gauges: Sequence[Gauge]) -> Float[np.ndarray, " gauge"]:
        """Readings of the gauges."""
        return np.sum([sign * read(rest, gauges) for sign, rest in self.states()], axis=0)

    def lengths(self, gauges: Sequence[Gauge]) -> Float[np.ndarray, " gauge"]:
        """See `lengths`."""
        return lengths(self.rest, self.unloaded, gauges)

    def strains(self) -> Float[np.ndarray, "state whitened"]:
        """Strains of the members, scaled so that their dot product is twice the energy."""
        return np.array([_whitened(rest) for _, rest in self.states()])


class StaticSetUp(NamedTuple):
    """An article under a load case and, where readings count from there, without it; and its unknowns."""

    name: str
    loaded: SetUp
    unloaded: SetUp | None

    def solve(self, x: Float[np.ndarray, " unknown"]) -> Loaded:
        """The rest states with the unknowns at ``x``. Raises `NumericalError` where none is stable."""
        return solve_statics([self], x)[0]

    def slope(
        self, at: Loaded, gauges: Sequence[Gauge], moves: OncePerState | None = None
    ) -> Float[np.ndarray, "gauge unknown"]:
        """Derivatives of readings by the unknowns, in the rest states ``at``.

        ``moves`` knows how states that several tests share move with the unknowns.
        """
        moves, places = moves or OncePerState(), (self.loaded, self.unloaded)
        return np.sum(
            [
                sign * _slopes(rest, place.bound, gauges, moves)
                for (sign, rest), place in zip(at.states(), places, strict=False)
                if place is not None
            ],
            axis=0,
        )


class OncePerState:
    """Values computed once for each rest state: tests in one set-up share that without loads."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Equilibrium, RestMotion]] = {}

    def motion(self, rest: Equilibrium, compute: Callable[[], RestMotion]) -> RestMotion:
        """Motion of the state, computed at the first request."""
        if id(rest) not in self._known:
            self._known[id(rest)] = rest, compute()  # kept with it, so that no other state has its place
        return self._known[id(rest)][1]


def solve_statics(places: Sequence[StaticSetUp], x: Float[np.ndarray, " unknown"]) -> list[Loaded]:
    """Rest states of all set-ups with the unknowns at ``x``; one that several share without loads, once.

    Raises `NumericalError` where none is stable.
    """
    unloaded: dict[int, Equilibrium | None] = {id(None): None}
    found: list[Loaded] = []
    for place in places:
        rest, bare = _at_rest(place.name, place.loaded, x), place.unloaded
        if bare is not None and id(bare) not in unloaded:
            unloaded[id(bare)] = _at_rest("", bare, x)
        found.append(Loaded(rest, unloaded[id(bare)]))
    return found


def _at_rest(load_case: str, place: SetUp, x: Float[np.ndarray, " unknown"]) -> Equilibrium:
    rest = solve_equilibrium(*change(*place, x))
    if not (rest.converged and rest.stable):
        what = "its rest state is not stable: it buckles or topples" if rest.converged else "no rest state"
        where = f"load case {load_case!r}" if load_case else "without a load case"
        raise NumericalError(f"the article: {what}", where=where, hint="a smaller load, a stiffer article")
    return rest


def set_up_static(
    structure: Structure,
    environment: Environment,
    settings: Sequence[tuple[str, float]],
    load_case: LoadCase | str | None,
    since_unloaded: bool,
    unknowns: Sequence[Unknown],
) -> StaticSetUp:
    """The article with ``settings`` and its loads. Raises `ConfigError` as `set_up` and `apply_load_case`."""
    return _under_load(
        set_up(structure, environment, settings, unknowns), load_case, since_unloaded, unknowns
    )


def set_up_statics(
    structure: Structure, tests: Sequence[StaticTest], unknowns: Sequence[Unknown]
) -> list[StaticSetUp]:
    """The article in each test; set-ups that tests share without their loads are one. Raises as
    `set_up_static`."""

    @functools.cache
    def bare(environment: Environment, settings: tuple[tuple[str, float], ...]) -> SetUp:
        return set_up(structure, environment, settings, unknowns)

    return [
        _under_load(bare(t.environment, t.settings), t.load_case, t.since_unloaded, unknowns) for t in tests
    ]


def _under_load(
    bare: SetUp, load_case: LoadCase | str | None, since_unloaded: bool, unknowns: Sequence[Unknown]
) -> StaticSetUp:
    both = apply_load_case(bare.structure, bare.environment, load_case)
    name = load_case.name if isinstance(load_case, LoadCase) else load_case or ""
    return StaticSetUp(name, SetUp(*both, bind(unknowns, *both)), bare if since_unloaded else None)


def _slopes(
    rest: Equilibrium, bound: Sequence[Bound], gauges: Sequence[Gauge], moves: OncePerState
) -> Float[np.ndarray, "gauge unknown"]:
    now = [[read_parameter(rest.model.structure, rest.environment, p) for p in b.parameters] for b in bound]
    motion = moves.motion(rest, lambda: differentiate_rest(rest, [p for own in now for p in own]))
    by = slopes(rest, motion, gauges)
    out, k = np.zeros((len(gauges), len(bound))), 0
    for column, (one, own) in enumerate(zip(bound, now, strict=True)):
        for parameter in own:
            out[:, column] += by[:, k] * (1.0 if one.unknown.added else parameter.value)
            k += 1
    return out


@record(kw_only=True)
class ComparedStatic:
    """A static test beside the model, each row in parts of the full scale of its gauge.

    Attributes:
        value: Readings of the model, in the units of the gauges.
        scale: Scale of the rows in these units, see `full_scales`; no less than a gauge's deviation.
        std: Standard deviation of each residual by its gauge.
    """

    test: StaticTest
    at: Loaded
    value: Float[np.ndarray, " gauge"]
    scale: Float[np.ndarray, " gauge"]
    residual: Float[np.ndarray, " gauge"]
    std: Float[np.ndarray, " gauge"]
    slope: Float[np.ndarray, "gauge unknown"]


def compare_statics(
    at: Sequence[Loaded], tests: Sequence[StaticTest], places: Sequence[StaticSetUp]
) -> tuple[ComparedStatic, ...]:
    """Residuals and slopes. Raises `ConfigError` for a gauge on a missing part, and as `slopes`."""
    full, moves = full_scales(at, tests), OncePerState()
    return tuple(_compare(*one, full, moves) for one in zip(at, tests, places, strict=True))


def full_scales(at: Sequence[Loaded], tests: Sequence[StaticTest]) -> dict[tuple[str, str, str], float]:
    """The longest change in all tests of which each gauge reads a part, in its unit, by `gauge_key`."""
    full: dict[tuple[str, str, str], float] = {}
    for loaded, test in zip(at, tests, strict=True):
        for gauge, own in zip(test.gauges, loaded.lengths(test.gauges).tolist(), strict=True):
            full[gauge_key(gauge)] = max(own, full.get(gauge_key(gauge), 0.0))
    return full


def gauge_key(gauge: Gauge) -> tuple[str, str, str]:
    """Key shared by one gauge in all tests."""
    return gauge.at, gauge.kind.value, gauge.name


def _compare(
    at: Loaded,
    test: StaticTest,
    place: StaticSetUp,
    full: Mapping[tuple[str, str, str], float],
    moves: OncePerState,
) -> ComparedStatic:
    std = np.array([gauge.std for gauge in test.gauges])
    scale = np.maximum([full[gauge_key(gauge)] for gauge in test.gauges], std)
    value = at.value(test.gauges)
    return ComparedStatic(
        test=test,
        at=at,
        value=value,
        scale=scale,
        residual=(test.value - value) / scale,
        std=std / scale,
        slope=place.slope(at, test.gauges, moves) / scale[:, None],
    )


class ErrorFields(NamedTuple):
    """Directions of the strains of some static tests, orthonormal in strain energy, one column each.

    Each has two errors: that at ``most``, the largest part that a test had of it, and how it changes as that
    part grows, `GROWTH` of an error for every factor of e. See `beyond` for parts larger than ``most``.
    """

    whitened: Float[np.ndarray, "whitened direction"]
    most: Float[np.ndarray, " direction"]

    @staticmethod
    def of(tests: Sequence[Loaded]) -> ErrorFields:
        """Error fields of all rest states of ``tests``, each counted equally, whatever its load."""
        strains = np.concatenate([test.strains() for test in tests]).T
        size = np.linalg.norm(strains, axis=0)
        left, s, _ = np.linalg.svd(strains / np.where(size > 0.0, size, 1.0), full_matrices=False)
        present = left[:, s > PRESENT * s.max(initial=0.0)]
        return ErrorFields(present, np.abs(present.T @ strains).max(axis=1, initial=0.0))

    @staticmethod
    def none(at: Loaded) -> ErrorFields:
        """Error fields of no test, for an article at rest as in ``at``."""
        return ErrorFields(np.zeros((at.strains().shape[1], 0)), np.zeros(0))

    def part(self, at: Loaded) -> float:
        """Part of the load's strain energy with the strains of the tests."""
        change = np.array([sign for sign, _ in at.states()]) @ at.strains()
        own = self.whitened.T @ change
        return float(own @ own / (change @ change or 1.0))

    def slope(
        self, at: Loaded, gauges: Sequence[Gauge], moves: OncePerState | None = None
    ) -> tuple[Float[np.ndarray, "gauge error"], Float[np.ndarray, " gauge"]]:
        """Readings by each error, all at ``most`` first, and by all errors without a direction.

        ``moves`` knows how states that several tests share move with the errors.
        """
        out, moves = np.zeros((len(gauges), 2 * len(self.most) + 1)), moves or OncePerState()
        for sign, rest in at.states():
            motion = moves.motion(rest, lambda rest=rest: self._motion(rest))
            out += sign * slopes(rest, motion, gauges)
        return out[:, :-1], out[:, -1]

    def beyond(self, at: Loaded, gauges: Sequence[Gauge]) -> Float[np.ndarray, "gauge direction"]:
        """Readings by a change of each error that begins at ``most``, where the tests end.

        The way in which an error changes within the tests need not go on beyond them: members that stiffen
        change their error by more and more for every factor of e, so that it is counted in parts of ``most``;
        at most anew as a whole, as of strains that no test had.
        """
        out = np.zeros((len(gauges), len(self.most)))
        for sign, rest in at.states():
            size = self.whitened.T @ _whitened(rest)
            growth = np.clip(GROWTH * (np.abs(size) / self.most - 1.0), 0.0, 1.0)
            if np.any(growth):
                further = yield_further(rest, _strains_of(rest, self.whitened * (size * growth)))
                out += sign * slopes(rest, further, gauges)
        return out

    def _motion(self, rest: Equilibrium) -> RestMotion:
        own = _whitened(rest)
        size = self.whitened.T @ own
        part = self.whitened * size
        growth = GROWTH * np.log(np.maximum(np.abs(size), ROUNDING * self.most) / self.most)
        parts = np.column_stack([part, part * growth, own - part.sum(axis=1)])
        return yield_further(rest, _strains_of(rest, parts))


def _roots(stiffness: np.ndarray, power: float) -> np.ndarray:
    """The symmetric square roots of D, or of its inverse; a strain without stiffness counts in neither."""
    value, turn = np.linalg.eigh(stiffness)
    stiff = value > STIFF * value[:, -1:]
    root = np.where(stiff, np.where(stiff, value, 1.0) ** power, 0.0)
    return (turn * root[:, None, :]) @ np.swapaxes(turn, 1, 2)


def _whitened(rest: Equilibrium) -> np.ndarray:
    strain, stiffness = member_strains(rest.model, rest.config)
    return np.einsum("eij,ej->ei", _roots(stiffness, 0.5), strain).ravel()


def _strains_of(rest: Equilibrium, whitened: np.ndarray) -> np.ndarray:
    """The strains (element, 6, field) that are ``whitened`` (whitened, field)."""
    _, stiffness = member_strains(rest.model, rest.config)
    return _roots(stiffness, -0.5) @ whitened.reshape(len(stiffness), 6, -1)
