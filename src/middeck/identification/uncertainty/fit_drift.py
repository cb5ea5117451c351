"""Has the article changed between two records? Tests on fitted modes, with the uncertainty of both fits."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import scipy.optimize
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.identification.uncertainty import parameter_deviations
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_set import check_alike
from middeck.identification.uncertainty.response_drift import holm
from middeck.values import record

# Modes farther apart than this factor are not taken for one mode that moved.
FARTHEST = 1.3
# In matching, a frequency off by 2 % counts as much as a shape off by 5 % (one minus their MAC).
NEAR = 0.02
ALIKE = 0.05
# A constant that is e times larger counts a tenth of that: a spurious mode beside a real one is small.
OF_SIZE = 0.1
# Share of the largest eigenvalue of a correlation matrix below which another is rounding.
RANK = 1e-9


@record(kw_only=True)
class ModeChange:
    """One mode in both fits.

    Attributes:
        before, after: Its index in the two models.
        frequency_hz, damping: Before and after.
        frequency_std_hz, damping_std: Standard deviations of the two differences.
        p_pole, p_constants: Probability of a difference as large by chance, of frequency and damping together
            and of the modal constants together (T^2 against F).
        moved, reshaped: Whether that counts, among all tests made, at the level of the comparison.
    """

    before: int
    after: int
    frequency_hz: tuple[float, float]
    frequency_std_hz: float
    damping: tuple[float, float]
    damping_std: float
    p_pole: float
    p_constants: float
    moved: bool
    reshaped: bool

    @property
    def sentence(self) -> str:
        """The change of the mode in words."""
        df, dz = (pair[1] - pair[0] for pair in (self.frequency_hz, self.damping))
        return (
            f"{self.frequency_hz[0]:.4g} Hz by {df:+.3g} Hz ({100.0 * df / self.frequency_hz[0]:+.2g}%, "
            f"{_deviations(df, self.frequency_std_hz)}), damping {self.damping[0]:.3%} by {100.0 * dz:+.2g}% "
            f"({_deviations(dz, self.damping_std)})"
        )


@record(kw_only=True)
class DelayChange:
    """The delay of one output in both fits [s], the deviation of the difference and its probability."""

    output: str
    delay_s: tuple[float, float]
    delay_std_s: float
    p: float
    changed: bool

    @property
    def sentence(self) -> str:
        """The change of the delay in words."""
        change = self.delay_s[1] - self.delay_s[0]
        return (
            f"the delay of {self.output} from {self.delay_s[0] * 1e3:.4g} ms by {change * 1e3:+.3g} ms "
            f"({_deviations(change, self.delay_std_s)})"
        )


@record(kw_only=True)
class FitChanges:
    """Changes between two fits.

    Attributes:
        modes, delays: Every mode found in both, in rising frequency, and every delay.
        only_before, only_after: Natural frequencies [Hz] of modes without a counterpart: unlike orders, or a
            mode that one record does not show. They are not tested.
        p_overall: Probability of all differences together by chance, in one test.
        level: Probability that a change is reported when nothing has changed (Holm 1979, over all tests
            of modes and delays).
    """

    modes: tuple[ModeChange, ...]
    delays: tuple[DelayChange, ...]
    only_before: Float[np.ndarray, " before"]
    only_after: Float[np.ndarray, " after"]
    p_overall: float
    level: float

    @property
    def drifted(self) -> bool:
        """Whether any mode moved or changed its constants, or any delay changed."""
        return any(m.moved or m.reshaped for m in self.modes) or any(d.changed for d in self.delays)

    @property
    def sentence(self) -> str:
        """One sentence: what changed, and by how much."""
        moved = [m.sentence for m in self.modes if m.moved]
        reshaped = [f"{m.frequency_hz[0]:.4g} Hz" for m in self.modes if m.reshaped and not m.moved]
        parts = [f"{len(moved)} of {len(self.modes)} modes moved: {'; '.join(moved)}"] if moved else []
        parts += [f"constants changed of the modes at {', '.join(reshaped)}"] if reshaped else []
        parts += [d.sentence for d in self.delays if d.changed]
        alone = [
            f"{', '.join(f'{f:.4g}' for f in hz)} Hz only {when}"
            for hz, when in ((self.only_before, "before"), (self.only_after, "after"))
            if len(hz)
        ]
        parts += [f"not compared: {', '.join(alone)}"] if alone else []
        if self.drifted:
            return "; ".join(parts)
        return "; ".join([f"none of {len(self.modes)} modes moved at the level {self.level:g}", *parts])


def _deviations(change: float, deviation: float) -> str:
    return f"{abs(change) / deviation:.1f} deviations" if deviation > 0.0 else "exact"


@named_kinds
def compare_fits(before: ModelCovariance, after: ModelCovariance, *, level: float = 0.05) -> FitChanges:
    """Test every mode and every delay of two fits for a change.

    Modes are matched by frequency, shape and size, all at once (the assignment of least total cost). A
    difference has the sum of the two fits' covariances, correlations within each fit included; its T^2 is
    judged by F with the degrees of freedom of both (Satterthwaite 1946).

    Args:
        before, after: ``covariance`` of the two fits.
        level: Probability of any false alarm.

    Raises `ConfigError` if the fits have unlike channels or rates, or for a level that is no probability.
    """
    parameter_deviations.check_level(level)
    check_alike(before.model, after.model)
    pairs = _match(before, after)
    compared = _compare(before, after, pairs)
    counts = holm(compared.p, level)
    modes = len(pairs)
    return FitChanges(
        modes=tuple(
            _mode_change(before, after, compared, (k, modes + k), pair, counts)
            for k, pair in enumerate(pairs)
        ),
        delays=tuple(
            _delay_change(before, after, compared, 2 * modes + k, o, counts)
            for k, o in enumerate(_with_delay(before, after))
        ),
        only_before=_alone(before.model, [a for a, _ in pairs]),
        only_after=_alone(after.model, [b for _, b in pairs]),
        p_overall=compared.p_overall,
        level=level,
    )


class _Compared(NamedTuple):
    """Differences of all quantities, their deviations, and the probability of each group of them: poles of
    the modes, constants of the modes, delays."""

    groups: list[np.ndarray]
    deviation: np.ndarray
    p: np.ndarray
    p_overall: float


def _compare(before: ModelCovariance, after: ModelCovariance, pairs: list[tuple[int, int]]) -> _Compared:
    entries = [_entries(before, a) for a, _ in pairs]
    real = [_is_real(before, a) and _is_real(after, b) for a, b in pairs]
    outputs = _with_delay(before, after)
    first, groups = _quantities(before, [a for a, _ in pairs], entries, real, outputs)
    second, _ = _quantities(after, [b for _, b in pairs], entries, real, outputs)
    change = second.value - first.value
    by = (side.by @ of.root for side, of in ((first, before), (second, after)))
    spreads = [each @ each.T for each in by]
    degrees = (before.degrees, after.degrees)
    p = np.array([_probability(change, spreads, degrees, group) for group in groups])
    everything = np.concatenate([np.zeros(0, int), *groups])
    deviation = np.sqrt(np.maximum(np.diag(spreads[0] + spreads[1]), 0.0))
    return _Compared(groups, deviation, p, _probability(change, spreads, degrees, everything))


class _Quantities(NamedTuple):
    value: np.ndarray
    by: np.ndarray


def _quantities(
    of: ModelCovariance,
    modes: list[int],
    entries: list[list[tuple[int, int]]],
    real: list[bool],
    outputs: list[int],
) -> tuple[_Quantities, list[np.ndarray]]:
    """Frequency and damping, constants, delays; their derivatives, and which are tested together."""
    at = of.at
    frequency, damping = parameter_deviations.pole_slopes(of)
    f, zeta = natural_hz(of.model), damping_ratio(of.model)
    rows: list[list[tuple[float, np.ndarray]]] = []
    for m in modes:
        pole = [(float(f[m]), frequency[m]), (float(zeta[m]), damping[m])]
        rows.append(pole if of.model.is_pair[m] else pole[:1])
    for m, places, is_real in zip(modes, entries, real, strict=True):
        constants = [parameter_deviations.modal_constant(of, at, m, o, i) for o, i in places]
        parts = [(k.real, np.real(by)) for k, by in constants]
        parts += [] if is_real else [(k.imag, np.imag(by)) for k, by in constants]
        rows.append(parts)
    for o in outputs:
        rows.append([(float(of.model.delay_s[o]), np.eye(at.size)[at.delay[o]])])
    flat = [row for group in rows for row in group]
    ends = np.cumsum([0, *(len(group) for group in rows)])
    groups = [np.arange(low, high) for low, high in itertools.pairwise(ends)]
    value = np.array([v for v, _ in flat])
    return _Quantities(value, np.array([by for _, by in flat]).reshape(len(flat), at.size)), groups


def _is_real(of: ModelCovariance, m: int) -> bool:
    return of.structure.real_constants or not bool(of.model.is_pair[m])


def _entries(of: ModelCovariance, m: int) -> list[tuple[int, int]]:
    """Entries that determine a mode's matrix of constants: all, or for rank one the column and row through
    its largest entry."""
    outputs, inputs = of.model.direct.shape
    if np.sum(of.model.poles == of.model.poles[m]) > 1:
        return [(o, i) for o in range(outputs) for i in range(inputs)]
    size = np.abs(np.outer(of.model.shapes[:, m], of.model.participation[m]))
    o, i = np.unravel_index(np.argmax(size), size.shape)
    return [(k, int(i)) for k in range(outputs)] + [(int(o), k) for k in range(inputs) if k != i]


def _with_delay(before: ModelCovariance, after: ModelCovariance) -> list[int]:
    both = before.structure.with_delay and after.structure.with_delay
    return list(range(len(before.model.outputs))) if both else []


def _probability(
    change: np.ndarray, spreads: list[np.ndarray], degrees: tuple[float, float], group: np.ndarray
) -> float:
    """Probability of so large a difference by chance: Hotelling's T^2 / k against F(k, degrees)."""
    if not len(group):
        return 1.0
    both = [spread[np.ix_(group, group)] for spread in spreads]
    total = both[0] + both[1]
    scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
    d = change[group] / scale
    # Quantities that share an unknown (a common delay, the pole of a residue of full rank) count once.
    size, direction = np.linalg.eigh(total / scale[:, None] / scale)
    known = size > RANK * max(size[-1], np.finfo(float).tiny)
    numbers = int(np.sum(known))
    if not numbers:
        return 1.0
    root = direction[:, known] / np.sqrt(size[known])
    inverse = root @ root.T
    share = float(np.trace(inverse @ (both[0] / scale[:, None] / scale))) / numbers
    slowness = share**2 / degrees[0] + (1.0 - share) ** 2 / degrees[1]
    nu = 1.0 / slowness if slowness > 0.0 else np.inf
    return float(parameter_deviations.joint_tail(d @ inverse @ d, numbers, nu))


