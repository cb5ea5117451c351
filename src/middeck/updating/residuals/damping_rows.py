"""Measured damping ratios beside those of the model's complex modes: rows of ln zeta.

A survey measures complex modes. Their frequencies differ from the model's by half the square of what the
losses mix; so where damping is refined the rows of frequencies are those of complex modes too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError, DataError
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damped_modes import DampedModes, solve_damped
from middeck.updating.residuals.complex_roots import LogRoots, differentiate_roots, roots_of_pairs
from middeck.updating.residuals.own_articles import MOST, SPARE, TooFewModesError
from middeck.updating.residuals.pairing import WINDOW
from middeck.updating.residuals.surveyed_friction import Added, added_to_joint
from middeck.updating.residuals.surveys import Compared, ModePairing, Survey, compare, pair_survey
from middeck.updating.unknowns.unknowns import DAMPING, Bound
from middeck.values import record

# Ratios that all are a hundred times the model's, to a factor of 4, and more than 3 prior deviations off.
PERCENT, ABOUT, BEYOND = np.log(100.0), np.log(4.0), 3.0


@record(kw_only=True)
class ComparedDamping:
    """Damping of one survey beside the model's.

    Attributes:
        pairs: (mode, measured mode) of each row.
        zeta: The model's damping ratios.
        residual, std, slope: ln zeta, measured less the model's; the survey's deviations of it; its slopes.
        likeness: Part of each complex mode that is its real one.
        left_out: Paired measured modes whose ratio is zero, not stated or not determined.
        frequency_hz: Frequency of the complex modes of all pairs of the survey, in their order.
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


def moves_losses(survey: Survey, bound: Sequence[Bound]) -> bool:
    """Whether any of the unknowns changes damping, or the survey has friction."""
    return bool(survey.friction) or any(p.name.startswith(DAMPING) for b in bound for p in b.parameters)


def states_damping(survey: Survey) -> bool:
    """Whether any of its modes has a damping ratio; frequencies show friction without one."""
    return bool(np.any(np.nan_to_num(survey.measured.damping) != 0.0))


def solve_damped_near(modes: Modes, survey: Survey) -> DampedModes:
    """Complex modes that a measured mode may be, and `SPARE` above these, without friction.

    Raises `DataError` for measured ratios that are negative, or one and more.
    """
    _check_range(survey)
    top = WINDOW * float(survey.measured.frequency_hz.max())
    return solve_damped(modes, count=int(np.count_nonzero(modes.frequency_hz <= top)) + SPARE)


def shifted_by_losses(compared: Compared) -> Float[np.ndarray, " pair"]:
    """ln |s| of each pair's complex mode less ln omega of its undamped mode, without friction.

    Ratios that modes have each by itself move nothing; what dampers and loss factors do between modes does.
    Raises `ConfigError` and `NumericalError` as `solve_damped`.
    """
    labels = compared.paired.labels
    count = min(int(labels.max()) + 1 + SPARE, len(compared.free.omega))
    s = solve_damped(compared.free, count=count).s[labels]
    return np.log(np.abs(s) / compared.free.omega[labels])


def compare_with_damping(
    modes: Modes,
    damped: DampedModes,
    survey: Survey,
    bound: Sequence[Bound],
    x: Float[np.ndarray, " unknown"],
) -> tuple[Compared, ComparedDamping]:
    """`compare` with the frequencies of complex modes, and the rows of damping; the unknowns are at ``x``.

    ``damped`` is of `solve_damped_near`. Raises as `compare`, `DataError` for ratios in per cent, and
    `ConfigError` for deviations that are not stated and a mode to which the model gives no damping.
    """
    damped, paired = _paired(modes, damped, survey, bound, x)
    ours, theirs = paired.pairs.T
    s, mixed = roots_of_pairs(damped, paired)
    higher = np.ones(len(survey.measured.frequency_hz))
    higher[theirs] = np.abs(s) / paired.own.modes.omega[ours]
    found = compare(modes, _slower(survey, higher), bound, paired)
    shapes = paired.own.in_free(mixed, theirs)
    roots = differentiate_roots(modes, damped, s, shapes, bound, _at_pairs(paired.added, theirs))
    slope, residual = found.slope.copy(), found.residual.copy()
    slope[: len(ours)] += np.real(roots.of_losses)
    residual[len(ours) :] -= _mixed(found, mixed)
    compared = dataclasses.replace(found, survey=survey, slope=slope, residual=residual)
    return compared, _rows(compared, roots, mixed, bound)


def _paired(
    modes: Modes, damped: DampedModes, survey: Survey, bound: Sequence[Bound], x: np.ndarray
) -> tuple[DampedModes, ModePairing]:
    """The pairs with friction, and the complex modes: of more modes where joints are too stiff for these."""
    while True:
        count = len(damped.s)
        try:
            added = tuple(added_to_joint(modes, count, f, bound, x) for f in survey.friction)
            return damped, pair_survey(modes, survey, added, count)
        except TooFewModesError:
            if count >= MOST:
                raise
            damped = solve_damped(modes, count=min(2 * count, MOST))


def _at_pairs(added: Sequence[Added], theirs: np.ndarray) -> tuple[Added, ...]:
    return tuple(a._replace(stiffness=a.stiffness[theirs], slope=a.slope[:, theirs]) for a in added)


def _mixed(found: Compared, shapes: np.ndarray) -> Float[np.ndarray, " row"]:
    """The neighbours' part of complex modes, in the rows of these."""
    of, mode = found.rows[len(found.pairs) :].T
    hz = found.survey.measured.frequency_hz[found.pairs[of, 1]]
    apart = 0.5 * (1.0 - (found.modes.frequency_hz[mode] / hz) ** 2)
    own, label = found.paired.labels[of], mode % found.paired.own.count
    return apart * np.real(shapes[label, of] / shapes[own, of])


def _slower(survey: Survey, by: np.ndarray) -> Survey:
    """The survey with its frequencies divided by ``by``, at equal accuracy."""
    measured, std = survey.measured, survey.measured.frequency_std_hz
    return dataclasses.replace(
        survey,
        measured=dataclasses.replace(
            measured,
            frequency_hz=measured.frequency_hz / by,
            frequency_std_hz=None if std is None else std / by,
        ),
    )


def _rows(compared: Compared, roots: LogRoots, mixed: np.ndarray, bound: Sequence[Bound]) -> ComparedDamping:
    survey, (ours, theirs) = compared.survey, compared.pairs.T
    std = log_std(survey)[theirs]
    kept = std <= 1.0
    index, at = ours[kept], theirs[kept]
    zeta = roots.zeta[kept]
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
        slope=roots.by_log_zeta[kept],
        likeness=np.abs(mixed[compared.paired.labels[kept], np.flatnonzero(kept)]) ** 2,
        left_out=tuple(theirs[~kept].tolist()),
        frequency_hz=np.abs(roots.s) / (2.0 * np.pi),
    )
    _check_per_cent(found, np.array([b.unknown.spread for b in bound]))
    return found


def log_std(survey: Survey) -> Float[np.ndarray, " measured"]:
    """Standard deviation of ln zeta; infinite for a ratio that is zero, not stated, or stated without one."""
    zeta, stated = np.nan_to_num(survey.measured.damping), survey.measured.damping_std
    if stated is None and survey.damping_std is None and np.any(zeta != 0.0):
        raise ConfigError(
            "the survey states no standard deviations of its damping ratios, which an unknown changes",
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
