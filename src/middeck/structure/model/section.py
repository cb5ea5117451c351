"""Cross-sections of members: stiffness and inertia, also coupled and off the node line."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import field
from enum import Enum
from typing import Any

import numpy as np
from jaxtyping import Float, Inexact

from middeck.structure.model.section_and_bushing_checks import RIGID_IN_SHEAR, check_stiffness
from middeck.values import record

# Fields of a section that vary along a tapered member.
CENTRES = ("shear_centre_y", "shear_centre_z", "mass_centre_y", "mass_centre_z")
STIFFNESS = ("EA", "GJ", "EI_y", "EI_z", "GA_y", "GA_z", "coupling")
INERTIA = ("rho_A", "rho_I_y", "rho_I_z")
NUMBERS = (*STIFFNESS, *INERTIA, *CENTRES)
# Powers of a tube's diameters in each property.
POWERS = {2: ("EA", "GA_y", "GA_z", "rho_A"), 4: ("GJ", "EI_y", "EI_z", "rho_I_y", "rho_I_z")}


class MemberMass(Enum):
    """Distribution of an element's mass over its ends; in the first two bending is consistent.

    ``COUPLED`` is the coupled bar mass of NX Nastran 9 and of older MSC Nastran: along the axis the mean
    of the lumped and the consistent mass, across it that of a bar rigid in shear (as in subroutine BARD
    of NASTRAN-95). Those bars have no rotary inertia either: that is a matter of ``rho_I`` of the
    section. In a ``ROD`` all points between the ends go straight from one to the other, however the ends
    turn (Przemieniecki 1968, 11.3); ``COUPLED_ROD`` is the coupled rod mass of those programs: along the
    axis as ``COUPLED``, across it halves at the ends.
    """

    CONSISTENT = "consistent"
    COUPLED = "coupled"
    ROD = "rod"
    COUPLED_ROD = "coupled rod"


@record(kw_only=True)
class Section:
    """Cross-section of a member with its material.

    Its strains are, on the node line (the line between the member's ends), the extension, the shears along
    own y and z, the twist and the curvatures about own y and z (right-handed, of the sections), in this
    order; work-conjugate are the axial force, the shear forces, the torque and the bending moments. Own x is
    along the member, from its start to its end. The symmetric 6x6 matrix between them is ``stiffness``; of
    most sections it is diagonal. See `coupled_section` for one by its matrix, `shifted_section` for one whose
    centroid is off the node line.

    Attributes:
        EA, GJ: Axial [N] and torsional [N m^2] stiffness.
        EI_y, EI_z: Bending stiffness [N m^2] about the member's own y and z axes.
        rho_A: Mass per length [kg/m].
        rho_I_y, rho_I_z: Rotary inertia per length [kg m] about axes through the mass centre along the own
            ones; their sum is the polar one.
        GA_y, GA_z: Shear stiffness [N] along own y and z; infinite for a Bernoulli beam.
        density: Density of its material [kg/m^3], where there is one; only checked, see `summarise`.
        mass: Formulation of the mass of each element.
        coupling: The stiffness less its diagonal; zero in the row of a shear whose stiffness is infinite.
        shear_centre_y, shear_centre_z: Where the shear strains are taken [m], from the node line. What shears
            a section off its node line twists it, also where it is rigid in shear.
        mass_centre_y, mass_centre_z: The centre of mass [m], from the node line.
        centroid: Centroid (y, z) [m] given to `shifted_section`; zero for a section by its whole matrix.
        diameters: Outer and inner [m], of a round tube; zero for any other. These and the centroid say how a
            member tapers, see `section_between`: the stiffness has them in it already.
    """

    EA: float
    GJ: float
    EI_y: float
    EI_z: float
    rho_A: float
    rho_I_y: float
    rho_I_z: float
    GA_y: float = np.inf
    GA_z: float = np.inf
    density: float | None = None
    mass: MemberMass = MemberMass.CONSISTENT
    coupling: Inexact[np.ndarray, "6 6"] = field(default_factory=lambda: np.zeros((6, 6)))
    shear_centre_y: float = 0.0
    shear_centre_z: float = 0.0
    mass_centre_y: float = 0.0
    mass_centre_z: float = 0.0
    centroid: Inexact[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    diameters: Inexact[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))

    @property
    def stiffness(self) -> Inexact[np.ndarray, "6 6"]:
        """The whole 6x6 matrix, its shears at the shear centre."""
        return self.coupling + np.diag([self.EA, self.GA_y, self.GA_z, self.GJ, self.EI_y, self.EI_z])


def section_between(first: Section, last: Section, part: float) -> Section:
    """The section at ``part`` of the way from ``first`` to ``last``, where a member tapers between them.

    Diameters of tubes are linear, and so are the place of the centroid and the stiffness about it; of other
    sections every number is.
    """
    if first is last:
        return first
    if not (np.any(first.centroid) or np.any(last.centroid)):
        return _tube_between(first, last, part)
    start, end = (shifted_section(s, (-s.centroid[0], -s.centroid[1])) for s in (first, last))
    y, z = (1.0 - part) * first.centroid + part * last.centroid
    return shifted_section(_tube_between(start, end, part), (y, z))


def _tube_between(first: Section, last: Section, part: float) -> Section:
    """Linear in the diameters of two tubes, and in what each number is beyond these, as of materials."""
    mixed = _mixed(first, last, part)
    if not (first.diameters[0] > 0.0 and last.diameters[0] > 0.0) or np.all(
        first.diameters == last.diameters
    ):
        return mixed
    here = (1.0 - part) * first.diameters + part * last.diameters
    numbers: dict[str, Any] = {"diameters": here}
    for power, names in POWERS.items():
        a, b, at = (d[0] ** power - d[1] ** power for d in (first.diameters, last.diameters, here))
        for name in names:
            x, y = getattr(first, name), getattr(last, name)
            numbers[name] = x if x == y and not np.isfinite(x) else at * ((1.0 - part) * x / a + part * y / b)
    return dataclasses.replace(mixed, **numbers)


def _mixed(first: Section, last: Section, part: float) -> Section:
    """Linear in every number."""

    def mixed(name: str) -> Any:
        a, b = getattr(first, name), getattr(last, name)
        return a if np.all(a == b) else (1.0 - part) * a + part * b

    return dataclasses.replace(first, **{name: mixed(name) for name in NUMBERS})


def sections_along(
    start: Section, stations: Sequence[tuple[float, Section]], elements: int
) -> tuple[Section, ...]:
    """The sections at the middles of elements of equal length; ``stations`` as of `Member`."""
    if not stations:
        return (start,) * elements
    stations = ((0.0, start), *stations)
    reach = np.array([at for at, _ in stations])
    middles = (np.arange(elements) + 0.5) / elements
    which = np.searchsorted(reach, middles, side="right").clip(1, len(stations) - 1)
    return tuple(
        section_between(
            stations[i - 1][1], stations[i][1], (middle - reach[i - 1]) / (reach[i] - reach[i - 1])
        )
        for i, middle in zip(which.tolist(), middles.tolist(), strict=True)
    )


def mean_section(sections: Sequence[Section]) -> Section:
    """The section with the mean of every number."""
    first, *others = sections
    if all(other is first for other in others):
        return first
    for count, other in enumerate(others, start=2):
        first = _mixed(first, other, 1.0 / count)
    return first


def coupled_section(
    stiffness: Inexact[np.ndarray, "strain strain"],
    *,
    rho_A: float,
    rho_I_y: float,
    rho_I_z: float,
) -> Section:
    """A section by its whole 6x6 stiffness, or by the 4x4 of one that is rigid in shear.

    The order is (extension, shear y, shear z, twist, curvature y, curvature z) [N, N m, N m^2], of a 4x4 the
    same without the shears.

    Raises `ConfigError` if the matrix is of another size, not symmetric, or has a negative eigenvalue.

    >>> K = np.diag([1e6, 10.0, 20.0, 30.0])
    >>> K[0, 3] = K[3, 0] = 1e3  # the centroid is at y = -1 mm
    >>> float(coupled_section(K, rho_A=0.1, rho_I_y=0.0, rho_I_z=0.0).EI_z)
    30.0
    """
    check_stiffness(stiffness)
    if len(stiffness) == len(RIGID_IN_SHEAR):
        whole = np.diag([0.0, np.inf, np.inf, 0.0, 0.0, 0.0])
        whole[np.ix_(RIGID_IN_SHEAR, RIGID_IN_SHEAR)] = stiffness
    else:
        whole = np.array(stiffness)
    diagonal = dict(zip(("EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z"), np.diag(whole), strict=True))
    return Section(
        **diagonal,
        rho_A=rho_A,
        rho_I_y=rho_I_y,
        rho_I_z=rho_I_z,
        coupling=np.where(np.eye(6, dtype=bool), 0.0, whole),
    )


def shifted_section(section: Section, centroid: tuple[float, float]) -> Section:
    """``section``, whose bending stiffness is about its centroid, with that at own (y, z) [m].

    An axial force on the node line then bends it. Centres of shear and of mass stay where they are.

    >>> bar = Section(EA=1e6, GJ=10.0, EI_y=20.0, EI_z=30.0, rho_A=0.1, rho_I_y=0.0, rho_I_z=0.0)
    >>> float(shifted_section(bar, (0.0, 0.01)).EI_y)
    120.0
    """
    y, z = centroid
    # The extension at the centroid is that of the node line + z curvature_y - y curvature_z.
    at = np.array([0.0, 0.0, 0.0, 0.0, z, -y])
    more = np.outer(at, at) * section.EA
    more[0] = more[:, 0] = at * section.EA
    more = more + np.outer(at, section.coupling[0]) + np.outer(section.coupling[0], at)
    off = np.where(np.eye(6, dtype=bool), 0.0, more)
    return dataclasses.replace(
        section,
        EI_y=section.EI_y + more[4, 4],
        EI_z=section.EI_z + more[5, 5],
        coupling=section.coupling + off,
        centroid=section.centroid + np.array([y, z]),
    )


def default_up(along: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """World y, or world x for a member within eight degrees of upright.

    >>> default_up(np.array([0.0, 2.0, 0.0])).tolist()
    [1.0, 0.0, 0.0]
    """
    upright = abs(along[1]) > 0.99 * np.linalg.norm(along)
    return np.array([1.0, 0.0, 0.0] if upright else [0.0, 1.0, 0.0])
