"""Results as canonical JSON text: equal results have equal bytes and are restored to the last bit."""

import base64
import json
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from middeck.errors import DataError

ARRAY, COMPLEX = "array:", "complex:"


def encode_result(result: Any) -> str:
    """JSON with sorted keys: numbers, text, lists, mappings, and arrays of numbers to the last bit.

    Tuples come back as lists. Raises `DataError` for anything else.

    >>> decode_result(encode_result({"rms": np.float64(0.5)}))
    {'rms': 0.5}
    """
    return json.dumps(_plain(result), sort_keys=True, separators=(",", ":"))


def decode_result(text: str) -> Any:
    """The value passed to `encode_result`."""
    return json.loads(text, object_hook=_restored)


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic) and np.asarray(value).dtype.kind in "biufc":
        if isinstance(value, np.generic) and value.dtype.kind in "biuf" and value.dtype.itemsize <= 8:
            return value.item()
        array = np.asarray(value)
        array = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(array.shape)
        return {ARRAY: [array.dtype.str, list(array.shape), base64.b64encode(array.tobytes()).decode()]}
    if isinstance(value, complex):
        return {COMPLEX: [value.real, value.imag]}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in cast("list[Any]", value)]
    if isinstance(value, Mapping):
        found = cast("Mapping[Any, Any]", value)
        if all(isinstance(k, str) and k not in (ARRAY, COMPLEX) for k in found):
            return {k: _plain(v) for k, v in found.items()}
    raise DataError(
        f"a case returned {type(value).__name__}, which the ledger cannot hold",
        hint="numbers, text, arrays of numbers, and lists and mappings (of text) of them",
    )


def _restored(found: dict[str, Any]) -> Any:
    if ARRAY in found:
        kind, shape, body = found[ARRAY]
        return np.frombuffer(base64.b64decode(body), dtype=kind).reshape(shape)
    return complex(*found[COMPLEX]) if COMPLEX in found else found
