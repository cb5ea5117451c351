"""Read articles, environments and studies; every configuration error of all of them at once."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Generic, Literal, NoReturn, TypeVar, cast

from pydantic import ValidationError

from middeck.errors import ConfigError
from middeck.files import looks
from middeck.files.article_build import build_structure
from middeck.files.article_checks import article_findings
from middeck.files.article_form import ArticleForm
from middeck.files.article_names import attach_names, hanging_names, node_names, wheel_names
from middeck.files.environment_checks import environment_findings
from middeck.files.environment_form import EnvironmentForm, build_environment, joint_findings
from middeck.files.faults import Fault, Finding, finding, form_findings, nearest, raise_fault, raise_faults
from middeck.files.form import Form
from middeck.files.overrides import Target, apply_overrides
from middeck.files.toml_lines import Path as KeyPath
from middeck.files.toml_lines import key_lines, line_of
from middeck.files.toml_trouble import explain
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.sensitivity.parameters import scale_parameters
from middeck.values import record

F = TypeVar("F", bound=Form)
Kind = Literal["article", "environment", "study"]
# What ``--environment orbit`` means far from any environments/: it is the same everywhere.
BUILT_IN = {name: Path(__file__).with_name(f"{name}.toml") for name in ("orbit", "lab")}
DOCUMENTS = (looks.ARTICLE, looks.ENVIRONMENT, looks.STUDY)
WANTED: dict[Kind, str] = dict(zip(("article", "environment", "study"), DOCUMENTS, strict=True))
FOLDERS: dict[Kind, str] = {"article": "articles", "environment": "environments", "study": "studies"}


@record
class Source:
    """A parsed document: its tables and where their keys stand, which nobody asks of a valid one."""

    file: str
    data: Any
    lines: Callable[[], dict[KeyPath, int]]


@record(kw_only=True)
class Checked(Generic[F]):
    """A document after its checks: its file, the form (None if it is broken), its data and its faults."""

    file: str
    form: F | None
    data: Any
    faults: tuple[Fault, ...]
    place: Callable[[Finding], Fault]


def read_source(path: str | Path, wanted: str = looks.CHANNELS) -> Source:
    """Parse a TOML file.

    Raises `ConfigError` if it is missing, empty, not UTF-8, not TOML, or looks like another than ``wanted``,
    a kind of `looks`.
    """
    file = str(path)
    try:
        raw = Path(path).read_bytes()
    except IsADirectoryError:
        _refuse(file, "is a folder, not a file", f"one of the files in {file}")
    except OSError as error:
        _refuse(file, f"cannot be read: {error.strerror}", "check the path")
    passing = (looks.EMPTY, looks.TOML, looks.TEXT, looks.NOT_UTF8)
    strange = looks.stray(path, wanted, (*passing, *(DOCUMENTS if wanted == looks.CHANNELS else ())))
    if strange:
        _refuse(file, strange, f"{wanted} in this place")
    try:
        text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        _refuse(file, "not UTF-8 text", "save the file as UTF-8", line=line)
    if "BEGIN BULK" in text.upper():
        _refuse(file, "a Nastran deck", f"middeck convert {file} makes an article of it", line=1)
    if not text.strip():
        _refuse(file, "the file is empty", f"{wanted} in this place", line=1)
    try:
        return Source(file, tomllib.loads(text), cache(partial(key_lines, text)))
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+)", str(error))
        line = int(found.group(1)) if found else text.rstrip().count("\n") + 1
        line, what, cure = explain(text, line, str(error))
        _refuse(file, f"not valid TOML: {what}", cure, line=line)


def _refuse(file: str, message: str, hint: str, *, line: int = 0) -> NoReturn:
    raise_fault(Fault(file=file, line=line, key="", message=message, hint=hint))


def read_sources(paths: Sequence[str | Path], kinds: Sequence[Kind]) -> list[Source]:
    """`read_source` of each path; the errors of all are raised together."""
    sources: list[Source] = []
    faults: list[Fault] = []
    for path, kind in zip(paths, kinds, strict=True):
        try:
            sources.append(read_source(path, WANTED[kind]))
        except ConfigError as error:
            faults += error.data["faults"]
    raise_faults(list(dict.fromkeys(faults)))
    return sources


def sha256_of(path: str | Path) -> str:
    """SHA-256 of a file's bytes, for provenance."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def place_in(source: Source, changed: Mapping[KeyPath, str], finding: Finding) -> Fault:
    """Where ``finding`` lies: at the override in ``changed`` that set the value, or in the file."""
    file, line = source.file, line_of(source.lines(), finding.path)
    for end in range(1, len(finding.path) + 1):
        if setter := changed.get(finding.path[:end]):
            file, line = f"--set {setter}", 0
    key, value = ".".join(map(str, finding.path)), finding.value
    return Fault(file=file, line=line, key=key, message=finding.message, value=value, hint=finding.hint)


