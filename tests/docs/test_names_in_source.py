"""What docstrings and comments name in single backticks exists: a file, or a name in the source."""

from __future__ import annotations

import ast
import re
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "middeck"
NAMED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")
OTHERS = {"savefig"}  # of Matplotlib


def names_in(tree: ast.AST) -> set[str]:
    """Functions, classes, variables, arguments, attributes, and texts that are one word, as of exports."""
    found: set[str] = set()
    for node in ast.walk(tree):
        for field in ("name", "id", "arg", "attr"):
            found.add(str(getattr(node, field, "")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found.add(node.value)
    return found


def test_names_in_backticks_exist() -> None:
    texts = {path: path.read_text() for path in sorted(SOURCE.rglob("*.py"))}
    known = OTHERS | {part for path in texts for part in path.relative_to(SOURCE).with_suffix("").parts}
    known.add("middeck")
    for text in texts.values():
        known |= names_in(ast.parse(text))
    gone = [
        f"{path.relative_to(SOURCE)}:{text.count(chr(10), 0, found.start()) + 1} {found[0]}"
        for path, text in texts.items()
        for found in NAMED.finditer(text)
        if found[1].split(".")[-1] not in known
    ]
    assert gone == []
