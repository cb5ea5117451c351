"""The same structure with more elements, and with the shear that slender members are drawn without."""

import dataclasses

import numpy as np

from middeck.structure.model.article import Member, Structure
from middeck.structure.model.section import Section

TUBE_SHEAR = 0.62
"""Cowper's (1966) shear coefficient of a tube of the sheet's proportions, bore half of the diameter, nu 0.37:
6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2) with m = 0.512."""

# Shear modulus over E of an incompressible isotropic material, the least of all.
LEAST_G = 1.0 / 3.0


def refine_mesh(structure: Structure, factor: int, shear: float | None = None) -> Structure:
    """Every member in ``factor`` times as many elements.

    ``shear`` is the coefficient k in k G A of every member without a shear stiffness of its own, taken as
    round; None leaves it rigid in shear.
    """

    def finer(member: Member) -> Member:
        return dataclasses.replace(
            member,
            elements=factor * member.elements,
            section=_in_shear(member.section, shear),
            stations=tuple((at, _in_shear(section, shear)) for at, section in member.stations),
        )

    return dataclasses.replace(structure, members=tuple(finer(m) for m in structure.members))


def add_shear(structure: Structure, part: float) -> Structure:
    """Members without a shear stiffness of their own, with ``part`` of a tube's; none from zero down."""
    return refine_mesh(structure, 1, TUBE_SHEAR / part) if part > 0.0 else structure


def _in_shear(section: Section, coefficient: float | None) -> Section:
    """k G A of a section from its other stiffnesses: of a round one GJ = 2 G I, so that G A = GJ EA / (2 EI).

    Others, crosses and slit tubes among them, twist more easily than that: G is no less than a third of E.
    """
    bending = section.EI_y + section.EI_z
    if coefficient is None or not (section.GJ > 0.0 and bending > 0.0):
        return section  # a rod has no shear to speak of
    stiff = coefficient * max(section.GJ / bending, LEAST_G) * section.EA
    GA_y = section.GA_y if np.isfinite(section.GA_y) else stiff
    GA_z = section.GA_z if np.isfinite(section.GA_z) else stiff
    return dataclasses.replace(section, GA_y=GA_y, GA_z=GA_z)
