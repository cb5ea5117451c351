"""Characters of names and units: what the engine's C, ``is_shown`` of ``text.c``, takes on every computer."""

SHOWN = (
    (0x20, 0x7E), (0xA1, 0xAC), (0xAE, 0x24F), (0x250, 0x36F), (0x391, 0x3A1), (0x3A3, 0x3CE), (0x400, 0x4FF),
    (0x2010, 0x2027), (0x2030, 0x205E), (0x2074, 0x208E), (0x2190, 0x22FF), (0x3041, 0x3096),
    (0x30A0, 0x30FF), (0x4E00, 0x9FBB), (0xAC00, 0xD7A3),
    *((c, c) for c in (0x2070, 0x2071, 0x2126, 0x212B, 0x2103)),
)  # fmt: skip
"""First and last of each block in which every place is a character that is shown, in all versions of Unicode
since 5.0 (2006): Python's own table grows with its releases."""


def is_shown(text: str) -> bool:
    """Whether ``text`` holds such characters alone.

    >>> is_shown("N·m"), is_shown("tip\\n")
    (True, False)
    """
    return all(any(first <= ord(c) <= last for first, last in SHOWN) for c in text)
