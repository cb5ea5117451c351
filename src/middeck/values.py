"""Frozen records: arrays are copied, locked and shape-checked on construction, and shown short.

A list given for a tuple becomes one: a record can be a key, and is what it was.

A stock frozen dataclass that holds arrays fails on ``==`` and ``hash`` and leaves the arrays writable.
``record`` mends the three. Shapes are written in the annotation (jaxtyping); names must agree across the
fields of one record::

    @record
    class Gain:
        K: Float[np.ndarray, "input state"]

    Gain(np.zeros(3))    # ConfigError: Gain.K: shape (3,) does not fit 'input state'
"""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Callable
from typing import (
    Any,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
    overload,
)

import jaxtyping
import numpy as np

from middeck.errors import ConfigError

T = TypeVar("T")
# Arrays of no more numbers and tuples of no more entries are shown as they are; of records within records,
# those whose call is no longer than a line.
SHORT, LINE = 6, 100
# The most fields that a record takes by position: A, B, C, D.
POSITIONAL = 4
# Where a record keeps its own hash, apart from its fields.
HASH = "_hash_of_fields"
# The most sets of shapes of a class that are known to fit, and not looked at again.
MOST_SHAPES = 1000


def require_kind(value: object, kind: type | types.UnionType, what: str, hint: str) -> None:
    """Raise `ConfigError` where ``value`` is of another kind, as one of two swapped arguments is.

    >>> require_kind(1.0, str, "name", "a text")
    Traceback (most recent call last):
    middeck.errors.ConfigError: a float stands in place of the name
      try: a text
    """
    if not isinstance(value, kind):
        raise ConfigError(f"{name_kind(value)} stands in place of the {what}", hint=hint)


def name_kind(value: object) -> str:
    """The kind of a value in words.

    >>> name_kind(None), name_kind([1])
    ('None', 'a list')
    """
    name = type(value).__name__
    return "None" if value is None else f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


@overload
@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def record(cls: type[T]) -> type[T]: ...
@overload
@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def record(*, kw_only: bool) -> Callable[[type[T]], type[T]]: ...
def record(cls: type[T] | None = None, *, kw_only: bool = False) -> Any:
    """Make ``cls`` a frozen dataclass that locks its arrays and compares by value.

    ``@record(kw_only=True)``: fields are given by name only. Raises `TypeError` for a class of five or more
    fields that could be given by position: nobody can read such a call.
    """
    if cls is None:
        return functools.partial(_recorded, kw_only=kw_only)
    return _recorded(cls, kw_only=kw_only)


def _recorded(cls: type[T], *, kw_only: bool) -> type[T]:
    namespace: Any = cls
    user_check = namespace.__dict__.get("__post_init__")

    def post_init(self: Any) -> None:
        _lock_arrays(self)
        user_check(self)

    namespace.__post_init__ = _lock_arrays if user_check is None else post_init
    namespace.__eq__ = _equal
    namespace.__hash__ = _hash
    namespace.__reduce__ = _reduce
    if "__repr__" not in namespace.__dict__:
        namespace.__repr__ = _shown
    made = dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=kw_only)(cls)
    by_position = sum(f.init and not f.kw_only for f in dataclasses.fields(namespace))
    if by_position > POSITIONAL:
        raise TypeError(f"{cls.__name__}: {by_position} fields by position: write @record(kw_only=True)")
    return made


class _ArrayField(NamedTuple):
    """The annotation of an array: kinds of number, and a name or a fixed size of each dimension."""

    name: str
    optional: bool
    kinds: tuple[np.dtype[Any], ...]
    dims: tuple[str | int, ...] | None


def _lock_arrays(self: Any) -> None:
    # Descents make thousands of records a second: no call that can be spared.
    cls, values = type(self), self.__dict__
    fields, tuples, fitting = _array_fields(cls)
    for name in tuples:
        if type(values[name]) is list:
            values[name] = tuple(values[name])
    shapes: list[tuple[int, ...] | None] = []
    for field in fields:
        name, optional, kinds, _ = field
        value = values[name]
        if type(value) is np.ndarray and (not kinds or value.dtype in kinds):
            # One that is locked and no view of what is not, as those of other records are, needs no copy.
            if value.base is not None or value.flags.writeable:
                value = values[name] = value.copy("K")
                value.setflags(write=False)
        elif value is None and optional:
            shapes.append(None)
            continue
        else:
            value = values[name] = _as_locked(cls, field, value)
        shapes.append(value.shape)
    known = tuple(shapes)
    if known not in fitting:
        _check_shapes(cls.__name__, fields, shapes)
        if len(fitting) < MOST_SHAPES:
            fitting.add(known)


def _check_shapes(owner: str, fields: tuple[_ArrayField, ...], shapes: list[tuple[int, ...] | None]) -> None:
    """Raise `ConfigError` where shapes do not fit their fields' annotations, or each other."""
    every = {dim for field in fields for dim in field.dims or ()}
    sizes: dict[str | int, int] = {dim: dim for dim in every if isinstance(dim, int)}
    for field, shape in zip(fields, shapes, strict=True):
        dims = field.dims
        if shape is None or dims is None:
            continue
        fits = len(shape) == len(dims)
        for dim, size in zip(dims, shape, strict=False):
            fits = fits and sizes.setdefault(dim, size) == size
        if not fits:
            raise _misfit(owner, field, shape, sizes)


