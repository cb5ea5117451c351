"""``--set key=value``: overrides of any input value, by the data sheet's name, in whatever file it stands.

A segment of the key fits a key of a file exactly or by the data sheet's name for it (``node.0.mass`` for
``mass_kg``, but ``suspension.bounce_hz``: see `sheet_name`); an item of an array is named by its index or its
``name``. A leading ``article.<name>.`` confines the override to the cases of that article. An override goes
to every document in which its path exists, otherwise to each whose form allows the key there. A table that
every document leaves out is made where the key, or those set with it, are all that it needs
(``constants.gravity``, in orbit). Otherwise (a suspension's bounce) the key is known and has no effect, with
a warning; a key that no form knows is an error.
"""

import copy
import re
import tomllib
import warnings
from collections.abc import Sequence
from enum import Enum
from typing import Any, cast, get_args, get_origin

from middeck.files.toml.faults import DocumentFault, nearest, raise_fault, raise_faults
from middeck.files.toml.form import Form, bare, child, is_form, keys_of, sheet_name
from middeck.files.toml.lines import Path
from middeck.files.toml.plain_number import as_number
from middeck.values import record

# Words and paths; what begins like a number must be one.
BARE = r"(?:[^\W\d]|\.{0,2}/)[\w./ -]*"


@record
class Override:
    """One ``key=value``, the value parsed as TOML; ``article`` is empty if not confined."""

    text: str
    segments: tuple[str, ...]
    value: Any
    article: str = ""


class KeyState(Enum):
    """The part of a document at the path of an override."""

    UNKNOWN = 0  # its form has no such key
    ABSENT = 1  # its form has the key, in a table that the document leaves out
    SETTABLE = 2  # the table is there, the key could be
    PRESENT = 3  # the value is there


def parse_override(text: str) -> Override:
    """Parse ``key=value``; a bare word or path is a text.

    >>> parse_override("node.0.mass=3.1").value, parse_override("wheel_node=n3").value
    (3.1, 'n3')
    """
    key, equals, written = text.partition("=")
    segments = tuple(s.strip() for s in key.strip().split("."))
    written = written.strip()
    if not equals or not all(segments) or not written:
        raise_fault(_fault(text, "not of the form key=value", "--set suspension.bounce_hz=0.2"))
    value = _parse_value(key, written)
    if len(segments) > 2 and segments[0] == "article":
        return Override(text, segments[2:], value, segments[1])
    return Override(text, segments, value)


def _parse_value(key: str, written: str) -> Any:
    """``written`` as TOML; decimals such as ``.2``, bare words and bare paths are understood too."""
    if re.fullmatch(r"[+-]?(\.\d+|\d+\.)(e[+-]?\d+)?", written, re.IGNORECASE):
        return float(written)
    try:
        parsed = tomllib.loads(f"value = {written}")
    except tomllib.TOMLDecodeError:
        parsed = {"value": written} if re.fullmatch(BARE, written) else {}
    if set(parsed) != {"value"}:
        advice = "numbers as 0.25, texts in quotes, arrays as [1.0, 2.0]"
        if number := as_number(written):
            advice = f"a decimal point: {key}={number}"
        raise_fault(_fault(key, f"the value {written!r} is not TOML", advice))
    return parsed["value"]


def _fault(key: str, message: str, hint: str) -> DocumentFault:
    return DocumentFault(file="--set", line=0, key=key, message=message, hint=hint)


def reach(data: Any, annotation: Any, segments: Sequence[str]) -> tuple[KeyState, Path]:
    """State of the key at ``segments`` in ``data``, a document of form ``annotation``, and its path."""
    path: list[str | int] = []
    for depth, segment in enumerate(segments):
        annotation = bare(annotation)
        if is_form(annotation) and not isinstance(data, dict):  # a table that another override has replaced
            return KeyState.UNKNOWN, tuple(path)
        last = depth == len(segments) - 1
        key = _match(segment, data, annotation)
        if key is None:
            return KeyState.UNKNOWN, tuple(path)
        annotation = child(annotation, key)
        path.append(key)
        if _has(data, key):
            data = data[key]
        elif last:
            return KeyState.SETTABLE, tuple(path)
        else:
            return _reach_unset(annotation, segments[depth + 1 :], path)
    return KeyState.PRESENT, tuple(path)


def _reach_unset(annotation: Any, segments: Sequence[str], path: list[str | int]) -> tuple[KeyState, Path]:
    """The same below a table that the document leaves out: settable if no other key of it is required.

    Tables of values by name require no key.
    """
    table = bare(annotation)
    of_values = get_origin(table) is dict and not is_form(bare(get_args(table)[1]))
    needed = {name for name, f in table.model_fields.items() if f.is_required()} if is_form(table) else {""}
    for segment in segments:
        annotation = bare(annotation)
        key = _match(segment, None, annotation)
        if key is None:
            return KeyState.UNKNOWN, tuple(path)
        annotation = child(annotation, key)
        path.append(key)
    whole = of_values or needed <= {path[-1]}
    return (KeyState.SETTABLE if whole and len(segments) == 1 else KeyState.ABSENT), tuple(path)


