"""Cross-sections of members as sections of an article: stiffness and mass on the axis of shear centres.

A member that tapers is divided into equal parts, so many that its numbers change little along each, and each
part into thirds. A third has a constant section: such as keep the integrals of flexibility and mass times
1, x and x^2 along the part, so that under loads at its ends, and as a rigid body, it moves as the taper does.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from middeck.files.nastran.deck.units import Units
from middeck.files.nastran.masses_and_springs.bodies import Mass
from middeck.files.nastran.members.beam_stations import Cut
from middeck.files.nastran.members.members import Bar, own_axes
from middeck.files.nastran.members.sections_of_bars import BarSection
from middeck.structure.model.connectivity import some_names

Formulation = Literal["consistent", "coupled", "lumped"]
Array = np.ndarray
THIRDS = 3
PARTS = (2, 4, 8)  # numbers of parts of a member that tapers
LEAST = 0.1  # least flexibility of a third, over the mean
NEAR = 0.25 ** np.arange(1, 20)  # parts of a cell: a beam may end in 1e-12 of its second moment
CHANGE = 1.3  # largest change of flexibility and mass along a part, over the mean
ROUNDING = 1e-9  # relative rounding of a coupling of bending in both planes
PRODUCT = 1e-6  # relative product of rotary inertia that an article leaves out
# Extension, shears, twist, curvatures; what a section rigid in shear has; units of length in each.
RIGID_IN_SHEAR = np.ix_(*2 * [[0, 3, 4, 5]])
LENGTHS = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])


class ArticleSections(NamedTuple):
    """Tables of an article, one for each element of a member.

    ``product``: rotary inertia about axes that are not those of the member is left out. ``steep``: it tapers
    more than the elements can follow.
    """

    tables: tuple[dict[str, Any], ...]
    product: bool
    steep: bool


def article_sections(
    section: BarSection, rod: bool, units: Units, mass_unit: float, formulation: Formulation
) -> ArticleSections:
    """The sections of a member in SI units; of a ``rod`` the mass goes straight between its ends."""
    coupled = formulation == "coupled"
    spread = ("coupled rod" if coupled else "rod") if rod else "coupled" if coupled else "consistent"
    stiffness, moments, steep = _elements(section, formulation)
    inertia = moments * mass_unit * units.length ** np.array([-1.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    lengths = units.length**LENGTHS
    tables: list[dict[str, Any]] = []
    product = False
    for K, (rho, y, z, yy, zz, yz) in zip(stiffness, inertia.tolist(), strict=True):
        centre = (y / rho, z / rho) if rho else (0.0, 0.0)
        table = _elastic(K * units.force * np.outer(lengths, lengths)) | {
            "rho_A_kg_per_m": rho,
            "rho_I_y_kg_m": max(0.0, zz - rho * centre[1] ** 2),
            "rho_I_z_kg_m": max(0.0, yy - rho * centre[0] ** 2),
            "mass": spread,
        }
        if section.material.rho:
            table["density_kg_m3"] = section.material.rho * mass_unit / units.length**3
        if any(centre):
            table["mass_centre_m"] = centre
        product |= abs(yz - rho * centre[0] * centre[1]) > PRODUCT * (yy + zz)
        tables.append(table)
    return ArticleSections(tuple(tables), bool(product), steep)


def taper_notes(made: Mapping[str, ArticleSections]) -> list[str]:
    """Notes on differences from the deck's own program, by names of sections."""
    notes: list[str] = []
    tapered = {name: len(part.tables) for name, part in made.items() if len(part.tables) > 1}
    if tapered:
        least, most = min(tapered.values()), max(tapered.values())
        count = f"{least}" if least == most else f"{least} to {most}"
        notes.append(
            f"{some_names(list(tapered))} tapers: {count} elements of a member have its flexibility and "
            "mass; the deck's own program makes one element of it, with an integration and a mass of its own"
        )
    steep = [name for name, part in made.items() if part.steep]
    if steep:
        notes.append(
            f"{some_names(steep)} changes so steeply that {THIRDS * PARTS[-1]} elements follow it to "
            "percents only: divide the beam in the deck"
        )
    left = [name for name, part in made.items() if part.product]
    if left:
        notes.append(
            f"{some_names(left)}: rotary inertia about axes that are not those of the member is left out"
        )
    return notes


