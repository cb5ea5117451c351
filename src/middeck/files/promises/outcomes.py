"""Outcomes of a promise, and the sealed document that compares both."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from middeck.errors import DataError
from middeck.files.disk.digest import sha256_of
from middeck.files.disk.kind_of_content import OUTCOME
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.measured.modes import load_measured_modes
from middeck.files.promises.promise_documents import few, versions
from middeck.files.toml.faults import PathFault, finding, raise_faults
from middeck.files.toml.form import Finite, Form, Positive
from middeck.files.toml.source import check, read_source, sound
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.updating.promise.outcome_pairs import (
    MeasuredMode,
    PairedMode,
    PromisedModes,
    pair_by_shape,
    pair_by_words,
    remarks_on,
)
from middeck.updating.promise.score import Scored, Statement, Verdict, judge, score
from middeck.values import record

COMPARISON = "middeck.comparison/1"


class ModeOutcomeForm(Form):
    """The outcome of a mode."""

    environment: str
    name: str | None = None
    number: Annotated[int, Field(ge=1)] | None = None
    frequency_hz: Positive


class SurveyOutcomeForm(Form):
    """Modes as a test measured them, with their shapes."""

    environment: str
    modes: str


class LoopOutcomeForm(Form):
    """The outcome of a compensator."""

    environment: str
    name: str
    stable: bool
    rms_db: Finite | None = None


class ReadingOutcomeForm(Form):
    """The outcome of a gauge, in the unit of the promise: degrees for angles, else SI."""

    environment: str
    load_case: str
    gauge: str
    value: Finite


class OutcomeForm(Form):
    """The outcome of a promise."""

    schema_: Literal["middeck.outcome/1"] = Field(alias="schema")
    mode: Annotated[tuple[ModeOutcomeForm, ...], Field(strict=False)] = ()
    survey: Annotated[tuple[SurveyOutcomeForm, ...], Field(strict=False)] = ()
    compensator: Annotated[tuple[LoopOutcomeForm, ...], Field(strict=False)] = ()
    reading: Annotated[tuple[ReadingOutcomeForm, ...], Field(strict=False)] = ()


@record(kw_only=True)
class Came:
    """The outcome as a document states it.

    Attributes:
        modes, surveys: Modes without shapes, and environment and modes of each survey with them.
        outcomes: Compensators and readings.
        files: Every file that was read.
    """

    modes: tuple[MeasuredMode, ...]
    surveys: tuple[tuple[str, MeasuredModes], ...]
    outcomes: tuple[Scored, ...]
    files: tuple[Path, ...]


def load_outcomes(path: str | Path) -> Came:
    """Outcomes in file ``path``; surveys are sought beside it.

    Raises `ConfigError` with all faults of the document, `DataError` for a stable loop without decibels and
    for a survey that cannot be read.
    """
    source = read_source(path, OUTCOME)
    checked = check(source, source.data, {}, OutcomeForm)
    form = sound(checked)
    raise_faults([checked.place(fault) for fault in _nameless(form)])
    for loop in form.compensator:
        if loop.stable == (loop.rms_db is None):
            what = "stable, without its rms_db" if loop.stable else "unstable, with rms_db"
            raise DataError(f"{loop.name} is {what}", where=str(path), hint="rms_db of stable loops alone")
    files = [Path(path).parent / survey.modes for survey in form.survey]
    surveys = [load_measured_modes(file) for file in files]
    return Came(
        modes=tuple(MeasuredMode(**mode.model_dump()) for mode in form.mode),
        surveys=tuple((s.environment, measured) for s, measured in zip(form.survey, surveys, strict=True)),
        outcomes=(
            *(
                Scored(kind="reading", name=name_of(r.environment, r.load_case, r.gauge), value=r.value)
                for r in form.reading
            ),
            *(
                Scored(
                    kind="compensator", name=name_of(c.environment, c.name), value=c.rms_db, stable=c.stable
                )
                for c in form.compensator
            ),
        ),
        files=(Path(path), *dict.fromkeys(files)),
    )


def _nameless(form: OutcomeForm) -> list[PathFault]:
    return [
        finding(("mode", k), "has neither name nor number", hint="its name, as the promise has it")
        for k, mode in enumerate(form.mode)
        if mode.name is None and mode.number is None
    ]


def comparison_document(
    promise: Mapping[str, Any], came: Came, *, date: str, beside: Path | None = None
) -> dict[str, Any]:
    """The outcome beside ``promise``, which it names by its seal and does not change.

    ``remarks`` name files in folder ``beside`` that are no longer what the promise was made of.

    Modes are paired by shape where a survey came, else by name or number; ``remarks`` say which pairs are
    open. Raises `DataError` for an outcome of which nothing was promised.
    """
    statements = statements_of(promise)
    paired, remarks = _pair(promised_modes_of(promise), came)
    named = [(name_of_mode(p.environment, p.index + 1), p) for p in paired]
    outcomes = (*(Scored(kind="mode", name=name, value=p.frequency_hz) for name, p in named), *came.outcomes)
    verdicts = judge(statements, outcomes)
    each = {(s.kind, s.name): s for s in statements}
    first, *others = ({"name": file.name, "sha256": sha256_of(file)} for file in came.files)
    return seal(
        {
            "schema": COMPARISON,
            "promise": promise[SEAL],
            "promised_on": promise["date"],
            "date": date,
            "versions": versions(),
            "outcome": first,
            "surveys": others,
            "remarks": [*([] if beside is None else _changed(promise, beside)), *remarks],
            "verdicts": [
                _row(v, each[v.kind, v.name], o) | (_pairing(dict(named)[v.name]) if v.kind == "mode" else {})
                for v, o in zip(verdicts, outcomes, strict=True)
            ],
            "score": score(verdicts),
        }
    )


def _changed(promise: Mapping[str, Any], folder: Path) -> Iterator[str]:
    digests: dict[str, set[str]] = {}  # files of several folders may share a name
    for file in promise.get("files", ()):
        digests.setdefault(Path(file["name"]).name, set()).add(file["sha256"])
    for name, known in digests.items():
        path = folder / name
        if path.is_file() and sha256_of(path) not in known:
            yield (
                f"{path.name} beside the promise is not the file that it was made of (another sha256): "
                "made again from it, the promise would be another one"
            )


def statements_of(promise: Mapping[str, Any]) -> tuple[Statement, ...]:
    """The statements of a promise, quantity by quantity."""
    at = {share: k for k, share in enumerate(promise.get("shares", ()))}

    def reached(value: float | None) -> float:
        return np.inf if value is None else float(value)

    found: list[Statement] = []
    for place in promise["environments"]:
        for number, mode in enumerate(place["modes"], start=1):
            low, high = mode["interval_95_hz"]
            name = name_of_mode(place["name"], number)
            found.append(Statement(kind="mode", name=name, low=low, high=high))
        for case in place.get("load_cases", ()):
            for reading in case["readings"]:
                low, high = reading["interval_95"]
                name = name_of(place["name"], case["name"], reading["gauge"])
                found.append(Statement(kind="reading", name=name, low=low, high=high))
        for loop in place.get("compensators", ()):
            db = loop["db"]
            found.append(
                Statement(
                    kind="compensator",
                    name=name_of(place["name"], loop["name"]),
                    low=reached(db[at[0.025]]),
                    high=reached(db[at[0.975]]),
                    probability=loop["probability_stable"],
                    cautious=reached(db[at[0.99]]),
                )
            )
    return tuple(found)


def promised_modes_of(promise: Mapping[str, Any]) -> dict[str, PromisedModes]:
    """Modes of a promise by environment; documents older than shapes have none."""
    found: dict[str, PromisedModes] = {}
    for place in promise["environments"]:
        modes, shapes = place["modes"], place.get("shapes")
        with_shapes: dict[str, Any] = {}
        if shapes is not None:
            shape = np.array(shapes["shape"], dtype=float).reshape(len(shapes["node"]), len(modes))
            with_shapes = {
                "node": tuple(shapes["node"]), "direction": tuple(shapes["direction"]), "shape": shape
            }  # fmt: skip
        found[place["name"]] = PromisedModes(
            environment=place["name"],
            name=tuple(m["name"] for m in modes),
            frequency_hz=np.array([m["frequency_hz"] for m in modes], dtype=float),
            interval_hz=np.array([m["interval_95_hz"] for m in modes], dtype=float).reshape(-1, 2),
            **with_shapes,
        )
    return found


def name_of_mode(environment: str, number: int) -> str:
    """The name of a mode in verdicts, numbered from 1."""
    return name_of(environment, f"mode {number}")


def name_of(environment: str, *names: str) -> str:
    """The name in verdicts of a compensator, or of the reading of a load case's gauge."""
    return ": ".join([environment, *names])


