"""Write data sets 58 and 58b."""

from typing import IO

import numpy as np

from middeck.errors import DataError
from middeck.files.records.uff58 import NONE, Place
from middeck.files.records.uff_lines import MARK
from middeck.values import record

REAL, COMPLEX = 4, 6  # double precision


@record(kw_only=True)
class Header:
    """Header of a data set 58: see `middeck.files.records.uff58.Dataset`."""

    texts: tuple[str, ...]
    kind: int
    response: Place
    reference: Place
    axis: int  # 17 time, 18 frequency
    axis_unit: str
    quantity: int
    unit: str
    divisor: int = 0
    divisor_unit: str = ""


def write_count(stream: IO[bytes], functions: int) -> None:
    """A data set 151 that states how many data sets 58 follow: a file cut between two would look whole."""
    lines = (b"   151", b"", f"{functions} functions".encode(), b"middeck", b"", b"", b"middeck", b"")
    stream.write(b"\n".join((MARK, *lines, MARK, b"")))


def write_58(
    stream: IO[bytes], header: Header, first: float, step: float | None, values: np.ndarray, *, binary: bool
) -> None:
    """One data set of real or complex ``values`` in double precision.

    Evenly spaced; with ``step`` None, rows of an abscissa and complex parts that stand for it. ASCII has 13
    digits, 7 of an abscissa; binary, little endian, has all.
    """
    is_complex = np.iscomplexobj(values) or step is None
    numbers = np.ascontiguousarray(values).view(float).ravel()
    stream.write(MARK + b"\n" + _opening(numbers.size * 8 if binary else None))
    for text in header.texts:
        stream.write(_cut(text, 80).encode() + b"\n")
    ends = "".join(_place(p) for p in (header.response, header.reference))
    stream.write(f"{header.kind:5d}{0:10d}{0:5d}{0:10d}{ends}\n".encode())
    data = COMPLEX if is_complex else REAL
    spacing = f"{int(step is not None):10d}{_e13(first)}{_e13(step or 0.0)}{_e13(0.0)}"
    stream.write(f"{data:10d}{len(values):10d}{spacing}\n".encode())
    stream.write(_axis(header.axis, header.axis_unit))
    stream.write(_axis(header.quantity, header.unit))
    stream.write(_axis(header.divisor, header.divisor_unit))
    stream.write(_axis(0, ""))
    if binary:
        stream.write(numbers.astype("<f8").tobytes())
        stream.write(b"\n" + MARK + b"\n")
        return
    on_line = 4 if step is not None else 3
    for row in range(0, len(numbers), on_line):
        line = [f"{x:20.12e}" for x in numbers[row : row + on_line]]
        line[:1] = [_e13(numbers[row])] if step is None else line[:1]
        stream.write("".join(line).encode() + b"\n")
    stream.write(MARK + b"\n")


def _opening(size: int | None) -> bytes:
    if size is None:
        return b"    58\n"
    # Little endian (1), IEEE (2), eleven lines of header.
    return f"{58:6d}b{1:6d}{2:6d}{11:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}\n".encode()


def _place(place: Place) -> str:
    return f" {_cut(stated(place.name), 10):<10}{place.number:10d}{place.direction:4d}"


def _axis(quantity: int, unit: str) -> bytes:
    return f"{quantity:10d}{0:5d}{0:5d}{0:5d} {NONE:<20} {_cut(stated(unit), 20):<20}\n".encode()


def _e13(x: float) -> str:
    """Thirteen columns with as many digits as they hold: two more than E13.5 asks for."""
    return f"{x:13.6e}"


def stated(text: str) -> str:
    """A name or a unit as the format has it, `NONE` for an empty one.

    Raises `DataError` where it is called that, and where it ends in blanks, which would be lost.
    """
    if text == NONE or text != text.strip():
        raise DataError(f"{text!r} is no name in a universal file", hint="another name, or write .npz or .h5")
    return text or NONE


def _cut(text: str, width: int) -> str:
    if len(text) > width or "\n" in text:
        raise DataError(f"{text!r} is longer than {width} characters", hint="shorten the name or the unit")
    return text
