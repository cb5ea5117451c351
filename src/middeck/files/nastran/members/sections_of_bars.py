"""Stiffness and mass of bars, beams and rods from their properties and materials, in units of the deck."""

import math
from typing import NamedTuple

import numpy as np

from middeck.files.nastran.deck.entries import CardError, Entries, Entry, add_fault
from middeck.files.nastran.deck.known_cards import PLACES
from middeck.files.nastran.members.beam_stations import Cut, FieldError, Stations, read_pbeam, read_shape
from middeck.files.toml.faults import DocumentFault

# Product of inertia over the second moments that is zero to rounding: fields have eight columns.
ROUNDING = 1e-6


class Material(NamedTuple):
    """Young's and shear modulus, density."""

    E: float
    G: float
    rho: float


class BarSection(NamedTuple):
    """The cross-sections of a member, see `Stations`, with its material.

    They are in axes turned about the member by ``angle`` [rad]: the principal ones if all share them.
    """

    material: Material
    stations: Stations
    angle: float

    @property
    def first(self) -> Cut:
        """The cross-section at end A."""
        return self.stations.cuts[0][1]

    @property
    def tapers(self) -> bool:
        """Whether it has more than one cross-section."""
        return len(self.stations.cuts) > 1

    @property
    def has_mass(self) -> bool:
        """Whether a member of it has mass of its own."""
        return self.material.rho > 0.0 or any(cut.nsm > 0.0 for _, cut in self.stations.cuts)

    @property
    def knots(self) -> np.ndarray:
        """Fractions of the length of all stations."""
        return np.array([at for at, _ in self.stations.cuts])

    def at(self, x: np.ndarray) -> Cut:
        """Numbers of the cross-sections at fractions ``x`` of the length, linear between stations."""
        columns = np.array([cut for _, cut in self.stations.cuts]).T
        return Cut(*(np.interp(x, self.knots, column) for column in columns))


class Sections:
    """Sections by the property that a member names; a fault of one is reported once."""

    def __init__(self, entries: Entries, faults: list[DocumentFault]) -> None:
        self.materials = entries.numbered("MAT1")
        self.properties = entries.numbered("PBAR", "PBARL", "PBEAM", "PBEAML", "PROD", "PTUBE")
        self.faults = faults
        self.done: dict[tuple[str, int], BarSection | None] = {}
        self.read_as = {
            "CBAR": ("PBAR", "PBARL"),
            "CBEAM": ("PBEAM", "PBEAML"),
            "CROD": ("PROD",),
            "CTUBE": ("PTUBE",),
        }

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
            self.done[key] = None
            try:
                self.done[key] = self._section(entry)
            except FieldError as error:
                self.faults.append(entry.fault_at(error.place, str(error)))
            except ValueError as error:
                add_fault(self.faults, error, entry, "dims" if entry.name.endswith("L") else "")
        return self.done[key]

    def _section(self, entry: Entry) -> BarSection:
        stations = _stations(entry)
        if min(stations.k1, stations.k2) < 0.0:
            key = "k1" if stations.k1 < 0.0 else "k2"
            raise CardError(entry.fault("a negative shear factor", key if entry.name == "PBAR" else ""))
        for at, cut in stations.cuts:
            where = f" at X/XB = {at:g}" if len(stations.cuts) > 1 else ""
            _check(entry, at, cut, where)
        material, angle = self._material(entry), principal_angle(stations)
        cuts = tuple((at, turned(cut, angle)) for at, cut in stations.cuts)
        if (
            any(cut.i12 for _, cut in cuts)
            and material.G > 0.0
            and (stations.k1 > 0.0) != (stations.k2 > 0.0)
        ):
            raise ValueError("I12 in a section rigid in shear in one plane alone is not converted")
        return BarSection(material, stations._replace(cuts=cuts), angle)

    def _material(self, entry: Entry) -> Material:
        card = self.materials.get(entry["mid"])
        if card is None:
            raise CardError(entry.fault(f"there is no MAT1 {entry['mid']}", "mid"))
        return read_material(card)


def _check(entry: Entry, at: float, cut: Cut, where: str) -> None:
    """Refuse a cross-section that none has, by its field where it is the one at end A of a PBAR or PBEAM."""
    negative = next((key for key in ("nsm", "nsi", "j") if getattr(cut, key) < 0.0), "")
    if not cut.area > 0.0:
        key, what = "a", "a member without area is not converted"
    elif negative:
        key, what = negative, "a negative mass or torsion constant"
    elif min(cut.i1, cut.i2) < 0.0 or (cut.i12 != 0.0 and not cut.i1 * cut.i2 > cut.i12**2):
        key = "i1" if cut.i1 < 0.0 else "i2" if cut.i2 < 0.0 else "i12"
        what = "second moments that no section has: I1 I2 > I12^2, none < 0"
    else:
        return
    own = PLACES[entry.name]
    raise CardError(entry.fault(what + where, "" if at else key if key in own else "dims" * ("dims" in own)))


