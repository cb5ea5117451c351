"""Shares of the effects of gravity in each mode's shift from 0-g to 1-g (the 1993 paper's classes).

Three of the five classes change the linear structure and can be switched, one at a time:

- *suspension*: what the devices add to stiffness and mass where they stand;
- *stiffness*: all that is linear in the forces inside the rest state, the weight and dead pulls included;
- *deformation*: the geometry about which one linearises, at rest or undeformed; where the article as a whole
  hangs, and its heading, are those at rest either way.

The eight states between orbit and the laboratory form a cube; an order of switching is a way along its edges.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.structure.assembly.energy import inner_forces, split_tangent
from middeck.structure.assembly.linked import bent_links
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.gravity.orbit_lab_pairs import pair_modes
from middeck.structure.gravity.tracking import HALF_SHAPE, solve_spectrum, track
from middeck.structure.modes.solve import Modes
from middeck.structure.modes.stiff_members import check_beside_modes
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.link_loads import rest_multipliers
from middeck.values import record

EFFECTS = ("suspension", "stiffness", "deformation")
ORDERS = tuple(itertools.permutations(range(len(EFFECTS))))
CORNERS = tuple(itertools.product((0, 1), (0, 1), (0, 1)))

Corner = tuple[int, int, int]


@record(kw_only=True)
class GravityBudget:
    """Each mode's omega^2 with every combination of the `EFFECTS` on or off; rows in the order of the lab.

    Attributes:
        pairs: (orbit, lab) index of each mode. Rigid-body modes have one frequency, so that any basis of
            theirs will do: theirs is the one nearest to the suspension modes, and the index is that of the
            first.
        corner: omega^2 [1/s^2] with suspension, stiffness and deformation off (0) or on (1), in that order;
            negative where the state, which is no rest state, would be unstable.
        match: Cross-orthogonality of the mode in each corner with the mode in orbit.
    """

    orbit: Modes
    lab: Modes
    pairs: Int[np.ndarray, "mode 2"]
    corner: Float[np.ndarray, "mode 2 2 2"]
    match: Float[np.ndarray, "mode 2 2 2"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, "mode 2"]:
        """Frequencies in orbit and in the laboratory [Hz]."""
        return np.sqrt(np.stack([self.corner[:, 0, 0, 0], self.corner[:, 1, 1, 1]], axis=1)) / (2.0 * np.pi)

    @property
    def by_order(self) -> Float[np.ndarray, "order mode effect"]:
        """Contribution of each effect to omega^2 [1/s^2] in each of the six `ORDERS` of switching."""
        return np.stack([_telescope(self.corner, order) for order in ORDERS])

    @property
    def hz_per_omega2(self) -> Float[np.ndarray, " mode"]:
        """1 / (4 pi^2 (f_0 + f_1)) [Hz s^2]: takes shares of omega^2 to shares of frequency, totals exactly.

        Zero for a mode that is at zero frequency on both sides: only its omega^2 has a meaning.
        """
        total = 4.0 * np.pi**2 * self.frequency_hz.sum(axis=1)
        return np.where(total > 0.0, 1.0 / np.where(total > 0.0, total, 1.0), 0.0)

    @property
    def shift_hz(self) -> Float[np.ndarray, " mode"]:
        """Frequency in the laboratory less that in orbit."""
        return self.frequency_hz[:, 1] - self.frequency_hz[:, 0]

    @property
    def share_hz(self) -> Float[np.ndarray, "mode effect"]:
        """Mean over the orders (Shapley 1953); the sum over the effects is `shift_hz`."""
        return self.by_order.mean(axis=0) * self.hz_per_omega2[:, None]

    @property
    def range_hz(self) -> Float[np.ndarray, "mode effect 2"]:
        """Smallest and largest over the orders: the dependence of the share on the order of switching."""
        ends = np.stack([self.by_order.min(axis=0), self.by_order.max(axis=0)], axis=2)
        return ends * self.hz_per_omega2[:, None, None]

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Rows that keep less than half of their shape in orbit in some corner: uncertain shares."""
        return tuple(map(int, np.flatnonzero(self.match.min(axis=(1, 2, 3)) < HALF_SHAPE)))


def _telescope(corner: np.ndarray, order: tuple[int, ...]) -> np.ndarray:
    """Differences along one path over the edges of the cube, in the order of the effects."""
    steps = np.zeros((len(corner), len(EFFECTS)))
    on = [0] * len(EFFECTS)
    for effect in order:
        before = corner[:, *on]
        on[effect] = 1
        steps[:, effect] = corner[:, *on] - before
    return steps


