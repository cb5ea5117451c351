"""The fault of a line that is not TOML, in words, and its remedy."""

import re
import tomllib
from typing import NamedTuple

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
KEY = r"^\s*(?P<key>[\w.\"-]+)\s*"
HEAD = r"(?!\s*(?:\[[^\[\]]+\]|\[\[[^\[\]]+\]\])\s*(?:#|$))"  # not the head of a closed table
BARE = r"^[^\"'#]*"  # before any text or comment
NEAR = 3  # lines above the one that the parser names: it notices an open bracket only later


class Trouble(NamedTuple):
    """A kind of syntax fault: its pattern, description and cure, in its named groups."""

    pattern: str
    what: str
    cure: str


TROUBLES = (
    Trouble(r"[\u201c\u201d\u201e\u2018\u2019\u00ab\u00bb]", "typographic quotes", 'straight quotes: "text"'),
    Trouble(BARE + r"[\u2010-\u2015\u2212]\s*[\d.]", "a typographic minus", "a hyphen: -"),
    Trouble(BARE + r"[\u00a0\u2007\u2009\u200b\u202f]", "a space that is none to TOML",
            "a plain space in its place"),
    Trouble(KEY + rf"=\s*(?P<n>{NUMBER})[dD](?P<e>[-+]?\d+)", "an exponent of Fortran", "{key} = {n}e{e}"),
    Trouble(KEY + rf"=\s*{NUMBER}\s*[*/^]", "arithmetic", "the number that it gives"),
    Trouble(KEY + r"=\s*[-+]?\d{1,3}(?:(?:,\d{3}){2,}|(?: \d{3})+)(?!\d)", "separators in a number",
            "leave them out, or take _ for them: 70_000"),
    Trouble(KEY + r"=\s*[-+]?(?P<w>(?i:nan|inf|infinity))\b", "'{w}', which is no number here",
            "a finite number"),
    Trouble(
        KEY + r"=\s*(?P<whole>[-+]?[1-9]\d{0,2}),(?P<part>\d{3})\s*(?:#.*)?$",
        "a comma in a number",
        "{key} = {whole}.{part} if it is a decimal comma, {key} = {whole}{part} if it parts thousands",
    ),
    Trouble(
        KEY + r"=\s*(?P<whole>[-+]?\d+),(?P<part>\d+(?:[eE][-+]?\d+)?)\s*(?:#.*)?$",
        "a decimal comma",
        "a decimal point: {key} = {whole}.{part}",
    ),
    Trouble(KEY + r"=\s*(?P<sign>[-+]?),(?P<part>\d+(?:[eE][-+]?\d+)?)\s*(?:#.*)?$",
            "a decimal comma", "a decimal point: {key} = {sign}0.{part}"),
    Trouble(KEY + r"=\s*\{.*=\s*[-+]?\d*,\d", "a decimal comma in a table", "a decimal point: 0.25"),
    Trouble(
        KEY + rf"=\s*(?P<n>{NUMBER})\s*(?P<unit>[A-Za-z%\u00b0\u00b5\u03bc][^#,]*)$",
        "a unit after the number",
        "the number alone, {key} = {n}: the unit is the ending of the key",
    ),
    Trouble(KEY + r"=\s*(?P<sign>[-+]?)(?P<n>\.\d\S*)", "a number without a digit before its point",
            "{key} = {sign}0{n}"),
    Trouble(KEY + r"=\s*(?P<n>[-+]?\d+)\.(?P<e>[eE][-+]?\d+)?\s*(?:#.*)?$",
            "a number without a digit after its point", "{key} = {n}.0{e}"),
    Trouble(KEY + r"=\s*[-+]?0\d", "a number that begins with 0", "leave the leading zeros out"),
    Trouble(KEY + r"=\s*(?:#.*)?$", "a key without a value", "{key} = and its value, or leave the line out"),
    Trouble(KEY + r"=\s*(?P<w>True|False|TRUE|FALSE)\b", "'{w}'", "true or false, in small letters"),
    Trouble(KEY + r"=\s*[^\"'#]*;\s*(?:#.*)?$", "a semicolon at the end", "leave it out"),
    Trouble(KEY + r"=\s*\"[^\"]*\\", "a backslash in double quotes", "forward slashes, or single quotes"),
    Trouble(KEY + r"=\s*(?P<q>[\"'])(?P<t>[^\"'#]*?)\s*(?:#.*)?$", "a quote that is not closed",
            "{key} = {q}{t}{q}"),
    Trouble(KEY + r"=\s*(?P<t>[A-Za-z_][\w ./-]*?)(?P<q>[\"'])?\s*(?:#.*)?$", "a text without quotes",
            '{key} = "{t}"'),
    Trouble(KEY + r"=\s*\[[^\]#]*\d,0\d", "decimal commas in an array", "decimal points: [0.06, 0.1]"),
    Trouble(KEY + r"=\s*\[[^\]#]*$", "an array that is not closed", "] at its end"),
    Trouble(KEY + r"=.*\bnp\.\w+\((?P<n>[^()]*)\)", "a number as NumPy prints it", "the number alone: {n}"),
    Trouble(HEAD + r"^\s*\[{1,2}(?P<name>[\w.\s-]+)(?:\]?|\]{1,2}.+)\s*(?:#.*)?$",
            "the head of a table that is not closed", "[{name}], or [[{name}]] for one of several"),
    Trouble(KEY + r":\s*(?P<v>\S.*)$", "a colon where TOML has =", "{key} = {v}"),
    Trouble(r"^\s*(?://|%|;|--|/\*)", "a comment that TOML does not know", "# before a comment"),
    Trouble(HEAD + r"^[^=#]*$", "neither a table nor key = value",
            "key = value, [table], or # before a comment"),
)  # fmt: skip


