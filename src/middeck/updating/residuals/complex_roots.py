"""Roots of complex modes, with the friction that each has at its amplitude, and derivatives by unknowns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes, damped_roots, damping_ratios, solve_damped
from middeck.structure.sensitivity.damping_derivatives import differentiate_pencil, steepness
from middeck.structure.sensitivity.parameters import read_parameter
from middeck.updating.residuals.own_articles import SPARE
from middeck.updating.residuals.surveyed_friction import Added
from middeck.updating.residuals.surveys import ModePairing
from middeck.updating.unknowns.unknowns import DAMPING, Bound
from middeck.values import record


@record
class LogRoots:
    """Roots s of complex modes, derivatives of ln s by unknowns, and the part of these by losses alone.

    One for each mode, in their order, or for each pair of a survey.
    """

    s: Complex[np.ndarray, " root"]
    shapes: Complex[np.ndarray, "mode root"]
    slope: Complex[np.ndarray, "root unknown"]
    of_losses: Complex[np.ndarray, "root unknown"]

    @property
    def zeta(self) -> Float[np.ndarray, " root"]:
        """Damping ratios."""
        return damping_ratios(self.s)

    @property
    def by_log_zeta(self) -> Float[np.ndarray, "root unknown"]:
        """Derivatives of ln zeta: zeta is minus the cosine of the root's angle."""
        zeta = self.zeta
        steep = np.divide(np.sqrt(1.0 - zeta**2), zeta, out=np.zeros(len(zeta)), where=zeta > 0.0)
        return steep[:, None] * np.imag(self.slope)


def roots_of_lowest(modes: Modes, bound: Sequence[Bound], count: int) -> LogRoots:
    """Roots of the lowest ``count`` modes, and of `SPARE` above these, without friction."""
    damped = solve_damped(modes, count=count + SPARE)
    return differentiate_roots(modes, damped, damped.s, damped.shapes, bound, ())


def differentiate_roots(
    modes: Modes,
    damped: DampedModes,
    s: np.ndarray,
    shapes: np.ndarray,
    bound: Sequence[Bound],
    added: Sequence[Added],
) -> LogRoots:
    """Derivatives of roots in the losses of ``damped``, under ``added`` joint stiffness for each root."""
    both = modes.equilibrium.model.structure, modes.equilibrium.environment
    now = [[read_parameter(*both, p) for p in b.parameters] for b in bound]
    parameters = [p for own in now for p in own]
    slopes = differentiate_pencil(modes, parameters, len(damped.losses), [a.coordinate for a in added])
    steps = iter(slopes.log_roots(s, shapes, damped.losses))
    at = np.where(s != 0.0, s, 1.0)
    steep = at * steepness(at, shapes, damped.losses)
    rows = iter(slopes.rows)
    slope, of_losses = np.zeros((2, len(bound), len(s)), complex)
    for k, own in enumerate(now):
        for parameter in own:
            step = next(steps)
            for a, turned in zip(added, next(rows), strict=True):
                step = step - 2.0 * a.stiffness * (a.row @ shapes) * (turned @ shapes) / steep
            step = step * (1.0 if bound[k].unknown.added else parameter.value)
            slope[k] += step
            of_losses[k] += step * parameter.name.startswith(DAMPING)
        for a in added:
            moved = (a.row @ shapes) ** 2 / steep
            slope[k] -= a.slope[k] * moved
            of_losses[k] -= 1j * np.imag(a.slope[k]) * moved
    return LogRoots(s, shapes, slope.T, of_losses.T)


def roots_of_pairs(
    damped: DampedModes, paired: ModePairing
) -> tuple[Complex[np.ndarray, " pair"], Complex[np.ndarray, "mode pair"]]:
    """Root of each pair with friction at its amplitude, and its shape in its article's modes."""
    if paired.own.turn is None:
        return damped.s[paired.labels], damped.shapes[:, paired.labels]
    rows = np.array([a.row for a in paired.added])
    count, found = paired.own.count, []
    for k, label in zip(paired.pairs[:, 1], paired.labels, strict=True):
        turn = paired.own.turn[k]
        lost = np.imag([a.stiffness[k] for a in paired.added])
        H = turn.T @ (damped.hysteresis + (rows.T * lost) @ rows) @ turn
        own = paired.own.modes.omega[count * k :][:count]
        s, shapes = damped_roots(own, turn.T @ damped.losses @ turn, H)
        found.append((s[label], shapes[:, label]))
    return np.array([s for s, _ in found]), np.array([v for _, v in found]).T
