"""From sections to elements: stiffness on the six deformations, exact for beams with loads at their ends.

The strains of a section are e = (extension, twist, curvatures about own y and z) and the shear strains g.
With the shear forces V in place of g its energy is

    e'A e/2 + V'F V/2,    g = F V - P e,

so that F = 0 is a beam rigid in shear. A coupled g has P, and so does a shear centre off the node line. Under
end loads the section forces are constant or, the moments, linear along an element; so are all strains, and
those that no deformation fixes are such that the energy is least (Przemieniecki 1968 for the diagonal case;
Hodges 2006, Nonlinear Composite Beam Theory, section 4, for sections).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from middeck.structure.elements.beam_deformations import PHI, STRETCH, Y1, Y2, Z1, Z2
from middeck.structure.model.section import Section

Array = np.ndarray
# Places in (extension, shear y, shear z, twist, curvature y, curvature z), the order of `Section.coupling`.
STRAINS, SHEARS = [0, 3, 4, 5], [1, 2]
# A shear strain (y, z) turns the centre line about own (y, z) by this.
TURNS = np.array([[0.0, -1.0], [1.0, 0.0]])


class SectionForms(NamedTuple):
    """A, P and F of each section; see above."""

    A: Array  # (section, 4, 4)
    P: Array  # (section, 2, 4)
    F: Array  # (section, 2, 2)


def section_forms(sections: Sequence[Section]) -> SectionForms:
    """A, P and F of sections; analytic."""
    diagonal = np.array([(s.EA, s.GJ, s.EI_y, s.EI_z) for s in sections]).reshape(-1, 4)
    coupling = np.array([s.coupling for s in sections]).reshape(-1, 6, 6)
    centre = np.array([(s.shear_centre_y, s.shear_centre_z) for s in sections]).reshape(-1, 2)
    F = _inverse(np.array([(s.GA_y, s.GA_z) for s in sections]).reshape(-1, 2), coupling[:, 1, 2])
    A = coupling[:, STRAINS][:, :, STRAINS] + diagonal[:, :, None] * np.eye(4)
    B = coupling[:, SHEARS][:, :, STRAINS]
    P = F @ B + 0.0 * centre[:, 0, None, None]
    # Shear strains are those at the shear centre: g_y - twist z, g_z + twist y.
    P[:, 0, 1] -= centre[:, 1]
    P[:, 1, 1] += centre[:, 0]
    return SectionForms(A - np.swapaxes(B, 1, 2) @ F @ B, P, F)


def _inverse(GA: Array, across: Array) -> Array:
    """Inverse of [[GA_y, across], [across, GA_z]] by flexibilities: GA may be infinite."""
    f = 1.0 / GA
    both = f[:, 0] * f[:, 1]
    least = 1.0 - across**2 * both
    F = np.zeros((len(GA), 2, 2), dtype=np.result_type(GA, across))
    F[:, [0, 1], [0, 1]] = f / least[:, None]
    F[:, 0, 1] = F[:, 1, 0] = -across * both / least
    return F


class ElementForms(NamedTuple):
    """Stiffness of elements on their deformations, the mean squared slope of their lines, and Phi.

    Phi is 12 / L^2 times shear flexibility times bending stiffness, of bending about own y and z.
    """

    stiffness: Array  # (element, 6, 6)
    bow: Array  # (element, 4, 4) in (y1, z1, y2, z2)
    shear: Array  # (element, 2, 2)


def element_forms(forms: SectionForms, length: Array) -> ElementForms:
    """Forms of elements with one of the sections each; analytic.

    With the mean m of the end rotations against the chord, u = m - TURNS P e of the mean strains e, and D the
    bending stiffness at no axial force and no torque, the linear part of the curvature is 6/L (1 + Phi)^-1 u.
    """
    A, P, F = forms
    L = np.asarray(length)
    scale = (12.0 / L**2)[:, None, None]
    D = _free_bending(A)
    shear = scale * (TURNS @ F @ TURNS.T) @ D
    W = _inverse_of_one_plus(shear)
    mean, end = np.zeros((4, 6)), np.zeros((2, 6))
    mean[[0, 1, 2, 2, 3, 3], [STRETCH, PHI, Y1, Y2, Z1, Z2]] = 1.0, 1.0, -1.0, 1.0, -1.0, 1.0
    end[[0, 0, 1, 1], [Y1, Y2, Z1, Z2]] = 0.5
    u = end - (TURNS @ P / L[:, None, None]) @ mean
    k = (mean.T @ A @ mean + 12.0 * np.swapaxes(u, 1, 2) @ (D @ W) @ u) / L[:, None, None]
    slope, turn = end[:, Y1:PHI], mean[2:, Y1:PHI]
    bow = turn.T @ turn / 12.0 + 0.2 * slope.T @ np.swapaxes(W, 1, 2) @ W @ slope
    return ElementForms(0.5 * (k + np.swapaxes(k, 1, 2)), bow, shear)


def _free_bending(A: Array) -> Array:
    """Stiffness on both curvatures with the extension and the twist free; what has none resists nothing."""
    left = A
    for _ in range(2):
        pivot, row = left[:, 0, 0], left[:, 0, 1:]
        ratio = np.divide(row, pivot[:, None], out=np.zeros_like(row), where=(pivot != 0.0)[:, None])
        left = left[:, 1:, 1:] - ratio[:, :, None] * row[:, None, :]
    return left


def _inverse_of_one_plus(a: Array) -> Array:
    b = np.eye(2) + a
    out = np.empty_like(b)
    out[:, 0, 0], out[:, 1, 1] = b[:, 1, 1], b[:, 0, 0]
    out[:, 0, 1], out[:, 1, 0] = -b[:, 0, 1], -b[:, 1, 0]
    return out / (b[:, 0, 0] * b[:, 1, 1] - b[:, 0, 1] * b[:, 1, 0])[:, None, None]
