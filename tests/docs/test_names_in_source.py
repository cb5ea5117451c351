"""What docstrings and comments name in single backticks exists: a file, or a name in the source."""

from __future__ import annotations

import re
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "middeck"
NAMED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
SAID = re.compile(r'#[^\n]*|"""(?:[^\\]|\\.)*?"""|"([^"\\\n]|\\.)*"|\'([^\'\\\n]|\\.)*\'', re.DOTALL)
OTHERS = {"savefig"}  # of Matplotlib


def names_in(text: str) -> set[str]:
    """Functions, classes, variables, arguments, attributes, and texts that are one word, as of exports."""
    return set(re.findall(r"\w+", SAID.sub(lambda said: _one_word(said[0]), text)))


def _one_word(said: str) -> str:
    return said[1:-1] if said[1:-1].isidentifier() and said[0] != "#" else " "


def test_what_is_only_said_is_no_name() -> None:
    text = """x = 1  # of "y"\ndef f(a): '''Of `b` and "c".'''; return a.d["e"] + "of g" + 'it\\'s h#'"""
    text = text.replace("'''", '"""')
    assert names_in(text) == {"x", "1", "def", "f", "a", "return", "d", "e"}


def test_names_in_backticks_exist() -> None:
    texts = {path: path.read_text() for path in sorted(SOURCE.rglob("*.py"))}
    known = OTHERS | {part for path in texts for part in path.relative_to(SOURCE).with_suffix("").parts}
    known.add("middeck")
    for text in texts.values():
        known |= names_in(text)
    gone = [
        f"{path.relative_to(SOURCE)}:{text.count(chr(10), 0, found.start()) + 1} {found[0]}"
        for path, text in texts.items()
        for found in NAMED.finditer(text)
        if found[1].split(".")[-1] not in known
    ]
    assert gone == []
