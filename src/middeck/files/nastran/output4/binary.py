"""OUTPUT4 in binary: Fortran records, each between two equal lengths of its own."""

import struct
from typing import NoReturn

import numpy as np

from middeck.errors import DataError
from middeck.files.nastran.output4.heads import DOUBLE, MatrixHeader, head_of

# Length of a header by the size of its integers.
HEADERS = {4: 24, 8: 48}


def is_binary(content: bytes) -> bool:
    """Whether a file begins with a record rather than with text."""
    return any(byte < 9 or byte > 126 for byte in content[:16])


class BinarySource:
    """Records of a binary file, of the byte order and size of integers in which the first one is a header."""

    def __init__(self, content: bytes, path: str) -> None:
        self.content, self.path, self.matrix = content, path, ""
        self.at = self.stop = 0
        found = [
            (order, size)
            for order in "<>"
            for size, length in HEADERS.items()
            if content[:4] == struct.pack(order + "i", length)
        ]
        if not found:
            self.fail(f"a first record of {content[:4].hex()}, no header in either byte order")
        self.order, self.size = found[0]

    def fail(self, what: str) -> NoReturn:
        """Raise `DataError` with the place."""
        named = f", matrix {self.matrix!r}" if self.matrix else ""
        raise DataError(what, where=f"{self.path}{named}, byte {self.at}", hint="write the file once more")

    def head(self) -> MatrixHeader | None:
        """The next header; None at the end of the file."""
        self.matrix = ""
        if self.at == len(self.content):
            return None
        self._open()
        numbers = self.integers(4)
        letters = self._take(2 * self.size)
        name = letters.decode("latin-1").replace(" ", "").replace("\0", "")
        head = head_of(numbers, name, self.fail)
        self.matrix = name
        self.end_column()
        return head

    def column(self) -> tuple[int, int, int]:
        """Column, first row (0: sparse) and number of words."""
        self._open()
        column, row, words = self.integers(3)
        return column, row, words

    def integers(self, count: int) -> tuple[int, ...]:
        """The next integers of the record."""
        letter = "i" if self.size == 4 else "q"
        return struct.unpack(f"{self.order}{count}{letter}", self._take(count * self.size))

    def reals(self, head: MatrixHeader, count: int) -> np.ndarray:
        """The next numbers of the record."""
        width = 4 * self.words_per_real(head) if self.size == 4 else 8
        with np.errstate(invalid="ignore"):  # damaged ones are refused by the reader
            return np.frombuffer(self._take(count * width), f"{self.order}f{width}").astype(float)

    def words_per_real(self, head: MatrixHeader) -> int:
        """Words that a number takes."""
        return 2 if self.size == 4 and head.kind in DOUBLE else 1

    def dense_count(self, words: int, head: MatrixHeader) -> int:
        """Numbers in a dense column of so many words."""
        count, rest = divmod(words, self.words_per_real(head))
        if rest:
            self.fail(f"{words} words for numbers of two each")
        return count

    def end(self) -> None:
        """Read the record beyond the last column: one number, whatever word count it states."""
        if self.stop - self.at not in (4, 8, 16):
            self.fail(f"{self.stop - self.at} bytes in place of a number")
        self._take(self.stop - self.at)
        self.end_column()

    def end_column(self) -> None:
        """Check that the record is over and that its closing length is the opening one."""
        if self.at != self.stop:
            self.fail(f"{self.stop - self.at} bytes too many in a record")
        begun = self.length
        self.stop = len(self.content)
        if (length := self._marker()) != begun:
            self.fail(f"a record of {begun} bytes that ends as one of {length}")

    def _open(self) -> None:
        self.stop = len(self.content)
        self.length = self._marker()
        if not 0 <= self.length <= len(self.content) - self.at - 4:
            self.fail(f"a record of {self.length} bytes with {len(self.content) - self.at} bytes left")
        self.stop = self.at + self.length

    def _marker(self) -> int:
        return struct.unpack(self.order + "i", self._take(4))[0]

    def _take(self, count: int) -> bytes:
        if not 0 <= count <= self.stop - self.at:
            self.fail(f"{count} bytes expected, {self.stop - self.at} there")
        part = self.content[self.at : self.at + count]
        self.at += count
        return part
