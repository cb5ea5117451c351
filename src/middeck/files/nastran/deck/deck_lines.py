"""A deck as lines: executive control, case control and bulk data, with everything that it includes."""

import re
from os.path import isfile
from pathlib import Path
from typing import NoReturn

from middeck.files.toml.faults import DocumentFault, raise_fault
from middeck.values import record

_INCLUDE = re.compile(r"\s*INCLUDE\b\s*=?\s*(.*)", re.IGNORECASE | re.DOTALL)
_BEGIN = re.compile(r"\s*BEGIN(\s*[,=]?\s*BULK|\s+SUPER|\s*$)", re.IGNORECASE)
CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
# A path in quotes may go on over so many lines.
PATH_LINES = 8
DEPTH = 32
WHOLE = "is the file whole?"


# A line of a file without its end and its comment, the file, and its number. A plain tuple: there are many.
Line = tuple[str, str, int]


@record(kw_only=True)
class DeckText:
    """The lines of a deck, see `Lines` for ``notes`` and ``unended``."""

    executive: tuple[Line, ...]
    case: tuple[Line, ...]
    bulk: tuple[Line, ...]
    notes: tuple[str, ...]
    unended: Line | None


def read_sections(path: str | Path) -> DeckText:
    """The sections of the deck ``path``; a file with neither CEND nor BEGIN BULK is bulk data alone.

    Raises `ConfigError` as `Lines` does, for part superelements, and for a deck without BEGIN BULK.
    """
    reader = Lines(Path(path))
    begin, *others = (*reader.begins, len(reader.lines))
    head, bulk = reader.lines[:begin], reader.lines[begin + 1 :]
    parts = [at for at in reader.begins if at > begin or "SUPER" in reader.lines[at][0].upper()]
    if parts:
        message = "a second bulk data section: part superelements are not read"
        raise_at(reader.lines[parts[0]], "BEGIN", message, hint="a deck without superelements")
    cend = next((i for i, line in enumerate(head) if CEND.match(line[0])), None)
    if not others:
        if cend is not None:
            raise_at(head[-1], "", "the deck ends here without BEGIN BULK", hint=WHOLE)
        return DeckText(executive=(), case=(), bulk=tuple(head), notes=(), unended=reader.unended)
    at = -1 if cend is None else cend
    return DeckText(
        executive=tuple(head[: at + 1]),
        case=tuple(head[at + 1 :]),
        bulk=tuple(bulk),
        notes=reader.notes,
        unended=reader.unended,
    )


def fault_on(line: Line, key: str, message: str, value: str = "", hint: str = "") -> DocumentFault:
    """A complaint about a line."""
    return DocumentFault(file=line[1], line=line[2], key=key, message=message, value=value, hint=hint)


def raise_at(line: Line, key: str, message: str, value: str = "", hint: str = "") -> NoReturn:
    """Raise `ConfigError` with `fault_on`."""
    raise_fault(fault_on(line, key, message, value, hint))


def _counts(text: str) -> bool:
    """Whether a line is part of a card, no comment and no ENDDATA."""
    return bool(text.split("$")[0].strip()) and not _ENDDATA.match(text)


class Lines:
    """All lines of a deck with what it includes, up to ENDDATA.

    Includes are sought beside the file that names them, then beside the deck. Raises `ConfigError` for a file
    that cannot be read, a deck that ends within a line (what is lost there is unknown), and an include
    that includes itself, or is missing in bulk data.

    Attributes:
        lines: Lines of the deck, without comments, blank ones and ENDDATA.
        begins: Places of the lines that begin bulk data.
        ended: Whether there is an ENDDATA.
        files: All files that were read, the deck first.
    """

    def __init__(self, deck: Path) -> None:
        self.deck = deck
        self.lines: list[Line] = []
        self.begins: list[int] = []
        self.ended = False
        self.files: list[Path] = []
        self._absent: list[DocumentFault] = []
        self._cut: list[str] = []
        self._read(deck, ())
        if self._absent and not self.begins and not any(CEND.match(line[0]) for line in self.lines):
            raise_fault(self._absent[0])

    @property
    def unended(self) -> Line | None:
        """The last line of a deck without ENDDATA."""
        return None if self.ended or not self.lines else self.lines[-1]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on includes: missing before bulk data, or with a last line that does not end."""
        gone = (f"include not found before BEGIN BULK: {f.value} ({f.place})" for f in self._absent)
        return (*gone, *self._cut)

    def _read(self, path: Path, within: tuple[Path, ...]) -> None:
        """Append the lines of ``path`` and of what it includes."""
        self.files.append(path)
        file, number, texts, lines = str(path), 0, text_of(path).split("\n"), self.lines
        while number < len(texts) and not self.ended:
            text = texts[number]
            number += 1
            if "$" in text and not _INCLUDE.match(text):
                text = text[: text.index("$")]
            bare = text.lstrip()
            if not bare:
                continue
            if bare[0] in "IiBbEe":  # what may steer the reader
                include = _INCLUDE.match(text)
                if include:
                    named, number = _quoted(include[1], texts, number)
                    self._include(named, (text, file, number), path, within)
                    if self.ended and any(map(_counts, texts[number:])):
                        what = "this file has an ENDDATA, and cards follow here, which would not count"
                        raise_at((text, file, number), "INCLUDE", what, hint="take that ENDDATA out")
                    continue
                if _BEGIN.match(text):
                    self.begins.append(len(lines))
                elif _ENDDATA.match(text):
                    self.ended = True
                    continue
            lines.append((text, file, number))
        last = texts[-1]
        if last and not (self.ended or last.lstrip().startswith("$") or _INCLUDE.match(last)):
            if within:  # includes of many writers end so
                self._cut.append(f"{file}:{len(texts)}: the include ends within this line; {WHOLE}")
                return
            what, hint = "the file ends within this line", f"{WHOLE} if it is, end the line"
            raise_at((last, file, len(texts)), "", what, hint=hint)

    def _include(self, named: str, line: Line, path: Path, within: tuple[Path, ...]) -> None:
        given = Path(named.replace("\\", "/"))
        found = next((p for p in (path.parent / given, self.deck.parent / given) if isfile(p)), None)
        if found is None:
            hint = f"put it beside {path.name}"
            self._absent.append(fault_on(line, "INCLUDE", "there is no such file", named, hint))
            if self.begins:
                raise_fault(self._absent[-1])
            return
        chain = (*within, path.resolve())
        if found.resolve() in chain or len(chain) > DEPTH:
            raise_at(line, "INCLUDE", "includes itself", named)
        self._read(found, chain)


def text_of(path: Path) -> str:
    """The file's text; a byte that is no ASCII is one character, so that columns stay."""
    here = "", str(path), 0
    try:
        text = path.read_bytes().decode("latin-1")
    except OSError as error:
        raise_at(here, "", f"cannot be read: {error.strerror}", hint="check the path")
    if "\0" in text:
        raise_at(here, "", "a binary file", hint="a Nastran deck is text")
    return text.replace("\r\n", "\n").replace("\r", "\n")


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
