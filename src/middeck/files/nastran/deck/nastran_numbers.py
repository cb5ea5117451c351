"""Numbers as Nastran writes them: ``6.894+7``, ``1.D3``, ``.5``; a real has a decimal point."""

import math
import re
import struct
from typing import Any

_REAL = re.compile(r"([+-]?(?:\d+\.\d*|\.\d+))(?:[ED]?([+-]\d{1,4})|[ED](\d{1,4}))?", re.ASCII)
_MANTISSA = re.compile(r"[+-]?(\d*)\.(\d*)", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,15}", re.ASCII)

# Numbers of fewer digits are written by hand, and exact: the narrowest field prints as many.
PRINTED, EXACT = 5, 1e-15


def real(text: str) -> float | None:
    """The real that ``text`` (upper case) writes; None for anything else, and for one without end.

    >>> real("6.894+7"), real("2.74-6"), real("1.D3"), real(".5"), real("7")
    (68940000.0, 2.74e-06, 1000.0, 0.5, None)
    """
    found = _REAL.fullmatch(text)
    if found is None:
        return None
    mantissa, signed, plain = found.groups()
    exponent = signed or plain
    value = float(f"{mantissa}E{exponent}" if exponent else mantissa)
    return value if math.isfinite(value) else None


def in_single(value: Any) -> Any:
    """A value of a field with its reals in single precision; raises `OverflowError` for one beyond that.

    >>> in_single(12.566), in_single(["12.566", "BAR", None]), in_single(3)
    (12.565999984741211, ['1.25659999847412109E+01', 'BAR', None], 3)
    """
    if isinstance(value, list):
        return [in_single(text) for text in value]
    number = real(value) if isinstance(value, str) else value
    if not isinstance(number, float):
        return value
    (single,) = struct.unpack("<f", struct.pack("<f", number))
    return f"{single:.17E}" if isinstance(value, str) else single


def integer(text: str) -> int | None:
    """The integer that ``text`` writes; None for anything else.

    >>> integer("-12"), integer("12."), integer("1 2")
    (-12, None, None)
    """
    return int(text) if _INTEGER.fullmatch(text) else None


def count_digits(text: str) -> int:
    """The digits of a real, zeros at its end counted.

    >>> count_digits("-0.120D+02"), count_digits("7")
    (3, 0)
    """
    found = _MANTISSA.match(text)
    return len("".join(found.groups()).lstrip("0")) if found else 0


def rounding_of(digits: int) -> float:
    """Largest relative rounding error of numbers of which the longest has ``digits``."""
    return max(EXACT, 0.5 * 10.0 ** (1 - digits)) if digits >= PRINTED else EXACT
