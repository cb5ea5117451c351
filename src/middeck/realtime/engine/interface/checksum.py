"""The check of commands and datagrams: ``source/checksum.h`` from the other side."""

import struct

BASIS, PRIME = 0xCBF29CE484222325, 0x100000001B3
BACK = pow(PRIME, -1, 1 << 64)


def checksum(words: bytes, start: int = BASIS) -> int:
    """FNV-1a over words of eight bytes: whatever changes within one word changes it.

    >>> checksum(bytes(8)) == BASIS * PRIME % (1 << 64)
    True
    """
    found = start
    for (word,) in struct.iter_unpack("<Q", words):
        found = (found ^ word) * PRIME % (1 << 64)
    return found


def start_of(datagram: bytes) -> int:
    """What the check in the first word of ``datagram`` was begun with; noise for what was changed.

    >>> words = bytes(range(16))
    >>> start_of(struct.pack("<Q", checksum(words, 7)) + words)
    7
    """
    found, *words = (word for (word,) in struct.iter_unpack("<Q", datagram))
    for word in reversed(words):
        found = found * BACK % (1 << 64) ^ word
    return found
