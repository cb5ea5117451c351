"""Measured damping ratios beside those of the model's complex modes: rows of ln zeta.

A survey measures complex modes. Their frequencies differ from the model's by half the square of what the
losses mix; so where damping is refined the rows of frequencies are those of complex modes too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.errors import ConfigError, DataError
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes, solve_damped
from middeck.structure.sensitivity.damping import differentiate_damped
from middeck.structure.sensitivity.parameters import read_parameter
from middeck.updating.residuals.pairing import WINDOW, pair
from middeck.updating.residuals.surveys import Compared, Survey, compare
from middeck.updating.unknowns.unknowns import DAMPING, Bound
from middeck.values import record

# Modes above the highest that is asked for, which losses may mix into it.
SPARE = 6
# Ratios that all are a hundred times the model's, to a factor of 4, and more than 3 prior deviations off.
PERCENT, ABOUT, BEYOND = np.log(100.0), np.log(4.0), 3.0


@record(kw_only=True)
class ComparedDamping:
    """Damping of one survey beside the model's.

    Attributes:
        pairs: (mode, measured mode) of each row.
        zeta: The model's damping ratios.
        residual, std, slope: Of ln zeta, measured less the model's; deviations are the survey's.
        likeness: Part of each complex mode that is its real one.
        left_out: Paired measured modes whose ratio is zero, not stated or not determined.
        frequency_hz: Of the complex modes of all pairs of the survey, in their order.
    """

    survey: Survey
    modes: Modes
    pairs: Int[np.ndarray, "row 2"]
    zeta: Float[np.ndarray, " row"]
    residual: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row unknown"]
    likeness: Float[np.ndarray, " row"]
    left_out: tuple[int, ...]
    frequency_hz: Float[np.ndarray, " pair"]


@record
class LogRoots:
    """ln s of complex modes, its derivatives by unknowns, and what damping parameters alone have of them."""

    damped: DampedModes
    slope: Complex[np.ndarray, "mode unknown"]
    of_damping: Complex[np.ndarray, "mode unknown"]

    @staticmethod
    def of(modes: Modes, damped: DampedModes, bound: Sequence[Bound]) -> LogRoots:
        """Of the complex modes ``damped`` of ``modes``."""
        both = modes.equilibrium.model.structure, modes.equilibrium.environment
        now = [[read_parameter(*both, p) for p in b.parameters] for b in bound]
        found = iter(differentiate_damped(modes, damped, [p for own in now for p in own]))
        slope, of_damping = np.zeros((2, len(bound), len(damped.s)), complex)
        for k, own in enumerate(now):
            for parameter in own:
                step = next(found) * (1.0 if bound[k].unknown.added else parameter.value)
                slope[k] += step
                of_damping[k] += step * parameter.name.startswith(DAMPING)
        return LogRoots(damped, slope.T, of_damping.T)

    @staticmethod
    def of_lowest(modes: Modes, bound: Sequence[Bound], count: int) -> LogRoots:
        """Of the lowest ``count`` modes, and of `SPARE` above these, which losses may mix into them."""
        return LogRoots.of(modes, solve_damped(modes, count=count + SPARE), bound)

    def by_log_zeta(self, index: Int[np.ndarray, " mode"]) -> Float[np.ndarray, "mode unknown"]:
        """Derivatives of ln zeta: zeta is minus the cosine of the root's angle."""
        zeta = self.damped.zeta[index]
        steep = np.divide(np.sqrt(1.0 - zeta**2), zeta, out=np.zeros(len(zeta)), where=zeta > 0.0)
        return steep[:, None] * np.imag(self.slope[index])


def moves_damping(bound: Sequence[Bound]) -> bool:
    """Whether any of the unknowns changes damping."""
    return any(p.name.startswith(DAMPING) for b in bound for p in b.parameters)


def states_damping(survey: Survey) -> bool:
    """Whether any of its modes has a damping ratio."""
    return bool(np.any(np.nan_to_num(survey.measured.damping) != 0.0))


def solve_damped_near(modes: Modes, survey: Survey) -> DampedModes:
    """Complex modes of all that a measured mode may be, and of `SPARE` above these.

    Raises `DataError` for measured ratios that are negative, or one and more.
    """
    _check_range(survey)
    top = WINDOW * float(survey.measured.frequency_hz.max())
    return solve_damped(modes, count=int(np.count_nonzero(modes.frequency_hz <= top)) + SPARE)


