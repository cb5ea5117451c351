"""The check of commands and datagrams: ``source/checksum.h`` from the other side."""

from __future__ import annotations

import struct

BASIS, PRIME = 0xCBF29CE484222325, 0x100000001B3


def checksum(words: bytes, start: int = BASIS) -> int:
    """FNV-1a over words of eight bytes: whatever changes within one word changes it.

    >>> checksum(bytes(8)) == BASIS * PRIME % (1 << 64)
    True
    """
    found = start
    for (word,) in struct.iter_unpack("<Q", words):
        found = (found ^ word) * PRIME % (1 << 64)
    return found
