"""Controller packages on disk: the binary, its JSON twin, and C."""

from pathlib import Path
from typing import Any, NoReturn, cast

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, DataError
from middeck.files.disk.atomic import write_bytes
from middeck.files.disk.kind_of_content import BINARY, EMPTY, JSON, PACKAGE, is_json, stray
from middeck.files.json.hash_seal import doubled_key
from middeck.files.json.input import json_numbers, read_json, read_ports, require_keys
from middeck.files.json.output import plain, write_json
from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.package import ControllerPackage, TestVectors
from middeck.realtime.package.package_bytes import MAGIC, decode_package, encode_package, hash_package

PACKAGE_SCHEMA = "middeck.package/1"
AGAIN = "the file as it was generated"
LARGEST_FILE = 1 << 26
"""Bytes: no package that this program writes comes near."""


def write_package(path: str | Path, package: ControllerPackage) -> tuple[Path, ...]:
    """Write ``package`` whole or not at all; the ending decides. Returns the files written.

    ``.mdk`` is the binary, ``.json`` its twin with the same numbers and the hash of the binary, ``.h`` the C
    header, ``.c`` the C source, which needs the header: it is written beside it. C names begin with the
    file's name. Raises `ConfigError` for another ending.
    """
    file = Path(path)
    match file.suffix.lower():
        case ".mdk":
            write_bytes(file, encode_package(package))
        case ".json":
            write_json(file, package_document(package))
        case ".h" | ".c":
            header = file.with_suffix(".h")
            made = generate_c(package, file.stem, header.name)
            write_bytes(header, made.header.encode())
            if file.suffix.lower() == ".c":
                write_bytes(file, made.source.encode())
                return file, header
        case other:
            raise ConfigError(f"no writer for {other!r} files", where=str(path), hint=".mdk, .json, .c or .h")
    return (file,)


