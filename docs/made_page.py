"""Writing a page that a script makes, or checking that the one in the repository is up to date."""

from __future__ import annotations

import sys
from pathlib import Path


def write_or_check(page: Path, text: str, arguments: list[str], script: str) -> int:
    """Write ``text`` to ``page``; with --check compare, and return 1 where the page is stale."""
    if "--check" not in arguments:
        page.write_text(text, encoding="utf-8")
    elif not page.is_file() or page.read_text(encoding="utf-8") != text:
        print(f"{page.name} is stale: run docs/{script}", file=sys.stderr)
        return 1
    return 0
