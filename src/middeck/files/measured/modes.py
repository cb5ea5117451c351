"""Measured modes as JSON: the result of a modal survey, one document a test."""

from __future__ import annotations

import dataclasses
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, DataError
from middeck.files.json.input import json_numbers, read_json
from middeck.files.json.output import write_json
from middeck.files.records.formats import UFF
from middeck.structure.correlation.measured_modes import NODES, MeasuredModes

if TYPE_CHECKING:
    from middeck.structure.model.article import Structure

MEASURED_SCHEMA = "middeck.measured-modes/1"
REQUIRED = ("frequency_hz", "damping", "node", "direction", "shape")
# A damping ratio from which on it is more likely one in per cent.
PERCENT = 0.3
# Text beside the numbers.
TEXTS = ("lines", "source")
OPTIONAL = ("frequency_std_hz", "damping_std", "shape_std", "position_m", "modal_mass")


@named_kinds
def load_measured_modes(path: str | Path) -> MeasuredModes:
    """The measured modes in the file ``path``: JSON, a universal file (.unv, .uff) or CSV, by its ending.

    docs/reference/files.md describes each. Oddities of a file are in ``warnings`` of the modes.

    Raises `DataError`, naming file and key, if it is missing, empty, truncated, of another schema, incomplete
    or inconsistent, if a key is unknown, or if a number is not finite or out of range.
    """
    ending = Path(path).suffix.lower()
    if ending in (*UFF, ".csv"):
        return _load_other(Path(path), ending)
    data = read_json(path, MEASURED_SCHEMA, "docs/reference/files.md describes it")
    _check_keys(data, str(path))
    values = {k: _numbers(data[k], f"{path}, {k}") for k in ("frequency_hz", "damping")}
    values |= {k: _numbers(data[k], f"{path}, {k}") for k in OPTIONAL if data.get(k) is not None}
    shape = _shape(data["shape"], f"{path}, shape")
    names = {k: _texts(data[k], f"{path}, {k}") for k in ("node", "direction")}
    lines = _lines(data.get("lines", []), f"{path}, lines")
    (source,) = _texts([data.get("source", "")], f"{path}, source")
    if not shape.size and not names["node"]:  # frequencies alone: no rows, which JSON cannot give a width
        shape = np.zeros((0, len(values["frequency_hz"])))
    try:
        return MeasuredModes(**values, **names, shape=shape, lines=lines, source=source)  # ty: ignore[invalid-argument-type]
    except DataError as error:
        raise DataError(error.what, where=str(path), hint=error.hint) from None
    except ConfigError as error:
        advice = "one value for each mode, one row of shapes for each channel"
        raise DataError(f"{error.where}: {error.what}", where=str(path), hint=advice) from None


def _load_other(path: Path, ending: str) -> MeasuredModes:
    from middeck.files.measured.survey_csv import load_csv
    from middeck.files.measured.survey_uff import load_uff

    try:
        found = load_csv(path) if ending == ".csv" else load_uff(path)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="check the path") from None
    high = np.flatnonzero(found.damping >= PERCENT)
    if not len(high):
        return found
    hz, ratio = found.frequency_hz[high[0]], found.damping[high[0]]
    doubt = f"the mode of {hz:.6g} Hz has a damping ratio of {ratio:g}: is it in per cent?"
    return dataclasses.replace(found, warnings=(*found.warnings, doubt))


def write_measured_modes(
    path: str | Path,
    measured: MeasuredModes,
    structure: Structure | None = None,
    sets: tuple[int, int] | None = None,
) -> None:
    """Write ``measured`` whole or not at all: as a universal file (.unv, .uff), else as JSON.

    JSON has a real shape as rows of numbers, a complex one as re and im. A universal file has nodes, shapes
    with six digits, and the members of ``structure`` as trace lines; ``sets`` are those of its nodes (2411 or
    15) and shapes (55 or 2414), 2411 and 55 by default. See `write_uff` for what it cannot hold.

    Raises `ConfigError` for ``sets`` that are not written, or with JSON, which has none.
    """
    if Path(path).suffix.lower() in UFF:
        from middeck.files.measured.survey_uff_write import SETS, write_uff

        return write_uff(Path(path), measured, structure, SETS if sets is None else sets)
    if sets is not None:
        hint = f"a path that ends in {' or '.join(UFF)}"
        raise ConfigError(f"{path} is JSON, which has no data sets", where="sets", hint=hint)
    shape = np.real(measured.shape) if measured.is_real else measured.shape
    stated = {k: v for k in OPTIONAL if (v := getattr(measured, k)) is not None}
    stated |= {k: v for k in TEXTS if (v := getattr(measured, k))}
    required = {k: getattr(measured, k) for k in REQUIRED} | {"shape": shape}
    write_json(path, {"schema": MEASURED_SCHEMA, **required, **stated})


def _check_keys(data: dict[str, Any], where: str) -> None:
    known = ("schema", *REQUIRED, *OPTIONAL, *TEXTS)
    missing = [k for k in REQUIRED if k not in data]
    if missing:
        raise DataError(
            f"keys missing: {', '.join(missing)}",
            where=where,
            hint=NODES if "node" in missing else "add them",
        )
    for key in data:
        if key not in known:
            near = get_close_matches(key, known, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"
            raise DataError(f"unknown key {key!r}", where=where, hint=hint)


def _shape(value: Any, where: str) -> np.ndarray:
    if not isinstance(value, dict):
        return _numbers(value, where)
    parts = cast("dict[str, Any]", value)
    if set(parts) != {"re", "im"}:
        raise DataError(
            f"keys {', '.join(map(str, parts))}", where=where, hint='rows, or {"re", "im"} of rows'
        )
    re, im = (_numbers(parts[part], f"{where}.{part}") for part in ("re", "im"))
    if re.shape != im.shape:
        raise DataError(f"re has shape {re.shape}, im {im.shape}", where=where, hint="one im for each re")
    return re + 1j * im


def _numbers(value: Any, where: str) -> np.ndarray:
    return json_numbers(
        value, where, ragged="rows of equal length", infinite="leave that mode or channel out"
    )


def _texts(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(v, str) for v in cast("list[Any]", value)):
        raise DataError("not a list of texts", where=where, hint="one name for each channel")
    return tuple(cast("list[str]", value))


def _lines(value: Any, where: str) -> tuple[tuple[str, ...], ...]:
    if not isinstance(value, list):
        raise DataError("not a list of lines", where=where, hint="a list of names for each line")
    return tuple(_texts(line, where) for line in cast("list[Any]", value))