def _match(before: ModelCovariance, after: ModelCovariance) -> list[tuple[int, int]]:
    """Pairs of modes, in rising frequency."""
    a, b = (_signature(of.model) for of in (before, after))
    ratio = np.abs(np.log(a.hz[:, None] / b.hz[None]))
    size = np.linalg.norm(a.constants, axis=1), np.linalg.norm(b.constants, axis=1)
    unlike = 1.0 - np.abs(a.constants.conj() @ b.constants.T) ** 2 / np.outer(size[0] ** 2, size[1] ** 2)
    cost = ratio / NEAR + unlike / ALIKE + OF_SIZE * np.abs(np.log(size[0][:, None] / size[1][None]))
    refused = (ratio > np.log(FARTHEST)) | (a.pair[:, None] != b.pair[None])
    # Far beyond the cost of any pair that is allowed.
    rows, columns = scipy.optimize.linear_sum_assignment(np.where(refused, 1e6, cost))
    after_of = {int(i): int(j) for i, j in zip(rows, columns, strict=True) if not refused[i, j]}
    rising = [int(i) for i in np.argsort(a.hz) if int(i) in after_of]
    return [(a.mode[i], b.mode[after_of[i]]) for i in rising]


class _Signature(NamedTuple):
    mode: list[int]
    hz: np.ndarray
    pair: np.ndarray
    constants: np.ndarray


