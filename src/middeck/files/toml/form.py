"""Forms of documents: strict tables, finite numbers in stated ranges, units in the key.

The unit of a value is the ending of its key (``mass_kg``), so that it is written once and read by people,
by the checks (`unit_of`, `stem`) and by ``--set`` (`sheet_name`).

The form of a document by paths: which table, array or value stands at a path.
"""

import itertools
import math
import types
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainValidator
from pydantic_core import PydanticCustomError

from middeck.files.toml.lines import Path

# Key ending -> unit in words; the longest ending that fits counts.
UNITS = {
    "_m": "m",
    "_kg": "kg",
    "_s": "s",
    "_n": "N",
    "_pa": "Pa",
    "_hz": "Hz",
    "_db": "dB",
    "_deg": "deg",
    "_nm": "N m",
    "_nm2": "N m^2",
    "_kg_m": "kg m",
    "_kg_m2": "kg m^2",
    "_kg_m3": "kg/m^3",
    "_kg_per_m": "kg/m",
    "_m_s2": "m/s^2",
    "_rad_s": "rad/s",
    "_rpm": "rpm",
    "_n_per_m": "N/m",
    "_ns_per_m": "N s/m",
    "_nm_per_rad": "N m/rad",
    "_nms_per_rad": "N m s/rad",
    "_nm_per_rthz": "N m/sqrt(Hz)",
    "_rad_per_rthz": "rad/sqrt(Hz)",
    "_m_per_rthz": "m/sqrt(Hz)",
    "_m_per_s_per_rthz": "m/s/sqrt(Hz)",
    "_m_per_s2_per_rthz": "m/s^2/sqrt(Hz)",
    "_rad_per_s_per_rthz": "rad/s/sqrt(Hz)",
    "_nm_per_s": "N m/s",
    "_rad_per_s_per_rts": "rad/s/sqrt(s)",
}

# The data sheet writes out these units and leaves every other SI unit to its head line.
WRITTEN_OUT = frozenset({"_hz", "_db", "_deg", "_s", "_nm", "_rad_s"})
LEFT_OUT = {"gyro_bias_rad_s": "gyro_bias"}  # its one rate without a unit


def sheet_name(key: str) -> str:
    """Name of ``key`` in the data sheet: without its unit, unless the sheet writes that unit out.

    >>> sheet_name("mass_kg"), sheet_name("bounce_hz"), sheet_name("pd_kp_nm_per_rad")
    ('mass', 'bounce_hz', 'pd_kp')
    """
    return LEFT_OUT.get(key, key if _ending(key) in WRITTEN_OUT else stem(key))


def stem(key: str) -> str:
    """The key without its unit ending.

    >>> stem("inertia_kg_m2"), stem("angle_x_deg"), stem("nu")
    ('inertia', 'angle_x', 'nu')
    """
    ending = _ending(key)
    return key[: len(key) - len(ending)]


def unit_of(key: str) -> str:
    """The unit that the ending of ``key`` states; empty for a pure number.

    >>> unit_of("pd_kd_nms_per_rad")
    'N m s/rad'
    """
    return UNITS.get(_ending(key), "")


def _ending(key: str) -> str:
    fitting = [e for e in UNITS if key.endswith(e) and len(key) > len(e)]
    return max(fitting, key=len, default="")


