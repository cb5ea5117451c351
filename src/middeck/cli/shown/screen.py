"""Results on stdout: one JSON document, or tables; warnings on stderr."""

import os
import sys
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any, TextIO

import click

from middeck.cli.shown.advice import in_options

WITHOUT = """
may be off: estimated change of the frequency by the geometric stiffness that components lack"""


class ScreenTable:
    """A titled table of texts; columns of numbers are set flush right."""

    def __init__(self, title: str, headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self.title = title
        self.headers = list(headers)
        self.rows = [list(row) for row in rows]

    @property
    def flush_right(self) -> list[bool]:
        """Whether each column holds numbers."""
        columns = range(len(self.headers))
        return [all(row[i][:1] in "+-.0123456789" for row in self.rows) for i in columns]


def is_terminal(stream: TextIO) -> bool:
    """Whether colours and moving bars are wanted (NO_COLOR: no-color.org)."""
    plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"
    return stream.isatty() and not plain


def show(as_json: bool, document: Mapping[str, Any], *blocks: str | ScreenTable) -> None:
    """Print the result: ``document`` as JSON, or the ``blocks`` for people."""
    if as_json:
        from middeck.files.json.output import json_text

        _write(json_text(document))
        return
    typed = click.get_current_context(silent=True)
    own = [name for p in typed.command.params for name in p.opts] if typed else []
    for warning in document.get("warnings", ()):
        click.echo(f"warning: {in_options(warning, own)}", err=True)
    if is_terminal(sys.stdout):
        _show_rich(blocks)
    else:
        _write("\n".join(block if isinstance(block, str) else plain_table(block) for block in blocks))


def _write(text: str) -> None:
    """To stdout, also into a pipe whose reader has seen enough (``| head``)."""
    try:
        click.echo(text)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def plain_table(table: ScreenTable) -> str:
    """Aligned columns.

    >>> print(plain_table(ScreenTable("masses", ["node", "kg"], [["n1", "3.5"], ["n20", "12"]])))
    <BLANKLINE>
    masses
    node   kg
    n1    3.5
    n20    12
    """
    lines = [table.headers, *table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.headers))]
    right = table.flush_right

    def aligned(line: Sequence[str]) -> str:
        cells = zip(line, widths, right, strict=True)
        return "  ".join(c.rjust(w) if flush else c.ljust(w) for c, w, flush in cells).rstrip()

    return "\n".join(["", table.title, *map(aligned, lines)])


def _show_rich(blocks: Sequence[str | ScreenTable]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable

    console = Console()
    for block in blocks:
        if isinstance(block, str):
            console.print(block, markup=False, highlight=False)
            continue
        drawn = RichTable(title=block.title, title_justify="left", box=box.SIMPLE_HEAD)
        for header, flush in zip(block.headers, block.flush_right, strict=True):
            drawn.add_column(header, justify="right" if flush else "left")
        for row in block.rows:
            drawn.add_row(*row)
        console.print(drawn)


def case_lines(document: Mapping[str, Any]) -> list[str]:
    """The article and the environment of a document, above its tables."""
    return [f"article      {document['article']}", f"environment  {document['environment']}"]


def cells(row: Mapping[str, Any], *forms: str) -> list[str]:
    """The cells of a row: keys, each with its format; a dash for a missing value.

    >>> cells({"name": "n1", "hz": 2.0, "mac": None}, "name", "hz:.3f", "mac:.2f")
    ['n1', '2.000', '-']
    """
    split = (form.partition(":") for form in forms)
    return ["-" if row[key] is None else format(row[key], form) for key, _, form in split]


def number(value: float | None, form: str, none: str = "-") -> str:
    """A number in its format; ``none`` for a missing one."""
    return none if value is None else format(value, form)


def rows_of(columns: Mapping[str, Any], *forms: str) -> list[list[str]]:
    """Rows of parallel columns: keys, each with its format, as for `cells`.

    >>> rows_of({"hz": [1.0, 2.5], "name": ["a", "b"]}, "name", "hz:.2f")
    [['a', '1.00'], ['b', '2.50']]
    """
    keys = [form.partition(":")[0] for form in forms]
    rows = zip(*(columns[key] for key in keys), strict=True)
    return [cells(dict(zip(keys, row, strict=True)), *forms) for row in rows]


def without_stiffness(table: ScreenTable, felt: Sequence[float]) -> ScreenTable:
    """The table with a column of the relative change of each row's frequency, if any is felt (`WITHOUT`)."""
    if not any(felt):
        return table
    changes = [f"{100.0 * share:.2g} %" if share else "" for share in felt]
    rows = [[*row, change] for row, change in zip(table.rows, changes, strict=True)]
    return ScreenTable(table.title, [*table.headers, "may be off"], rows)


def mode_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Frequency and damping of fitted modes, each with its deviation, and remarks on them."""
    keys = ("frequency_hz", "frequency_std_hz", "damping", "damping_std", "standing")
    rows = sorted(zip(*(document[k] for k in keys), strict=True), key=itemgetter(0, 2))
    return [
        [f"{f:.5f}", deviation_words(df), f"{z:.5f}", deviation_words(dz), standing.replace("sound", "")]
        for f, df, z, dz, standing in rows
    ]


def delay_cells(document: Mapping[str, Any], output: str) -> list[str]:
    """The delay in ms, with deviation and standing."""
    return [
        f"{document['delay_s'][output] * 1e3:.4f}",
        deviation_words(document["delay_std_s"][output], 1e-3),
        document["delay_standing"][output].replace("sound", ""),
    ]


def deviation_words(deviation: float | None, unit: float = 1.0) -> str:
    """A deviation in ``unit``; words for one that is infinite."""
    return "not determined" if deviation is None else f"{deviation / unit:.1e}"