def lumps(bar: Bar) -> list[Mass]:
    """Half masses at the ends of a member that tapers with its mass and its centre along it.

    Those of a CBEAM turn about its axis, those of a bar or rod do not.
    """
    axes = own_axes(bar.ends[1] - bar.ends[0], bar.up)
    polar = float(bar.entry.name == "CBEAM") * np.outer(axes[:, 0], axes[:, 0])
    found: list[Mass] = []
    for grid, end, (rho, y, z, about) in zip(bar.grids, bar.ends, _ends(bar.section), strict=True):
        if rho:
            centre = end + y * axes[:, 1] + z * axes[:, 2]
            found.append(Mass(grid, rho * bar.length, centre, about * bar.length * polar))
    return found


@lru_cache
def _ends(section: BarSection) -> tuple[tuple[float, float, float, float], ...]:
    """Mass, centre (y, z) and polar inertia about it that go to each end of a member of length 1."""
    whole, first = (part[0] for part in _integrals(section, np.array([0.0, 1.0]), "consistent"))
    out: list[tuple[float, float, float, float]] = []
    for rho, y, z, yy, zz, _ in (whole - first, first):
        y, z = (y / rho, z / rho) if rho else (0.0, 0.0)
        out.append((float(rho), float(y), float(z), max(0.0, float(yy + zz - rho * (y * y + z * z)))))
    return tuple(out)


def _elements(section: BarSection, formulation: Formulation) -> tuple[Array, Array, bool]:
    """Stiffness and moments of mass of the elements of a member, one, or several if it tapers; if steeply."""
    factor = 0.0 if formulation == "lumped" else 1.0
    if not section.tapers:
        start = np.zeros(1)
        return _stiffness(section, start), factor * _moments(section, section.at(start), formulation), False
    x, weight, cell = _points(section, np.linspace(0.0, 1.0, THIRDS * PARTS[-1] + 1))
    K, moments = _stiffness(section, x), _moments(section, section.at(x), formulation)
    diagonal = np.diagonal(K, axis1=1, axis2=2)
    live = np.flatnonzero(np.all(np.isfinite(diagonal) & (diagonal > 0.0), axis=0))
    C = np.linalg.inv(K[:, live[:, None], live])
    mass = moments[:, :1, None]
    parts = next((n for n in PARTS if all(_is_even(v, weight, cell, n) for v in (C, mass))), PARTS[-1])
    found, steep = _positive_thirds(C, x, weight, cell, parts)
    out = np.repeat(K[:1], len(found), axis=0)
    out[:, live[:, None], live] = np.linalg.inv(found)
    return out, factor * _thirds(moments, x, weight, cell, parts), steep


def _is_even(values: Array, weight: Array, cell: Array, parts: int) -> bool:
    """Whether positive ``values`` (point, n, n) stay within `CHANGE` of their means over each part."""
    part = cell * parts // (THIRDS * PARTS[-1])
    here = np.arange(parts)[:, None] == part
    mean = np.einsum("gi,ijk->gjk", parts * here * weight, values)
    if np.any(mean[:, 0, 0] <= 0.0):
        return True  # no mass, which is even too
    root = np.linalg.inv(np.linalg.cholesky(mean))[part]
    ratio = np.linalg.eigvalsh(root @ values @ np.swapaxes(root, 1, 2))
    return bool(ratio.min() * CHANGE >= 1.0 and ratio.max() <= CHANGE)


def _thirds(rows: Array, x: Array, weight: Array, cell: Array, parts: int) -> Array:
    """Constants of the thirds of ``parts`` that keep the integrals of ``rows`` times 1, x, x^2 over each."""
    edges = np.arange(THIRDS + 1) / THIRDS
    P = np.array([np.diff(edges**k) / k for k in (1, 2, 3)])
    part = cell * parts // (THIRDS * PARTS[-1])
    out: list[Array] = []
    for k in range(parts):
        here = part == k
        at, w = x[here] * parts - k, weight[here] * parts
        out.append(np.linalg.solve(P, np.array([w, w * at, w * at * at]) @ rows[here]))
    return np.vstack(out)


def _positive_thirds(C: Array, x: Array, weight: Array, cell: Array, parts: int) -> tuple[Array, bool]:
    """`_thirds` of flexibilities (point, n, n), with plain means where those are not positive definite.

    Where a part changes steeply, constants that keep its three integrals may be negative: a hinge, or worse.
    The flag is true if any part has plain means.
    """
    third = cell * parts // PARTS[-1]
    means = np.einsum("gi,ijk->gjk", (np.arange(THIRDS * parts)[:, None] == third) * weight, C)
    means *= THIRDS * parts
    kept = _thirds(C.reshape(len(x), -1), x, weight, cell, parts).reshape(means.shape)
    root = np.linalg.inv(np.linalg.cholesky(means))
    lost = np.linalg.eigvalsh(root @ kept @ np.swapaxes(root, 1, 2)).min(axis=1) < LEAST
    lost = np.repeat(lost.reshape(-1, THIRDS).any(axis=1), THIRDS)
    return np.where(lost[:, None, None], means, kept), bool(lost.any())