@named_kinds
def load_package(path: str | Path) -> ControllerPackage:
    """The package in ``path``, binary or JSON.

    Raises `DataError`, naming the file, for anything else, and where a byte was changed: a package is known
    by its hash.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST_FILE)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="check the path") from None
    strange = "" if data.startswith(MAGIC) else stray(path, PACKAGE, (EMPTY, BINARY, JSON))
    if strange and not is_json(path):
        raise DataError(strange, where=str(path), hint="a package of middeck generate")
    if data.startswith(MAGIC) or data.lstrip()[:1] != b"{":
        return decode_package(data, str(path))
    document = read_json(path, PACKAGE_SCHEMA, "a package of middeck generate")
    doubled = doubled_key(data.decode("utf-8-sig"))
    if doubled:
        _refuse(f"key {doubled!r} stands twice", str(path))
    return _from_document(document, str(path))


def package_document(package: ControllerPackage) -> dict[str, Any]:
    """The JSON twin; null stands for an absent limit."""
    core = package.core
    vectors = package.vectors
    assert vectors is not None  # the hash has asked for them
    return {
        "schema": PACKAGE_SCHEMA,
        "sha256": hash_package(package),
        "name": package.name,
        "period_s": package.period_s,
        "precision": "single" if package.single else "double",
        "unstable": package.unstable,
        "inputs": package.inputs,
        "input_range": _open(package.input_range),
        "outputs": package.outputs,
        "lower": _open(package.lower),
        "upper": _open(package.upper),
        "slew_per_sample": _open(package.slew),
        "ramp_samples": package.ramp,
        "error_bound": package.error_bound,
        **({"error_bound_own": True} if package.error_bound_own else {}),
        "pairs": core.pairs,
        **{name: getattr(core, name) for name in "ABCDE"},
        "filters": [{"input": f.input, **plain(f.section)} for f in package.filters],
        "paths": [{"input": p.input, "output": p.output, **plain(p.section)} for p in package.paths],
        "vectors": vectors,
    }


def _from_document(data: dict[str, Any], where: str) -> ControllerPackage:
    keys = (
        "sha256", "name", "period_s", "precision", "unstable", "inputs", "input_range", "outputs", "lower",
        "upper", "slew_per_sample", "ramp_samples", "error_bound", "pairs", *"ABCDE", "filters", "paths",
        "vectors",
    )  # fmt: skip
    require_keys(data, keys, where, AGAIN)
    strange = sorted(set(data) - {"schema", "error_bound_own", *keys})
    if strange:
        _refuse(f"keys that no package has: {', '.join(strange)}", where)
    try:
        package = _build(data, where)
    except DataError:
        raise
    except ConfigError as error:
        raise DataError(error.what, where=where, hint=error.hint) from None
    except (TypeError, ValueError, OverflowError) as error:
        _refuse(f"no package: {error}", where)
    if hash_package(package) != data["sha256"]:
        _refuse("the package was changed: its hash does not fit", where)
    if not _same(data, plain(package_document(package))):
        _refuse("the document does not say this package as it is written", where)
    return package


def _same(stated: Any, written: Any) -> bool:
    """Whether two JSON values are equal: numbers by their value, all else by value and type."""
    if isinstance(stated, dict) and isinstance(written, dict):
        return stated.keys() == written.keys() and all(_same(stated[key], written[key]) for key in written)
    if isinstance(stated, list) and isinstance(written, list):
        return len(stated) == len(written) and all(map(_same, stated, written))
    numbers = type(stated) in (int, float) and type(written) in (int, float)
    return stated == written and (numbers or type(stated) is type(written))


def _build(data: dict[str, Any], where: str) -> ControllerPackage:
    inputs, outputs = (read_ports(data[side], f"{where}, {side}", AGAIN) for side in ("inputs", "outputs"))
    m, p = len(inputs), len(outputs)
    n = len(_list(data["A"], f"{where}, A"))
    shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "E": (n, p)}
    core = {name: _numbers(data[name], f"{where}, {name}").reshape(shape) for name, shape in shapes.items()}
    require_keys(data["vectors"], ("start_level", "engaged", "y", "u"), f"{where}, vectors", AGAIN)
    vectors = cast("dict[str, Any]", data["vectors"])
    return ControllerPackage(
        name=_of(data, "name", str, where),
        period_s=_of(data, "period_s", float, where),
        inputs=inputs,
        outputs=outputs,
        input_range=_closed(data["input_range"], np.inf, f"{where}, input_range"),
        lower=_closed(data["lower"], -np.inf, f"{where}, lower"),
        upper=_closed(data["upper"], np.inf, f"{where}, upper"),
        slew=_closed(data["slew_per_sample"], np.inf, f"{where}, slew_per_sample"),
        core=Core(**core, pairs=None if data["pairs"] is None else _of(data, "pairs", int, where)),
        filters=tuple(
            InputFilter(_of(f, "input", int, where), _read_section(f, where))
            for f in _list(data["filters"], where)
        ),
        paths=tuple(
            LoopPath(_of(f, "input", int, where), _of(f, "output", int, where), _read_section(f, where))
            for f in _list(data["paths"], where)
        ),
        ramp=_of(data, "ramp_samples", int, where),
        unstable=_of(data, "unstable", bool, where),
        single=_is_single(_of(data, "precision", str, where), where),
        error_bound=None if data["error_bound"] is None else _numbers(data["error_bound"], where),
        error_bound_own=_of({"error_bound_own": False} | data, "error_bound_own", bool, where),
        vectors=TestVectors(
            start_level=_of(vectors, "start_level", int, where),
            engaged=np.array(_list(vectors["engaged"], where), dtype=bool),
            y=_numbers(vectors["y"], f"{where}, vectors").reshape(-1, m),
            u=_numbers(vectors["u"], f"{where}, vectors").reshape(-1, p),
        ),
    )


def _is_single(precision: str, where: str) -> bool:
    if precision not in ("double", "single"):
        _refuse(f"a precision {precision!r}", where)
    return precision == "single"


def _read_section(table: Any, where: str) -> Section:
    require_keys(table, ("b", "a"), where, AGAIN)
    return Section(_numbers(table["b"], where), _numbers(table["a"], where))


def _open(limits: np.ndarray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in limits.tolist()]


def _closed(value: Any, missing: float, where: str) -> np.ndarray:
    return np.array([missing if v is None else v for v in _list(value, where)], dtype=float)


def _numbers(value: Any, where: str) -> np.ndarray:
    return json_numbers(value, where, AGAIN)


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        _refuse("not a list", where)
    return cast("list[Any]", value)


def _of(table: Any, key: str, kind: type, where: str) -> Any:
    """The value of ``key``, of just this type: True is no number."""
    require_keys(table, (key,), where, AGAIN)
    value = table[key]
    if type(value) is not kind:
        _refuse(f"{key} is not of the kind {kind.__name__}", where)
    return value


def _refuse(what: str, where: str) -> NoReturn:
    raise DataError(what, where=where, hint=AGAIN)