@named_kinds
def build_budget(orbit: Modes, lab: Modes, count: int = 26) -> GravityBudget:
    """The budget of the ``count`` lowest modes in orbit, whatever their rank in the laboratory.

    Each corner is an eigenproblem of its own; its modes are those with the largest cross-orthogonality with
    orbit. Raises `ConfigError` for two different structures, or where ``orbit`` is not free of gravity, and
    `NumericalError` beside a member so stiff that rounding is all there is.

    Both are modes, from `solve_modes`, not rest states:

    >>> import middeck as md
    >>> parts, environment = md.load_setup("articles/mace-dm.toml", "environments/lab.toml")
    >>> rests = [md.solve_equilibrium(parts, e) for e in (md.Environment.orbit(), environment)]
    >>> orbit, lab = map(md.solve_modes, rests)
    >>> budget = build_budget(orbit, lab, 12)
    >>> bool(np.allclose(budget.share_hz.sum(axis=1), budget.shift_hz, atol=1e-9))
    True
    """
    _check(orbit, lab)
    check_beside_modes(lab, "shares of gravity")
    model = lab.equilibrium.model
    count = min(count, len(orbit.omega), len(lab.omega))
    start_at, start, at_rest, end = pair_modes(orbit, lab, count)
    corner, match = np.zeros((count, 2, 2, 2)), np.ones((count, 2, 2, 2))
    corner[:, 0, 0, 0] = start.lam
    for on in CORNERS[1:-1]:
        K, M = corner_matrices(start_at, lab.equilibrium, on)
        at = lab.equilibrium.config if on[-1] else start_at.config
        found = track(at_rest if on[-1] else start, solve_spectrum(model, at, K, M, count))
        corner[:, *on], match[:, *on] = found.spectrum.lam, found.match
    corner[:, 1, 1, 1], match[:, 1, 1, 1] = end.spectrum.lam, end.match
    rows = np.argsort(end.found, kind="stable")
    first = np.array([orbit.kind.index("rigid") if k == "rigid" else i for i, k in enumerate(orbit.kind)])
    pairs = np.stack([first[:count], end.found], axis=1)
    return GravityBudget(orbit=orbit, lab=lab, pairs=pairs[rows], corner=corner[rows], match=match[rows])


def corner_matrices(orbit: Equilibrium, lab: Equilibrium, on: Corner) -> tuple[sp.csr_array, sp.csr_array]:
    """Tangent and mass in all coordinates with suspension, stiffness and deformation off (0) or on (1).

    (0, 0, 0) is the tangent in orbit and (1, 1, 1) that in the laboratory. Spans of devices are from where
    ``orbit`` has the article: see `carry_along`. With deformation off, the forces
    are those of the true rest state, on the geometry in orbit: not an equilibrium, so that the tangent is
    the Hessian in the coordinates of the frame tree (displacements and rotation vectors).
    """
    suspension, stiffness, deformation = on
    model = lab.model
    at = lab.config if deformation else orbit.config
    inside = inner_forces(model, lab.config, lab.loads)
    if stiffness:
        forces, gravity = inside, lab.loads.gravity
    else:  # an article may be pretensioned in orbit
        own = inner_forces(model, orbit.config, orbit.loads)
        forces = own._replace(device=np.zeros_like(inside.device), ground=np.zeros_like(inside.ground))
        gravity = orbit.loads.gravity
    parts = split_tangent(model, at, dataclasses.replace(lab.loads, gravity=gravity), forces)
    held = split_tangent(model, at, lab.loads, inside).device
    K = parts.material + parts.geometric + suspension * held
    # Forces of links are inside too.
    bent = (
        None if model.links is None else bent_links(model, at, rest_multipliers(lab if stiffness else orbit))
    )
    whole = sp.csr_array(K if bent is None else K + bent[1])
    return whole, mass_matrix(model, at, lab.loads if suspension else None)


def _check(orbit: Modes, lab: Modes) -> None:
    free, hung = orbit.equilibrium, lab.equilibrium
    if free.model.held != hung.model.held:
        raise ConfigError(
            "the two environments have different clamps: a budget knows gravity and suspension alone",
            where=f"environments {free.environment.title!r} and {hung.environment.title!r}",
            hint="give both the same clamps, or compare_modes",
        )
    if free.model != hung.model:
        raise ConfigError(
            "a budget needs one structure in two environments",
            where=f"{free.model.structure.title!r} and {hung.model.structure.title!r}",
            hint="solve both from the same load_structure(...)",
        )
    if np.any(hung.loads.push):
        raise ConfigError(
            "applied loads shift the frequencies too: a budget knows gravity and suspension alone",
            where=f"structure {hung.model.structure.title!r}",
            hint="leave the loads out; added masses may stay",
        )
    if np.any(free.loads.gravity) or len(free.loads.attach_point):
        raise ConfigError(
            "the first argument of a budget must be modes in orbit, without gravity and suspension",
            where=f"environment {free.environment.title!r}",
            hint="solve_modes(solve_equilibrium(structure, Environment.orbit()))",
        )
