"""Data sets of a universal file by their numbers: set 58 with its functions, any other as lines of text."""

import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from middeck.errors import DataError
from middeck.files.records.uff58 import Dataset, scan_58
from middeck.files.records.uff_lines import AGAIN, MARK, Cursor, to_mark
from middeck.values import record

HEADER = 151
BLANK = b" \t\r\n\0\x1a"  # some programs end a file with the mark of its end
# Units (data set 164) stand near the beginning of a file.
SEARCHED = 1_000_000


@record
class TextSet:
    """A data set other than 58: its number, the line on which its content begins, and its lines."""

    number: int
    line: int
    lines: tuple[str, ...]


def scan(file: Path) -> list[Dataset]:
    """All data sets 58 of ``file``; others are passed over.

    Raises `DataError`, with the line, if the file is cut.
    """
    found = list(_sets(file, (HEADER,)))
    functions = [data for data in found if isinstance(data, Dataset)]
    require_stated([s for s in found if isinstance(s, TextSet)], len(functions), "functions", file)
    return functions


def require_stated(heads: Iterable[TextSet], there: int, what: str, file: Path) -> None:
    """Raise `DataError` for fewer data sets than our own header states: cut between two, a file looks whole.

    ``heads`` are its data sets 151; ``what`` they count, ``there`` are in the file.
    """
    ours = [s.lines[1] for s in heads if len(s.lines) > 2 and s.lines[2].strip() == "middeck"]
    stated = sum(int(found[1]) for line in ours if (found := re.fullmatch(rf"(\d+) {what}", line.strip())))
    if there < stated:
        cut = f"cut: {there} of the {stated} {what} that its header states"
        hint = f"{AGAIN}; if {what} were deleted on purpose, correct the number in data set {HEADER}"
        raise DataError(cut, where=str(file), hint=hint)


def scan_texts(file: Path, wanted: Collection[int]) -> list[TextSet]:
    """The data sets of ``file`` whose numbers are ``wanted``, line by line; raises `DataError` as `scan`."""
    return [found for found in _sets(file, wanted) if isinstance(found, TextSet)]


def _sets(file: Path, wanted: Collection[int]) -> Iterator[Dataset | TextSet]:
    size = file.stat().st_size
    with open(file, "rb") as stream:
        cursor = Cursor(stream, file)
        while stream.tell() < size:
            line = cursor.line("a data set")
            if line.strip(b" ") == b"" and len(line) < len(MARK):
                what = "truncated: the file ends in blanks, as if in the midst of a mark (-1)"
                hint = AGAIN + "; or end it behind the last mark, if it is whole"
                raise DataError(what, where=cursor.where(), hint=hint)
            if not line.strip(BLANK):
                continue
            if line.rstrip() != MARK:
                raise DataError(
                    f"{line[:20].decode('ascii', 'replace').rstrip()!r} stands outside of a data set",
                    where=cursor.where(), hint="a data set begins with -1 in columns 5 and 6",
                )  # fmt: skip
            head = cursor.line("the number of a data set").decode("ascii", "replace")
            number = head[:6].strip()
            if number == "58":
                yield scan_58(cursor, head)
            elif number in map(str, wanted):
                yield _scan_text(cursor, int(number))
            else:
                to_mark(cursor)


def _scan_text(cursor: Cursor, number: int) -> TextSet:
    begin, lines = cursor.number + 1, list[str]()
    while (line := cursor.line("the end of a data set")).rstrip() != MARK:
        lines.append(line.decode("utf-8", "replace").rstrip("\r\n"))
    return TextSet(number, begin, tuple(lines))


def is_si(file: Path) -> bool:
    """Whether data set 164 states SI units, or the file has no such data set."""
    with open(file, "rb") as stream:
        found = re.search(rb"^ {4}-1\s*\n {3}164\s*\n([ \d]{10})", stream.read(SEARCHED), re.MULTILINE)
    return found is None or found.group(1).strip() == b"1"


def few(nodes: list[int]) -> str:
    """The first five nodes."""
    return ", ".join(map(str, nodes[:5])) + (", ..." if len(nodes) > 5 else "")
