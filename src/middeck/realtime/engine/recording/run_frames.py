"""The form of a run file: a head twice, then frames, each with its number, its length and CRC-32.

Head: magic, format, length and CRC-32 of a JSON document, the document, zeros up to a multiple of eight
bytes; all of it a second time. A frame: the first eight bytes of the document's SHA-256, kind, length,
number from 1, first sequence number and count of what it holds, CRC-32 of the content, CRC-32 of the frame's
own forty-four bytes, the content, zeros. A frame that does not fit is passed over by looking for the next.
"""

import hashlib
import json
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from typing import Any

from middeck.errors import DataError
from middeck.realtime.package.package_bytes import pad_bytes
from middeck.values import record

MAGIC, FORMAT, SCHEMA = b"MIDDECKR", 1, "middeck.run/1"
_HEAD = struct.Struct("<8sIII")
_FRAME = struct.Struct("<8sIIQQQII")
_TESTED = _FRAME.size - 4
LONGEST_HEAD, LONGEST = 1 << 20, 1 << 28


class Kind(IntEnum):
    """What a frame holds: records of the ring, events, records from before a trip, a note, the end."""

    RECORDS = 1
    EVENTS = 2
    PRETRIP = 3
    NOTE = 4
    END = 5


@record(kw_only=True)
class Head:
    """What stands before the frames: the document, the mark of its frames, where they ``begin``, and whether
    both copies are whole."""

    document: dict[str, Any]
    mark: bytes
    begin: int
    both: bool


@record(kw_only=True)
class Frame:
    """A frame from byte ``start`` to ``end``; ``content`` is None where its CRC-32 is wrong."""

    kind: int
    number: int
    first: int
    count: int
    start: int
    end: int
    content: bytes | None


@record
class Unreadable:
    """Bytes ``start`` to ``end`` that belong to no frame; ``torn`` where the file ends in them."""

    start: int
    end: int
    torn: bool


def encode_head(document: dict[str, Any]) -> bytes:
    """The bytes before the first frame."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    return 2 * pad_bytes(_HEAD.pack(MAGIC, FORMAT, len(text), zlib.crc32(text)) + text)


def encode_frame(mark: bytes, kind: Kind, number: int, first: int, count: int, content: bytes) -> bytes:
    """One frame; ``mark`` is that of `head_mark`."""
    front = _FRAME.pack(mark, kind, len(content), number, first, count, zlib.crc32(content), 0)[:_TESTED]
    return pad_bytes(front + struct.pack("<I", zlib.crc32(front)) + content)


def head_mark(document: dict[str, Any]) -> bytes:
    """The first bytes of every frame of a file with this head."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    return hashlib.sha256(text).digest()[:8]


def decode_head(data: bytes, where: str) -> Head:
    """The head of a file.

    Raises `DataError` for what is no run file, for another format, and where neither copy is whole.
    """
    places = [0, data.find(MAGIC, 1)] if data.startswith(MAGIC) else [data.find(MAGIC)]
    found = [_head_at(data, place) for place in places if 0 <= place < 2 * LONGEST_HEAD]
    whole = [one for one in found if one is not None]
    if not whole:
        _say_what_it_is(data, where)
    text, document, size, place = whole[0]
    return Head(
        document=document,
        mark=hashlib.sha256(text).digest()[:8],
        begin=place + size if place else 2 * size,
        both=len(whole) == 2,
    )


def frames_in(data: bytes, begin: int, mark: bytes) -> Iterator[Frame | Unreadable]:
    """Every frame from ``begin`` on, and the bytes between them that are none."""
    at = begin
    while at < len(data):
        frame = _frame_at(data, at, mark)
        if frame is None:
            following = _next_frame(data, at, mark)
            yield Unreadable(at, following, torn=following == len(data))
            at = following
        else:
            yield frame
            at = frame.end


def _say_what_it_is(data: bytes, where: str) -> None:
    if not data:
        raise DataError("the file is empty", where=where, hint="record it again")
    if not data.startswith(MAGIC):
        raise DataError("no run of an engine: it begins otherwise", where=where, hint="a file of a recorder")
    if len(data) >= _HEAD.size:
        form = int(_HEAD.unpack_from(data)[1])
        if form != FORMAT:
            raise DataError(
                f"format {form}; this program reads {FORMAT}", where=where, hint="a newer middeck"
            )
    raise DataError(
        "both copies of its head are damaged or cut short: nothing says what its numbers are", where=where,
        hint="the shared file of the engine, if it is still there",
    )  # fmt: skip


def _head_at(data: bytes, place: int) -> tuple[bytes, dict[str, Any], int, int] | None:
    if place + _HEAD.size > len(data):
        return None
    magic, form, length, check = _HEAD.unpack_from(data, place)
    text = data[place + _HEAD.size : place + _HEAD.size + min(length, LONGEST_HEAD)]
    if magic != MAGIC or form != FORMAT or len(text) != length or zlib.crc32(text) != check:
        return None
    try:
        document = json.loads(text)
    except ValueError:
        return None
    size = -(-(_HEAD.size + length) // 8) * 8
    return (text, document, size, place) if isinstance(document, dict) else None


def _frame_at(data: bytes, at: int, mark: bytes) -> Frame | None:
    """The frame at ``at``; None where there is none, or not all of it."""
    if at + _FRAME.size > len(data):
        return None
    found, kind, length, number, first, count, check, own = _FRAME.unpack_from(data, at)
    if found != mark or zlib.crc32(data[at : at + _TESTED]) != own or length > LONGEST:
        return None
    begin = at + _FRAME.size
    end = at + -(-(_FRAME.size + length) // 8) * 8
    if end > len(data):
        return None
    content = data[begin : begin + length]
    whole = zlib.crc32(content) == check and not any(data[begin + length : end])
    return Frame(
        kind=kind, number=number, first=first, count=count, start=at, end=end,
        content=content if whole else None,
    )  # fmt: skip


def _next_frame(data: bytes, at: int, mark: bytes) -> int:
    place = data.find(mark, at + 1)
    while place >= 0 and _frame_at(data, place, mark) is None:
        place = data.find(mark, place + 1)
    return place if place >= 0 else len(data)