def _signature(model: MeasurementModel) -> _Signature:
    """Frequency and constants of every pole, each entry in units of its largest mode."""
    modes = parameter_deviations.distinct_poles(model)
    unit = np.where(model.is_pair, 2j * np.imag(model.poles), 1.0)
    each = (model.shapes * unit).T[:, :, None] * model.participation[:, None, :]
    constants = np.array([np.sum(each[model.poles == model.poles[m]], axis=0) for m in modes])
    largest = np.maximum(np.abs(constants).max(axis=0), np.finfo(float).tiny)
    flat = (constants / largest).reshape(len(modes), -1)
    # A mode without constants has no shape; it may still be matched by its frequency.
    return _Signature(modes, natural_hz(model)[modes], model.is_pair[modes], flat + np.finfo(float).eps)


def _alone(model: MeasurementModel, matched: list[int]) -> Float[np.ndarray, " mode"]:
    return natural_hz(model)[[m for m in parameter_deviations.distinct_poles(model) if m not in matched]]


def _mode_change(
    before: ModelCovariance,
    after: ModelCovariance,
    compared: _Compared,
    tests: tuple[int, int],
    pair: tuple[int, int],
    counts: np.ndarray,
) -> ModeChange:
    f, zeta = (
        (float(value(before.model)[pair[0]]), float(value(after.model)[pair[1]]))
        for value in (natural_hz, damping_ratio)
    )
    poles, constants = tests
    deviation = [*compared.deviation[compared.groups[poles]], 0.0]
    return ModeChange(
        before=pair[0],
        after=pair[1],
        frequency_hz=f,
        frequency_std_hz=float(deviation[0]),
        damping=zeta,
        damping_std=float(deviation[1]),
        p_pole=float(compared.p[poles]),
        p_constants=float(compared.p[constants]),
        moved=bool(counts[poles]),
        reshaped=bool(counts[constants]),
    )


def _delay_change(
    before: ModelCovariance,
    after: ModelCovariance,
    compared: _Compared,
    test: int,
    o: int,
    counts: np.ndarray,
) -> DelayChange:
    return DelayChange(
        output=before.model.outputs[o].name,
        delay_s=(float(before.model.delay_s[o]), float(after.model.delay_s[o])),
        delay_std_s=float(compared.deviation[compared.groups[test][0]]),
        p=float(compared.p[test]),
        changed=bool(counts[test]),
    )