def _match(segment: str, data: Any, annotation: Any) -> str | int | None:
    """The key or index that ``segment`` names; in absent data (None) as far as the form defines it."""
    if is_form(annotation):
        known = list(keys_of(annotation))
        exact = [k for k in known if k == segment]
        return next(iter(exact or [k for k in known if sheet_name(k) == segment]), None)
    if isinstance(data, dict):
        return segment if segment in data else None
    if isinstance(data, list):
        return _match_item(segment, cast("list[Any]", data))
    if data is None:
        index = int(segment) if segment.isdigit() else segment
        return index if child(annotation, index) is not None else None
    return None


def _match_item(segment: str, items: list[Any]) -> int | None:
    if segment.isdigit():
        return int(segment) if int(segment) < len(items) else None
    named = [i for i, item in enumerate(items) if isinstance(item, dict) and item.get("name") == segment]
    return named[0] if named else None


def _has(data: Any, key: str | int) -> bool:
    if isinstance(data, dict):
        return key in data
    return isinstance(data, list) and isinstance(key, int) and key < len(cast("list[Any]", data))


@record
class OverriddenDocument:
    """A document that overrides may change: parsed data, its form and the article it belongs to, if any."""

    name: str
    data: Any
    form: Any
    article: str = ""


def apply_overrides(
    targets: Sequence[OverriddenDocument], overrides: Sequence[str]
) -> tuple[list[dict[str, Any]], list[dict[Path, str]]]:
    """The documents with all ``overrides`` applied, and for each the paths set with the key that set them.

    Warns of one whose table every document leaves out. Raises `ConfigError` with every override that no
    document knows.
    """
    documents = [copy.deepcopy(t.data) for t in targets]
    changed: list[dict[Path, str]] = [{} for _ in targets]
    faults: list[DocumentFault] = []
    waiting = [parse_override(text) for text in overrides]
    again = len(waiting)  # one whose table is not there waits for the others, which may make it
    for turn, override in enumerate(waiting):
        found = [
            reach(data, target.form, override.segments)
            if not override.article or override.article == target.article
            else (KeyState.UNKNOWN, ())
            for data, target in zip(documents, targets, strict=True)
        ]
        best = max((r.value for r, _ in found), default=0)
        if best == KeyState.UNKNOWN.value:
            faults.append(_unknown(override, documents, targets))
        if best == KeyState.ABSENT.value and turn < again:
            waiting.append(override)
        elif best == KeyState.ABSENT.value:
            warnings.warn(_no_effect(override, targets, found), stacklevel=2)
        for data, marks, (how, path) in zip(documents, changed, found, strict=True):
            if how.value == best and how in (KeyState.SETTABLE, KeyState.PRESENT):
                _put(data, path, override.value)
                marks[path] = override.text.partition("=")[0].strip()
    raise_faults(faults)
    return documents, changed


def _put(data: Any, path: Path, value: Any) -> None:
    for key in path[:-1]:
        data = data.setdefault(key, {}) if isinstance(data, dict) else data[key]
    data[path[-1]] = copy.deepcopy(value)


def _no_effect(
    override: Override, targets: Sequence[OverriddenDocument], found: Sequence[tuple[KeyState, Path]]
) -> str:
    files = ", ".join(t.name for t, (how, _) in zip(targets, found, strict=True) if how is KeyState.ABSENT)
    return (
        f"--set {override.text} has no effect: its table is not in {files}; write the table there to set it"
    )


def _unknown(
    override: Override, documents: Sequence[Any], targets: Sequence[OverriddenDocument]
) -> DocumentFault:
    key = ".".join(override.segments)
    names = [p for d, t in zip(documents, targets, strict=True) for p in leaf_names(d, t.form)]
    read = ", ".join(dict.fromkeys(t.name for t in targets))
    articles = {t.article for t in targets if t.article}
    if override.article and override.article not in articles:
        return _fault(
            override.text,
            f"no article {override.article!r} is read here",
            nearest(override.article, articles),
        )
    close = nearest(key, dict.fromkeys(names))
    hint = close if close.startswith("did you mean") else "a key of the documents read here, e.g. node.0.mass"
    return _fault(override.text, f"unknown key; not in {read}", hint)


def leaf_names(data: Any, form: type[Form]) -> list[str]:
    """The sheet names and file names of all values of a document."""
    names: list[str] = []

    def walk(value: Any, annotation: Any, plain: str, full: str) -> None:
        annotation = bare(annotation)
        children: dict[str | int, Any] = {}
        if is_form(annotation):
            children = dict.fromkeys(keys_of(annotation))
        if isinstance(value, dict):
            children |= cast("dict[str | int, Any]", value)
        elif isinstance(value, list):
            children = dict(enumerate(cast("list[Any]", value)))
        if plain and (not children or isinstance(value, list)):
            names.extend(dict.fromkeys([plain, full]))
        for key, below in children.items():
            lead, path = (f"{plain}.", f"{full}.") if plain else ("", "")
            name = sheet_name(str(key)) if is_form(annotation) else str(key)
            walk(below, child(annotation, key), f"{lead}{name}", f"{path}{key}")

    walk(data, form, "", "")
    return names
