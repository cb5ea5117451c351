"""The ledger of a campaign: one SQLite file, one row a case, one process at a time."""

from __future__ import annotations

import contextlib
import hashlib
import json
import sqlite3
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, TypeGuard, cast

from middeck.campaign.encoding import decode_result
from middeck.errors import DataError
from middeck.values import record

APPLICATION = 0x4D49444B
"""SQLite's ``application_id`` of our files: MIDK."""
TABLES = """
create table campaign (key text primary key, value text not null) without rowid;
create table result (
    campaign text not null, case_index integer not null, fault integer not null, body text not null,
    digest blob not null, primary key (campaign, case_index)) without rowid;
"""
NEW = "keep it, and name another ledger"
DIGEST = 64
"""Characters of a SHA-256."""


@record(kw_only=True)
class Outcome:
    """The result of one case, or the text of its error."""

    index: int
    result: Any
    fault: str | None


class Ledger:
    """An open ledger of one campaign; a second process that opens it is refused until this one has ended.

    ``identity``: values that define the campaign, by name; the first opening writes them, later ones agree.

    Raises `DataError` for a file that is no ledger, is damaged, is another campaign's, is in use by another
    process or cannot be written.
    """

    def __init__(self, path: str | Path, identity: Mapping[str, str]) -> None:
        self.path = Path(path)
        with _explained(self.path):
            # The lock falls with its process, however that ends; journal files need no shared memory then.
            self._base = sqlite3.connect(self.path, timeout=0.0, isolation_level=None)
        try:
            with _explained(self.path):
                self._base.execute("pragma locking_mode = exclusive")
                self._base.execute("begin exclusive")
                self._claim(identity)
                self._base.execute("commit")
                self._base.execute("pragma journal_mode = wal")
                self._base.execute("pragma synchronous = normal")
        except BaseException:
            self._base.close()
            raise
        # Rows know their campaign by this hash.
        self.campaign = hashlib.sha256(repr(sorted(identity.items())).encode()).hexdigest()

    def _claim(self, identity: Mapping[str, str]) -> None:
        application = self._base.execute("pragma application_id").fetchone()[0]
        tables = self._base.execute("select count(*) from sqlite_master").fetchone()[0]
        if not tables and not application:
            for statement in TABLES.split(";"):
                self._base.execute(statement)
            self._base.executemany("insert into campaign values (?, ?)", sorted(identity.items()))
            self._base.execute(f"pragma application_id = {APPLICATION}")
            return
        if application != APPLICATION:
            raise DataError("a SQLite file, but no ledger of a campaign", where=str(self.path), hint=NEW)
        if self._base.execute("pragma quick_check").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("database disk image is malformed")
        known = dict(self._base.execute("select key, value from campaign"))
        if known != dict(identity):
            was = "; ".join(_changes("", known, dict(identity)))
            raise DataError(f"the ledger is another campaign's: {was}", where=str(self.path), hint=NEW)

    def __enter__(self) -> Ledger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._base.close()

    def done(self) -> dict[int, bool]:
        """Index of each case in the ledger, and whether it is a fault."""
        with _explained(self.path):
            rows = self._base.execute(
                "select case_index, fault from result where campaign = ?", (self.campaign,)
            )
            return {index: bool(fault) for index, fault in rows}

    def add(self, index: int, body: str, *, fault: bool) -> None:
        """Keep a case's row; an existing row stays."""
        row = (self.campaign, index, int(fault), body, _digest(self.campaign, index, fault, body))
        with _explained(self.path):
            self._base.execute("insert or ignore into result values (?, ?, ?, ?, ?)", row)

    def forget_faults(self) -> None:
        """Let cases that failed run again."""
        with _explained(self.path):
            self._base.execute("delete from result where campaign = ? and fault", (self.campaign,))

    def outcomes(self) -> tuple[Outcome, ...]:
        """All rows in the order of the cases; `DataError` for a damaged one."""
        return tuple(
            Outcome(index=i, result=None if fault else decode_result(body), fault=body if fault else None)
            for i, fault, body in self._rows()
        )

    def digest(self) -> str:
        """Hash of all rows: equal for equal results, however often the campaign was interrupted."""
        found = hashlib.sha256()
        for index, fault, body in self._rows():
            found.update(_digest(self.campaign, index, fault, body))
        return found.hexdigest()

    def _rows(self) -> Iterator[tuple[int, bool, str]]:
        query = "select case_index, fault, body, digest from result where campaign = ? order by case_index"
        with _explained(self.path):
            rows = self._base.execute(query, (self.campaign,)).fetchall()
        for index, fault, body, digest in cast("list[tuple[int, int, str, bytes]]", rows):
            if digest != _digest(self.campaign, index, bool(fault), body):
                raise _damaged(self.path, f"the row of case {index} is not as it was written")
            yield index, bool(fault), body


def _changes(name: str, was: object, now: object) -> Iterator[str]:
    """Differences, by the names of keys; rows of equal lists one by one."""
    was, now = _parsed(was), _parsed(now)
    if isinstance(was, dict) and isinstance(now, dict):
        for key in sorted({*was, *now}):
            if was.get(key) != now.get(key):
                yield from _changes(f"{name}.{key}".lstrip("."), was.get(key), now.get(key))
    elif _is_table(was) and _is_table(now) and len(was) == len(now):
        for a, b in zip(was, now, strict=True):
            if a != b:
                yield from _changes(name, a, b)
    else:
        yield f"{name} {_short(was)}, now {_short(now)}"


def _parsed(value: object) -> object:
    with contextlib.suppress(ValueError):  # a text that only begins like JSON
        return json.loads(value) if isinstance(value, str) and value[:1] in ("{", "[") else value
    return value


def _is_table(value: object) -> TypeGuard[list[object]]:
    return isinstance(value, list) and all(isinstance(row, list) for row in value)


def _short(value: object) -> str:
    if isinstance(value, list):
        return " ".join(_short(x) for x in value)[:80]
    text = "nothing" if value is None else str(value)
    return text[:12] if len(text) == DIGEST and set(text) <= set("0123456789abcdef") else text[:80]


def _digest(campaign: str, index: int, fault: bool, body: str) -> bytes:
    return hashlib.blake2b(repr((campaign, index, fault, body)).encode(), digest_size=16).digest()


def _damaged(path: Path, why: str) -> DataError:
    return DataError(f"the ledger is damaged: {why}", where=str(path), hint=NEW + "; or bring back a copy")


@contextlib.contextmanager
def _explained(path: Path) -> Generator[None, None, None]:
    """SQLite's errors in words."""
    try:
        yield
    except sqlite3.Error as error:
        text, name = str(error), getattr(error, "sqlite_errorname", "")
        if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
            raise DataError(
                "another process runs a campaign in this ledger: two would compute every case twice",
                where=str(path),
                hint="wait for its end, or name another ledger",
            ) from error
        if name.startswith(("SQLITE_FULL", "SQLITE_IOERR", "SQLITE_CANTOPEN", "SQLITE_READONLY")):
            raise DataError(
                f"the ledger cannot be written ({text})",
                where=str(path),
                hint="a folder that exists, may be written and has room; cases in the ledger are kept, and "
                "the same call continues after them",
            ) from error
        raise _damaged(path, text) from error
