"""The log of the gate: a file of lines that has each step before the next begins."""

import datetime
import json
import os
import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from middeck.errors import DataError
from middeck.files.json.hash_seal import SEAL, seal
from middeck.realtime.gate.gate import GateVerdict
from middeck.realtime.gate.steps_without_rig import GateStep
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import hash_law, hash_package
from middeck.values import record

GATE_LOG = "middeck.gate-log/1"
HEAD = f'{{"schema": "{GATE_LOG}"'.encode()


@record(kw_only=True)
class LoggedGate:
    """Record of one gate in a log.

    Attributes:
        package, law: SHA-256 of the package, and of what computes in it (`hash_law`).
        models: Names of the models that it was to be tried on.
        steps: Steps that ended, in order.
        passed: Its verdict; None where the gate was cut off.
        tripped: The trip that the package is to blame for, as in `GateVerdict`; empty for none. A gate that
            was cut off after a trip has written only the blacklist.
    """

    package: str
    law: str
    models: tuple[str, ...]
    steps: tuple[GateStep, ...]
    passed: bool | None
    tripped: str


class GateLog:
    """Appends the steps of one gate to a file, each as it ends: what `examine_package` takes as ``log``.

    Every line is a sealed document with the package's SHA-256, and is on the disk when the call returns.
    Several gates may write to one file at once. Raises `DataError` where ``path`` is another file, or takes
    no more: a line that could not be written whole is as torn as that of a gate that was killed.

    >>> with GateLog("gate.jsonl", package, models) as log:  # doctest: +SKIP
    ...     log.end(examine_package(package, models, log=log))
    """

    def __init__(self, path: str | Path, package: ControllerPackage, models: Iterable[str]) -> None:
        _ends_torn(path)
        self._path = path
        self._about = {"schema": GATE_LOG, "gate": secrets.token_hex(8), "package": hash_package(package)}
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        self._lines = 0
        self._write({"law": hash_law(package), "begins": list(models)})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)

    def __call__(self, step: GateStep) -> None:
        """Add a step that ended."""
        self._write({"step": step.name, "passed": step.passed, "said": step.said})

    def end(self, verdict: GateVerdict) -> None:
        """Add the end of the gate and its verdict."""
        self._write({"ends": verdict.passed, "tripped": verdict.tripped})

    def _write(self, what: Mapping[str, Any]) -> None:
        self._lines += 1
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
        line = json.dumps(seal({**self._about, "line": self._lines, "utc": now, **what})) + "\n"
        # What another gate was writing when it died stays a line of its own.
        data = b"\n" * _ends_torn(self._path) + line.encode()
        try:
            written = os.write(self._file, data)
            os.fsync(self._file)
        except OSError as error:
            raise self._stuck(error.strerror) from None
        if written < len(data):
            raise self._stuck("no more room on the disk")

    def _stuck(self, why: str | None) -> DataError:
        return DataError(f"cannot be written: {why}", where=str(self._path), hint="free the disk")


def load_gate_log(path: str | Path) -> tuple[LoggedGate, ...]:
    """The gates in the log ``path``, in the order in which they began.

    A line that was being written when its gate died is left out: nothing of that gate may follow. Raises
    `DataError` for another file, and for a line that was changed or taken out.
    """
    gates: dict[str, list[dict[str, Any]]] = {}
    for line in _sealed_lines(path):
        gates.setdefault(line["gate"], []).append(line)
    return tuple(_gate(lines) for lines in gates.values())


def _gate(lines: list[dict[str, Any]]) -> LoggedGate:
    first, last = lines[0], lines[-1]
    steps = (line for line in lines if "step" in line)
    return LoggedGate(
        package=first["package"],
        law=first["law"],
        models=tuple(first["begins"]),
        steps=tuple(GateStep(name=s["step"], passed=s["passed"], said=s["said"]) for s in steps),
        passed=last.get("ends"),
        tripped=last.get("tripped", ""),
    )


def _sealed_lines(path: str | Path) -> list[dict[str, Any]]:
    try:
        rows = Path(path).read_bytes().split(b"\n")
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="check the path") from None
    taken: dict[str, int] = {}
    kept: list[dict[str, Any]] = []
    for number, row in enumerate(filter(None, rows), 1):
        line = _parsed(row)
        if line is None:  # torn: of a gate that wrote no more, or its next line has a number too many
            continue
        inside = {key: value for key, value in line.items() if key != SEAL}
        if line.get("schema") != GATE_LOG or seal(inside) != line:
            raise _changed(path, number)
        before = taken.get(line["gate"], 0)
        if line["line"] != before + 1 or ("begins" in line) != (before == 0):
            raise _changed(path, number)
        taken[line["gate"]] = before + 1
        kept.append(line)
    if not kept:
        raise DataError(
            "no log of the gate", where=str(path), hint="a log that the gate wrote, which ends in .jsonl"
        )
    return kept


def _parsed(row: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(row)
    except (ValueError, RecursionError):
        return None
    return line if isinstance(line, dict) else None


def _changed(path: str | Path, number: int) -> DataError:
    return DataError("not a line as the gate wrote it", where=f"{path}:{number}", hint="the file as written")


def _ends_torn(path: str | Path) -> bool:
    """Whether an existing log of the gate ends within a line; raises `DataError` for any other file."""
    if not os.path.lexists(path) or os.path.getsize(path) == 0:
        return False
    with open(path, "rb") as file:
        first = file.readline().rstrip(b"\n")  # which may be torn itself
        if not first or first[: len(HEAD)] != HEAD[: len(first)]:
            raise DataError("is no log of the gate", where=str(path), hint="a new file, or one that it wrote")
        file.seek(-1, os.SEEK_END)
        return file.read(1) != b"\n"
