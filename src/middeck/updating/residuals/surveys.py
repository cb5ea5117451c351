"""Modes measured on the ground beside those of the article as drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError, NumericalError
from middeck.structure.correlation.measured_modes import MeasuredModes, sort_rms, straight_channels
from middeck.structure.correlation.unit_slips import doubt_survey_units
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.updating.residuals.friction import SurveyedFriction
from middeck.updating.residuals.pairing import at_channels, pair
from middeck.updating.residuals.responses import (
    ComparedResponse,
    MeasuredResponse,
    compare_response,
    kept_modes,
    poles_of,
)
from middeck.updating.unknowns.unknowns import Bound, Unknown, bind, change, product_slopes
from middeck.values import record

# Relative standard deviation of a shape for which the test states none.
SHAPE_STD = 0.05
# Modes whose frequencies differ by less than this, in logarithms, are neighbours that a small change may mix.
NEIGHBOURS = 0.15
# Relative uncertainty of parts of a measured shape beyond which the channels do not determine them.
TOLD = 0.25
# Shapes that differ by less than this part of themselves at all channels are one to rounding.
SAME = 1e-10


@record(kw_only=True)
class Survey:
    """One test on the ground.

    Attributes:
        settings: Parameters that the test set, by name, with their values: the angle of a gimbal, an added
            mass.
        frequency_std: Standard deviation of a frequency over the frequency where ``measured`` states none.
        damping_std: Standard deviation of a damping ratio over the ratio where ``measured`` states none.
        response: What the same test measured beside its modes.
        friction: Friction of the joints that had any, and how far they moved.
    """

    name: str
    measured: MeasuredModes
    environment: Environment
    settings: tuple[tuple[str, float], ...] = ()
    frequency_std: float | None = None
    damping_std: float | None = None
    response: MeasuredResponse | None = None
    friction: tuple[SurveyedFriction, ...] = ()

    def __post_init__(self) -> None:
        modes = len(self.measured.frequency_hz)
        for friction in self.friction:
            if len(friction.amplitude) != modes:
                raise ConfigError(
                    f"{len(friction.amplitude)} amplitudes of joint {friction.joint!r} for {modes} modes",
                    where=self.name,
                    hint="one for each measured mode",
                )

    @property
    def std(self) -> Float[np.ndarray, " measured"]:
        """Standard deviations of the logarithms of the frequencies.

        Raises `ConfigError` where nothing states one.
        """
        hz, stated = self.measured.frequency_hz, self.measured.frequency_std_hz
        own = np.zeros(len(hz)) if stated is None else stated / hz
        std = np.where(own > 0.0, own, self.frequency_std or 0.0)
        if not np.all(std > 0.0):
            first = hz[np.flatnonzero(~(std > 0.0))[0]]
            raise ConfigError(
                f"the survey does not state how well it knows the frequency {first:.6g} Hz",
                where=self.name,
                hint="frequency_std_hz with the modes, or frequency_std = 0.001 with the survey",
            )
        return std


@record(kw_only=True)
class Compared:
    """A survey beside the model: equations of motion of the measured modes in the model's own.

    A measured mode of frequency lambda that is the sum of c_j of the model's modes phi_j asks for changes
    with sum_j phi_i'(dK - lambda dM) phi_j c_j = (lambda - lambda_i) c_i. Over 2 lambda, the row of its own
    mode is the error of ln f; those of neighbours say how the model must mix modes that are close, which
    their frequencies alone leave open.

    Attributes:
        pairs: (mode, measured mode), one to one.
        rows: (pair, mode) of each equation: first those of the pairs' own modes, then those of neighbours.
        std: Standard deviation of each residual by the noise of the test.
    """

    survey: Survey
    modes: Modes
    pairs: Int[np.ndarray, "pair 2"]
    rows: Int[np.ndarray, "row 2"]
    residual: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row unknown"]

    @property
    def unpaired(self) -> tuple[int, ...]:
        """Measured modes that no mode of the model resembles."""
        return tuple(
            sorted(set(range(len(self.survey.measured.frequency_hz))) - set(self.pairs[:, 1].tolist()))
        )


def left_open(compared: Compared) -> tuple[tuple[float, float], ...]:
    """Frequencies [Hz] of measured neighbours of which the survey's shapes do not say how they mix."""
    near = _neighbours(compared.modes, compared.pairs)
    said = compared.rows[len(compared.pairs) :]
    hz = compared.survey.measured.frequency_hz[compared.pairs[:, 1]]
    known = {(int(a), int(i)) for a, i in said}
    return tuple(
        (float(hz[a]), float(hz[b]))
        for a, b in zip(*np.nonzero(np.triu(near)), strict=True)
        if (int(a), int(compared.pairs[b, 0])) not in known
    )


