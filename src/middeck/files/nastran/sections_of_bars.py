"""Stiffness and mass of bars, beams and rods from their properties and materials, in units of the deck."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from middeck.files.faults import Fault
from middeck.files.nastran.entries import Entries, Entry
from middeck.files.nastran.numbers import real
from middeck.files.nastran.shapes import SHAPES, SectionShape, section_shape

ROW = 8
STATIONS = ("YES", "YESA", "NO")  # the first field of a station of a PBEAM


class Material(NamedTuple):
    """Young's and shear modulus, density."""

    E: float
    G: float
    rho: float


class BarSection(NamedTuple):
    """The cross-section of a member with its material; ``i12`` is turned away by `principal_axes`."""

    material: Material
    shape: SectionShape
    i12: float
    nsm: float

    @property
    def per_length(self) -> float:
        """Mass per length."""
        return self.material.rho * self.shape.area + self.nsm


class Sections:
    """Sections by the property that a member names; what is wrong with one is said once."""

    def __init__(self, entries: Entries, faults: list[Fault]) -> None:
        self.materials = entries.numbered("MAT1")
        self.properties = entries.numbered("PBAR", "PBARL", "PBEAM", "PBEAML", "PROD")
        self.faults = faults
        self.done: dict[tuple[str, int], BarSection | None] = {}
        self.read_as = {"CBAR": ("PBAR", "PBARL"), "CBEAM": ("PBEAM", "PBEAML"), "CROD": ("PROD",)}

    def of(self, element: Entry) -> BarSection | None:
        """The section of ``element``; None where a fault stands in its place."""
        if element.name == "CONROD":
            return self._once(element)
        pid = element["pid"]
        found = self.properties.get(pid)
        wanted = self.read_as[element.name]
        if found is None or found.name not in wanted:
            there = f"; {pid} is a {found.name}" if found else ""
            self.faults.append(element.fault(f"there is no {' or '.join(wanted)} {pid}{there}", "pid"))
            return None
        return self._once(found)

    def _once(self, entry: Entry) -> BarSection | None:
        key = (entry.name, entry.id)
        if key not in self.done:
            try:
                self.done[key] = self._section(entry)
            except ValueError as error:
                key_name = "dims" if entry.name.endswith("L") else ""
                self.faults.append(entry.fault(str(error), key_name))
                self.done[key] = None
        return self.done[key]

    def _section(self, entry: Entry) -> BarSection:
        material = self._material(entry)
        if entry.name in ("PBARL", "PBEAML"):
            shape, nsm = _shape(entry)
            if entry.name == "PBEAML" and not shape.centred:
                raise ValueError(
                    f"the shear centre of this {entry['type']} is not its centroid, which a CBEAM counts: "
                    "not converted yet"
                )
            return BarSection(material, shape, 0.0, nsm)
        area, nsm, torsion = entry["a"], entry["nsm"], entry["j"]
        if not area > 0.0:
            raise ValueError("a member without area is not converted")
        if nsm < 0.0 or torsion < 0.0:
            raise ValueError("a negative mass or torsion constant")
        if entry.name in ("PROD", "CONROD"):
            return BarSection(material, SectionShape(area, 0.0, 0.0, torsion), 0.0, nsm)
        i1, i2, i12 = entry["i1"], entry["i2"], entry["i12"]
        if i1 < 0.0 or i2 < 0.0 or (i12 != 0.0 and not i1 * i2 > i12**2):
            raise ValueError("second moments that no section has: I1 I2 > I12^2, none < 0")
        if entry.name == "PBEAM":
            k1, k2 = _constant_beam(entry)
            if i12 != 0.0 and (k1, k2) != (0.0, 0.0):
                raise ValueError("I12 together with shear flexibility is not converted yet")
        else:
            k1, k2 = (0.0, 0.0) if i12 != 0.0 else (entry["k1"] or 0.0, entry["k2"] or 0.0)
        if min(k1, k2) < 0.0:
            raise ValueError("a negative shear factor")
        shape = SectionShape(area, i1, i2, torsion, k1 or math.inf, k2 or math.inf)
        return BarSection(material, shape, i12, nsm)

    def _material(self, entry: Entry) -> Material:
        card = self.materials.get(entry["mid"])
        if card is None:
            raise ValueError(f"there is no MAT1 {entry['mid']}")
        return read_material(card)


