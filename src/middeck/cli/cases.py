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

# From this many coordinates on, all modes take longer than anybody waits for the few that are shown.
LARGE = 2000
SPARE = 12  # the comparison of two environments looks beyond what it shows


def find_case(article: str, environment: str) -> tuple[Path, Path]:
    """The two files; the environment is sought in the current folder, then beside the article."""
    body = find_document(article, "article")
    return body, find_document(environment, "environment", beside=body)


def solve_case(article: str, environment: str, overrides: Sequence[str], count: int | None = None) -> Modes:
    """Rest state and modes; of a large article the ``count`` lowest, with a few to spare."""
    files = find_case(article, environment)
    return solve_in(*load_case(*files, overrides), *files, count=count)


def solve_in(structure: Structure, environment: Environment, *files: Path, count: int | None = None) -> Modes:
    """The same for what has been read from ``files``, which errors then name."""
    with reading(*files):
        rest = solve_equilibrium(structure, environment)
        if count is None or rest.model.tree.size <= LARGE:
            return solve_modes(rest)
        return solve_modes(rest, count + SPARE)
