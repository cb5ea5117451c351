"""Tables of a document as parsed, read as far as they have the form; refused values are skipped."""

import math
from collections.abc import Iterator
from typing import Any, cast

Table = dict[str, Any]


def table_of(data: Table, key: str) -> Table:
    """The table ``key``; empty where there is none."""
    value = data.get(key)
    return cast("Table", value) if isinstance(value, dict) else {}


def array_of(data: Table, key: str) -> list[Any]:
    """The array ``key``; empty where there is none."""
    value = data.get(key)
    return cast("list[Any]", value) if isinstance(value, list) else []


def tables(data: Table, key: str) -> Iterator[tuple[int, Table]]:
    """The tables of the array ``key`` with their indices; nothing if it is no array of tables."""
    return ((k, cast("Table", item)) for k, item in enumerate(array_of(data, key)) if isinstance(item, dict))


def is_number(value: Any) -> bool:
    """Whether the value is a number, not a truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def all_numbers(*values: Any) -> bool:
    """Whether all are finite numbers."""
    return all(is_number(v) and math.isfinite(v) for v in values)


def is_vector(value: Any) -> bool:
    """Whether the value is an array of three finite numbers."""
    items = cast("list[Any]", value) if isinstance(value, list) else []
    return len(items) == 3 and all_numbers(*items)
