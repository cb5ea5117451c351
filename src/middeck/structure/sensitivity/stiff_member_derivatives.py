"""Derivatives beside members too stiff for matrices in W: those of the same article with such members softer.

Matrices in W round by 1e-16 of the stiffest member, and derivatives with them (`stiff_members`). A member
1e7 times as stiff as the article's supports moves as if it were rigid, to 1e-7. Each one beyond that is given
so much less axial, shear, bending and torsional stiffness; rest state and modes are found anew and compared
with those of the article itself, which are right whatever its stiffness. Where they agree, derivatives do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.structure.eigenproblem.repeated import by_frequency
from middeck.structure.model.article import Member, Structure
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.modes.stiff_members import Stiffest, beside_devices, beside_modes
from middeck.structure.rest.equilibrium import Equilibrium, node_rotations, node_shifts, solve_equilibrium
from middeck.structure.rest.imbalance import article_size
from middeck.structure.sensitivity.parameters import ModelParameter, Path, read_parameter

# Up to this ratio rounding is 1e-5 of a derivative, and nothing is made softer.
LEFT_ALONE = 1e8
# What members are then made: a higher one bends less in the upper modes, and rounds more in the lowest.
LEVELS = (1e7, 1e8, 1e9, 1e10)
# Relative difference of rest states and frequencies, and of shapes, up to which they agree.
AGREE, ALIKE = 1e-5, 1e-3


class Softened(NamedTuple):
    """An article at rest, and the factor on each of its stiffnesses."""

    rest: Equilibrium
    factors: Mapping[Path, float]

    def parameters(self, parameters: Sequence[ModelParameter]) -> tuple[ModelParameter, ...]:
        """The same parameters, with their values here."""
        model = self.rest.model
        return tuple(read_parameter(model.structure, self.rest.environment, p) for p in parameters)

    def scales(self, parameters: Sequence[ModelParameter]) -> Float[np.ndarray, " parameter"]:
        """Factors that turn derivatives in each parameter into those of the article itself.

        A flexibility c/(s k) has 1/s of the effect of c/k in the logarithm of k, and 1/s^2 in s k itself.
        """
        out = np.ones(len(parameters))
        for i, p in enumerate(parameters):
            own = {self.factors.get(spot, 1.0) for spot in p.spots}
            if len(own) == 1:
                out[i] = own.pop() ** (1 if p.scales else 2)
        return out


def soften_rest(rest: Equilibrium) -> Softened:
    """``rest`` itself, or with softer members where matrices in W need it.

    Raises `NumericalError` that names the member where the rest state is then another one.
    """
    what, stiffest = "derivatives of the rest state", beside_devices(rest)
    if stiffest is None or stiffest.ratio <= LEFT_ALONE:
        return Softened(rest, {})
    size = np.abs(_moved(rest)).max(axis=0)
    for level in LEVELS:
        found = _settled(rest, level * stiffest.held)
        if found is None:
            continue
        if not _is_soft(beside_devices(found.rest)):
            raise stiffest.refusal(what)
        if np.all(np.abs(_moved(found.rest) - _moved(rest)) <= AGREE * size):
            return found
    raise stiffest.refusal(what, f"{LEVELS[-1]:.0e} times as stiff it is at rest elsewhere")


def soften_modes(modes: Modes, count: int, what: str) -> tuple[Modes, Softened]:
    """``modes`` and their article, or those with softer members, of which the ``count`` lowest are the same.

    Raises `NumericalError` that names the member and the mode where one is not.
    """
    stiffest = beside_modes(modes)
    if stiffest is None or stiffest.ratio <= LEFT_ALONE:
        return modes, Softened(modes.equilibrium, {})
    apart = 0
    for level in LEVELS:
        found = _settled(modes.equilibrium, level * stiffest.held)
        if found is None:
            continue
        softer = solve_modes(found.rest, len(modes.omega))
        if not _is_soft(beside_modes(softer)):
            raise stiffest.refusal(what)
        apart = _first_apart(modes, softer, count)
        if apart == count:
            return dataclasses.replace(softer, shapes=_aligned(modes, softer, count)), found
    raise stiffest.refusal(
        what,
        f"made {LEVELS[-1]:.0e} times as stiff it moves mode {apart} of {modes.frequency_hz[apart]:.4g} Hz",
        f"the {apart} lowest modes alone, or " if apart else "",
    )


def _is_soft(left: Stiffest | None) -> bool:
    """Whether nothing too stiff is left: springs and bushings are not made softer."""
    return left is None or left.ratio <= 4.0 * LEVELS[-1]


def _settled(rest: Equilibrium, most: float) -> Softened | None:
    """The rest state with no member stiffer than ``most`` [N/m]; None where it does not settle."""
    structure, factors = _softer(rest, most)
    found = solve_equilibrium(structure, rest.environment)
    return Softened(found, factors) if found.converged else None


def _softer(rest: Equilibrium, most: float) -> tuple[Structure, dict[Path, float]]:
    model = rest.model
    structure, arm = model.structure, article_size(model)
    length = np.full(len(structure.members), np.inf)
    np.minimum.at(length, model.element_member, np.real(model.beams.length))
    factors: dict[Path, float] = {}
    members: list[Member] = []
    for i, (member, L) in enumerate(zip(structure.members, length, strict=True)):
        path: Path = ("structure", "members", i)
        section = _softer_section(member.section, float(L), arm, most, (*path, "section"), factors)
        stations = tuple(
            (at, _softer_section(s, float(L), arm, most, (*path, "stations", k, 1), factors))
            for k, (at, s) in enumerate(member.stations)
        )
        members.append(dataclasses.replace(member, section=section, stations=stations))
    return dataclasses.replace(structure, members=tuple(members)), factors


def _softer_section(
    section: Section, length: float, arm: float, most: float, path: Path, factors: dict[Path, float]
) -> Section:
    """A section no stiffer than ``most`` in shifts, and in turns at ``arm``, for an element of ``length``."""
    shift, turn = most * length, most * arm**2 * length
    limits = {"EA": shift, "GA_y": shift, "GA_z": shift, "GJ": turn, "EI_y": turn, "EI_z": turn}
    if not any(getattr(section, name) > limit for name, limit in limits.items() if name[:2] != "GA"):
        return section
    values = {name: min(getattr(section, name), limit) for name, limit in limits.items()}
    share = {n: v / getattr(section, n) if getattr(section, n) > 0.0 else 1.0 for n, v in values.items()}
    factors.update({(*path, name): s for name, s in share.items() if 0.0 < s < 1.0})
    # Congruent with what it was, so that a coupled section stays positive.
    root = np.sqrt([share[n] for n in ("EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z")])
    return dataclasses.replace(section, coupling=section.coupling * np.outer(root, root), **values)


def _moved(rest: Equilibrium) -> Float[np.ndarray, "node 2 3"]:
    """Shift [m] and turn [rad] of each node."""
    both = node_shifts(rest), node_rotations(rest)
    return np.array([[of[n.name] for of in both] for n in rest.model.structure.nodes])


def _first_apart(modes: Modes, softer: Modes, count: int) -> int:
    """The first mode of which ``softer`` has another frequency or shape; ``count`` where all agree."""
    have = min(count, len(softer.omega))
    off = np.abs(softer.omega[:have] - modes.omega[:have]) > AGREE * modes.omega[:have]
    off = np.append(off, np.ones(count - have, dtype=bool))
    if not off.any():
        shapes, M = _aligned(modes, softer, count), modes.mass
        alike = np.einsum("im,im->m", modes.shapes[:, :count], M @ shapes[:, :count])
        off = np.abs(alike - 1.0) > ALIKE
    return int(np.argmax(np.append(off, True)))


def _aligned(modes: Modes, softer: Modes, count: int) -> Float[np.ndarray, "coordinate mode"]:
    """Shapes of ``softer`` turned within equal frequencies, or in sign, to those of ``modes``."""
    shapes = softer.shapes.copy()
    for own in by_frequency(modes.omega[:count] ** 2):
        U, _, Vt = sla.svd(shapes[:, own].T @ (modes.mass @ modes.shapes[:, own]))
        shapes[:, own] = shapes[:, own] @ (U @ Vt)
    return shapes
