"""Values of many fields are given by name, and no two classes of the source share a name."""

from __future__ import annotations

import ast
import collections
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "middeck"
# The most fields that are given by position, as in `record`.
FEW = 4
# Tuples of five fields or more whose fields are all treated alike, as columns.
TUPLES = {
    "BeamState": "arrays of all elements, stacked and picked in every assembly",
    "BushingState": "as those of beams",
    "Inner": "forces of all kinds of elements, added up in steps of one branch",
    "Cut": "numbers along a member, completed and interpolated",
    "_Limits": "a row of the table that the compiled ticks take",
}
SHARED = {"Section": "a member's cross-section in an article's file, and a filter's in `realtime`"}


def classes() -> list[tuple[Path, ast.ClassDef]]:
    return [
        (file.relative_to(SOURCE), node)
        for file in sorted(SOURCE.rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]


def by_position(node: ast.ClassDef) -> bool:
    """Whether it is a named tuple, or a dataclass that takes fields by position."""
    tuples = any(ast.unparse(base).endswith("NamedTuple") for base in node.bases)
    made = [ast.unparse(decorator) for decorator in node.decorator_list]
    return tuples or any("dataclass" in text and "kw_only=True" not in text for text in made)


def test_five_fields_or_more_are_given_by_name() -> None:
    """But in `realtime`, whose long evidence is of the code as it is."""
    found = {
        node.name
        for file, node in classes()
        if file.parts[0] != "realtime"
        and by_position(node)
        and sum(isinstance(part, ast.AnnAssign) for part in node.body) > FEW
    }
    assert found == set(TUPLES)


def test_no_two_classes_share_a_name() -> None:
    """But for private ones, each of which is used in its own file."""
    files = collections.defaultdict(list)
    for file, node in classes():
        files[node.name].append(str(file))
    shared = {name: where for name, where in files.items() if len(where) > 1 and name[0] != "_"}
    assert set(shared) == set(SHARED)
