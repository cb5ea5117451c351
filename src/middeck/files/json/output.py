"""The one way results leave as JSON: plain values, nothing that is not finite, whole files only."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, cast

import numpy as np

from middeck.errors import NumericalError
from middeck.files.disk.atomic import write_text
from middeck.signals.ports import Port


def json_text(value: Any) -> str:
    """``value`` as JSON with full precision, keys in the order given.

    Arrays become lists, complex numbers and arrays ``{"re": ..., "im": ...}``, records tables.
    Raises `NumericalError`, naming the key, for a number that is not finite: write None where one is meant.

    A list of plain numbers or texts stands on one line.

    >>> print(json_text({"H": np.array([1 + 2j, 3])}))
    {
     "H": {
      "re": [1.0, 3.0],
      "im": [2.0, 0.0]
     }
    }
    """
    return _text(plain(value), "\n")


def _text(value: Any, line: str) -> str:
    """JSON of a plain value; ``line`` is the line break with the indentation so far."""
    inner = line + " "
    match value:
        case dict() if value:
            pairs = cast("dict[str, Any]", value).items()
            rows = (f"{_leaf(k)}: {_text(v, inner)}" for k, v in pairs)
            return "{" + inner + ("," + inner).join(rows) + line + "}"
        case list() if any(isinstance(v, dict | list) for v in cast("list[Any]", value)):
            rows = (_text(v, inner) for v in cast("list[Any]", value))
            return "[" + inner + ("," + inner).join(rows) + line + "]"
        case _:
            return _leaf(value)


def _leaf(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def write_json(path: str | Path, value: Any) -> None:
    """Write ``value`` to ``path`` as `json_text`, whole or not at all."""
    write_text(path, json_text(value) + "\n")


def plain(value: Any, where: str = "") -> Any:
    """``value`` in tables, lists, texts and numbers; ``where`` names it in errors."""
    match value:
        case Enum():
            return value.value
        case None | bool() | str() | int():
            return value
        case np.bool_() | np.integer():
            return value.item()
        case float() | np.floating():
            return _finite(float(value), where)
        case complex() | np.complexfloating():
            z = complex(value)
            return {"re": _finite(z.real, f"{where}.re"), "im": _finite(z.imag, f"{where}.im")}
        case np.ndarray():
            return _array(value, where)
        case Path():
            return value.as_posix()
        case Mapping():
            pairs = cast("Mapping[Any, Any]", value).items()
            return {str(k): plain(v, f"{where}.{k}".lstrip(".")) for k, v in pairs}
        case Sequence():
            return [plain(v, f"{where}.{i}") for i, v in enumerate(cast("Sequence[Any]", value))]
        case Port(channel=None):
            return {"name": value.name, "unit": value.unit}  # as computed: without a transducer
        case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
            pairs = ((f.name, getattr(value, f.name)) for f in dataclasses.fields(value))
            return {k: plain(v, f"{where}.{k}".lstrip(".")) for k, v in pairs}
        case _:
            raise TypeError(f"{where}: {type(value).__name__} has no JSON form")


def _array(array: np.ndarray, where: str) -> Any:
    if array.dtype.kind == "c":
        return {"re": _array(np.real(array), f"{where}.re"), "im": _array(np.imag(array), f"{where}.im")}
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        first = np.argwhere(~np.isfinite(array))[0]
        raise _not_finite(".".join([where, *map(str, first)]), float(array[tuple(first)]))
    if array.dtype.kind not in "fiubUO":
        raise TypeError(f"{where}: an array of {array.dtype} has no JSON form")
    return plain(array.tolist(), where) if array.dtype.kind == "O" else array.tolist()


def _finite(number: float, where: str) -> float:
    if not math.isfinite(number):
        raise _not_finite(where, number)
    return float(number)


def _not_finite(where: str, number: float) -> NumericalError:
    return NumericalError(
        f"a result is {number}, not a finite number",
        where=where.strip("."),
        hint="look at the inputs that this number is computed from",
    )
