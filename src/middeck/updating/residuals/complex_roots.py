"""Roots of complex modes, with the friction that each has at its amplitude, and derivatives by unknowns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes, damping_ratios, solve_damped, solve_stiffened
from middeck.structure.sensitivity.damping import differentiate_pencil, steepness
from middeck.structure.sensitivity.parameters import read_parameter
from middeck.updating.residuals.friction import Added
from middeck.updating.unknowns.unknowns import DAMPING, Bound
from middeck.values import record

# Modes above the highest that is asked for, which losses may mix into it; and by how much, relative, a root
# with friction may move without the last of these: a joint that sticks bends the article where it holds, as
# a sum of free modes does slowly.
SPARE, MISSED = 6, 1e-3


@record
class LogRoots:
    """Roots s of complex modes, derivatives of ln s by unknowns, and what losses alone have of these.

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
            pushed = -a.slope[k] * (a.row @ shapes) ** 2 / steep
            slope[k] += pushed
            of_losses[k] += pushed
    return LogRoots(s, shapes, slope.T, of_losses.T)


def stiffened_roots(
    damped: DampedModes, ours: np.ndarray, added: Sequence[Added], omega: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Root and shape of each pair, with the friction that it has at its amplitude.

    Raises `ConfigError` where the modes are too few for the stiffness of the joints.
    """
    if not added:
        return damped.s[ours], damped.shapes[:, ours]
    s, shapes = _stiffened(damped, ours, added, omega, len(omega))
    fewer = max(len(omega) - SPARE, int(ours.max(initial=0)) + 1)
    moved = np.abs(_stiffened(damped, ours, added, omega, fewer)[0] / s - 1.0)
    if moved.max(initial=0.0) > MISSED:
        hz = np.abs(s[np.argmax(moved)]) / (2.0 * np.pi)
        raise ConfigError(
            f"joints with friction are too stiff for {len(omega)} modes: the mode at {hz:.4g} Hz moves by "
            f"{100.0 * moved.max():.2g} % without the last {len(omega) - fewer}",
            where="surveyed friction",
            hint="a test in which the joints slip, or an article with an elastic joint that sticks",
        )
    return s, shapes


def _stiffened(
    damped: DampedModes, ours: np.ndarray, added: Sequence[Added], omega: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Losses and stiffness of the lowest ``count`` free modes alone."""
    kept = slice(count)
    few = DampedModes(damped.s[kept], *(M[kept, kept] for M in damped[1:]))
    rows = np.array([a.row[kept] for a in added])
    found = [
        solve_stiffened(few, omega[kept], int(i), rows, np.array([a.stiffness[k] for a in added]))
        for k, i in enumerate(ours)
    ]
    return np.array([s for s, _ in found]), np.array([v for _, v in found]).T