def read_material(card: Entry) -> Material:
    """Moduli of a MAT1, one of which may follow from the others; raises `ValueError` for impossible ones."""
    young, shear, nu = card["e"], card["g"], card["nu"]
    if nu is not None and not -1.0 < nu <= 0.5:
        what = f"MAT1 {card.id} has Poisson's ratio {nu}; must be > -1 and <= 0.5"
        raise CardError(card.fault(what, "nu"))
    if young is None and shear is not None and nu is not None:
        young = 2.0 * (1.0 + nu) * shear
    if shear is None:
        shear = 0.0 if nu is None else (young or 0.0) / (2.0 * (1.0 + nu))
    if young is None or not young > 0.0 or shear < 0.0 or card["rho"] < 0.0:
        what = f"MAT1 {card.id} has E {young}, G {shear} and rho {card['rho']}: no solid has them"
        raise CardError(card.fault(what, "rho" if card["rho"] < 0.0 else "g" if shear < 0.0 else "e"))
    return Material(young, shear, card["rho"])


def _stations(entry: Entry) -> Stations:
    if entry.name in ("PBARL", "PBEAML"):
        return read_shape(entry)
    if entry.name == "PBEAM":
        return read_pbeam(entry)
    if entry.name == "PBAR":
        i12 = entry["i12"]
        factors = (0.0, 0.0) if i12 != 0.0 else (entry["k1"] or 0.0, entry["k2"] or 0.0)
        cut = Cut(area=entry["a"], i1=entry["i1"], i2=entry["i2"], i12=i12, j=entry["j"], nsm=entry["nsm"])
        return Stations(((0.0, cut),), *factors)
    area, twist = _tube(entry) if entry.name == "PTUBE" else (entry["a"], entry["j"])
    return Stations(((0.0, Cut(area=area, i1=0.0, i2=0.0, i12=0.0, j=twist, nsm=entry["nsm"])),), 0.0, 0.0)


def _tube(entry: Entry) -> tuple[float, float]:
    """Area and torsion constant of a PTUBE, solid without a thickness; raises `ValueError` for no tube."""
    outer, wall = entry["od"], entry["t"] or 0.5 * entry["od"]
    if not 0.0 < wall <= 0.5 * outer:
        raise ValueError(
            f"no tube has diameter {outer:g} and thickness {wall:g}: at most half of it, both > 0"
        )
    if entry["od2"] not in (None, 0.0, outer):
        raise ValueError("a tube whose diameter changes (OD2) is not converted: give its mean, or two tubes")
    inner = outer - 2.0 * wall
    return 0.25 * math.pi * (outer**2 - inner**2), math.pi * (outer**4 - inner**4) / 32.0


def principal_angle(stations: Stations) -> float:
    """The angle [rad] from own y to the first principal axis of all cross-sections; 0 if they share none."""
    cut = max((cut for _, cut in stations.cuts), key=lambda cut: abs(cut.i12))
    angle = 0.5 * math.atan2(2.0 * cut.i12, cut.i1 - cut.i2) if cut.i12 else 0.0
    shared = all(not turned(cut, angle).i12 for _, cut in stations.cuts)
    return angle if shared and stations.k1 == stations.k2 else 0.0


def turned(cut: Cut, angle: float) -> Cut:
    """The cross-section in axes turned by ``angle`` from own y to z; a product that is rounding is zero."""
    if angle == 0.0:
        return cut
    c, s = math.cos(angle), math.sin(angle)
    i12 = c * s * (cut.i2 - cut.i1) + (c * c - s * s) * cut.i12
    return cut._replace(
        i1=c * c * cut.i1 + 2.0 * c * s * cut.i12 + s * s * cut.i2,
        i2=s * s * cut.i1 - 2.0 * c * s * cut.i12 + c * c * cut.i2,
        i12=0.0 if abs(i12) <= ROUNDING * (cut.i1 + cut.i2) else i12,
        m1=c * cut.m1 + s * cut.m2,
        m2=c * cut.m2 - s * cut.m1,
        n1=c * cut.n1 + s * cut.n2,
        n2=c * cut.n2 - s * cut.n1,
    )
