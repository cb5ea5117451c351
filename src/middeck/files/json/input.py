"""JSON documents on their way in: text, schema, ports and arrays of numbers, refused by file and key."""

import json
from pathlib import Path
from typing import Any, cast

import numpy as np

from middeck.errors import DataError
from middeck.files.disk.kind_of_content import EMPTY, JSON, NOT_UTF8, SCHEMAS, TEXT, is_json, stray
from middeck.files.json.channels import build_channel
from middeck.signals.ports import Port


def read_json(path: str | Path, schema: str, hint: str) -> dict[str, Any]:
    """The document in file ``path``; ``hint`` says what it should be.

    Raises `DataError`, naming the file, if it is missing, empty, truncated, not UTF-8 or of another schema.
    """
    where = str(path)
    wanted = SCHEMAS[schema.removeprefix("middeck.").partition("/")[0]]
    strange = stray(path, wanted, (EMPTY, JSON, TEXT, NOT_UTF8))
    if strange and not is_json(path):
        raise DataError(strange, where=where, hint=hint)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=where, hint="check the path") from None
    except UnicodeDecodeError:
        raise DataError("not UTF-8 text", where=where, hint=hint) from None
    if not text.strip():
        raise DataError("the file is empty", where=where, hint="write it again")
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        what = f"truncated or not JSON: {error.msg}"
        raise DataError(what, where=f"{path}:{error.lineno}", hint="write it again") from None
    except (ValueError, RecursionError):  # Python reads neither, and JSON forbids neither
        what = "holds a number of thousands of digits, or tables within tables without end"
        raise DataError(what, where=where, hint=hint) from None
    found = cast("dict[str, Any]", data).get("schema") if isinstance(data, dict) else None
    if found != schema:
        what = f"schema is {found!r}, this reader knows {schema!r}"
        raise DataError(f"{strange}: {what}" if strange else what, where=where, hint=hint)
    return cast("dict[str, Any]", data)


def json_numbers(value: Any, where: str, ragged: str, infinite: str = "") -> np.ndarray:
    """``value`` as an array of finite numbers; ``ragged`` and ``infinite`` say what to try otherwise."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise DataError("not an array of numbers", where=where, hint=ragged) from None
    if not np.isfinite(array).all():
        raise DataError("a number is not finite", where=where, hint=infinite or ragged)
    return array


def require_keys(data: Any, keys: tuple[str, ...], where: str, hint: str) -> None:
    """Raise `DataError` unless ``data`` is a table with all ``keys``."""
    missing = [k for k in keys if not isinstance(data, dict) or k not in data]
    if missing:
        raise DataError(f"keys missing: {', '.join(missing)}", where=where, hint=hint)


def read_ports(value: Any, where: str, hint: str) -> tuple[Port, ...]:
    """The ports of a list of names, units and channels; raises `DataError` where it is none."""
    if not isinstance(value, list) or not value:
        raise DataError("no ports", where=where, hint='a list of {"name": ..., "unit": ...}')
    return tuple(_port(item, where, hint) for item in cast("list[Any]", value))


def _port(item: Any, where: str, hint: str) -> Port:
    require_keys(item, ("name", "unit"), where, hint)
    channel = item.get("channel")
    if channel is None:
        return Port(str(item["name"]), str(item["unit"]))
    return Port(str(item["name"]), str(item["unit"]), build_channel(channel, f"{where}, channel"))
