"""Numbers that people write with a decimal comma, or in quotes."""

import re

NUMBER = re.compile(r"(?P<sign>[-+]?)(?P<whole>\d*)[.,]?(?P<part>\d*)(?P<power>(?:[eE][-+]?\d+)?)")


def as_number(text: str) -> str:
    """The number of ``text`` as TOML has it; empty if it is none.

    >>> as_number("-,5"), as_number("2,50e3"), as_number("4"), as_number("four")
    ('-0.5', '2.50e3', '4.0', '')
    """
    found = NUMBER.fullmatch(text.strip())
    if found is None or not (found["whole"] or found["part"]):
        return ""
    whole = found["whole"].lstrip("0") or "0"
    return f"{found['sign']}{whole}.{found['part'] or '0'}{found['power']}"
