"""Form of a promise's document: an intact seal shows that it was not changed, not that it is complete."""

from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.form import Finite, Form, NotNegative, Positive, rule, within
from middeck.structure.correlation.measured_modes import DIRECTIONS

PROMISE = "middeck.promise/1"
# Levels that statements are made of.
STATED = (0.025, 0.5, 0.975, 0.99)
Share = Annotated[float, within(least=0.0, most=1.0)]
# A reading over the largest one of its mode.
Reading = Annotated[float, within(least=-1.0, most=1.0)]
RISES = rule(lambda ends: ends[0] <= ends[1], "must rise")


class SealedTable(Form):
    """A table whose keys in use are checked: later documents may have more."""

    model_config = ConfigDict(extra="ignore")


class SealedMode(SealedTable):
    """A mode."""

    name: str
    frequency_hz: Positive
    interval_95_hz: Annotated[tuple[Positive, Positive], Field(strict=False), RISES]
    damping: NotNegative
    seen: Share


class SealedShapes(SealedTable):
    """Shapes of the modes of an environment, a row a channel."""

    node: Annotated[tuple[str, ...], Field(strict=False)]
    direction: Annotated[tuple[Literal[DIRECTIONS], ...], Field(strict=False)]  # ty: ignore[invalid-type-form]
    shape: Annotated[tuple[Annotated[tuple[Reading, ...], Field(strict=False)], ...], Field(strict=False)]


class SealedReading(SealedTable):
    """A promised gauge reading."""

    gauge: str
    unit: str
    value: Finite
    interval_95: Annotated[tuple[Finite, Finite], Field(strict=False), RISES]


class SealedCase(SealedTable):
    """A load case."""

    name: str
    readings: Annotated[tuple[SealedReading, ...], Field(strict=False)]


class SealedLoop(SealedTable):
    """A compensator; levels are null where it is unstable."""

    name: str
    probability_stable: Share
    db: Annotated[tuple[Finite | None, ...], Field(strict=False)]
    without_friction_db: Annotated[tuple[Finite | None, ...], Field(strict=False)] | None = None


class SealedPlace(SealedTable):
    """An environment."""

    name: str
    modes: Annotated[tuple[SealedMode, ...], Field(strict=False)]
    shapes: SealedShapes | None = None
    load_cases: Annotated[tuple[SealedCase, ...], Field(strict=False)] = ()
    compensators: Annotated[tuple[SealedLoop, ...], Field(strict=False)] = ()


class SealedFile(SealedTable):
    """A file that the promise stands on, or that of the plants that were drawn."""

    name: str
    sha256: str


class SealedForm(SealedTable):
    """A promise."""

    schema_: Literal["middeck.promise/1"] = Field(alias="schema")
    date: str
    files: Annotated[tuple[SealedFile, ...], Field(strict=False)] = ()
    shares: Annotated[tuple[Share, ...], Field(strict=False)] = ()
    plants: SealedFile | None = None
    environments: Annotated[tuple[SealedPlace, ...], Field(strict=False, min_length=1)]


def further_findings(form: SealedForm) -> Iterator[PathFault]:
    """Faults between several keys."""
    yield from _each_once(("environments",), [place.name for place in form.environments])
    for k, place in enumerate(form.environments):
        at = ("environments", k)
        yield from _of_loops(form, place, at)
        if place.shapes is not None:
            yield from _of_shapes(place.shapes, len(place.modes), (*at, "shapes"))


def _of_loops(form: SealedForm, place: SealedPlace, at: tuple[str | int, ...]) -> Iterator[PathFault]:
    if place.compensators and not set(STATED) <= set(form.shares):
        yield finding(("shares",), f"must hold {', '.join(map(str, STATED))}", list(form.shares))
    yield from _each_once((*at, "compensators"), [loop.name for loop in place.compensators])
    for c, loop in enumerate(place.compensators):
        for key, levels in (("db", loop.db), ("without_friction_db", loop.without_friction_db)):
            if levels is None:
                continue
            worse = [float("inf") if db is None else db for db in levels]
            if len(levels) != len(form.shares):
                message = f"has {len(levels)} levels for {len(form.shares)} shares"
                yield finding((*at, "compensators", c, key), message)
            elif worse != sorted(worse):
                yield finding((*at, "compensators", c, key), "must rise, null last", list(levels))


def _of_shapes(shapes: SealedShapes, modes: int, at: tuple[str | int, ...]) -> Iterator[PathFault]:
    if not len(shapes.node) == len(shapes.direction) == len(shapes.shape):
        message = f"{len(shapes.node)} nodes, {len(shapes.direction)} directions and {len(shapes.shape)} rows"
        yield finding(at, message)
    wide = [k for k, row in enumerate(shapes.shape) if len(row) != modes]
    if wide:
        yield finding((*at, "shape", wide[0]), f"has {len(shapes.shape[wide[0]])} numbers for {modes} modes")
    channels = [f"{n} {d}" for n, d in zip(shapes.node, shapes.direction, strict=False)]
    yield from _each_once((*at, "node"), channels)


def _each_once(at: tuple[str | int, ...], names: list[str]) -> Iterator[PathFault]:
    for name, count in Counter(names).items():
        if count > 1:
            yield finding(at, f"{name!r} stands there {count} times")
