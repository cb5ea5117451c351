"""A deck as lines: executive control, case control and bulk data, with everything that it includes."""

from __future__ import annotations

import re
from os.path import isfile
from pathlib import Path
from typing import NamedTuple, NoReturn

from middeck.files.toml.faults import Fault, raise_fault

_INCLUDE = re.compile(r"\s*INCLUDE\b\s*=?\s*(.*)", re.IGNORECASE | re.DOTALL)
_BEGIN = re.compile(r"\s*BEGIN(\s*[,=]?\s*BULK|\s+SUPER|\s*$)", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
# A path in quotes may go on over so many lines.
PATH_LINES = 8
DEPTH = 32


# A line of a file without its end and its comment, the file, and its number. A plain tuple: there are many.
Line = tuple[str, str, int]


class Sections(NamedTuple):
    """The lines of a deck; ``missing`` names includes of executive and case control that are not there."""

    executive: tuple[Line, ...]
    case: tuple[Line, ...]
    bulk: tuple[Line, ...]
    missing: tuple[str, ...]


def read_sections(path: str | Path) -> Sections:
    """The sections of the deck ``path``; a file with neither CEND nor BEGIN BULK is bulk data alone.

    Includes are sought beside the file that names them, then beside the deck. Raises `ConfigError` for a file
    that cannot be read, an include that is missing after BEGIN BULK or includes itself, a part superelement,
    and a deck without BEGIN BULK or ENDDATA: it is cut off.
    """
    reader = _Reader(Path(path))
    reader.read(Path(path), ())
    head, bulk = reader.head, reader.bulk
    cend = next((i for i, line in enumerate(head) if _CEND.match(line[0])), None)
    if not reader.begun:
        if cend is not None:
            cut_off(head[-1], "BEGIN BULK")
        if reader.absent:
            raise_fault(reader.absent[0])
        return Sections((), (), tuple(head), ())
    if not reader.ended:
        cut_off(bulk[-1] if bulk else head[-1], "ENDDATA")
    missing = tuple(f"{fault.value} ({fault.place})" for fault in reader.absent)
    at = -1 if cend is None else cend
    return Sections(tuple(head[: at + 1]), tuple(head[at + 1 :]), tuple(bulk), missing)


def cut_off(last: Line, end: str) -> NoReturn:
    """Refuse a deck whose ``last`` line is not its ``end``."""
    raise_fault(
        Fault(
            file=last[1],
            line=last[2],
            key="",
            message=f"the deck ends here without {end}",
            hint="is the file whole?",
        )
    )


def counts(text: str) -> bool:
    """Whether a line is part of a card, no comment and no ENDDATA."""
    return bool(text.split("$")[0].strip()) and not ENDDATA.match(text)


def no_end(line: Line) -> NoReturn:
    """Refuse an INCLUDE of a file with ENDDATA, behind which cards would not count."""
    message = "this file has an ENDDATA, and cards follow here, which would not count"
    raise_fault(
        Fault(file=line[1], line=line[2], key="INCLUDE", message=message, hint="take that ENDDATA out")
    )


class _Reader:
    """Files read so far: the lines before and after BEGIN BULK."""

    def __init__(self, deck: Path) -> None:
        self.deck = deck
        self.head: list[Line] = []
        self.bulk: list[Line] = []
        self.absent: list[Fault] = []
        self.begun = self.ended = False

    def read(self, path: Path, within: tuple[Path, ...]) -> None:
        """Append the lines of ``path`` and of what it includes."""
        file, number, texts = str(path), 0, text_of(path).split("\n")
        lines = self.bulk if self.begun else self.head
        while number < len(texts) and not self.ended:
            text = texts[number]
            number += 1
            if "$" in text and not _INCLUDE.match(text):
                text = text[: text.index("$")]
            bare = text.lstrip()
            if not bare:
                continue
            if bare[0] in "IiBbEe":  # what may steer the reader
                include = included(text, texts, number)
                if include:
                    named, number = include
                    self._include(named, (text, file, number), path, within)
                    lines = self.bulk if self.begun else self.head
                    if self.ended and any(map(counts, texts[number:])):
                        no_end((text, file, number))
                    continue
                if _BEGIN.match(text):
                    self._begin((text, file, number))
                    lines = self.bulk
                    continue
                if ENDDATA.match(text):
                    self.ended = True
                    continue
            lines.append((text, file, number))

    def _begin(self, line: Line) -> None:
        if self.begun or "SUPER" in line[0].upper():
            raise_fault(
                Fault(
                    file=line[1],
                    line=line[2],
                    key="BEGIN",
                    message="a second bulk data section: part superelements are not read",
                    hint="a deck without superelements",
                )
            )
        self.begun = True

    def _include(self, named: str, line: Line, path: Path, within: tuple[Path, ...]) -> None:
        found = file_beside(named, path, self.deck)
        fault = absent(named, line, path)
        if found is None:
            if self.begun:
                raise_fault(fault)
            self.absent.append(fault)
            return
        chain = (*within, path.resolve())
        if found.resolve() in chain or len(chain) > DEPTH:
            raise_fault(
                Fault(file=line[1], line=line[2], key="INCLUDE", message="includes itself", value=named)
            )
        self.read(found, chain)


def text_of(path: Path) -> str:
    """The file's text; a byte that is no ASCII is one character, so that columns stay."""
    try:
        text = path.read_bytes().decode("latin-1")
    except OSError as error:
        raise_fault(
            Fault(
                file=str(path),
                line=0,
                key="",
                message=f"cannot be read: {error.strerror}",
                hint="check the path",
            )
        )
    if "\0" in text:
        raise_fault(
            Fault(file=str(path), line=0, key="", message="a binary file", hint="a Nastran deck is text")
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def included(text: str, texts: list[str], number: int) -> tuple[str, int] | None:
    """The path that an INCLUDE names, and the number of its last line; None for a line that is none.

    ``texts`` are all of its file, ``number`` that of the line, counted from one.
    """
    found = _INCLUDE.match(text)
    return _quoted(found.group(1), texts, number) if found else None


def file_beside(named: str, path: Path, deck: Path) -> Path | None:
    """The file that ``path`` includes, beside it or else beside the deck; None where neither is there."""
    given = Path(named.replace("\\", "/"))
    return next((place for place in (path.parent / given, deck.parent / given) if isfile(place)), None)


def absent(named: str, line: Line, path: Path) -> Fault:
    """What is wrong with an INCLUDE of a file that is not there."""
    return Fault(
        file=line[1],
        line=line[2],
        key="INCLUDE",
        message="there is no such file",
        value=named,
        hint=f"put it beside {path.name}",
    )


def _quoted(rest: str, texts: list[str], number: int) -> tuple[str, int]:
    """The path of an INCLUDE, in quotes perhaps over several lines, and the number of its last line."""
    rest = rest.strip()
    quote = rest[:1]
    if quote not in ("'", '"'):
        return rest.split("$")[0].split(",")[0].strip(), number
    last = min(number + PATH_LINES, len(texts))
    while quote not in rest[1:] and number < last:
        rest += texts[number].strip()
        number += 1
    return rest[1:].split(quote)[0].strip(), number