class SetUp(NamedTuple):
    """An article in an environment, and what the unknowns move there."""

    structure: Structure
    environment: Environment
    bound: tuple[Bound, ...]

    def solve(self, x: Float[np.ndarray, " unknown"]) -> Modes:
        """The modes with the unknowns at ``x``. Raises `NumericalError` where there is no rest state."""
        equilibrium = solve_equilibrium(*change(*self, x))
        if not equilibrium.converged:
            raise NumericalError(
                "the article has no rest state",
                where="refinement",
                hint="narrower priors, or a suspension that holds the article in this survey",
            )
        return solve_modes(equilibrium)


def set_up(
    structure: Structure,
    environment: Environment,
    settings: Sequence[tuple[str, float]],
    unknowns: Sequence[Unknown],
) -> SetUp:
    """The article with ``settings``. Raises `ConfigError` for a setting of no parameter, and as `bind`."""
    both = structure, environment
    for name, value in settings:
        (parameter,) = find_parameters(*both, [name])
        both = set_parameter(*both, parameter, value)
    return SetUp(*both, bind(unknowns, *both))


def compare(
    modes: Modes,
    survey: Survey,
    bound: Sequence[Bound],
    pairs: Int[np.ndarray, "pair 2"] | None = None,
) -> Compared:
    """Pairs (those of `pair` where none are given), residuals and slopes.

    Raises `ConfigError` where nothing measured resembles any of the modes.
    """
    pairs = pair(modes, survey.measured) if pairs is None else pairs
    if not len(pairs):
        raise ConfigError(
            "no measured mode resembles any of the model's",
            where=survey.name,
            hint="; ".join(
                (
                    *doubt_survey_units(modes, survey.measured),
                    "check nodes, directions, frequencies and the environment of the survey",
                )
            ),
        )
    c, c_std = _mixtures(modes, survey, pairs)
    k, j = np.nonzero(_neighbours(modes, pairs) & (c_std > 0.0))
    rows = np.concatenate(
        [np.stack([np.arange(len(pairs)), pairs[:, 0]], axis=1), np.stack([k, pairs[j, 0]], axis=1)]
    )
    ratio = (modes.frequency_hz[pairs[:, 0]] / survey.measured.frequency_hz[pairs[:, 1], None]) ** 2
    own = survey.std[pairs[:, 1]]
    apart = 0.5 * (1.0 - ratio[k, j])
    return Compared(
        survey=survey,
        modes=modes,
        pairs=pairs,
        rows=rows,
        residual=np.concatenate([-0.5 * np.log(np.diag(ratio)), apart * c[k, j]]),
        std=np.concatenate([own, np.hypot(apart * c_std[k, j], own[k] * c[k, j])]),
        slope=_equation_slopes(modes, survey, bound, pairs, rows, c),
    )


def compare_measured_response(
    compared: Compared,
    bound: Sequence[Bound],
    x: Float[np.ndarray, " unknown"],
    open_x: Float[np.ndarray, "unknown drawn"],
) -> ComparedResponse:
    """The survey's response beside the model at ``x``, at the poles of its modes (`compare_response`)."""
    survey, modes, pairs = compared.survey, compared.modes, compared.pairs
    test, measured = survey.response, survey.measured
    assert test is not None
    count = kept_modes(modes, pairs, test.top_hz)
    poles = poles_of(
        modes,
        pairs,
        2.0 * np.pi * measured.frequency_hz,
        survey.std,
        measured.damping,
        measured.damping_std,
        estimate_damping(modes, count=count).zeta,
    )
    return compare_response(survey.name, test, modes, poles, bound, x, open_x)


