"""Modes measured on the ground beside those of the article as drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError, NumericalError
from middeck.structure.correlation.frequency_pairs import nearest_two
from middeck.structure.correlation.measured_modes import (
    MeasuredModes,
    real_shapes,
    sort_rms,
    straight_channels,
)
from middeck.structure.correlation.unit_slips import warnings_on_survey_units
from middeck.structure.model.article import JointState, LoadCase, Structure
from middeck.structure.model.connectivity import REDRAW, turned_by_redrawing
from middeck.structure.model.environment import Environment
from middeck.structure.model.load_case import apply_load_case
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter
from middeck.updating.residuals.own_articles import OwnArticles, check_spare, own_articles
from middeck.updating.residuals.pairing import COMMON, WINDOW, at_channels, pair
from middeck.updating.residuals.responses import (
    ComparedResponse,
    MeasuredResponse,
    compare_response,
    kept_modes,
    poles_of,
)
from middeck.updating.residuals.surveyed_friction import Added, SurveyedFriction
from middeck.updating.unknowns.unknowns import Bound, Unknown, bind, change, product_slopes
from middeck.values import record

# Relative standard deviation of a shape for which the test states none.
SHAPE_STD = 0.05
# Modes whose frequencies differ by less than this, in logarithms, are neighbours that a small change may mix.
NEIGHBOURS = 0.15
# Relative uncertainty of parts of a measured shape beyond which the channels do not determine them.
DETERMINED = 0.25
# Shapes that differ by less than this part of themselves at all channels are one to rounding.
SAME = 1e-10


@record(kw_only=True)
class Survey:
    """One test on the ground.

    Attributes:
        settings: Parameters that the test set, by name, with their values: the angle of a gimbal, an added
            mass.
        load_case: Loads on the article: one of its load cases by name, or one of the test's own.
        frequency_std: Standard deviation of a frequency over the frequency where ``measured`` states none.
        damping_std: Standard deviation of a damping ratio over the ratio where ``measured`` states none.
        response: Response that the same test measured beside its modes.
        friction: Friction of the joints that had any, and how far they moved.
    """

    name: str
    measured: MeasuredModes
    environment: Environment
    settings: tuple[tuple[str, float], ...] = ()
    load_case: LoadCase | str | None = None
    frequency_std: float | None = None
    damping_std: float | None = None
    response: MeasuredResponse | None = None
    friction: tuple[SurveyedFriction, ...] = ()

    def set_up(self, structure: Structure, unknowns: Sequence[Unknown]) -> SetUp:
        """The article in this test. Raises `ConfigError` as `set_up` and `apply_load_case`."""
        bare = set_up(structure, self.environment, self.settings, unknowns)
        if self.load_case is None:
            return bare
        both = apply_load_case(bare.structure, bare.environment, self.load_case)
        return SetUp(*both, bind(unknowns, *both))

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
                f"the survey states no standard deviation of the frequency {first:.6g} Hz",
                where=self.name,
                hint="frequency_std_hz with the modes, or frequency_std = 0.001 with the survey",
            )
        return std


class ModePairing(NamedTuple):
    """Modes of the articles in which a survey was measured, and the pairs with the measured modes.

    Attributes:
        pairs: (mode, measured mode), one to one.
        column: Mode that each pair is (second axis) in the article of each.
        added: Stiffness and loss added by friction.
    """

    own: OwnArticles
    pairs: Int[np.ndarray, "pair 2"]
    column: Int[np.ndarray, "pair pair"]
    added: tuple[Added, ...]

    @property
    def labels(self) -> Int[np.ndarray, " pair"]:
        """The free mode with the largest share in each pair."""
        return self.pairs[:, 0] % self.own.count


@record(kw_only=True)
class Compared:
    """A survey beside the model: equations of motion of the measured modes in the model's own.

    A measured mode of frequency lambda that is the sum of c_j of the model's modes phi_j asks for changes
    with sum_j phi_i'(dK - lambda dM) phi_j c_j = (lambda - lambda_i) c_i. Over 2 lambda, the row of its own
    mode is the error of ln f; those of neighbours say how the model must mix modes that are close, which
    their frequencies alone leave open.

    Attributes:
        paired: The compared modes; ``free`` are without the friction of joints, ``modes`` with it.
        rows: (pair, mode) of each equation: first those of the pairs' own modes, then those of neighbours.
        std: Standard deviation of each residual by the noise of the test.
    """

    survey: Survey
    free: Modes
    paired: ModePairing
    rows: Int[np.ndarray, "row 2"]
    residual: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row unknown"]

    @property
    def modes(self) -> Modes:
        """Modes of the articles in which the survey was measured."""
        return self.paired.own.modes

    @property
    def pairs(self) -> Int[np.ndarray, "pair 2"]:
        """(mode, measured mode), one to one."""
        return self.paired.pairs

    @property
    def unpaired(self) -> tuple[int, ...]:
        """Measured modes that no mode of the model resembles."""
        return tuple(
            sorted(set(range(len(self.survey.measured.frequency_hz))) - set(self.pairs[:, 1].tolist()))
        )


def left_open(compared: Compared) -> tuple[tuple[float, float], ...]:
    """Frequencies [Hz] of measured neighbours whose mixing the survey's shapes leave open."""
    column = compared.paired.column
    near = neighbours(compared.modes, column)
    resolved = compared.rows[len(compared.pairs) :]
    hz = compared.survey.measured.frequency_hz[compared.pairs[:, 1]]
    known = {(int(a), int(i)) for a, i in resolved}
    return tuple(
        (float(hz[a]), float(hz[b]))
        for a, b in zip(*np.nonzero(np.triu(near)), strict=True)
        if (int(a), int(column[a, b])) not in known
    )


