"""Documents in TOML as read, and their checks: all errors of a document at once, each where it stands."""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Generic, Literal, NoReturn, TypeVar

from pydantic import ValidationError

from middeck.errors import ConfigError
from middeck.files.disk import kind_of_content
from middeck.files.toml.faults import DocumentFault, PathFault, form_findings, raise_fault, raise_faults
from middeck.files.toml.form import Form
from middeck.files.toml.lines import Path as KeyPath
from middeck.files.toml.lines import key_lines, line_of
from middeck.files.toml.syntax_faults import explain
from middeck.values import record

F = TypeVar("F", bound=Form)
Kind = Literal["article", "environment", "study"]
DOCUMENTS = (kind_of_content.ARTICLE, kind_of_content.ENVIRONMENT, kind_of_content.STUDY)
# Words for a fitted model in place of an article.
NO_GRAVITY_TO_TAKE = (
    "; gravity and suspension are in all modes of a measurement, and cannot be taken out of it"
)
WANTED: dict[Kind, str] = dict(zip(("article", "environment", "study"), DOCUMENTS, strict=True))


@record
class Source:
    """A parsed document: its tables and a function for the lines of their keys, called only for faults."""

    file: str
    data: Any
    lines: Callable[[], dict[KeyPath, int]]


@record(kw_only=True)
class Checked(Generic[F]):
    """A document after its checks: its file, the form (None if it is broken), its data and its faults."""

    file: str
    form: F | None
    data: Any
    faults: tuple[DocumentFault, ...]
    place: Callable[[PathFault], DocumentFault]


def read_source(path: str | Path, wanted: str = kind_of_content.CHANNELS) -> Source:
    """Parse a TOML file.

    Raises `ConfigError` if it is missing, empty, not UTF-8, not TOML, or looks like another than ``wanted``,
    a kind of `kind_of_content`.
    """
    file = str(path)
    try:
        raw = Path(path).read_bytes()
    except IsADirectoryError:
        refuse(file, "is a folder, not a file", f"one of the files in {file}")
    except OSError as error:
        refuse(file, f"cannot be read: {error.strerror}", "check the path")
    passing = (kind_of_content.EMPTY, kind_of_content.TOML, kind_of_content.TEXT, kind_of_content.NOT_UTF8)
    strange = kind_of_content.stray(
        path, wanted, (*passing, *(DOCUMENTS if wanted == kind_of_content.CHANNELS else ()))
    )
    if strange:
        fitted = (
            wanted == kind_of_content.ARTICLE and kind_of_content.looks_like(path) == kind_of_content.MODEL
        )
        refuse(file, strange, f"{wanted} in this place{NO_GRAVITY_TO_TAKE * fitted}")
    try:
        text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        refuse(file, "not UTF-8 text", "save the file as UTF-8", line=line)
    if "BEGIN BULK" in text.upper():
        refuse(file, "a Nastran deck", f"middeck convert {file} makes an article of it", line=1)
    if not text.strip():
        refuse(file, "the file is empty", f"{wanted} in this place", line=1)
    try:
        return Source(file, tomllib.loads(text), cache(partial(key_lines, text)))
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+)", str(error))
        line = int(found.group(1)) if found else text.rstrip().count("\n") + 1
        line, what, cure = explain(text, line, str(error))
        refuse(file, f"not valid TOML: {what}", cure, line=line)


def refuse(file: str, message: str, hint: str, *, line: int = 0) -> NoReturn:
    """Raise the one fault of a file as a `ConfigError`."""
    raise_fault(DocumentFault(file=file, line=line, key="", message=message, hint=hint))


def read_sources(paths: Sequence[str | Path], kinds: Sequence[Kind]) -> list[Source]:
    """`read_source` of each path; the errors of all are raised together."""
    sources: list[Source] = []
    faults: list[DocumentFault] = []
    for path, kind in zip(paths, kinds, strict=True):
        try:
            sources.append(read_source(path, WANTED[kind]))
        except ConfigError as error:
            faults += error.data["faults"]
    raise_faults(list(dict.fromkeys(faults)))
    return sources


def place_in(source: Source, changed: Mapping[KeyPath, str], finding: PathFault) -> DocumentFault:
    """Place of ``finding``: the override in ``changed`` that set the value, or the file."""
    file, line = source.file, line_of(source.lines(), finding.path)
    for end in range(1, len(finding.path) + 1):
        if setter := changed.get(finding.path[:end]):
            file, line = f"--set {setter}", 0
    key, value = ".".join(map(str, finding.path)), finding.value
    return DocumentFault(
        file=file, line=line, key=key, message=finding.message, value=value, hint=finding.hint
    )


def check(
    source: Source,
    data: Any,
    changed: dict[KeyPath, str],
    form: type[F],
    more: Callable[[Any], list[PathFault]] = lambda _: [],
) -> Checked[F]:
    """Check ``data`` (the source with overrides) against its form and its further rules."""

    place = partial(place_in, source, changed)
    findings, valid = [], None
    try:
        valid = form.model_validate(data)
    except ValidationError as error:
        findings = form_findings(error, form)
    findings = [*findings, *more(data)]
    first = {f.path: f for f in reversed(findings)}  # one finding per key; the form speaks first
    faults = sorted((place(f) for f in first.values()), key=lambda f: (f.file, f.line))
    return Checked(file=source.file, form=valid, data=data, faults=tuple(faults), place=place)


def sound(checked: Checked[F]) -> F:
    """The form of a document; raises one `ConfigError` with all its faults."""
    raise_faults(checked.faults)
    assert checked.form is not None  # a form is broken by faults alone
    return checked.form


def read_form(
    path: str | Path, wanted: str, form: type[F], more: Callable[[Any], list[PathFault]] = lambda _: []
) -> F:
    """The document in a TOML file of its own; raises `ConfigError` with all its faults."""
    source = read_source(path, wanted)
    return sound(check(source, source.data, {}, form, more))