def compare_with_damping(
    modes: Modes, damped: DampedModes, survey: Survey, bound: Sequence[Bound]
) -> tuple[Compared, ComparedDamping]:
    """`compare` with the frequencies of complex modes, and the rows of damping.

    ``damped`` is of `solve_damped_near`. Raises as `compare`, `DataError` for ratios in per cent, and
    `ConfigError` for deviations that are not stated and a mode to which the model gives no damping.
    """
    roots = LogRoots.of(modes, damped, bound)
    ours, theirs = pair(modes, survey.measured).T
    higher = np.ones(len(survey.measured.frequency_hz))
    higher[theirs] = np.abs(damped.s[ours]) / modes.omega[ours]
    found = compare(modes, _slower(survey, higher), bound)
    slope, own = found.slope.copy(), found.pairs[:, 0]
    slope[: len(own)] += np.real(roots.of_damping[own])
    compared = dataclasses.replace(found, survey=survey, slope=slope)
    return compared, _rows(compared, roots, bound)


def _slower(survey: Survey, by: np.ndarray) -> Survey:
    """With frequencies divided by so much, as accurate as they were."""
    measured, std = survey.measured, survey.measured.frequency_std_hz
    return dataclasses.replace(
        survey,
        measured=dataclasses.replace(
            measured,
            frequency_hz=measured.frequency_hz / by,
            frequency_std_hz=None if std is None else std / by,
        ),
    )


def _rows(compared: Compared, roots: LogRoots, bound: Sequence[Bound]) -> ComparedDamping:
    survey, (ours, theirs) = compared.survey, compared.pairs.T
    std = log_std(survey)[theirs]
    kept = std <= 1.0
    index, at = ours[kept], theirs[kept]
    zeta = roots.damped.zeta[index]
    if np.any(zeta <= 0.0):
        name = compared.modes.name[int(index[np.argmin(zeta)])]
        raise ConfigError(
            f"the model gives mode {name!r} no damping, which no factor makes more",
            where=survey.name,
            hint="small positive ratios, loss factors or dampers in the article's [damping]",
        )
    found = ComparedDamping(
        survey=survey,
        modes=compared.modes,
        pairs=compared.pairs[kept],
        zeta=zeta,
        residual=np.log(survey.measured.damping[at] / zeta),
        std=std[kept],
        slope=roots.by_log_zeta(index),
        likeness=roots.damped.likeness[index],
        left_out=tuple(theirs[~kept].tolist()),
        frequency_hz=np.abs(roots.damped.s[ours]) / (2.0 * np.pi),
    )
    _check_per_cent(found, np.array([b.unknown.spread for b in bound]))
    return found


def log_std(survey: Survey) -> Float[np.ndarray, " measured"]:
    """Of ln zeta; infinite where a ratio is zero, not stated, or has no deviation beside others that have."""
    zeta, stated = np.nan_to_num(survey.measured.damping), survey.measured.damping_std
    if stated is None and survey.damping_std is None:
        raise ConfigError(
            "the survey does not state how well it knows its damping, which an unknown moves",
            where=survey.name,
            hint="damping_std with the modes, or damping_std = 0.1 with the survey, relative",
        )
    own = np.zeros(len(zeta)) if stated is None else stated
    relative = np.divide(own, zeta, out=np.full(len(zeta), np.inf), where=(zeta > 0.0) & (own > 0.0))
    if survey.damping_std is not None:
        relative[(zeta > 0.0) & (own == 0.0)] = survey.damping_std
    return relative


def _check_range(survey: Survey) -> None:
    zeta, hz = survey.measured.damping, survey.measured.frequency_hz
    for off, what, hint in (
        (zeta < 0.0, "negative", "leave the ratio out: NaN or zero is none"),
        (zeta >= 1.0, "not below one", "a ratio to critical damping, 0.01 for 1 %: is it in per cent?"),
    ):
        if np.any(off):
            k = int(np.argmax(off))
            raise DataError(
                f"the mode of {hz[k]:.4g} Hz has the damping ratio {zeta[k]:.4g}, which is {what}",
                where=survey.name,
                hint=hint,
            )


def _check_per_cent(found: ComparedDamping, spread: np.ndarray) -> None:
    reach = np.linalg.norm(found.slope * spread, axis=1)
    every = np.all(np.abs(found.residual - PERCENT) < ABOUT) and np.all(found.residual > BEYOND * reach)
    if len(reach) and every:
        off = float(np.median(found.residual))
        raise DataError(
            f"the damping is {np.exp(off):.3g} times the model's: per cent in place of a ratio?",
            where=found.survey.name,
            hint="0.01 for 1 %; or spreads of the damping that allow for such a factor",
        )
