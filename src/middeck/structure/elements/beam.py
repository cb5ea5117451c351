"""Corotational cubic beam elements from one strain energy: forces, tangent and weight.

The energy is a quadratic form in six deformations (`beam_deformations`), whose derivatives are exact, so that
the tangent is symmetric and contains the whole geometric stiffness. Arrays hold one element per row.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Inexact

from middeck.structure.elements.beam_deformations import (
    ONE,
    STRETCH,
    TWO,
    EndStrain,
    chord,
    deform,
)
from middeck.structure.elements.beam_geometric_stiffness import add_cosine_hessian, geometric_stiffness
from middeck.structure.elements.rotations import cross, symmetric_double_cross
from middeck.structure.elements.section_stiffness import SectionForms, element_forms, section_forms
from middeck.structure.model.section import MemberMass, Section
from middeck.values import record

Array = np.ndarray
AXIAL = np.eye(6)[STRETCH]
# Shares of the mass that are lumped along and across the axis, and whether it goes straight between the ends;
# see `MemberMass`.
SPREAD = {
    MemberMass.CONSISTENT: (0.0, 0.0, False),
    MemberMass.COUPLED: (0.5, 0.0, False),
    MemberMass.ROD: (0.0, 0.0, True),
    MemberMass.COUPLED_ROD: (0.5, 1.0, True),
}


@record(kw_only=True)
class BeamProperties:
    """Stiffness and inertia of each element, one row an element.

    Attributes:
        length: Undeformed length [m].
        stiffness: On (stretch, y1, z1, y2, z2, twist), see `section_stiffness`.
        bow: Mean squared slope of the centre line against its chord, a quadratic form in (y1, z1, y2, z2);
            zero in a plane where a rod has no stiffness to bend it, and it goes straight between the ends.
        slant: Shear strains that (extension, twist, curvatures) bring at no shear force, with opposite sign.
        tension: Axial force [N] as drawn.
        EA, GJ, EI_y, EI_z: Diagonal of the section's stiffness.
        shear_y, shear_z: Phi = 12 EI_z / (GA_y L^2) of bending in the own x-y plane, and of that in x-z.
        rho_A, rho_I_y, rho_I_z, mass_centre_y, mass_centre_z: As of `Section`.
        lumped: Shares of the mass, along and across the axis, that are lumped at the ends.
    """

    length: Inexact[np.ndarray, " element"]
    stiffness: Inexact[np.ndarray, "element 6 6"]
    bow: Inexact[np.ndarray, "element 4 4"]
    slant: Inexact[np.ndarray, "element 2 4"]
    tension: Inexact[np.ndarray, " element"]
    EA: Inexact[np.ndarray, " element"]
    GJ: Inexact[np.ndarray, " element"]
    EI_y: Inexact[np.ndarray, " element"]
    EI_z: Inexact[np.ndarray, " element"]
    shear_y: Inexact[np.ndarray, " element"]
    shear_z: Inexact[np.ndarray, " element"]
    rho_A: Inexact[np.ndarray, " element"]
    rho_I_y: Inexact[np.ndarray, " element"]
    rho_I_z: Inexact[np.ndarray, " element"]
    mass_centre_y: Inexact[np.ndarray, " element"]
    mass_centre_z: Inexact[np.ndarray, " element"]
    lumped: Inexact[np.ndarray, "element 2"]  # shares of the mass, along and across, lumped at the ends
    straight: Bool[np.ndarray, " element"]  # whether the mass goes straight between the ends


def beam_properties(
    sections: Sequence[Section],
    lengths: Inexact[np.ndarray, " element"],
    tension: Inexact[np.ndarray, " element"] | None = None,
) -> BeamProperties:
    """Gather one section, one length and one tension (none: zero) per element."""

    distinct = {id(s): s for s in sections}
    place = {key: i for i, key in enumerate(distinct)}
    which = np.array([place[id(s)] for s in sections], dtype=int)

    def column(name: str) -> Array:
        return (np.array([getattr(s, name) for s in distinct.values()]) + 0.0)[which]

    lengths = np.asarray(lengths)
    spread = [SPREAD[s.mass] for s in distinct.values()]
    straight = np.array([row[2] for row in spread], dtype=bool)[which]
    names = ("EA", "GJ", "EI_y", "EI_z", "rho_A", "rho_I_y", "rho_I_z", "mass_centre_y", "mass_centre_z")
    forms = section_forms(tuple(distinct.values()))
    element = element_forms(SectionForms(*(part[which] for part in forms)), lengths)
    bows = ~straight[:, None] | np.column_stack([column("EI_y"), column("EI_z")] * 2).astype(bool)
    return BeamProperties(
        length=lengths,
        stiffness=element.stiffness,
        bow=element.bow * (bows[:, :, None] & bows[:, None, :]),
        slant=forms.P[which],
        tension=np.zeros(len(lengths)) if tension is None else tension,
        **{name: column(name) for name in names},
        shear_y=element.shear[:, 1, 1],
        shear_z=element.shear[:, 0, 0],
        lumped=np.array([row[:2] for row in spread]).reshape(-1, 2)[which],
        straight=straight,
    )


class BeamState(NamedTuple):
    """Strain energy [J], end forces and tangent in (dx1, theta1, dx2, theta2) of each element.

    ``force`` [N, N m] works on the six deformations ``strain``, which have the ``slope`` (element, 6, 12) in
    the pose coordinates; ``excess`` is what the elements' own forces add to the
    gradient where another has taken their place. The tangent is the sum of the ``material`` part, at
    which no force is present, and the ``geometric`` part, which is linear in the forces.
    """

    energy: Array
    force: Array
    gradient: Array
    excess: Array
    material: Array
    geometric: Array
    strain: Array
    slope: Array

    @property
    def hessian(self) -> Array:
        """The tangent (element, 12, 12)."""
        return self.material + self.geometric


def beam_state(
    beams: BeamProperties,
    x: Inexact[np.ndarray, "element 2 3"],
    T: Inexact[np.ndarray, "element 2 3 3"],
    force: Inexact[np.ndarray, "element 6"] | None = None,
    known: EndStrain | None = None,
) -> BeamState:
    """Energy, forces and tangent of every element at the given end poses.

    ``force`` takes the place of the elements' own, for a tangent with the forces of another state; ``known``
    has digits of the strain that the poses have not.
    """
    strain = deform(beams.length, beams.bow, x, T, known)
    k = beams.stiffness
    own = np.matvec(k, strain.value)
    energy = 0.5 * np.einsum("ei,ei->e", own, strain.value) + beams.tension * strain.value[:, STRETCH]
    own = tensioned(beams, own)
    force = own if force is None else force
    gradient, excess = (((f[:, None]) @ strain.slope)[:, 0] for f in (force, own - force))
    material = np.swapaxes(strain.slope, 1, 2) @ (k @ strain.slope)
    geometric = geometric_stiffness(strain, force)
    return BeamState(
        energy=energy,
        force=force,
        gradient=gradient,
        excess=excess,
        material=material,
        geometric=geometric,
        strain=strain.value,
        slope=strain.slope,
    )


def beam_deformations(
    beams: BeamProperties,
    x: Inexact[np.ndarray, "element 2 3"],
    T: Inexact[np.ndarray, "element 2 3 3"],
    known: EndStrain | None = None,
) -> tuple[Inexact[np.ndarray, "element 6"], Inexact[np.ndarray, "element 6 12"]]:
    """(stretch, y1, z1, y2, z2, twist) and their derivative in the twelve pose coordinates."""
    strain = deform(beams.length, beams.bow, x, T, known)
    return strain.value, strain.slope


def tensioned(beams: BeamProperties, elastic: Inexact[np.ndarray, "element 6"]) -> Array:
    """Forces on the six deformations: ``elastic`` ones and the tension as drawn."""
    return elastic + beams.tension[:, None] * AXIAL


def mass_arms(beams: BeamProperties, T: Inexact[np.ndarray, "element end 3 3"]) -> Array:
    """From the node line to the mass centre at both ends."""
    return beams.mass_centre_y[:, None, None] * T[..., 1] + beams.mass_centre_z[:, None, None] * T[..., 2]


class BeamWeight(NamedTuple):
    """Potential [J], gradient and Hessian in (dx1, theta1, dx2, theta2) of each element's weight."""

    energy: Array
    gradient: Array
    hessian: Array


