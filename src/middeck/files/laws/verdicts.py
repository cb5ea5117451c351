"""Verdicts of the gate as sealed files, and the packages that they admit to an engine."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from middeck.errors import ConfigError, DataError
from middeck.files.json.hash_seal import read_sealed

VERDICT = "middeck.gate/4"
ONCE = ("blacklist", "interface", "poles", "vectors", "error bound", "shadow run", "engagement")
ALWAYS = frozenset(ONCE[:5])
"""Steps that are compulsory."""
ON_EACH_MODEL = ("model", "recovery", "dry run")


def load_verdicts(paths: Iterable[str | Path], *, without: Collection[str] = ()) -> dict[str, str]:
    """The hold of each package that has passed, by its SHA-256: what `Supervisor` takes as ``admitted``.

    ``without`` names steps that a verdict may lack: ("dry run", "shadow run", "engagement") takes those on
    paper too, and by default every step counts. Raises `ConfigError` for one of `ALWAYS`; `DataError` for
    another file or a changed one, for a package that did not pass or was not tried so far, and for one
    package beside two holds.
    """
    if over := sorted(ALWAYS & set(without)):
        raise ConfigError(f"a verdict without {', '.join(over)}", hint="every package must pass these steps")
    admitted: dict[str, str] = {}
    for path in [paths] if isinstance(paths, (str, Path)) else paths:
        found = read_sealed(path, VERDICT)
        if not _passed(found):
            raise _refused(found, "did not pass", path, "a verdict that is passed")
        missing = sorted(_left_out(found) - set(without))
        if missing:
            hint = "middeck gate on a rig, or name what may be left out"
            raise _refused(found, f"was tried without {', '.join(missing)}", path, hint)
        if admitted.setdefault(found["package"], found["hold"]) != found["hold"]:
            hint = "the verdicts beside the hold of one engine"
            raise _refused(found, "was judged beside another hold too", path, hint)
    return admitted


def _passed(verdict: dict[str, Any]) -> bool:
    steps = verdict["steps"]
    return verdict["passed"] and bool(steps) and all(step["passed"] for step in steps)


def _left_out(verdict: dict[str, Any]) -> set[str]:
    """Steps that are not there, whatever it says of itself: an older gate may have asked for fewer."""
    there = {step["name"] for step in verdict["steps"]}
    names = verdict["models"] or [""]
    each = {kind for kind in ON_EACH_MODEL for name in names if f"{kind} {name}" not in there}
    return each | (set(ONCE) - there)


def _refused(verdict: dict[str, Any], what: str, path: str | Path, hint: str) -> DataError:
    return DataError(f"package {verdict['name']} {what}", where=str(path), hint=hint)
