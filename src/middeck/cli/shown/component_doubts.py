"""How far frequencies may be off, because matrices of components have no geometric stiffness."""

from collections.abc import Sequence

from middeck.cli.shown.screen import Table

WITHOUT = """
may be off: estimated change of the frequency by the geometric stiffness that components lack"""


def without_stiffness(table: Table, felt: Sequence[float]) -> Table:
    """The table with a column of the relative change of each row's frequency, if any is felt."""
    if not any(felt):
        return table
    cells = [f"{100.0 * share:.2g} %" if share else "" for share in felt]
    rows = [[*row, cell] for row, cell in zip(table.rows, cells, strict=True)]
    return Table(table.title, [*table.headers, "may be off"], rows)
