"""OUTPUT4 as text: lines of integers, and of numbers in fields of one width."""

import re
from itertools import pairwise
from typing import NoReturn

import numpy as np

from middeck.errors import DataError
from middeck.files.nastran.output4.heads import COMPLEX, DOUBLE, MatrixHeader, head_of

# 1P,3E24.16: numbers in a line, and their width.
FORMAT = re.compile(r"(?:1P,?)?(\d+)[ED](\d+)\.(\d+)")
# A Fortran exponent of three digits may stand without its letter.
NUMBER = re.compile(r"([+-]?\d+\.\d*|[+-]?\.\d+)(?:[ED]?([+-]\d+)|[ED](\d+))?")
INTEGER = re.compile(r" *-?\d+")
PLAIN = (5, 16)  # format of older files, which state none
PYNASTRAN = (3, 23)  # also Nastran's format in double precision


class TextSource:
    """Lines of a text file."""

    def __init__(self, content: bytes, path: str) -> None:
        self.path, self.matrix, self.at = path, "", 0
        try:
            self.lines = content.decode("ascii").splitlines()
        except UnicodeDecodeError as error:
            raise DataError(
                f"byte {error.start} is no text", where=path, hint="is it an OUTPUT4 file?"
            ) from None
        while self.lines and not self.lines[-1].strip():
            self.lines.pop()
        self.format = PLAIN

    def fail(self, what: str) -> NoReturn:
        """Raise `DataError` with the place."""
        named = f", matrix {self.matrix!r}" if self.matrix else ""
        raise DataError(what, where=f"{self.path}{named}, line {self.at}", hint="write the file once more")

    def head(self) -> MatrixHeader | None:
        """The next header; None at the end of the file."""
        self.matrix = ""
        if self.at == len(self.lines):
            return None
        line = self._line().rstrip()
        widths = (16, 16, 8, 8) if line.endswith("|I16") else (8, 8, 8, 8)
        line = line.removesuffix("|I16")
        edges = np.cumsum([0, *widths])
        numbers = tuple(self._integer(line[a:b]) for a, b in pairwise(edges))
        name, form = line[edges[-1] : edges[-1] + 8], line[edges[-1] + 8 :].strip().upper()
        found = FORMAT.fullmatch(form)
        if form and not found:
            self.fail(f"a format {form!r}")
        self.format = (int(found[1]), int(found[2])) if found else PLAIN
        if not (1 <= self.format[0] <= 100 and 8 <= self.format[1] <= 100):
            self.fail(f"a format {form!r}")
        head = head_of(numbers, name.replace(" ", "").replace("\0", ""), self.fail)
        self.matrix = head.name
        return head

    @property
    def of_pynastran(self) -> bool:
        """Whether pyNastran may have written the matrix, whose sparse columns then have any order."""
        return self.format == PYNASTRAN

    def numbers_ahead(self) -> int:
        """Numbers in the lines before the next integers."""
        width, count, at = self.format[1], 0, self.at
        while at < len(self.lines) and "." in self.lines[at]:
            count += len(self.lines[at].rstrip()) // width
            at += 1
        return count

    def integers_ahead(self) -> bool:
        """Whether the next line has one integer, which begins a run; a line with three begins a column."""
        return self.at < len(self.lines) and len(self.lines[self.at].split()) == 1

    def column(self) -> tuple[int, int, int]:
        """Column, first row (0: sparse) and number of words."""
        column, row, words = self.integers(3)
        if words <= 0:
            self.fail(f"a column of {words} words")
        return column, row, words

    def integers(self, count: int) -> tuple[int, ...]:
        """A line of integers."""
        line = self._line().rstrip()
        width = 8 if len(line) <= 8 * count else 16
        # A length and a row in one number need more digits than a field has.
        width = max(width, len(line)) if count == 1 else width
        if len(line) > width * count:
            self.fail(f"{line.strip()[:40]!r} in place of {count} integers")
        return tuple(self._integer(line[i * width : (i + 1) * width]) for i in range(count))

    def reals(self, head: MatrixHeader, count: int) -> np.ndarray:
        """Lines of numbers."""
        per, width = self.format
        out = np.empty(count)
        for first in range(0, count, per):
            line, most = self._line().rstrip(), min(per, count - first)
            if len(line) != width * most:
                self.fail(f"{len(line)} characters for {most} numbers of {width} each")
            for i in range(most):
                out[first + i] = self._number(line[i * width : (i + 1) * width])
        return out

    def words_per_real(self, head: MatrixHeader) -> int:
        """Words that a number counts for."""
        return 2 if head.kind in DOUBLE else 1

    def dense_count(self, words: int, head: MatrixHeader) -> int:
        """Numbers in a dense column: text counts them, not words."""
        if head.kind in COMPLEX and words % 2:
            self.fail(f"{words} numbers for complex entries")
        return words

    def end_column(self) -> None:
        """A column ends where its numbers do."""

    def end(self) -> None:
        """The column beyond the last: one number."""
        self._number(self._line().strip())

    def _line(self) -> str:
        if self.at == len(self.lines):
            self.at += 1
            self.fail("the file ends within a matrix")
        self.at += 1
        return self.lines[self.at - 1]

    def _integer(self, text: str) -> int:
        if not INTEGER.fullmatch(text):
            self.fail(f"{text.strip()!r} is no integer")
        return int(text)

    def _number(self, text: str) -> float:
        found = NUMBER.fullmatch(text.strip())
        if not found:
            self.fail(f"{text.strip()!r} is no number")
        return float(f"{found[1]}E{found[2] or found[3] or 0}")