def _points(section: BarSection, edges: Array) -> tuple[Array, Array, Array]:
    """Six Gauss points each between edges and stations, weights, and the cell of each.

    Towards stations the pieces are ever shorter: a beam may end in a point, where its flexibility is large.
    """
    near = section.knots[:, None] + np.outer([-1.0, 1.0], NEAR / (len(edges) - 1)).ravel()
    ends: Array = np.unique(np.clip(np.concatenate([edges, section.knots, near.ravel()]), 0.0, 1.0))
    half, middle = 0.5 * np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
    points, weights = np.polynomial.legendre.leggauss(6)
    x, weight = middle[:, None] + half[:, None] * points, half[:, None] * weights
    cell = np.searchsorted(edges, middle) - 1
    return x.ravel(), weight.ravel(), np.repeat(cell, len(points))


def _integrals(section: BarSection, edges: Array, formulation: Formulation) -> tuple[Array, Array]:
    """Moments of mass, see `_moments`, of each cell between ``edges``, and the same times x."""
    x, weight, cell = _points(section, edges)
    moments = weight[:, None] * _moments(section, section.at(x), formulation)
    cells = np.arange(len(edges) - 1)[:, None] == cell
    return cells @ moments, cells @ (x[:, None] * moments)


def _moments(section: BarSection, cut: Cut, formulation: Formulation) -> Array:
    """Mass per length, its first moments (y, z) and second ones (yy, zz, yz) about the axis, a row for each.

    Second moments of structural mass about its own centroid are in the ``consistent`` formulation alone.
    """
    rho = section.material.rho
    own = rho if formulation != "coupled" else 0.0
    mass = rho * np.asarray(cut.area)
    columns = (
        mass + cut.nsm,
        mass * cut.n1 + cut.nsm * np.asarray(cut.m1),
        mass * cut.n2 + cut.nsm * np.asarray(cut.m2),
        own * cut.i1 + mass * cut.n1**2 + cut.nsm * np.asarray(cut.m1) ** 2 + 0.5 * cut.nsi,
        own * cut.i2 + mass * cut.n2**2 + cut.nsm * np.asarray(cut.m2) ** 2 + 0.5 * cut.nsi,
        own * cut.i12 + mass * cut.n1 * cut.n2 + cut.nsm * np.asarray(cut.m1) * cut.m2,
    )
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _stiffness(section: BarSection, x: Array) -> Array:
    """6x6 on the axis of shear centres, in the order of `Section`; a rigid shear is infinite."""
    cut, (E, G, _) = section.at(x), section.material
    K = np.zeros((len(x), 6, 6))
    K[:, 0, 0] = EA = E * np.asarray(cut.area)
    for i, factor in ((1, section.stations.k1), (2, section.stations.k2)):
        K[:, i, i] = factor * G * cut.area if factor * G > 0.0 else np.inf
    K[:, 3, 3] = G * cut.j
    K[:, 0, 4] = K[:, 4, 0] = EA * cut.n2
    K[:, 0, 5] = K[:, 5, 0] = -EA * cut.n1
    K[:, 4, 4] = E * cut.i2 + EA * cut.n2**2
    K[:, 5, 5] = E * cut.i1 + EA * cut.n1**2
    K[:, 4, 5] = K[:, 5, 4] = -E * cut.i12 - EA * cut.n1 * cut.n2
    return K


def _elastic(K: Array) -> dict[str, Any]:
    """Stiffnesses about the centroid, or the whole matrix where bending in both planes is coupled there."""
    EA, shears = K[0, 0], np.diag(K)[1:3]
    y, z = -K[0, 5] / EA, K[0, 4] / EA
    EI_y, EI_z = K[4, 4] - EA * z * z, K[5, 5] - EA * y * y
    if abs(K[4, 5] + EA * y * z) > ROUNDING * (EI_y + EI_z):
        return {"stiffness": K if np.all(np.isfinite(shears)) else K[RIGID_IN_SHEAR]}
    table = {"EA_n": EA, "GJ_nm2": K[3, 3], "EI_y_nm2": max(0.0, EI_y), "EI_z_nm2": max(0.0, EI_z)}
    table |= {key: GA for key, GA in zip(("GA_y_n", "GA_z_n"), shears, strict=True) if np.isfinite(GA)}
    if y or z:
        table["centroid_m"] = np.array([y, z])
    return table