class Form(BaseModel):
    """Base of every table: frozen, no unknown keys, no silent conversion."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, validate_by_name=False)


def within(
    above: float = -math.inf, least: float = -math.inf, below: float = math.inf, most: float = math.inf
) -> AfterValidator:
    """A check for a finite number with ``above < x``, ``least <= x``, ``x < below`` and ``x <= most``."""
    bounds = [(">", above), (">=", least), ("<", below), ("<=", most)]
    allowed = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if math.isfinite(bound))

    def check(value: float) -> float:
        if not math.isfinite(value):
            raise PydanticCustomError("finite", "not a finite number", {"allowed": allowed or "finite"})
        if not (above < value < below and least <= value <= most):
            raise PydanticCustomError("range", "out of range", {"allowed": allowed})
        return value

    return AfterValidator(check)


def whole(least: int, most: int) -> AfterValidator:
    """A check for a whole number from ``least`` to ``most``."""

    def check(value: int) -> int:
        if not least <= value <= most:
            raise PydanticCustomError("range", "out of range", {"allowed": f"{least} to {most}"})
        return value

    return AfterValidator(check)


def rule(holds: Callable[[Any], object], message: str, hint: str = "") -> AfterValidator:
    """A check of a whole value whose parts are valid; ``message`` and ``hint`` report where it fails."""

    def check(value: Any) -> Any:
        if not holds(value):
            raise PydanticCustomError("rule", "{message}", {"message": message, "hint": hint})
        return value

    return AfterValidator(check)


def ascends(numbers: Sequence[float]) -> bool:
    """Whether each number is larger than the one before."""
    return all(a < b for a, b in itertools.pairwise(numbers))


# Principal value over the largest that is zero to rounding: the inertia is singular.
SINGULAR = 1e-9
Finite = Annotated[float, within()]
NotNegative = Annotated[float, within(least=0.0)]
Positive = Annotated[float, within(above=0.0)]
Log10Authority = Annotated[float, within(least=-12.0, most=12.0)]
# TOML has arrays, not tuples: this one conversion is wanted, the items stay strict.
Vector = Annotated[tuple[Finite, Finite, Finite], Field(strict=False)]
Direction = Annotated[Vector, rule(any, "must not be the zero vector")]
Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
NotNegatives = Annotated[tuple[NotNegative, ...], Field(strict=False, min_length=1)]
Positives = Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]
Interval = Annotated[
    tuple[Finite, Finite],
    Field(strict=False),
    rule(ascends, "must rise from the least to the largest"),
]
Band = Annotated[
    tuple[Positive, Positive],
    Field(strict=False),
    rule(ascends, "must ascend, [lowest, highest] in Hz"),
]
Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$")]


def inertia_matrix(value: Any) -> tuple[tuple[float, ...], ...]:
    """Three principal values or a 3x3 matrix, as a matrix; refuses values that no body can have.

    A matrix may be singular, as that of masses on one line; principal values are all positive.
    """
    allowed = {"allowed": "[Ixx, Iyy, Izz], each > 0, or a symmetric, positive semidefinite 3x3 matrix"}
    matrix = real_numbers(value)
    least = -SINGULAR
    if matrix.shape == (3,):
        matrix, least = np.diag(matrix), 0.0
    if matrix.shape != (3, 3):
        raise PydanticCustomError("inertia", "not three numbers nor a 3x3 matrix", allowed)
    if not np.isfinite(matrix).all():
        raise PydanticCustomError("inertia", "not finite", allowed)
    if np.abs(matrix - matrix.T).max() > 1e-12 * np.abs(matrix).max():  # rounding of decimal input
        raise PydanticCustomError("inertia", "not symmetric", allowed)
    if not np.linalg.eigvalsh(matrix)[0] > least * np.abs(matrix).max():
        raise PydanticCustomError("inertia", "not positive definite", allowed)
    return tuple(tuple(row) for row in (0.5 * (matrix + matrix.T)).tolist())


def real_numbers(value: Any) -> np.ndarray:
    """``value`` as an array; empty if it is ragged or holds anything but numbers."""
    try:
        array = np.array(value)
    except ValueError:
        array = np.array([])
    return array.astype(float) if array.dtype.kind in "if" else np.array([])


Inertia = Annotated[Any, PlainValidator(inertia_matrix)]


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


def tables_of(form: type[Form]) -> dict[str, type[Form]]:
    """The tables of a document by their heads, as ``[mesh]``, ``[[node]]`` and ``[section.NAME]``."""
    found: dict[str, type[Form]] = {}

    def walk(table: type[Form], above: str) -> None:
        for key, annotation in keys_of(table).items():
            inner = bare(annotation)
            origin, arguments = get_origin(inner), get_args(inner)
            name = f"{above}{key}.NAME" if origin is dict else f"{above}{key}"
            below = inner if origin is None else bare(arguments[1 if origin is dict else 0])
            if is_form(below):
                found[f"[[{name}]]" if origin is tuple else f"[{name}]"] = below
                walk(below, f"{name}.")

    walk(form, "")
    return found


def is_of_tables(form: type[Form], key: str) -> bool:
    """Whether the document has a table, or tables, under this key at its top."""
    return {f"[{key}]", f"[[{key}]]", f"[{key}.NAME]"} & tables_of(form).keys() != set()


def fixed_length(form: type[Form], path: Path) -> int:
    """Required number of values in an array; zero for any number, and where there is none."""
    annotation: Any = form
    for key in path:
        annotation = child(annotation, key)
    annotation = bare(annotation)
    values = get_args(annotation) if get_origin(annotation) is tuple else ()
    return 0 if Ellipsis in values else len(values)


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