def explain(text: str, line: int, error: str) -> tuple[int, str, str]:
    """The faulty line, its fault and the cure, for the parser's message on ``line``.

    >>> explain("schema = 1\\nbounce_hz = 0,25\\n", 2, "Expected newline")
    (2, "a decimal comma in 'bounce_hz = 0,25'", 'a decimal point: bounce_hz = 0.25')
    """
    lines = text.splitlines()
    twice = _twice(lines, line, error)
    if twice is not None:
        return line, *twice
    for number in range(line, max(0, line - 1 - NEAR), -1):
        content = lines[number - 1] if number <= len(lines) else ""
        found = None if _sound(content) else _trouble(content)
        if found is not None:
            return number, f"{found[0]} in '{_shown(content)}'", found[1]
    shown = f" in '{_shown(lines[line - 1])}'" if 0 < line <= len(lines) and lines[line - 1].strip() else ""
    return (
        line,
        f"{error}{shown}",
        "mend this line or the one before it; a file that ends here may be cut off",
    )


def _sound(content: str) -> bool:
    """Whether a line is TOML by itself, even if its value is not allowed (nan, inf)."""
    try:
        tomllib.loads(content)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _trouble(content: str) -> tuple[str, str] | None:
    for trouble in TROUBLES:
        found = re.search(trouble.pattern, content)
        if found is not None:
            groups = {name: value or "" for name, value in found.groupdict().items()}
            return trouble.what.format(**groups), trouble.cure.format(**groups)
    return None


def _twice(lines: list[str], line: int, error: str) -> tuple[str, str] | None:
    """A key or table that is there already; TOML has each once."""
    if not re.search(r"twice|overwrite|redefine|mutate", error) or not 0 < line <= len(lines):
        return None
    content = lines[line - 1].strip()
    head = re.match(r"\[{1,2}\s*([^\]]+?)\s*\]", content)
    if head is not None:
        name = head[1]
        first = next(
            (n for n, x in enumerate(lines, 1) if re.match(rf"\s*\[+\s*{re.escape(name)}\s*\]", x)), 0
        )
        return f"table [{name}] is there twice, first on line {first}", (
            f"one table with all its keys; of what there may be several, [[{name}]] each time"
        )
    key = content.partition("=")[0].strip()
    return f"{key!r} is there twice in its table", "leave one of them out"


def _shown(content: str) -> str:
    content = content.strip()
    return content if len(content) <= 60 else content[:57] + "..."
