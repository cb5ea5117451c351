"""Gauges and their readings in documents: the unit of a reading is the ending of its key."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from middeck.files.articles.boundary_form import ORIGIN
from middeck.files.articles.name_checks import given_twice
from middeck.files.refinements.loading_form import LoadingForm, case_of, loaded_twice, own_loads
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.form import Finite, Form, Positive, Vector
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import tables
from middeck.structure.model.environment import Environment
from middeck.updating.residuals.gauges import Gauge, GaugeKind
from middeck.updating.residuals.static_tests import StaticTest

# Endings of the keys of each kind, and their units over those of a `Gauge`.
ENDING = {"shift": "m", "tilt": "deg", "force": "n", "moment": "nm"}
UNIT = {"m": 1.0, "deg": np.pi / 180.0, "n": 1.0, "nm": 1.0}
# What a reading states of its kind: of a test, and of one that may be made.
VALUED, PLANNED = ("value", "std"), ("std",)
# Words for load cases that nothing reads, and for gauges that nothing loads.
NOTHING, ONE_OF_EACH = "nothing is promised", "[[load_case]] and [[gauge]], one of each at least, or modes"


class GaugeForm(Form):
    """A gauge of the displacement of a point, the tilt of a line, or the force or moment of a support."""

    name: str
    at: str
    kind: Literal["shift", "tilt", "force", "moment"] = "shift"
    direction: Vector = ORIGIN
    point_m: Vector = ORIGIN
    line: Vector = ORIGIN
    std_m: Positive | None = None
    std_deg: Positive | None = None
    std_n: Positive | None = None
    std_nm: Positive | None = None


class ReadingForm(GaugeForm):
    """A gauge and its reading."""

    value_m: Finite | None = None
    value_deg: Finite | None = None
    value_n: Finite | None = None
    value_nm: Finite | None = None


class _LoadedForm(LoadingForm):
    """Reference of readings under loads."""

    environment: str = "lab"
    since: Literal["unloaded", "drawn"] = "unloaded"
    series: str = ""
    set: dict[str, Finite] = Field(default_factory=dict)


class StaticForm(_LoadedForm):
    """A static test: loads, and what its gauges read."""

    reading: Annotated[tuple[ReadingForm, ...], Field(strict=False, min_length=1)]


class PlannedStaticForm(_LoadedForm):
    """A static test that may be made: as `StaticForm`, its gauges without values."""

    reading: Annotated[tuple[GaugeForm, ...], Field(strict=False, min_length=1)]


def build_gauge(form: GaugeForm) -> Gauge:
    """The gauge that a form describes; without a deviation it reads exactly."""
    std = getattr(form, f"std_{ENDING[form.kind]}")
    return Gauge(
        name=form.name,
        at=form.at,
        kind=GaugeKind(form.kind),
        direction=np.array(form.direction),
        point=np.array(form.point_m),
        line=np.array(form.line),
        std=UNIT[ENDING[form.kind]] * (std or 0.0),
    )


def value_of(form: ReadingForm) -> float:
    """The reading of a gauge, in the unit of its kind."""
    ending = ENDING[form.kind]
    return UNIT[ending] * getattr(form, f"value_{ending}")


def build_static(
    form: StaticForm | PlannedStaticForm, environment: Environment, value: Sequence[float] | np.ndarray
) -> StaticTest:
    """The static test that a form describes, whose gauges read ``value``, each in the unit of its kind."""
    return StaticTest(
        name=form.name,
        environment=environment,
        gauges=tuple(build_gauge(r) for r in form.reading),
        value=np.array(value),
        load_case=case_of(form),
        since_unloaded=form.since == "unloaded",
        series=form.series,
        settings=tuple(form.set.items()),
    )


def static_findings(data: Any, stated: tuple[str, ...] = VALUED) -> list[PathFault]:
    """Faults beyond the forms of static tests: keys of another unit, missing values, loads given twice.

    ``stated``: Required keys of a reading: `VALUED`, or `PLANNED` for tests that may be made.
    """
    return [f for i, test in tables(data, "static") for f in _of_test(("static", i), test, stated)]


def _of_test(path: Path, test: dict[str, Any], stated: tuple[str, ...]) -> Iterator[PathFault]:
    own = own_loads(test)
    yield from loaded_twice(path, test)
    if test.get("since", "unloaded") == "unloaded" and not own and "load_case" not in test:
        yield finding(path, "a change since unloaded, of no load", hint='a load, or since = "drawn"')
    for k, reading in tables(test, "reading"):
        yield from _of_reading((*path, "reading", k), reading, stated)


def _of_reading(path: Path, reading: dict[str, Any], stated: tuple[str, ...]) -> Iterator[PathFault]:
    kind = str(reading.get("kind", "shift"))  # what is no text, the form has refused
    if kind not in ENDING:
        return
    yield from _of_another_kind(path, reading, kind, stated)
    for wanted in (f"{what}_{ENDING[kind]}" for what in stated):
        if wanted not in reading:
            yield finding(path, f"a {kind} without {wanted}", hint=f"{wanted} = 0.001")


def _of_another_kind(
    path: Path, reading: dict[str, Any], kind: str, stated: tuple[str, ...]
) -> Iterator[PathFault]:
    for what in stated:
        wanted = f"{what}_{ENDING[kind]}"
        for other in (f"{what}_{ending}" for ending in UNIT):
            if other != wanted and other in reading:
                yield finding((*path, other), f"of a {kind}", hint=f"{wanted}")


def promised_findings(data: Any) -> list[PathFault]:
    """Faults of promised loads beyond their forms.

    A deviation in the unit of another kind, a name given twice, by which no outcome could be compared, and
    gauges without load cases, and load cases without gauges or without loads.
    """
    return list(_of_promise(data))


def _of_promise(data: Any) -> Iterator[PathFault]:
    for table in ("load_case", "gauge"):
        named = [((table, i, "name"), one.get("name")) for i, one in tables(data, table)]
        yield from given_twice(named, table.replace("_", " "))
    for i, gauge in tables(data, "gauge"):
        kind = str(gauge.get("kind", "shift"))
        if kind in ENDING:
            yield from _of_another_kind(("gauge", i), gauge, kind, PLANNED)
    if data.get("since", "unloaded") == "unloaded":
        for i, case in tables(data, "load_case"):
            if not any(case[key] for key in own_loads(case)):
                hint = 'a load, or since = "drawn"'
                yield finding(("load_case", i), "a change since unloaded, of no load", hint=hint)
    if bool(data.get("load_case")) != bool(data.get("gauge")):
        yield finding((), NOTHING, hint=ONE_OF_EACH)
