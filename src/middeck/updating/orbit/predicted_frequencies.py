"""Frequencies in another environment, above all in orbit, from a refinement on the ground."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.arguments import named_kinds
from middeck.structure.correlation.measured_modes import seen, sensor_rows
from middeck.structure.model.environment import Environment
from middeck.structure.model.umbilical import floats, umbilical_point
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.updating.orbit.predicted_damping import DampingParts, carry_damping, measured_damping
from middeck.updating.orbit.second_order_shift import bend_of
from middeck.updating.refinement.bayesian_estimate import BELOW, NORMAL_95
from middeck.updating.refinement.curvature import frequency_curvature
from middeck.updating.refinement.mesh_and_shear import left_out
from middeck.updating.refinement.model_errors import HALF, OwnErrors, sorts_of
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.complex_roots import LogRoots, roots_of_lowest
from middeck.updating.residuals.surveys import Compared, set_up
from middeck.updating.unknowns.unknowns import product_slopes
from middeck.values import record

# Hz: of a cable that no model has, by which an article that floats may hang.
CABLE_HZ = 0.03
# Part of a mode that need not have been seen.
LITTLE = 0.01


@record(kw_only=True)
class Prediction:
    """Modes as predicted, rigid ones left out.

    Attributes:
        modes, index: Modes of the refined model, and which of them these are.
        log_shift: Addition to ln f by the model's own errors, seen on the ground, and, in the mean, by a
            cable and the second order of the unknowns (`bend_of`).
        log_root: Root of their shared covariance, by unknowns and errors of the refinement.
        log_rest: Standard deviation of each mode's own further error.
        damping: Ratios measured by the surveys, weighted by the share of each mode in their shapes, less
            losses on the ground alone (`carry_damping`); for the rest, and where the survey states none, the
            article's. Where damping was refined: of the refined article's complex modes, with the model's
            errors of ln zeta as far as the modes share them.
        damping_own: Root of the part of the variance of ln zeta that no measured mode has: one of a mode that
            was not seen, and not zero of one that is made of several; zero where damping was refined.
        damping_spread: Standard deviation of the logarithm by the noise of the tests, or, where damping was
            refined, of what each mode has alone.
        damping_root: Root of the shared covariance of the logarithms; zero where damping was not
            refined.
        seen: Part of each shape that the surveys saw.
        ground_hz: The refined model's frequency of the mode on the ground that has most of each; not a number
            where none has half of it.
    """

    modes: Modes
    index: Int[np.ndarray, " mode"]
    log_shift: Float[np.ndarray, " mode"]
    log_root: Float[np.ndarray, "mode both"]
    log_rest: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    damping_own: Float[np.ndarray, " mode"]
    damping_spread: Float[np.ndarray, " mode"]
    damping_root: Float[np.ndarray, "mode both"]
    seen: Float[np.ndarray, " mode"]
    ground_hz: Float[np.ndarray, " mode"]

    def damping_alone(self, unseen: float) -> Float[np.ndarray, " mode"]:
        """Deviations of ln zeta without the shared part; ``unseen``: that of a mode never measured."""
        return np.hypot(self.damping_spread, self.damping_own * unseen)

    def damping_std(self, unseen: float) -> Float[np.ndarray, " mode"]:
        """Total deviations of ln zeta; ``unseen`` as in `damping_alone`."""
        return np.hypot(np.linalg.norm(self.damping_root, axis=1), self.damping_alone(unseen))

    @property
    def log_std(self) -> Float[np.ndarray, " mode"]:
        """Total standard deviations of ln f."""
        return np.hypot(np.linalg.norm(self.log_root, axis=1), self.log_rest)

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """The most probable frequencies [Hz]."""
        return self.modes.frequency_hz[self.index] * np.exp(self.log_shift)

    @property
    def interval_hz(self) -> Float[np.ndarray, "mode 2"]:
        """95 % intervals [Hz]."""
        half = NORMAL_95 * self.log_std[:, None] * np.array([-1.0, 1.0])
        return self.frequency_hz[:, None] * np.exp(half)

    def below(self, number: int) -> Prediction:
        """Those of the modes that are among the lowest ``number``, rigid ones counted."""
        kept = self.index < number
        rows = [f.name for f in dataclasses.fields(self) if f.name != "modes"]
        return dataclasses.replace(self, **{name: getattr(self, name)[kept] for name in rows})


@record(kw_only=True)
class SolvedModes:
    """The refined article in an environment: its modes, those that are predicted, and their slopes.

    Slopes are of the logarithms of frequencies by the unknowns; ``left_out`` is of `left_out`, found when it
    is asked for. ``roots`` are of the complex modes where damping was refined.
    """

    modes: Modes
    index: Int[np.ndarray, " mode"]
    slope: Float[np.ndarray, "mode unknown"]
    left_out: Float[np.ndarray, " mode"]
    curvature: Float[np.ndarray, "mode unknown unknown"]
    roots: LogRoots | None


def solve_there(refined: Refined, environment: Environment, count: int = 10) -> SolvedModes:
    """The lowest ``count`` modes that are not rigid, in ``environment``."""
    there = set_up(refined.structure, environment, (), refined.unknowns)
    modes = there.solve(refined.x)
    index = np.array([i for i, kind in enumerate(modes.kind) if kind != "rigid"][:count], dtype=int)
    lam = modes.omega[index] ** 2
    slope = product_slopes(modes, there.bound, index, index, lam) / (2.0 * lam[:, None])
    finer = np.diag(left_out(modes, index)) / (2.0 * lam)
    roots = roots_of_lowest(modes, there.bound, int(index[-1]) + 1) if refined.damped else None
    return SolvedModes(
        modes=modes,
        index=index,
        slope=slope,
        left_out=finer,
        curvature=frequency_curvature(modes, there.bound, index),
        roots=roots,
    )


@named_kinds
def predict_modes(
    refined: Refined,
    environment: Environment,
    count: int = 10,
    umbilical_hz: float = CABLE_HZ,
) -> Prediction:
    """The lowest ``count`` modes that are not rigid, in ``environment``.

    Without gravity a weak cable may hold the article, with any frequency up to ``umbilical_hz``
    (`tie_umbilical`), all as likely: frequencies include its mean effect, intervals its variation.
    """
    return predict_at(refined, solve_there(refined, environment, count), umbilical_hz)


def predict_at(refined: Refined, there: SolvedModes, umbilical_hz: float = CABLE_HZ) -> Prediction:
    """The prediction of ``refined`` for modes already solved."""
    modes, index, slope, finer = there.modes, there.index, there.slope, there.left_out
    found, compared = refined.estimate, refined.compared
    errors = OwnErrors.of(compared) if compared else None
    share = np.zeros((len(index), 0)) if errors is None else errors.shared_with(modes)[index]
    shared = share if errors is None else np.column_stack([finer, share])
    alone = np.maximum(1.0 - np.sum(share**2, axis=1), 0.0)
    rest = alone * refined.unseen[sorts_of(modes, index)] ** 2
    unseen = np.maximum(1.0 - share.sum(axis=1), 0.0)
    if np.any(unseen > LITTLE):
        rest = rest + (unseen * finer) ** 2
    # Less than no shear, by more than draws are cut to, is another error, which shifts the modes that showed
    # it: of others nobody knows.
    less = refined.shear[0] if refined.shear[0] < -BELOW * refined.shear[1] else 0.0
    false = np.where(unseen > LITTLE, unseen * finer * less, 0.0)
    log_root = np.hstack([slope, shared]) @ found.root[: slope.shape[1] + shared.shape[1]]
    # Mean and deviation of what no linear estimate has.
    cable, cable_std = _by_a_cable(modes, index, umbilical_hz)
    bend, bend_std = bend_of(refined, log_root, there.curvature)
    return Prediction(
        modes=modes,
        index=index,
        log_shift=shared @ found.d[: shared.shape[1]] - false + cable + bend,
        log_root=log_root,
        log_rest=np.sqrt(rest + false**2 + cable_std**2 + bend_std**2),
        **(
            _damping(refined, modes, index, share, errors)
            if there.roots is None
            else _refined_damping(refined, there.roots, index, share)
        ),
        seen=share.sum(axis=1),
        ground_hz=_on_the_ground(share, errors, compared),
    )


def _by_a_cable(modes: Modes, index: np.ndarray, umbilical_hz: float) -> Float[np.ndarray, "2 mode"]:
    """Mean and deviation of what a cable to ``umbilical_hz``, all frequencies as likely, adds to ln f."""
    structure, place = modes.equilibrium.model.structure, modes.equilibrium.environment
    if not structure.attach_points or not floats(place):
        return np.zeros((2, len(index)))
    point = umbilical_point(structure).name
    motion = seen(sensor_rows(modes, [point] * 3, ("x", "y", "z")), modes)[:, index]
    most = 0.5 * structure.mass * np.sum(motion**2, axis=0) * (umbilical_hz / modes.frequency_hz[index]) ** 2
    # Mean and deviation of the square of a number uniform from zero to one.
    return np.outer([1.0 / 3.0, np.sqrt(4.0 / 45.0)], most)


def _on_the_ground(share: np.ndarray, errors: OwnErrors | None, compared: Sequence[Compared]) -> np.ndarray:
    if errors is None or not share.shape[1]:
        return np.full(len(share), np.nan)
    hz = errors.ground_hz(compared)[share.argmax(axis=1)]
    return np.where(share.max(axis=1) > HALF, hz, np.nan)


def _damping(
    refined: Refined, modes: Modes, index: np.ndarray, share: np.ndarray, errors: OwnErrors | None
) -> dict[str, np.ndarray]:
    """Damping ratios by shape, not by rank (`carry_damping`).

    As with frequencies, how losses that the model lacks join in a mode that is made of several is not known:
    their shares in squares are sure, the rest is its own.
    """
    root, nothing = np.zeros((len(index), refined.estimate.root.shape[1])), np.zeros(len(index))
    if errors is None:
        own, alone = ratios_by_cause(modes, count=int(index[-1]) + 1).zeta[index], np.ones(len(index))
        return {"damping": own, "damping_own": alone, "damping_spread": nothing, "damping_root": root}
    ground, zeta, relative = measured_damping(errors, refined.compared)
    carried = carry_damping(share, DampingParts.of(modes, index), ground, zeta, relative)
    known = share * (zeta > 0.0)
    apart = np.sqrt(np.maximum(1.0 - np.sum(known**2, axis=1), 0.0))
    return {
        "damping": carried.zeta,
        "damping_own": np.hypot(apart, carried.open_part),
        "damping_spread": carried.noise,
        "damping_root": root,
    }


def _refined_damping(
    refined: Refined, roots: LogRoots, index: np.ndarray, share: np.ndarray
) -> dict[str, np.ndarray]:
    """Damping ratios of the refined article, corrected by its errors on the ground, mode by mode."""
    found, slope = refined.estimate, roots.by_log_zeta[index]
    first = 1 + share.shape[1]
    own = slice(first, first + share.shape[1])
    rows = found.root[slope.shape[1] :][own]
    alone = np.sqrt(np.maximum(1.0 - np.sum(share**2, axis=1), 0.0))
    return {
        "damping": roots.zeta[index] * np.exp(share @ found.d[own]),
        "damping_own": np.zeros(len(index)),
        "damping_spread": alone * refined.unseen[-1],
        "damping_root": slope @ found.root[: slope.shape[1]] + share @ rows,
    }
