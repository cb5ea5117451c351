"""Shapes for ParaView and its like: a VTK XML unstructured grid of line segments, in ASCII."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from middeck.files.disk.atomic import write_text
from middeck.structure.modes.results.article_drawing import Drawing

LINE = 3  # VTK's number of this cell: two points, which every reader knows
# Numbers of the parts of a drawing in the array "part".
PARTS = ("member", "section", "rigid", "body", "spring", "bushing", "cable", "component", "link")


def write_vtu(path: str | Path, drawing: Drawing) -> None:
    """``drawing`` as a file, whole or not at all: see `vtu_text`."""
    write_text(path, vtu_text(drawing))


def vtu_text(drawing: Drawing) -> str:
    """Points at rest; the displacement since drawn and every shape as vectors, for a filter that warps.

    Cells are segments; they have the number of their part in `PARTS`, and the share of the whole member or
    component in the strain energy of each shape.
    """
    lines = drawing.lines
    count = [line.last - line.first - 1 for line in lines]
    first = np.array([i for line in lines for i in range(line.first, line.last - 1)], dtype=int)
    part = np.array([PARTS.index(line.what) for line in lines], dtype=int)
    titles = [
        f"mode {n}: {hz:.6g} Hz, {name}"
        for n, hz, name in zip(drawing.number, drawing.frequency_hz, drawing.name, strict=True)
    ]
    displaced = [_array("displacement since drawn", drawing.rest - drawing.drawn)]
    displaced += [_array(title, motion) for title, motion in zip(titles, drawing.motion, strict=True)]
    shares = [
        _array(title, np.repeat(share, count)) for title, share in zip(titles, drawing.strain, strict=True)
    ]
    return "\n".join([
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(drawing.rest)}" NumberOfCells="{len(first)}">',
        "<PointData>", *displaced, "</PointData>",
        "<CellData>", _array("part", np.repeat(part, count)), *shares,
        "</CellData>",
        "<Points>", _array("points", drawing.rest), "</Points>",
        "<Cells>",
        _array("connectivity", np.stack([first, first + 1], axis=1)),
        _array("offsets", 2 * np.arange(1, len(first) + 1)),
        _array("types", np.full(len(first), LINE)),
        "</Cells>",
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
        "",
    ])  # fmt: skip


def _array(name: str, values: np.ndarray) -> str:
    kind = "Int64" if values.dtype.kind == "i" else "Float64"
    width = 1 if values.ndim == 1 or name == "connectivity" else values.shape[1]
    rows = values.reshape(len(values), -1).tolist()
    text = "\n".join(" ".join(f"{x + 0:.9g}" if kind == "Float64" else str(x) for x in row) for row in rows)
    head = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" format="ascii">'
    return f"{head}\n{text}\n</DataArray>"