def _pair(promised: Mapping[str, PromisedModes], came: Came) -> tuple[list[PairedMode], list[str]]:
    paired: list[PairedMode] = []
    remarks: list[str] = []
    for environment, measured in came.surveys:
        by_shape, by_survey = pair_by_shape(_place(promised, environment), measured)
        paired += by_shape
        remarks += [*by_survey, *remarks_on(promised[environment], by_shape)]
    for mode in came.modes:
        by_words = pair_by_words(_place(promised, mode.environment), mode)
        paired.append(by_words)
        remarks += remarks_on(promised[mode.environment], [by_words])
    return paired, remarks


def _place(promised: Mapping[str, PromisedModes], environment: str) -> PromisedModes:
    if environment not in promised:
        raise DataError(
            f"the promise has no environment {environment!r}",
            where="outcome",
            hint=f"one of {', '.join(promised)}",
        )
    return promised[environment]


def _row(verdict: Verdict, statement: Statement, came: Scored) -> dict[str, Any]:
    return {
        "kind": verdict.kind,
        "name": verdict.name,
        "promised": [few(statement.low), few(statement.high)],
        "probability_stable": statement.probability,
        "value": came.value,
        "stable": came.stable,
        "inside": verdict.inside,
        "brier": verdict.brier,
        "pessimism_db": None if verdict.pessimism is None else few(verdict.pessimism),
    }


def _pairing(paired: PairedMode) -> dict[str, Any]:
    return {
        "mode": paired.name,
        "paired_by": paired.by,
        "mac": None if paired.mac is None else few(paired.mac),
        "open": bool(paired.open),
    }
