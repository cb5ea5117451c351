"""A truss of bars, whole and as two superelements: frequencies and stiffness that NX Nastran printed."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import middeck as md
from measured.rows import row
from middeck.cli.main import execute
from middeck.files.nastran.components.external import read_external
from middeck.files.nastran.deck.units import parse_units

DATA = Path(__file__).resolve().parents[2] / "data"
WHOLE, PARTS, UNITS = DATA / "nastran-truss", DATA / "nastran-superelement", "mm-kg-s-mN"
GRIDS = ["g3", "g11", "g19", "g27"]


def rows() -> list[dict[str, Any]]:
    """Frequencies of deck and assembly; the stiffness of two components between their boundary grids."""
    case, told, printed = "Truss of NX Nastran", [], _printed(WHOLE / "full.out.txt")
    for formulation, count, level in (("coupled", len(printed) - 6, 1e-6), ("consistent", 14, 2.5e-4)):
        hz = _frequencies(WHOLE / "full.dat", formulation)[6:][:count]
        measure = f"{count} elastic frequencies, {formulation} mass, largest relative difference"
        told.append(row(case, measure, "", float(np.abs(hz / printed[6:][:count] - 1.0).max()), level))
    hz, printed = _frequencies(PARTS / "assemble.dat", "consistent"), _printed(PARTS / "assemble.out.txt")
    off = float(np.abs(hz[6:] / printed[6:] - 1.0).max())
    told += [
        row(
            case,
            f"as two superelements, {len(hz) - 6} elastic frequencies, largest difference",
            "",
            off,
            1e-6,
        ),
        row(case, "as two superelements, largest of six rigid frequencies", "Hz", float(hz[:6].max()), 1e-3),
    ]
    for measure, reals in (("as printed", "double"), ("its numbers in single precision", "single")):
        off = max(_boundary(name, reals) for name in ("inboard", "outboard"))
        note = "NX Nastran keeps the area 12.566 mm^2 in single precision, 1.04e-8 off"
        note = note if reals == "double" else "convert --reals single"
        told.append(row(case, f"boundary stiffness from the bulk data, {measure}", "", off, 1e-8, note=note))
    return told


def _frequencies(deck: Path, formulation: str) -> np.ndarray:
    structure = _converted(deck, formulation)
    return md.solve_modes(md.solve_equilibrium(structure, md.Environment.orbit())).frequency_hz


def _converted(deck: Path, formulation: str, reals: str = "double") -> md.Structure:
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        out = Path(folder) / "article.toml"
        told = ["convert", str(deck), "-o", str(out), "--units", UNITS, "--mass-formulation", formulation]
        told += ["--reals", reals]
        if execute(told, lambda: False):
            raise RuntimeError(f"{deck} was not converted")
        return md.load_structure(out)


def _printed(path: Path) -> np.ndarray:
    """Frequencies [Hz] of a table of eigenvalues."""
    lines = re.findall(r"^\s+\d+\s+\d+((?:\s+\S+E[+-]\d\d){5})\s*$", path.read_text(), re.MULTILINE)
    return np.array([float(line.split()[1]) / (2.0 * np.pi) for line in lines])


def _boundary(name: str, reals: str) -> float:
    """Largest difference between our stiffness and the printed one, over the roots of its diagonal."""
    theirs = read_external([PARTS / f"{name}.pch"], PARTS / f"{name}.op4", parse_units(UNITS), name=name)
    deck = _converted(PARTS / f"{name}.blk", "coupled", reals)
    ours = md.reduce_structure(deck, GRIDS, upto_hz=50.0).component
    K, L = (part.stiffness[:24, :24] for part in (ours, theirs))
    size = np.sqrt(np.diagonal(L))
    return float(np.abs((K - L) / np.outer(size, size)).max())
