"""Configuration errors: all of them at once, each with file, line, key, value, allowed range and advice."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NoReturn

from pydantic import ValidationError

from middeck.errors import ConfigError
from middeck.files.toml.form import (
    UNITS,
    Form,
    fixed_length,
    form_at,
    is_of_tables,
    keys_of,
    stem,
    tables_of,
    unit_of,
)
from middeck.files.toml.lines import Path
from middeck.files.toml.plain_number import as_number
from middeck.values import record

# Endings that people write where another unit is expected.
FOREIGN_UNITS = frozenset(ending[1:] for ending in UNITS) | {
    *("mm", "cm", "um", "km", "in", "inch", "ft", "g", "gram", "t", "lb", "lbf", "mpa", "gpa", "kpa", "psi"),
    *("ms", "us", "ns", "min", "khz", "mhz", "rad", "degrees", "rpm", "kn", "nmm", "ncm", "deg_s", "percent"),
    *("kgm2", "kg_mm2", "g_mm2", "g_cm3", "n_per_mm", "nm_per_deg"),
}

# Keys of directions, of which people write a letter.
DIRECTIONS = frozenset({"axis", "up", "gravity_direction"})
LETTERS = 3  # values of a direction or place
AXES = {
    **{"x": "[1.0, 0.0, 0.0]", "y": "[0.0, 1.0, 0.0]", "z": "[0.0, 0.0, 1.0]"},
    **{"-x": "[-1.0, 0.0, 0.0]", "-y": "[0.0, -1.0, 0.0]", "-z": "[0.0, 0.0, -1.0]"},
}
ABSENT = object()
CLOSE, UNKNOWN, MISSING = "did you mean", "unknown key", "missing"
MOST_PLACES = 3  # tables that are named as those of which a key may be


@record(kw_only=True)
class DocumentFault:
    """One thing wrong: where (``file``, ``line``, ``key``), what, the ``value`` and what to try.

    ``file`` is ``--set`` and ``line`` zero for a value that an override has set.
    """

    file: str
    line: int
    key: str
    message: str
    value: str = ""
    hint: str = ""

    @property
    def place(self) -> str:
        """File and line as editors understand them."""
        return f"{self.file}:{self.line}" if self.line else self.file

    @property
    def what(self) -> str:
        """Key, value and message in one line."""
        named = f"{self.key} = {self.value}" if self.value else self.key
        return f"{named}: {self.message}" if named else self.message

    def __str__(self) -> str:
        hint = f"\n  try: {self.hint}" if self.hint else ""
        return f"{self.place}: {self.what}{hint}"


@record(kw_only=True)
class PathFault:
    """A fault whose file and line are not yet known."""

    path: Path
    message: str
    value: str = ""
    hint: str = ""
    expected: str = ""  # the key that an unknown one stands for


def finding(
    path: Path, message: str, value: Any = ABSENT, *, hint: str = "", expected: str = ""
) -> PathFault:
    """A finding at ``path``, with its ``value``, if there is one, as TOML would write it."""
    shown = "" if value is ABSENT else show(value)
    return PathFault(path=path, message=message, value=shown, hint=hint, expected=expected)


def raise_faults(faults: Sequence[DocumentFault]) -> None:
    """Raise one `ConfigError` with all ``faults`` (its ``data["faults"]``); nothing if there are none."""
    if not faults:
        return
    if len(faults) == 1:
        raise_fault(faults[0])
    lines = "\n".join(map(str, faults))
    raise ConfigError(f"{len(faults)} errors in the configuration\n{lines}", faults=tuple(faults))


def raise_fault(fault: DocumentFault) -> NoReturn:
    """Raise a `ConfigError` with this one fault, in place of whatever it stands for."""
    raise ConfigError(fault.what, where=fault.place, hint=fault.hint, faults=(fault,)) from None


def nearest(word: str, known: Iterable[str]) -> str:
    """``did you mean 'x'?`` or, with nothing near, the list of what there is.

    >>> nearest("mas_kg", ["mass_kg", "size_m"])
    "did you mean 'mass_kg'?"
    """
    choices = list(dict.fromkeys(known))
    small = {choice.lower(): choice for choice in reversed(choices)}
    close = difflib.get_close_matches(word.lower(), small, 1, 0.6)
    if close:
        return f"{CLOSE} {small[close[0]]!r}?"
    return f"one of {', '.join(choices)}" if choices else ""


def show(value: Any) -> str:
    """``value`` as TOML would write it, cut to 60 characters."""
    text = str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')
    return text if len(text) <= 60 else text[:57] + "..."


def form_findings(error: ValidationError, form: type[Form]) -> list[PathFault]:
    """The errors of pydantic in our words."""
    items = error.errors(include_url=False)
    found = [_finding(item, form) for item in items if not _is_echo(item, items)]
    # A key in another unit is one fault, not also a missing key.
    meant = {(f.path[:-1], f.expected) for f in found if f.expected}
    found = list(dict.fromkeys(f for f in found if (f.path[:-1], f.path[-1]) not in meant))
    return [_for_the_missing(f, found) for f in found]


def _for_the_missing(fault: PathFault, found: Sequence[PathFault]) -> PathFault:
    """``fault`` with the key that its table lacks as its hint, where it is the only unknown key there."""
    beside = [f for f in found if f.path[:-1] == fault.path[:-1]]
    lacking = [f.path[-1] for f in beside if f.message.startswith(MISSING)]
    alone = [f.message for f in beside].count(UNKNOWN) == len(lacking) == 1
    if fault.message != UNKNOWN or fault.hint.startswith(CLOSE) or not alone:
        return fault
    return replace(fault, hint=f"{CLOSE} {lacking[0]!r}?")


def _is_echo(item: Any, items: Sequence[Any]) -> bool:
    """Whether "too short" of an array only follows from the fault of one of its items."""
    at = item["loc"]
    return item["type"] == "too_short" and any(
        len(other["loc"]) > len(at) and other["loc"][: len(at)] == at for other in items
    )


def _finding(item: Any, form: type[Form]) -> PathFault:
    path: Path = tuple(item["loc"])
    named = [p for p in path if isinstance(p, str)]
    key = named[-1] if named else ""
    kind: str = item["type"]
    if kind == "extra_forbidden":
        return _unknown_key(path, key, item["input"], form)
    if kind == "missing":
        hint = "schema = 1, above the first [table]" if path == ("schema",) else ""
        return finding(path, MISSING + _in_unit(key), hint=hint)
    if kind == "model_type" and len(path) == 2 and f"[{path[0]}.NAME]" in tables_of(form):
        return finding(path[:1], "must have a name", hint=f"[{path[0]}.NAME] above its keys")
    messages: dict[str, str] = {
        "range": f"must be {item.get('ctx', {}).get('allowed')}{_in_unit(key, ' ')}",
        "finite": "must be a finite number" + _in_unit(key),
        "inertia": f"{item['msg']}; must be {item.get('ctx', {}).get('allowed')}{_in_unit(key)}",
        "float_type": "must be a number" + _in_unit(key),
        "int_type": "must be a whole number",
        "string_type": "must be a text in quotes",
        "bool_type": "must be true or false",
        "model_type": "must be a table",
        "dict_type": "must be a table",
        "list_type": "must be an array",
        "tuple_type": "must be an array",
        "string_pattern_mismatch": "must begin with a letter and hold letters, digits, '_' and '-' only",
    }
    if kind in ("too_long", "too_short"):
        return _wrong_length(path, item)
    if kind == "literal_error":
        messages[kind] = f"must be {item['ctx']['expected']}".replace("'", '"')
    hint = item.get("ctx", {}).get("hint", "")
    if kind == "float_type" and isinstance(item["input"], str) and (number := as_number(item["input"])):
        hint = f"without quotes: {number}"
    hint = _as_array(key, item["input"], form, path) if kind in ("list_type", "tuple_type") else hint
    return finding(path, messages.get(kind, str(item["msg"])), item["input"], hint=hint)


def _as_array(key: str, value: Any, form: type[Form], path: Path) -> str:
    """Hint that shows a single value or table as an array, or states how many values it needs."""
    if isinstance(value, dict):
        return f"[[{key}]] for each table"
    if key in DIRECTIONS and isinstance(value, str):
        return f"{key} = {AXES.get(value.lower().lstrip('+'), '[x, y, z], three numbers')}"
    if (count := fixed_length(form, path)) > 1:
        return f"{key} = [{', '.join('xyz' if count == LETTERS else ['...'] * count)}], {count} values"
    return f"{key} = [{show(value)}]" if isinstance(value, str | int | float) and key else ""


def _wrong_length(path: Path, item: Any) -> PathFault:
    """An array of too many or too few; with decimal commas it has twice as many."""
    limits, value = item["ctx"], item["input"]
    wanted = limits.get("max_length", limits.get("min_length"))
    commas = len(value) == 2 * wanted and all(isinstance(x, int) for x in value[1::2])
    advice = "decimal points: 0,25 is two numbers" if commas else ""
    return finding(path, f"has {len(value)} items; must be {wanted}", value, hint=advice)


def _unknown_key(path: Path, key: str, value: Any, form: type[Form]) -> PathFault:
    table = form_at(form, path[:-1])
    known = [f.alias or name for name, f in table.model_fields.items()] if table else []
    same = next((k for k in known if k.lower() == key.lower()), "")
    if same:
        return finding(path, UNKNOWN, value, hint=f"did you mean {same!r}?", expected=same)
    for expected in known:
        if _is_other_unit(key, expected):
            unit = unit_of(expected) or "a pure number"
            message = f"unknown key; {expected!r} is expected, in {unit}"
            return finding(path, message, value, hint=f"convert to {unit}", expected=expected)
    if key in keys_of(form) and (isinstance(value, list | tuple | dict) or not is_of_tables(form, key)):
        above = ".".join(map(str, path[:-1]))
        hint = f"it is a key of the file: write it above the first [table], here it belongs to {above}"
        return finding(path, UNKNOWN, value, hint=hint)
    advice = nearest(key, known)
    other = "" if advice.startswith(CLOSE) else _elsewhere(key, form)
    return finding(path, UNKNOWN, value, hint=other or advice)


def _elsewhere(key: str, form: type[Form]) -> str:
    """A hint naming the other tables that have this key, in this unit or another; "" for none or many."""
    places = {
        head: known
        for head, table in tables_of(form).items()
        for known in keys_of(table)
        if key == known or _is_other_unit(key, known)
    }
    if len(set(places.values())) != 1 or len(places) > MOST_PLACES:
        return ""
    return f"{next(iter(places.values()))!r} is a key of {' and '.join(places)}"


def _is_other_unit(key: str, expected: str) -> bool:
    if key == expected:
        return False
    root = stem(expected)
    return (
        key == root or stem(key) == root or any(key.lower() == f"{root}_{u}".lower() for u in FOREIGN_UNITS)
    )


def _in_unit(key: str, lead: str = ", in ") -> str:
    unit = unit_of(key)
    return f"{lead}{unit}" if unit else ""
