"""Arguments of another kind than a public function says, named where the function fails on one.

What a function takes stands in its annotations. They are compared with the arguments only after it has failed
with an error that is not one of this package, so that a call that works costs nothing and is never refused.
"""

from __future__ import annotations

import functools
import inspect
import itertools
import math
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, Literal, ParamSpec, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from middeck.errors import ConfigError
from middeck.values import name_kind

P = ParamSpec("P")
R = TypeVar("R")
# How the kinds that are asked for most are made.
MAKERS = {
    "Compensator": "design_lqg makes one",
    "Environment": "load_environment, or Environment.orbit(), makes one",
    "Equilibrium": "solve_equilibrium makes one",
    "FrequencyResponse": "estimate_response(record) makes one",
    "MeasurementModel": "that of a fit is fit_response(...).model",
    "Modes": "solve_modes makes one",
    "ModelCovariance": "that of a fit is fit_response(...).covariance",
    "Plant": "make_plant, build_plant or measured_plant makes one",
    "Record": "load_record makes one",
    "Refined": "refine makes one",
    "Structure": "load_structure makes one",
    "Tracking": "identification.start_tracking makes one",
}
# Annotations of sequences, and how many of their entries are looked at.
ROWS, MANY = (Sequence, Iterable, list, tuple), 1000
PLAIN = {int: "a whole number", float: "a number", str: "a text", bool: "True or False", type(None): "None"}


def named_kinds(function: Callable[P, R]) -> Callable[P, R]:
    """``function``, with a `ConfigError` that names the argument where one of another kind makes it fail."""
    foreign, fault_of = (AttributeError, TypeError, ValueError, LookupError, ArithmeticError), _fault

    def called(*args: Any, **given: Any) -> Any:
        try:
            return function(*args, **given)
        except foreign as error:
            fault = fault_of(function, args, given)
            if fault is None:
                raise
            raise fault from error

    # In the function's own module, where doctest looks for it: all that it needs is in its closure.
    plain = cast(types.FunctionType, called)
    moved = types.FunctionType(
        plain.__code__, cast(types.FunctionType, function).__globals__, None, None, plain.__closure__
    )
    return cast(Callable[P, R], functools.wraps(function)(moved))


def _fault(function: Callable[..., Any], args: tuple[Any, ...], given: dict[str, Any]) -> ConfigError | None:
    """What is wrong with the first argument that does not fit its annotation; None where all do."""
    try:
        bound, hints = inspect.signature(function).bind(*args, **given), get_type_hints(function)
    except (TypeError, NameError):
        return None
    for name, value in bound.arguments.items():
        hint = hints.get(name, Any)
        kind = inspect.signature(function).parameters[name].kind
        if kind not in (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD) and not fits(
            value, hint
        ):
            return ConfigError(
                f"{name_kind(value)} stands in place of {name}",
                where=getattr(function, "__name__", ""),
                hint=f"{name} is {words(hint)}",
            )
    return None


def fits(value: Any, hint: Any) -> bool:
    """Whether ``value`` is what an annotation asks for; true of annotations that are not known here.

    >>> fits(3, int | None), fits("xyz", tuple[float, float] | None), fits(float("nan"), float)
    (True, False, False)
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, one) for one in inner)
    if origin is Literal:
        return any(type(value) is type(one) and value == one for one in inner)
    if hint is None or hint is type(None):
        return value is None
    if hasattr(hint, "dim_str"):
        return _fits_array(value, hint)
    if hint is float:
        # NaN is not up to infinity, and whole numbers beyond floats are.
        return isinstance(value, Real) and not isinstance(value, bool) and bool(value <= math.inf)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if origin is tuple and Ellipsis not in inner:
        return _is_row(value) and len(value) == len(inner) and all(map(fits, value, inner))
    if isinstance(origin, type):
        return _fits_generic(value, origin, inner)
    return not isinstance(hint, type) or _is_one(value, hint)


def _fits_generic(value: Any, origin: type, inner: tuple[Any, ...]) -> bool:
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(fits(x, inner[-1]) for x in value.values())
    if origin in ROWS:
        return _is_row(value) and all(fits(x, inner[0]) for x in itertools.islice(value, MANY))
    return callable(value) if origin is Callable else _is_one(value, origin)


def _fits_array(value: Any, hint: Any) -> bool:
    try:
        array = np.asarray(value)
    except ValueError:
        return False
    text = hint.dim_str
    kinds = "fiu" + "b" * ("bool" in hint.dtypes) + "c" * ("complex128" in hint.dtypes)
    sizes = "*" in text or "..." in text or array.ndim == len(text.split())
    return array.dtype.kind in kinds and sizes and bool(np.all(np.isfinite(array)))


def _is_row(value: Any) -> bool:
    """Whether it has entries in an order; a text is none of names."""
    if isinstance(value, np.ndarray):
        return value.ndim == 1 and len(value) > 0
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_one(value: Any, kind: type) -> bool:
    try:
        return isinstance(value, kind)
    except TypeError:  # a protocol
        return True


def words(hint: Any) -> str:
    """An annotation in words.

    >>> words(int | None), words(tuple[float, float])
    ('a whole number or None', '2 entries: a number, a number')
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(map(words, inner))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if hasattr(hint, "dim_str"):
        return f"an array of finite numbers [{', '.join(hint.dim_str.split())}]"
    if origin is tuple and Ellipsis not in inner:
        return f"{len(inner)} entries: {', '.join(map(words, inner))}"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"a dict, of which each value is {words(inner[-1])}"
    if origin in ROWS:
        return f"a sequence, of which each entry is {words(inner[0])}"
    name = getattr(hint, "__name__", str(hint))
    article = f"{'an' if name[:1] in 'AEIOaeio' else 'a'} {name}"
    found = PLAIN.get(hint, "a function" if origin is Callable else article)
    return f"{found} ({MAKERS[name]})" if name in MAKERS else found
