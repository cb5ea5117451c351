"""An article's document as TOML."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def document_text(document: Mapping[str, Any], head: str) -> str:
    """The document with ``head`` as its comment: keys, tables, tables of tables, then arrays of tables.

    >>> print(document_text({"name": "a", "node": [{"name": "b", "x_m": 1.0}]}, "c"), end="")
    # c
    name = "a"
    <BLANKLINE>
    [[node]]
    name = "b"
    x_m = 1.0
    """
    lines = [f"# {line}".rstrip() for line in head.splitlines()]
    lines += _keys(document)
    for name, table in document.items():
        if isinstance(table, Mapping):
            groups = {key: t for key, t in table.items() if isinstance(t, Mapping)}
            for heading, part in {f"{name}.{k}": t for k, t in groups.items()}.items() or [(name, table)]:
                lines += ["", f"[{heading}]", *_keys(part)]
        elif _is_tables(table):
            for row in table:
                inner = {k: v for k, v in row.items() if _is_tables(v)}
                lines += [
                    "",
                    f"[[{name}]]",
                    *(f"{k} = {_value(v)}" for k, v in row.items() if k not in inner),
                ]
                for key, parts in inner.items():
                    for part in parts:
                        lines += ["", f"[[{name}.{key}]]", *_keys(part)]
    return "\n".join(lines) + "\n"


def _keys(table: Mapping[str, Any]) -> list[str]:
    return [
        f"{key} = {_value(v)}" for key, v in table.items() if not (isinstance(v, Mapping) or _is_tables(v))
    ]


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(f"{json.dumps(str(key))} = {_value(v)}" for key, v in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, np.ndarray):
        return json.dumps(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    return json.dumps(value, ensure_ascii=False)