def check(
    source: Source,
    data: Any,
    changed: dict[KeyPath, str],
    form: type[F],
    more: Callable[[Any], list[Finding]],
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


def load_structure(path: str | Path, overrides: Sequence[str] = ()) -> Structure:
    """The article in file ``path``; raises `ConfigError` with all its faults."""
    source = read_source(path, looks.ARTICLE)
    article = _check_all([(source, ArticleForm, article_findings)], overrides)[0]
    return build_article(article)


def load_environment(path: str | Path, overrides: Sequence[str] = ()) -> Environment:
    """The environment in file ``path``, or "orbit"; raises `ConfigError` with all its faults.

    "lab" hangs on the attach points of an article: see `load_setup`.
    """
    source = read_source(_environment_file(path), looks.ENVIRONMENT)
    checked = _check_all([(source, EnvironmentForm, environment_findings)], overrides)[0]
    return _environment(checked)


def load_setup(
    article: str | Path, environment: str | Path, overrides: Sequence[str] = ()
) -> tuple[Structure, Environment]:
    """An article and an environment, joined by the names of attach points.

    ``environment`` is a file, or "orbit" or "lab", which need none: in "lab" the article hangs along x on a
    cable of 4 m at each attach point where no spring or bushing ends, at 0.25 Hz. Raises `ConfigError` with
    all faults of both, among them names that the article lacks.
    """
    first, second = _check_case(article, environment, overrides)
    return build_article(first), _environment(second, hanging_names(first.data))


def load_offset_keys(
    article: str | Path, environment: str | Path, overrides: Sequence[str] = ()
) -> dict[str, str]:
    """Attach point = the key of its offset in the article's file, which an override may set.

    Raises `ConfigError` as `load_setup` does.
    """
    form = cast("ArticleForm", _check_case(article, environment, overrides)[0].form)
    nodes = () if form.suspension is None else form.suspension.nodes
    hung = {name: f"suspension.offsets_m.{i}" for i, name in enumerate(nodes)}
    return hung | {point.name: f"attach.{point.name}.offset_m" for point in form.attach}


def _check_case(article: str | Path, environment: str | Path, overrides: Sequence[str]) -> list[Checked[Any]]:
    """The article, then the environment."""
    around = _environment_file(environment)
    if (looks.looks_like(article), looks.looks_like(around)) == (looks.ENVIRONMENT, looks.ARTICLE):
        _refuse(f"{article}, {around}", "environment and article are swapped", "the article first")
    body, surroundings = read_sources([article, around], ["article", "environment"])
    return _check_all(
        [(body, ArticleForm, article_findings), (surroundings, EnvironmentForm, environment_findings)],
        overrides,
    )


def _environment_file(given: str | Path) -> str | Path:
    """The path as given; the file of a built-in environment of this name, unless a file has the name."""
    return given if Path(given).is_file() else BUILT_IN.get(str(given), given)


def build_article(checked: Checked[Any]) -> Structure:
    """The structure of a checked article with its ``[factors]``; `ConfigError` for one of no number."""
    form = cast("ArticleForm", checked.form)
    built = build_structure(form, Path(checked.file).parent)
    faults = []
    for name, factor in form.factors.items():
        try:
            built = scale_parameters(built, {name: factor})
        except ConfigError as error:
            faults.append(checked.place(finding(("factors", name), error.what, hint=error.hint)))
    raise_faults(faults)
    return built


def _environment(checked: Checked[Any], attach: Sequence[str] = ()) -> Environment:
    return build_environment(cast("EnvironmentForm", checked.form), attach)


def _check_all(
    sources: Sequence[tuple[Source, type[Form], Any]], overrides: Sequence[str]
) -> list[Checked[Any]]:
    """Override and check documents that belong to one case; raises all their faults together."""
    article = next((str(s.data.get("name")) for s, form, _ in sources if form is ArticleForm), "")
    targets = [Target(s.file, s.data, form, article) for s, form, _ in sources]
    documents, changed = apply_overrides(targets, overrides)
    checked = [
        check(source, data, marks, form, more)
        for (source, form, more), data, marks in zip(sources, documents, changed, strict=True)
    ]
    faults = [*(f for c in checked for f in c.faults), *join_findings(checked)]
    raise_faults(list(dict.fromkeys(faults)))  # an override of two documents may be wrong in both
    return checked


def join_findings(checked: Sequence[Checked[Any]]) -> list[Fault]:
    """Faults where environments name what the article among ``checked`` lacks."""
    articles = [c for c in checked if isinstance(c.form, ArticleForm)]
    if not articles:
        return []
    data = articles[0].data
    return [
        c.place(finding)
        for c in checked
        if isinstance(c.form, EnvironmentForm)
        for finding in joint_findings(
            c.form, attach_names(data), node_names(data), wheel_names(data), data["name"]
        )
    ]


def find_document(name: str, kind: Kind, beside: str | Path | None = None) -> Path:
    """The file that ``name`` means: an existing path, else ``articles/NAME.toml`` and the like.

    The folder is sought in the current folder, then next to the folder of the file ``beside``, so that an
    article's environments are found from anywhere; so is a file of this name beside that file. The
    environments ``orbit`` and ``lab`` need no file. Raises `ConfigError` with the nearest name there is.
    """
    given = Path(name)
    if not name:
        raise ConfigError(f"no name of {WANTED[kind]}: the text is empty", hint="a path, or a name")
    if given.is_file():
        return given
    if given.is_dir():
        raise ConfigError(f"{name} is a folder, not {WANTED[kind]}", hint=f"the path of {WANTED[kind]} file")
    own = [] if beside is None else [Path(beside).resolve().parent]
    folders = [*(root / FOLDERS[kind] for root in (Path(), *(folder.parent for folder in own))), *own]
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    if kind == "environment" and name in BUILT_IN:
        return BUILT_IN[name]
    built_in = BUILT_IN if kind == "environment" else ()
    files = [p for folder in folders for p in folder.glob("*.toml")]
    known = sorted({*built_in, *(p.stem for p in files if looks.looks_like(p) == WANTED[kind])})
    advice = nearest(name, known) or f"give the path of {WANTED[kind]} file"
    raise ConfigError(f"no {kind} {name!r}", hint=advice)
