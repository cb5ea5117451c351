"""Write docs/reference/cli.md from the help of every verb; with --check only say whether it is stale."""

from __future__ import annotations

import sys
from pathlib import Path

from click.testing import CliRunner
from made_page import write_or_check

from middeck.cli.app import VERBS, app

PAGE = Path(__file__).parent / "reference" / "cli.md"
HEAD = """\
# Command line

One verb for each arrow; files in, files out. `--json` prints one document for machines, `--set key=value`
[overrides any input](../how-to/override-a-value.md), `--debug` shows the traceback of an error. The exit
codes are those of [errors](errors.md). This page is written by `docs/make_cli_reference.py`.
"""


def help_of(*verb: str) -> str:
    """What ``middeck VERB --help`` prints in a terminal of 80 columns."""
    shown = CliRunner().invoke(app, [*verb, "--help"], prog_name="middeck", terminal_width=80).output
    return "\n".join(line.rstrip() for line in shown.rstrip().splitlines())


def page() -> str:
    """The whole page."""
    parts = [HEAD, f"```text\n{help_of()}\n```\n"]
    parts += [f"## middeck {verb}\n\n```text\n{help_of(verb)}\n```\n" for verb in VERBS]
    return "\n".join(parts)


def main(arguments: list[str]) -> int:
    """Write the page, or compare it; 1 where it is stale."""
    return write_or_check(PAGE, page(), arguments, Path(__file__).name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