def _as_locked(cls: type, field: _ArrayField, value: Any) -> np.ndarray:
    """Float, complex, either of them as it comes (an ``Inexact`` annotation), or anything."""
    either = len(field.kinds) == 2
    try:
        kind = np.result_type(np.asarray(value), float) if either else next(iter(field.kinds), None)
        if kind is not None and kind.kind != "c" and np.iscomplexobj(value):  # NumPy would drop a part
            raise TypeError("complex ones where real ones belong")
        array = np.array(value, dtype=kind)
    except (ValueError, TypeError) as error:
        raise ConfigError(
            f"no array of numbers: {error}", where=f"{cls.__name__}.{field.name}", hint="rows of one length"
        ) from None
    array.setflags(write=False)
    return array


def _misfit(
    owner: str, field: _ArrayField, shape: tuple[int, ...], sizes: dict[str | int, int]
) -> ConfigError:
    dims = field.dims or ()
    names = [d for d in dims if isinstance(d, str) and d in sizes] if len(dims) == len(shape) else []
    known = ", ".join(f"{name} = {sizes[name]}" for name in names)
    written = repr(" ".join(map(str, dims)))
    return ConfigError(
        f"shape {shape} does not fit {written}" + (f" ({known})" if known else ""),
        where=f"{owner}.{field.name}",
        hint="one axis for each word; a word stands for one size in the whole record",
    )


@functools.cache
def _array_fields(
    cls: type,
) -> tuple[tuple[_ArrayField, ...], tuple[str, ...], set[tuple[tuple[int, ...] | None, ...]]]:
    """The fields that hold arrays, those of tuples, and the shapes that were found to fit, as yet none."""
    found: dict[str, _ArrayField] = {}
    names, tuples = {f.name for f in dataclasses.fields(cast("Any", cls))}, []
    for name, hint in get_type_hints(cls).items():
        if name in names and tuple in (get_origin(hint), *map(get_origin, get_args(hint))):
            tuples.append(name)
        options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
        for option in options:
            if isinstance(option, type) and issubclass(option, jaxtyping.AbstractArray):
                spec: Any = option
                kinds = {"float64": np.dtype(float), "complex128": np.dtype(complex)}
                given = tuple(kinds[k] for k in kinds if k in spec.dtypes)
                dims = tuple(int(d) if d.isdigit() else d for d in spec.dim_str.split())
                found[name] = _ArrayField(name, type(None) in options, given, dims)
            elif option is np.ndarray:
                found[name] = _ArrayField(name, type(None) in options, (), None)
    return tuple(found.values()), tuple(tuples), set()


def _fields(self: Any) -> tuple[Any, ...]:
    return tuple(getattr(self, f.name) for f in dataclasses.fields(self))


def _equal(self: Any, other: object) -> bool:
    if type(self) is not type(other):
        return NotImplemented
    return self is other or all(_same(a, b) for a, b in zip(_fields(self), _fields(other), strict=True))


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return (
            isinstance(a, np.ndarray)
            and isinstance(b, np.ndarray)
            and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc" and b.dtype.kind in "fc")
        )
    if hasattr(a, "nnz") or hasattr(b, "nnz"):  # sparse; a scipy that nobody needs is not imported
        return type(a) is type(b) and a.shape == b.shape and (a != b).nnz == 0
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(a == b)


def _hash(self: Any) -> int:
    # Nothing in a record changes, and plants and systems are asked for theirs in every cache they pass.
    known = self.__dict__.get(HASH)
    if known is None:
        parts = (
            a.tobytes() if isinstance(a, np.ndarray) else a.data.tobytes() if hasattr(a, "tocsr") else a
            for a in _fields(self)
        )
        known = self.__dict__[HASH] = hash((type(self).__name__, *parts))
    return known


def _shown(self: Any) -> str:
    """The constructor's call, arrays of more than a few numbers by shape and kind only."""
    fields = (f"{f.name}={_brief(getattr(self, f.name))}" for f in dataclasses.fields(self) if f.repr)
    return f"{type(self).__qualname__}({', '.join(fields)})"


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > SHORT:
        shape = " x ".join(map(str, value.shape))
        return f"array({shape}) of {value.dtype}"
    if type(value) is tuple and len(value) > SHORT:
        return f"({', '.join(map(_brief, value[:2]))}, ..., {_brief(value[-1])}: {len(value)} in all)"
    if type(value) is tuple:
        return f"({', '.join(map(_brief, value))}{',' if len(value) == 1 else ''})"
    shown = repr(value)
    if dataclasses.is_dataclass(value) and len(shown) > LINE:
        return f"{type(value).__qualname__}(...)"
    return shown


def _reduce(self: Any) -> tuple[Any, ...]:
    # Unpickled arrays are writable; going through the constructor locks them again.
    return _made, (type(self), {f.name: getattr(self, f.name) for f in dataclasses.fields(self)})


def _made(cls: type[T], fields: dict[str, Any]) -> T:
    return cls(**fields)
