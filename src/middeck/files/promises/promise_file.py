"""Reading a promise: its seal, then the checks of its form."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from middeck.errors import DataError
from middeck.files.json.hash_seal import read_sealed
from middeck.files.promises.form import PROMISE, SealedForm, further_findings
from middeck.files.toml.faults import form_findings


def read_promise(path: str | Path) -> dict[str, Any]:
    """The promise in ``path``.

    Raises `DataError` for another document, one that was changed, and one whose seal fits but that lacks what
    a promise says, by its key.
    """
    found = read_sealed(path, PROMISE)
    _require(found, str(path))
    return found


def _require(found: Mapping[str, Any], path: str) -> None:
    try:
        faults = list(further_findings(SealedForm.model_validate(found)))
    except ValidationError as error:
        faults = form_findings(error, SealedForm)
    if not faults:
        return
    first, more = faults[0], len(faults) - 1
    value = f" = {first.value}" if first.value else ""
    also = f"; and {more} more" if more else ""
    raise DataError(
        f"{'.'.join(map(str, first.path))}{value}: {first.message}{also}",
        where=path,
        hint=first.hint
        or "the document as `middeck promise` wrote it: this one was sealed without being whole",
    )