def _neighbours(modes: Modes, pairs: np.ndarray) -> np.ndarray:
    """Which paired modes are close to which others."""
    f = np.log(modes.frequency_hz[pairs[:, 0]])
    return (np.abs(f[:, None] - f) < NEIGHBOURS) & ~np.eye(len(f), dtype=bool)


def _mixtures(modes: Modes, survey: Survey, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The share of each paired mode in each measured shape, one of its own, and the deviations of that.

    Of all modes where the channels tell them apart, else of neighbours alone; nothing of others, and no
    deviation, where they do not tell these apart either. Channels that stand still, or move as others do,
    tell nothing, however many there are.
    """
    count, measured = len(pairs), survey.measured
    c, c_std = np.eye(count), np.zeros((count, count))
    channels = len(measured.node)
    basis = at_channels(modes, measured)[:, pairs[:, 0]] if channels else np.zeros((0, count))
    shape, std = _real_shapes(measured), _shape_std(modes, measured)
    near = _neighbours(modes, pairs) | np.eye(count, dtype=bool)
    for k, a in enumerate(pairs[:, 1]):
        weight = 1.0 / std[:, a]
        for own in (np.arange(count), np.flatnonzero(near[k])):
            part = _parts(weight[:, None] * basis[:, own], weight * shape[:, a], own == k)
            if part is not None and part[1][near[k, own]].max() <= TOLD:
                c[k, own], c_std[k, own] = part
                break
    return c, c_std


def _parts(basis: np.ndarray, shape: np.ndarray, one: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """What ``shape`` has of each column of ``basis``, of ``one`` of them 1, and the deviations of that.

    None where the rows of both, of unit deviation, do not tell the columns apart.
    """
    if len(basis) <= basis.shape[1]:
        return None
    Q, R = np.linalg.qr(basis)
    if not 1.0 / np.linalg.cond(R / np.linalg.norm(R, axis=0)) > SAME:
        return None
    inverse = np.linalg.inv(R)
    found = inverse @ (Q.T @ shape)
    scale = found[one][0]
    return found / scale, np.sqrt(np.einsum("ij,ij->i", inverse, inverse)) / np.abs(scale)


def _real_shapes(measured: MeasuredModes) -> np.ndarray:
    """Shapes turned to the phase in which they are largest."""
    phase = 0.5 * np.angle(np.sum(measured.shape**2, axis=0))
    return np.real(measured.shape * np.exp(-1j * phase))


def _shape_std(modes: Modes, measured: MeasuredModes) -> np.ndarray:
    """Stated standard deviations of shapes; otherwise `SHAPE_STD` of the mode at channels of that sort."""
    rms = sort_rms(straight_channels(modes, measured.node, measured.direction), measured.shape)
    usual, stated = SHAPE_STD * np.where(rms > 0.0, rms, 1.0), measured.shape_std
    return usual if stated is None else np.where(stated > 0.0, stated, usual)


def _equation_slopes(
    modes: Modes, survey: Survey, bound: Sequence[Bound], pairs: np.ndarray, rows: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Derivatives of each row by the unknowns: of its mode with the pair's own and its neighbours."""
    near = _neighbours(modes, pairs) | np.eye(len(pairs), dtype=bool)
    place = np.full(len(modes.omega), -1)
    place[pairs[:, 0]] = np.arange(len(pairs))
    terms = [(r, i, j, a) for r, (a, i) in enumerate(rows) for j in np.flatnonzero(near[a])]
    row, left, right, of = np.array(terms, dtype=int).T
    lam = (2.0 * np.pi * survey.measured.frequency_hz[pairs[of, 1]]) ** 2
    by_unknown = product_slopes(modes, bound, left, pairs[right, 0], lam) / (2.0 * lam[:, None])
    out = np.zeros((len(rows), len(bound)))
    np.add.at(out, row, c[of, right][:, None] * by_unknown)
    return out
