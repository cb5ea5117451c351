"""An article in an environment, from the names that were typed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from middeck.cli.blame import reading
from middeck.files.documents import find_document, load_case
from middeck.structure.article import Structure
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import solve_equilibrium
from middeck.structure.modes import Modes, solve_modes


def find_case(article: str, environment: str) -> tuple[Path, Path]:
    """The two files; the environment is sought in the current folder, then beside the article."""
    body = find_document(article, "article")
    return body, find_document(environment, "environment", beside=body)


def solve_case(article: str, environment: str, overrides: Sequence[str]) -> Modes:
    """Rest state and modes."""
    files = find_case(article, environment)
    return solve_in(*load_case(*files, overrides), *files)


def solve_in(structure: Structure, environment: Environment, *files: Path) -> Modes:
    """The same for what has been read from ``files``, which errors then name."""
    with reading(*files):
        return solve_modes(solve_equilibrium(structure, environment))