class SetUp(NamedTuple):
    """An article in an environment, and the unknowns' parameters there."""

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
    """The article with ``settings``.

    Raises `ConfigError` for a setting of no parameter, for an angle that draws ties anew, and as `bind`.
    """
    both = structure, environment
    for name, value in settings:
        (parameter,) = find_parameters(*both, [name])
        for joint in both[0].joints if value != parameter.value else ():
            drawn = f"joint.{joint.name}." + ("target" if joint.state is JointState.DRIVEN else "angle")
            redrawn = turned_by_redrawing(both[0], joint.name, both[1].bushings)
            if parameter.name == drawn and redrawn:
                raise ConfigError(redrawn, where=f"set {name}", hint=REDRAW)
        both = set_parameter(*both, parameter, value)
    return SetUp(*both, bind(unknowns, *both))


def pair_survey(modes: Modes, survey: Survey, added: Sequence[Added] = (), count: int = 0) -> ModePairing:
    """Pairs with the modes, with friction ``added`` to the lowest ``count`` of ``modes``.

    Raises `ConfigError` where nothing measured resembles any of the modes, and as `check_spare`.
    """
    own = own_articles(modes, count, added)
    every = own.columns(np.arange(len(survey.measured.frequency_hz))) if added else None
    pairs = pair(own.modes, survey.measured, every)
    if not len(pairs):
        raise ConfigError(
            "no measured mode resembles any of the model's",
            where=survey.name,
            hint="; ".join(
                (
                    *warnings_on_survey_units(modes, survey.measured),
                    _nearest(own.modes, survey.measured),
                    "check nodes, directions, units and the environment",
                )
            ),
        )
    if count < len(modes.omega):  # all of them leave nothing out
        check_spare(modes.omega, own, pairs, added)
    column = own.columns(pairs[:, 1])[pairs[:, 0] % own.count].T
    return ModePairing(own, pairs, column, tuple(added))


def _nearest(modes: Modes, measured: MeasuredModes) -> str:
    rule = f"within a factor of {WINDOW:g} in frequency and by a MAC of {COMMON:g} and more"
    how = rule if measured.node else "by likelihood, without shapes"
    return f"modes are paired {how}; {nearest_two(modes.frequency_hz, measured.frequency_hz)}"


def compare(
    modes: Modes, survey: Survey, bound: Sequence[Bound], paired: ModePairing | None = None
) -> Compared:
    """Residuals and slopes of pairs (those of `pair_survey` without friction where none are given)."""
    paired = pair_survey(modes, survey) if paired is None else paired
    free, modes, pairs, column = modes, paired.own.modes, paired.pairs, paired.column
    c, c_std = _mixtures(modes, survey, pairs, column)
    k, j = np.nonzero(neighbours(modes, column) & (c_std > 0.0))
    rows = np.concatenate(
        [np.stack([np.arange(len(pairs)), pairs[:, 0]], axis=1), np.stack([k, column[k, j]], axis=1)]
    )
    ratio = (modes.frequency_hz[column] / survey.measured.frequency_hz[pairs[:, 1], None]) ** 2
    std = survey.std[pairs[:, 1]]
    apart = 0.5 * (1.0 - ratio[k, j])
    return Compared(
        survey=survey,
        free=free,
        paired=paired,
        rows=rows,
        residual=np.concatenate([-0.5 * np.log(np.diag(ratio)), apart * c[k, j]]),
        std=np.concatenate([std, np.hypot(apart * c_std[k, j], std[k] * c[k, j])]),
        slope=_equation_slopes(paired, survey, bound, rows, c),
    )


