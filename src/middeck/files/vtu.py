"""Shapes for ParaView and its like: a VTK XML unstructured grid of poly-lines, in ASCII."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from middeck.files.atomic import replacing
from middeck.structure.modes.drawn import Drawing

POLY_LINE = 4
# Numbers of the parts of a drawing in the array "part".
PARTS = ("member", "section", "rigid", "body", "spring", "bushing", "cable")


def write_vtu(path: str | Path, drawing: Drawing) -> None:
    """``drawing`` as a file, whole or not at all: see `vtu_text`."""
    with replacing(path) as temporary:
        temporary.write_text(vtu_text(drawing), encoding="utf-8", newline="\n")


def vtu_text(drawing: Drawing) -> str:
    """Points at rest; the displacement since drawn and every shape as vectors, for a filter that warps.

    Cells have the number of their part in `PARTS`, and their share of the strain energy of each shape.
    """
    lines = drawing.lines
    titles = [
        f"mode {n}: {hz:.6g} Hz, {name}"
        for n, hz, name in zip(drawing.number, drawing.frequency_hz, drawing.name, strict=True)
    ]
    displaced = [_array("displacement since drawn", drawing.rest - drawing.drawn)]
    displaced += [_array(title, motion) for title, motion in zip(titles, drawing.motion, strict=True)]
    shares = [_array(title, share) for title, share in zip(titles, drawing.strain, strict=True)]
    return "\n".join([
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(drawing.rest)}" NumberOfCells="{len(lines)}">',
        "<PointData>", *displaced, "</PointData>",
        "<CellData>", _array("part", np.array([PARTS.index(n.what) for n in lines], dtype=int)), *shares,
        "</CellData>",
        "<Points>", _array("points", drawing.rest), "</Points>",
        "<Cells>",
        _array("connectivity", _joined(range(n.first, n.last) for n in lines)),
        _array("offsets", np.cumsum([n.last - n.first for n in lines], dtype=int)),
        _array("types", np.full(len(lines), POLY_LINE)),
        "</Cells>",
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
        "",
    ])  # fmt: skip


def _joined(ranges: Iterable[range]) -> np.ndarray:
    return np.array([i for each in ranges for i in each], dtype=int)


def _array(name: str, values: np.ndarray) -> str:
    kind = "Int64" if values.dtype.kind == "i" else "Float64"
    width = 1 if values.ndim == 1 else values.shape[1]
    rows = values.reshape(len(values), -1).tolist()
    text = "\n".join(" ".join(f"{x + 0:.9g}" if kind == "Float64" else str(x) for x in row) for row in rows)
    head = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" format="ascii">'
    return f"{head}\n{text}\n</DataArray>"