def read_material(card: Entry) -> Material:
    """Moduli of a MAT1, one of which may follow from others; raises `ValueError` for those of no solid."""
    young, shear, nu = card["e"], card["g"], card["nu"]
    if nu is not None and not -1.0 < nu <= 0.5:
        raise ValueError(f"MAT1 {card.id} has Poisson's ratio {nu}; must be > -1 and <= 0.5")
    if young is None and shear is not None and nu is not None:
        young = 2.0 * (1.0 + nu) * shear
    if shear is None:
        shear = 0.0 if nu is None else (young or 0.0) / (2.0 * (1.0 + nu))
    if young is None or not young > 0.0 or shear < 0.0 or card["rho"] < 0.0:
        raise ValueError(f"MAT1 {card.id} has E {young}, G {shear} and rho {card['rho']}: no solid has them")
    return Material(young, shear, card["rho"])


def principal_axes(section: BarSection) -> tuple[SectionShape, float]:
    """The section in its principal axes and the angle [rad] from own y to the first of them."""
    if section.i12 == 0.0:
        return section.shape, 0.0
    shape = section.shape
    angle = 0.5 * math.atan2(2.0 * section.i12, shape.i1 - shape.i2)
    middle, half = 0.5 * (shape.i1 + shape.i2), math.hypot(0.5 * (shape.i1 - shape.i2), section.i12)
    return shape._replace(i1=middle + half, i2=middle - half), angle


def _shape(entry: Entry) -> tuple[SectionShape, float]:
    name = entry["type"]
    if name not in SHAPES:
        raise ValueError(f"shape {name} is not converted yet; {', '.join(SHAPES)} are")
    dims = [real(text) if isinstance(text, str) else text for text in entry["dims"]]
    count = SHAPES[name][0]
    if None in dims[:count] or len(dims) < count:
        raise ValueError(f"{name} needs {count} real dimensions")
    if len(dims) > count + 1:
        raise ValueError(f"more than the {count} dimensions of {name} and a mass per length: it tapers")
    nsm = (dims[count] if len(dims) > count else 0.0) or 0.0
    if nsm < 0.0:
        raise ValueError("a negative mass per length")
    return section_shape(name, [float(d) for d in dims[:count] if d is not None]), nsm


def _constant_beam(entry: Entry) -> tuple[float, float]:
    """Shear factors of a PBEAM; raises `ValueError` for one that tapers, warps, or whose axes are apart."""
    fields = [text or "" for text in entry["rest"]]  # from C1(A), on the second line of eight
    rows = [fields[i : i + ROW] for i in range(0, len(fields), ROW)]
    rows = [row + [""] * (ROW - len(row)) for row in rows]
    if rows and rows[0][0] not in STATIONS:  # stress recovery at end A may be left out
        rows = rows[1:]
    own = [entry[key] for key in ("a", "i1", "i2", "i12", "j", "nsm")]
    while rows and rows[0][0] in STATIONS:
        here = [real(text) if text else value for text, value in zip(rows[0][2:], own, strict=True)]
        if here != own:
            raise ValueError("a beam that tapers is not converted yet")
        stress = rows[0][0] == "YES" or (len(rows) > 1 and not any(rows[1]))
        rows = rows[2 if stress else 1 :]
    texts = [text for row in rows for text in row]
    values = [real(text) if text else None for text in texts]
    if any(text and value is None for text, value in zip(texts, values, strict=True)):
        raise ValueError("a field of its last lines is not a real number")
    values += [None] * (2 * ROW - len(values))
    if len(values) > 2 * ROW or any(value for value in values[4:]):
        raise ValueError("warping, mass beside the axis or a neutral axis beside it are not converted yet")
    k1, k2 = (1.0 if value is None else value for value in values[:2])
    return k1, k2


def shear_stiffness(section: BarSection, factor: float) -> float:
    """K G A; infinite for a section that is rigid in shear."""
    stiffness = factor * section.material.G * section.shape.area
    return stiffness if stiffness > 0.0 else float(np.inf)
