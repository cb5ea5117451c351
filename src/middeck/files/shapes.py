"""The form of a document by paths: which table, array or value stands at a path."""

from __future__ import annotations

import types
from typing import Annotated, Any, Union, get_args, get_origin

from middeck.files.form import Form
from middeck.files.toml_lines import Path


def bare(annotation: Any) -> Any:
    """``annotation`` without ``Annotated`` and without ``| None``."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) in (Union, types.UnionType):
        options = [a for a in get_args(annotation) if a is not type(None)]
        return bare(options[0]) if len(options) == 1 else annotation
    return annotation


def is_form(annotation: Any) -> bool:
    """Whether ``annotation`` is a table of fixed keys."""
    return isinstance(annotation, type) and issubclass(annotation, Form)


def keys_of(form: type[Form]) -> dict[str, Any]:
    """Key in the file to annotation."""
    return {field.alias or name: field.annotation for name, field in form.model_fields.items()}


def child(annotation: Any, key: str | int) -> Any:
    """The annotation below ``annotation`` at ``key``; None if the form has none there."""
    annotation = bare(annotation)
    if is_form(annotation):
        return keys_of(annotation).get(str(key))
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is dict and isinstance(key, str):
        return arguments[1]
    if origin is tuple and isinstance(key, int):
        return arguments[0]  # all our arrays are of one kind
    return annotation if annotation is Any else None


def form_at(form: type[Form], path: Path) -> type[Form] | None:
    """The table at ``path`` of a document of kind ``form``; None if something else stands there."""
    annotation: Any = form
    for key in path:
        annotation = child(annotation, key)
    annotation = bare(annotation)
    return annotation if is_form(annotation) else None