def beam_weight(
    beams: BeamProperties,
    x: Inexact[np.ndarray, "element 2 3"],
    T: Inexact[np.ndarray, "element 2 3 3"],
    gravity: Inexact[np.ndarray, "3"],
) -> BeamWeight:
    """Potential of the distributed weight on the cubic centre line, with its consistent end moments.

    The Hermite curve through both ends has its mean at (x1 + x2)/2 + L/12 (t1 - q1). Along the chord e that
    curve gains length as it bends, L/24 (theta2^2 - theta1^2), which the weight would use: bare, it makes
    cables fall sideways. Material points of a line that keeps its length move along the chord by the
    bowing up to them, in the mean L/60 (theta2^2 - theta1^2). With t1.e - q1.e = (theta2^2 - theta1^2)/2 the
    difference is the last term of

        mean = (x1 + x2)/2 + L/12 (t1 - q1) - L/20 (t1.e - q1.e) e,

    so that the tension inside an element varies linearly, as it does under weight. The mass of a rod goes
    straight between the ends. A mass centre off the line adds the mean of its arms at both ends.
    """
    n = len(beams.length)
    W = (beams.rho_A * beams.length)[:, None] * gravity
    dtype = np.result_type(W, x, T)
    if not np.any(W):
        return BeamWeight(np.zeros(n, dtype), np.zeros((n, 12), dtype), np.zeros((n, 12, 12), dtype))
    lever = np.where(beams.straight, 0.0, beams.length / 12.0)
    along = np.where(beams.straight, 0.0, -(beams.length / 20.0))
    e, span = chord(x)
    t, q = T[:, 0, :, 0], T[:, 1, :, 0]
    down, lean = np.einsum("ei,ei->e", W, e), np.einsum("ei,ei->e", t - q, e)
    mean = 0.5 * (x[:, 0] + x[:, 1]) + lever[:, None] * (t - q)
    aside = 0.5 * mass_arms(beams, T)
    energy = -np.einsum("ei,ei->e", W, mean + aside[:, 0] + aside[:, 1]) - along * down * lean
    d_down, d_lean = np.zeros((n, 12), dtype), np.zeros((n, 12), dtype)
    for slope, vector in ((d_down, W), (d_lean, t - q)):
        across = (vector - np.einsum("ei,ei->e", vector, e)[:, None] * e) / span[:, None]
        slope[:, 0:3], slope[:, 6:9] = -across, across
    d_lean[:, ONE], d_lean[:, TWO] = cross(t, e), -cross(q, e)
    gradient = -along[:, None] * (lean[:, None] * d_down + down[:, None] * d_lean)
    both = d_down[:, :, None] * d_lean[:, None, :]
    hessian = -along[:, None, None] * (both + np.swapaxes(both, 1, 2))
    led: list[tuple[Array, slice | None]] = [(-(along * lean)[:, None] * W, None)]
    for rows, normal, sign in ((ONE, t, 1.0), (TWO, q, -1.0)):
        gradient[:, rows.start - 3 : rows.start] -= 0.5 * W
        arm = sign * lever[:, None] * normal + aside[:, 0 if rows is ONE else 1]
        gradient[:, rows] -= cross(arm, W)
        hessian[:, rows, rows] -= symmetric_double_cross(W, arm)
        led.append((-(sign * along * down)[:, None] * normal, rows))
    add_cosine_hessian(hessian, e, span, led)
    return BeamWeight(energy, gradient, hessian)
