"""A component as an external superelement: OUTPUT4, the cards of its own section, and those that join it.

The three files are what EXTSEOUT(ASMBULK,EXTBULK,MATOP4) writes: KXX, MXX and BXX1 over the boundary grids
and scalar points in the order of EXTRN; units m, kg, s, N. After MSC Nastran Superelements User's Guide,
external superelements.
"""

import dataclasses
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from middeck.errors import ConfigError
from middeck.files.disk.atomic import replacing
from middeck.files.nastran.deck.entries import ALL
from middeck.files.nastran.output4.matrices import Op4Matrix, write_op4
from middeck.structure.model.component import Component

# The superelement's number; those of its scalar points begin at so many times it.
NUMBER, SPOINTS = 101, 10_000


def write_external(stem: str | Path, component: Component) -> dict[str, Path]:
    """Write ``stem``.op4, .pch and .asm, each whole or not at all; the paths by ending.

    Grids stand in ascending order, in which Nastran expects the rows of a boundary.

    Grids have the numbers in their names (``g12`` is 12) or, where those are not all different, 1, 2, 3 ...
    Raises `ConfigError` for a component whose grids lack coordinates.
    """
    if not np.all(component.has):
        raise ConfigError(
            "a grid without some of its six coordinates",
            where=f"component {component.name!r}",
            hint="reduce the component with all six coordinates of each boundary grid",
        )
    stem = Path(stem)
    paths = {ending: stem.with_name(f"{stem.name}.{ending}") for ending in ("op4", "pch", "asm")}
    component, grids = _ascending(component)
    points = [max(NUMBER * SPOINTS, *grids) + k + 1 for k in range(component.modal)]
    names = [f"$ GRID {grid} IS {name}" for grid, name in zip(grids, component.grids, strict=True)]
    cards = [
        *names,
        *(_grid(g, x) for g, x in zip(grids, component.positions, strict=True)),
        *_rows("SPOINT", points),
    ]
    whole = [field for grid in grids for field in (grid, ALL)] + [f for point in points for f in (point, 0)]
    own = [f"BEGIN SUPER={NUMBER}", *_card("EXTRN", whole), *cards]
    own += [f"ASET    {grid:8d}{ALL:>8}" for grid in grids] + [
        f"ASET    {point:8d}{0:8d}" for point in points
    ]
    pairs = [value for point in (*grids, *points) for value in (point, point)]
    join = [
        *_card("SEBULK", [NUMBER, "EXTOP4", "", "MANUAL", "", "", NUMBER]),
        *_card("SECONCT", [NUMBER, 0, "", "NO", "", "", "", "", *pairs]),
        *cards,
    ]
    matrices = {"KXX": component.stiffness, "MXX": component.mass, "BXX1": component.damping}
    found = [Op4Matrix(name, 6, sp.csc_array(m)) for name, m in matrices.items() if m is not None]
    write_op4(paths["op4"], found)
    for ending, lines in (("pch", own), ("asm", join)):
        with replacing(paths[ending]) as file:
            file.write_text(
                "\n".join([f"$ {component.name}: M, KG, S, N", *lines, ""]),
                encoding="ascii",
                errors="replace",
            )
    return paths


def _ascending(component: Component) -> tuple[Component, list[int]]:
    """The component with its grids in the order of their numbers, and these."""
    numbers = grid_numbers(component.grids)
    order = np.argsort(numbers)
    modal = np.arange(6 * len(order), len(component.mass))
    rows = np.concatenate([(6 * order[:, None] + np.arange(6)).ravel(), modal])
    turned = {
        key: matrix[np.ix_(rows, rows)]
        for key in ("stiffness", "mass", "damping")
        if (matrix := getattr(component, key)) is not None
    }
    sorted_ones = dataclasses.replace(
        component,
        grids=tuple(component.grids[i] for i in order),
        frames=tuple(component.frames[i] for i in order),
        positions=component.positions[order],
        offsets=component.fixed_at[order],
        recovery=None if component.recovery is None else component.recovery[:, rows],
        **turned,
    )
    return sorted_ones, [numbers[i] for i in order]


def grid_numbers(names: Sequence[str]) -> list[int]:
    """Numbers of grids with these names.

    >>> grid_numbers(["g12", "n3"]), grid_numbers(["left", "right"])
    ([12, 3], [1, 2])
    """
    found = [re.fullmatch(r"\D*(\d{1,7})", name) for name in names]
    numbers = [int(match[1]) if match else 0 for match in found]
    return numbers if min(numbers) > 0 and len(set(numbers)) == len(names) else list(range(1, len(names) + 1))


def _grid(number: int, place: np.ndarray) -> str:
    x, y, z = (f"{value:16.9E}" for value in place)
    return f"GRID*   {number:16d}{0:16d}{x}{y}\n*       {z}{0:16d}"


def _rows(name: str, values: Iterable[int]) -> list[str]:
    listed = list(values)
    return [f"{name:8}" + "".join(f"{v:8d}" for v in listed[i : i + 8]) for i in range(0, len(listed), 8)]


def _card(name: str, fields: Sequence[object]) -> list[str]:
    """Small fields, eight a line."""
    rows = ["".join(f"{field!s:>8}" for field in fields[i : i + 8]) for i in range(0, len(fields), 8)]
    return [f"{name if i == 0 else '':8}{row}" for i, row in enumerate(rows)]