def compare_measured_response(
    compared: Compared,
    bound: Sequence[Bound],
    x: Float[np.ndarray, " unknown"],
    open_x: Float[np.ndarray, "unknown drawn"],
) -> ComparedResponse:
    """The survey's response beside the model at ``x``, at the poles of its modes (`compare_response`)."""
    survey, modes = compared.survey, compared.free
    pairs = np.stack([compared.paired.labels, compared.pairs[:, 1]], axis=1)
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
        ratios_by_cause(modes, count=count).zeta,
    )
    return compare_response(survey.name, test, modes, poles, bound, x, open_x)


def neighbours(modes: Modes, column: np.ndarray) -> np.ndarray:
    """Whether paired modes are close to each other."""
    f = np.log(modes.frequency_hz[column])
    return (np.abs(np.diag(f)[:, None] - f) < NEIGHBOURS) & ~np.eye(len(f), dtype=bool)


def _mixtures(
    modes: Modes, survey: Survey, pairs: np.ndarray, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The share of each paired mode in each measured shape, one of its own, and the deviations of that.

    Of all modes where the channels tell them apart, else of neighbours alone; nothing of others, and no
    deviation, where they do not tell these apart either. Channels that stand still, or move as others do,
    have no information, however many there are.
    """
    count, measured = len(pairs), survey.measured
    c, c_std = np.eye(count), np.zeros((count, count))
    channels = len(measured.node)
    read = at_channels(modes, measured) if channels else np.zeros((0, len(modes.omega)))
    shape, std = real_shapes(measured), shape_deviations(modes, measured)
    near = neighbours(modes, column) | np.eye(count, dtype=bool)
    for k, a in enumerate(pairs[:, 1]):
        weight, basis = 1.0 / std[:, a], read[:, column[k]]
        for own in (np.arange(count), np.flatnonzero(near[k])):
            part = _parts(weight[:, None] * basis[:, own], weight * shape[:, a], own == k)
            if part is not None and part[1][near[k, own]].max() <= DETERMINED:
                c[k, own], c_std[k, own] = part
                break
    return c, c_std


def _parts(basis: np.ndarray, shape: np.ndarray, one: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Part of each column of ``basis`` in ``shape``, 1 for that of ``one``, and their deviations.

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


def shape_deviations(modes: Modes, measured: MeasuredModes) -> np.ndarray:
    """Standard deviations of shapes as stated; otherwise `SHAPE_STD` of the mode at channels of that sort."""
    rms = sort_rms(straight_channels(modes, measured.node, measured.direction), measured.shape)
    usual, stated = SHAPE_STD * np.where(rms > 0.0, rms, 1.0), measured.shape_std
    return usual if stated is None else np.where(stated > 0.0, stated, usual)


def _equation_slopes(
    paired: ModePairing, survey: Survey, bound: Sequence[Bound], rows: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Derivatives of each row by the unknowns: of its mode with the pair's own and its neighbours."""
    (own, pairs, column, added), count = paired, len(paired.pairs)
    modes = own.modes
    near = neighbours(modes, column) | np.eye(count, dtype=bool)
    terms = [(r, i, j, a) for r, (a, i) in enumerate(rows) for j in np.flatnonzero(near[a])]
    row, left, right, of = np.array(terms, dtype=int).T
    lam = (2.0 * np.pi * survey.measured.frequency_hz[pairs[of, 1]]) ** 2
    others = column[of, right]
    by_unknown = product_slopes(modes, bound, left, others, lam)
    for joint in added:
        moved = modes.shapes[joint.coordinate]
        by_unknown += (np.real(joint.slope[:, pairs[of, 1]]) * moved[left] * moved[others]).T
    by_unknown /= 2.0 * lam[:, None]
    out = np.zeros((len(rows), len(bound)))
    np.add.at(out, row, c[of, right][:, None] * by_unknown)
    return out
