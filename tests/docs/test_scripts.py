"""Scripts beside the package name modules and names that are there."""

from __future__ import annotations

import ast
import functools
import importlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PLACES = [ROOT / folder for folder in ("benchmarks", "tests", "tests/cross")]
SCRIPTS = sorted(
    p for folder in ("benchmarks", "data", "docs", "examples") for p in (ROOT / folder).rglob("*.py")
)


def imports() -> list[tuple[str, str, list[str]]]:
    """Script, module and names of each import from somewhere."""
    return [
        (str(script.relative_to(ROOT)), node.module, [name.name for name in node.names])
        for script in SCRIPTS
        for node in ast.walk(ast.parse(script.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
    ]


def test_what_scripts_import_is_there() -> None:
    """Of the package, of each other and of the tests."""
    assert SCRIPTS
    for script, module, names in imports():
        if module.split(".")[0] == "middeck":
            held = importlib.import_module(module)
            for name in names:
                if not hasattr(held, name):
                    importlib.import_module(f"{module}.{name}")
        files = [place / f"{module.replace('.', '/')}.py" for place in PLACES]
        for file in filter(Path.is_file, files):
            assert set(names) <= _names_in(file), script


@functools.cache
def _names_in(file: Path) -> set[str]:
    """What a file has at its top."""
    found = set()
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {name.asname or name.name for name in node.names}
        else:
            found |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return found
