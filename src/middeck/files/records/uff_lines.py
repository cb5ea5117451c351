"""Lines, bytes and numbers of a universal file, of whatever data set."""

import re
from pathlib import Path
from typing import IO

from middeck.errors import DataError

MARK = b"    -1"
AGAIN = "copy or export it again"


class Cursor:
    """Walks through the lines and bytes of a file and knows on which line it is."""

    def __init__(self, stream: IO[bytes], file: Path) -> None:
        self.stream, self.file, self.number = stream, file, 0

    def where(self) -> str:
        """File and line, for errors."""
        return f"{self.file}:{self.number}"

    def line(self, awaited: str) -> bytes:
        """The next line; raises `DataError` at the end of the file."""
        text = self.stream.readline(100_000)
        self.number += 1
        if not text:
            raise DataError(f"truncated: the file ends before {awaited}", where=self.where(), hint=AGAIN)
        return text

    def left(self) -> int:
        """Bytes from here to the end of the file."""
        here = self.stream.tell()
        end = self.stream.seek(0, 2)
        self.stream.seek(here)
        return end - here

    def fits(self, size: int) -> bool:
        """Whether ``size`` bytes are left."""
        return 0 <= size <= self.left()


def to_mark(cursor: Cursor) -> int:
    """Pass over the rest of a data set; the byte at which it ends."""
    while True:
        end = cursor.stream.tell()
        if cursor.line("the end of a data set").rstrip() == MARK:
            return end


def fortran(text: str) -> str:
    """A Fortran number as Python reads it: 1.0D+02 has an E, and 1.0-101 lost its own.

    >>> fortran("1.5D-03"), fortran("1.5-103")
    ('1.5e-03', '1.5e-103')
    """
    return re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", re.sub("[dD]", "e", text))
