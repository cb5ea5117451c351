"""Decibels added to a compensator's by dry friction of joints, from simulations in time.

The linear loop's mean square is known exactly. What friction makes of it is simulated under noise that
repeats, and counts only against the same noise without friction: the error of a short record, common to both,
drops out. The noise is Gaussian line by line: of one size and random phase, lines would be too few for what
friction makes of a narrow mode.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import MOST_PADE, pade_order
from middeck.control.law.partition import partition_modes
from middeck.errors import ConfigError
from middeck.joints.sliding_loops import Sliding, SlidingLoops
from middeck.systems.plants.plant import Plant, select_ports
from middeck.systems.state_space.statespace import StateSpace
from middeck.updating.promise.plan import Plan
from middeck.updating.promise.slip import DrawnSlips
from middeck.updating.promise.slip_lines import mean_squares, sample_lines
from middeck.updating.promise.slip_loops import (
    SlipPoles,
    SlipPorts,
    around_sliders,
    evaluate_open,
    hold_while_sticking,
    law_response,
    noise_response,
    pole_form,
)
from middeck.updating.promise.slip_time import SlipTime, choose_time, noise_intensity
from middeck.values import record

RECORDS, ALONE = 2, 16
"""Records of each draw, under other noise each: with a compensator, and without, where friction does most."""
UNCERTAIN, TIMES = 0.02, 4
"""Variance of a draw's decibels without a compensator by the noise of its records [dB^2] from which there are
more of them, and how many times as many at most. Articles differ by one or two tenths of a decibel: a spread
estimated beside twice that noise comes out a quarter too wide, or by chance twice."""
TRIED = 400
"""Variances that are weighed, evenly up to four times what draws have."""
MOST, HELD = 15_000_000, 70_000_000
"""Numbers of responses that are held at once, and of samples and lines of the records that run side by side,
beside which their performance takes as much again: a step of a hundred takes little more than one of ten."""
SAMPLES_AT_ONCE = 2048
"""Samples that slide at once."""


@record(kw_only=True)
class Slipped:
    """One compensator, or none, on draws with the friction of the joints.

    Attributes:
        db: What friction adds to the rms of the performance, by draw; ``inf`` where the slipping loop is
            unstable. Draws differ by as much as articles do, without what their records add.
        variance: Variance of a draw's result by the noise of its records.
        travel: Rms of each joint's angle [rad].
        sticks: Whether the loop with its sliders as springs does not grow.
    """

    db: Float[np.ndarray, " draw"]
    variance: Float[np.ndarray, " draw"]
    travel: Float[np.ndarray, "draw joint"]
    sticks: Bool[np.ndarray, " draw"]


@record(kw_only=True)
class SlipRun:
    """Settings of the simulation of every compensator (None: no compensator) on all draws.

    Attributes:
        order: Order of the Pade approximation of the loop's delay, for the band of the noise. One for modes
            far above it is no better there, and its poles nearly coincide with those of a compensator
            designed on one: residues cancel (7 % of a joint's response in a step, at order 40 of 30 ms).
        alone: Records of each draw without a compensator.
    """

    plan: Plan
    laws: Mapping[str | None, Compensator | None]
    slips: DrawnSlips
    wiring: SlipPorts
    time: SlipTime
    order: int
    alone: int = ALONE

    @functools.cached_property
    def lines(self) -> slice:
        """Indices of the active noise lines: those in the plan's band."""
        return self.time.noise_lines(self.plan.band_hz)

    @property
    def lines_hz(self) -> Float[np.ndarray, " line"]:
        """Frequencies of these lines [Hz]."""
        return self.time.lines_hz[self.lines]

    def records_of(self, name: str | None) -> int:
        """Records of each draw with this compensator."""
        return self.alone if name is None else RECORDS

    @functools.cached_property
    def answers(self) -> dict[str | None, Complex[np.ndarray, "line command read"]]:
        """Responses kept by `answer_of`."""
        return {}

    def answer_of(self, name: str | None) -> Complex[np.ndarray, "line command read"] | None:
        """Response of a compensator on the lines of the noise: found once for all draws, unless all that
        are kept would be more than `MOST` numbers."""
        if name in self.answers:
            return self.answers[name]
        found = law_response(self.laws[name], self.lines_hz)
        if found is not None and found.size + sum(kept.size for kept in self.answers.values()) <= MOST:
            self.answers[name] = found
        return found


def set_run(first: Plant, laws: Mapping[str, Compensator], slips: DrawnSlips, plan: Plan) -> SlipRun:
    """Length and step of the simulation, and the number of records, chosen by the ``first`` draw.

    Raises `ConfigError` for a joint whose torque does not turn its own angle, or that nothing brings to rest,
    and for a band without lines of the noise.
    """
    wiring = SlipPorts(
        joints=tuple(j.name for j in plan.joints),
        performance=plan.performance,
        disturbances=plan.disturbances,
    )
    every: dict[str | None, Compensator | None] = {None: None, **laws}
    own = _own_ports(first, every.values(), wiring)
    time = choose_time(own, every.values(), slips, plan, wiring)
    phase = 2.0 * np.pi * time.band_hz * float(own.delay_s.max(initial=0.0))
    run = SlipRun(
        plan=plan, laws=every, slips=slips, wiring=wiring, time=time, order=min(pade_order(phase), MOST_PADE)
    )
    if plan.band_hz is not None and not len(run.lines_hz):
        low, high = plan.band_hz
        raise ConfigError(
            f"the noise, which moves joints and performance up to {time.band_hz:.3g} Hz, has no line in the "
            f"band of {low:g} to {high:g} Hz",
            where="joint", hint="a wider band, or one in which the performance moves",
        )  # fmt: skip
    alone = dataclasses.replace(run, laws={None: None})
    uncertain = float(_run(alone, [own], 0)[None].variance[0])
    return dataclasses.replace(run, alone=ALONE * int(np.clip(np.ceil(uncertain / UNCERTAIN), 1, TIMES)))


def run_slips(run: SlipRun, plants: Sequence[Plant], start: int = 0) -> dict[str | None, Slipped]:
    """Results of every compensator on ``plants``, which are the draws from ``start`` on.

    Several records of each draw give the error.
    """
    own = [_own_ports(p, run.laws.values(), run.wiring) for p in plants]
    most = max(1, MOST // max(1, len(run.lines_hz) * len(own[0].inputs) * len(own[0].outputs)))
    together = -(-len(own) // -(-len(own) // most))  # as many in each part
    parts = [
        _run(run, own[first : first + together], start + first) for first in range(0, len(own), together)
    ]
    return {name: _joined([part[name] for part in parts]) for name in run.laws}


def join_slips(parts: Sequence[Mapping[str | None, Slipped]]) -> dict[str | None, Slipped]:
    """All draws together, without what their records add to their differences.

    Raises `ConfigError` where a joint or a performance output grows without a compensator.
    """
    found = {name: _as_articles_differ(_joined([part[name] for part in parts])) for name in parts[0]}
    if not np.all(np.isfinite(found[None].db)):
        raise ConfigError(
            "without a compensator a joint or a performance output grows without bound",
            where="joint",
            hint="inner loops that hold the article",
        )
    return found


def _own_ports(plant: Plant, laws: Iterable[Compensator | None], wiring: SlipPorts) -> Plant:
    drives = [p.name for law in laws if law is not None for p in law.outputs]
    reads = [p.name for law in laws if law is not None for p in law.inputs]
    inputs, outputs = (
        (*wiring.disturbances, *wiring.joints, *drives),
        (*wiring.joints, *wiring.performance, *reads),
    )
    own = select_ports(plant, tuple(dict.fromkeys(inputs)), tuple(dict.fromkeys(outputs)))
    return partition_modes(own).active


@record(kw_only=True)
class _Loop:
    """One compensator on one draw that decays while it slips, and the numbers of its records."""

    name: str | None
    draw: int
    form: SlipPoles
    records: range


def _run(asked: SlipRun, plants: Sequence[Plant], first: int) -> dict[str | None, Slipped]:
    """Every compensator on the draws from ``first`` on, as many records side by side as `HELD` allows."""
    around = {
        name: [around_sliders(p, law, asked.wiring, asked.order) for p in plants]
        for name, law in asked.laws.items()
    }
    responses = [evaluate_open(plant, asked.lines_hz) for plant in plants]
    squares: dict[str | None, list[list[_Squares]]] = {name: [[] for _ in plants] for name in around}
    for loops in _in_parts(asked, _decaying(asked, around)):
        for loop, one in zip(loops, _squares(asked, plants, responses, loops, first), strict=True):
            squares[loop.name][loop.draw].append(one)
    stiffness = asked.slips.stiffness[first : first + len(plants)]
    return {
        name: _slipped(squares[name], hold_while_sticking(each, stiffness), len(asked.wiring.joints))
        for name, each in around.items()
    }


def _slipped(parts: Sequence[Sequence[_Squares]], sticks: Bool[np.ndarray, " draw"], joints: int) -> Slipped:
    """Results of each draw from the parts of its records; a loop that does not decay has no parts."""
    db, variance = np.full(len(parts), np.inf), np.zeros(len(parts))
    travel = np.full((len(parts), joints), np.inf)
    for at, each in enumerate(parts):
        if each:
            performance, angle = (np.concatenate(part, axis=1) for part in zip(*each, strict=True))
            db[at], variance[at] = _ratio_db(*performance)
            travel[at] = np.sqrt(np.mean(angle, axis=1))
    return Slipped(db=db, variance=variance, travel=travel, sticks=sticks)


def _decaying(asked: SlipRun, around: Mapping[str | None, Sequence[StateSpace]]) -> list[_Loop]:
    """The loops that decay, sorted by compensator, then by draw."""
    forms = [(name, k, pole_form(p)) for name, systems in around.items() for k, p in enumerate(systems)]
    return [
        _Loop(name=name, draw=draw, form=form, records=range(asked.records_of(name)))
        for name, draw, form in forms
        if form is not None
    ]


def _in_parts(asked: SlipRun, loops: Sequence[_Loop]) -> list[list[_Loop]]:
    """Parts of at most `HELD` numbers, or of one record; a loop of more records comes in several."""
    joints = len(asked.wiring.joints)
    one = asked.time.samples * joints + 2 * len(asked.lines_hz) * (joints + len(asked.plan.weights))
    most = max(1, HELD // one)
    parts: list[list[_Loop]] = []
    room = 0
    for loop in loops:
        for first in range(0, len(loop.records), most):
            some = dataclasses.replace(loop, records=loop.records[first : first + most])
            if room < len(some.records):
                parts.append([])
                room = most
            parts[-1].append(some)
            room -= len(some.records)
    return parts


class _Squares(NamedTuple):
    """Mean squares of the performance with friction and without, and of the joints' angles."""

    performance: Float[np.ndarray, "2 record"]
    angle: Float[np.ndarray, "joint record"]


def _squares(
    asked: SlipRun,
    plants: Sequence[Plant],
    responses: Sequence[Complex[np.ndarray, "line output input"]],
    loops: Sequence[_Loop],
    first: int,
) -> list[_Squares]:
    """All ``loops`` side by side, of ``plants`` that are the draws from ``first`` on."""
    lines = [_lines(asked, plants[p.draw], responses[p.draw], p, first + p.draw) for p in loops]
    came = _slide(asked, _side_by_side(loops, asked.slips, first), lines)
    return [
        _Squares(_mean_squares(asked, loop.form, free, one), one.square.T)
        for loop, free, one in zip(loops, lines, came, strict=True)
    ]


def _lines(
    asked: SlipRun, plant: Plant, response: Complex[np.ndarray, "line output input"], loop: _Loop, draw: int
) -> Complex[np.ndarray, "output record line"]:
    """Angles and performance without friction on the lines of the noise, which is Gaussian."""
    law, every = asked.laws[loop.name], len(asked.time.lines_hz)
    noise = noise_response(plant, response, law, asked.answer_of(loop.name), asked.wiring, asked.lines_hz)
    noise *= noise_intensity(asked.plan, law) * np.sqrt(2.0 / asked.time.record_s)
    drawn = np.empty((len(noise), noise.shape[2], len(loop.records)), dtype=complex)
    for at, number in enumerate(loop.records):
        rng = np.random.default_rng([asked.plan.seed, draw, number])
        real, imaginary = rng.standard_normal((2, noise.shape[2], every))[:, :, asked.lines]
        drawn[:, :, at] = (real + 1j * imaginary).T
    return np.ascontiguousarray((noise @ drawn).transpose(1, 2, 0))


class _Came(NamedTuple):
    """Result of one loop: torques that its sliders held, mean squares of the angles, and the sums of states
    before the record and behind it."""

    torque: Float[np.ndarray, "record joint sample"]
    square: Float[np.ndarray, "record joint"]
    ends: Complex[np.ndarray, "record pole"]


def _slide(
    asked: SlipRun, groups: Sequence[SlidingLoops], lines: Sequence[Complex[np.ndarray, "output record line"]]
) -> list[_Came]:
    """All loops with their sliders. Before the record comes its end with the other sign."""
    time, joints = asked.time, len(asked.wiring.joints)
    runs = [one[:joints, number] for one in lines for number in range(one.shape[1])]
    held = np.empty((len(runs), joints, time.samples))
    for samples, run in zip(held, runs, strict=True):
        samples[:] = sample_lines(time, asked.lines, run)
    sliding = Sliding(groups, 1.0 / time.sample_hz)
    sliding.move(-held[:, :, time.samples - time.settling :])
    before, square = sliding.states, np.zeros(held.shape[:2])
    for first in range(0, time.samples, SAMPLES_AT_ONCE):
        piece = held[:, :, first : first + SAMPLES_AT_ONCE]
        angle, torque = sliding.move(piece)
        square += np.mean(angle**2, axis=2) * (piece.shape[2] / time.samples)
        piece[:] = torque  # the angles without sliders are not asked for again
    ends = [both for b, e in zip(before, sliding.states, strict=True) for both in b + e]
    each = np.cumsum([one.shape[1] for one in lines])[:-1]
    parts = zip(np.split(held, each), np.split(square, each), ends, strict=True)
    return [_Came(*part) for part in parts]


def _mean_squares(
    asked: SlipRun, form: SlipPoles, lines: Complex[np.ndarray, "output record line"], came: _Came
) -> Float[np.ndarray, "2 record"]:
    """Mean squares of the weighted performance, with friction and without."""
    joints, weights = came.torque.shape[1], asked.plan.weights
    return mean_squares(
        asked.time,
        asked.time.record_lines(asked.plan.band_hz),
        SlipPoles(form.poles, form.drives, weights[:, None] * form.reads[joints:]),
        weights[:, None, None] * lines[joints:],
        came.torque,
        came.ends[:, : len(form.poles)],
    )


def _ratio_db(
    upper: Float[np.ndarray, " record"], lower: Float[np.ndarray, " record"]
) -> tuple[float, float]:
    """Decibels of the ratio of two sums over records, and their variance (Cochran 1977, chapter 6)."""
    above, records = upper.sum(), len(upper)
    ratio = above / lower.sum()
    off = (upper - ratio * lower) / above
    scale = 10.0 / np.log(10.0)
    return float(scale * np.log(ratio)), float(scale**2 * records / (records - 1) * np.sum(off**2))


def _as_articles_differ(found: Slipped) -> Slipped:
    """Draws nearer to their mean by the variance of their simulation (Louis 1984, J. Am. Stat. Assoc. 79).

    Each is the article's decibels and an error of its own records: left in, that widens every interval.
    Where draws of one linear performance slip alike, that is narrowed with the rest.
    """
    held = np.isfinite(found.db)
    if np.count_nonzero(held) < 2:
        return found
    db, noise = found.db[held], found.variance[held]
    spread = _spread_of_articles(db, noise)
    if spread == 0.0:
        return found
    weight = 1.0 / (spread + noise)
    mean = float(weight @ db / weight.sum())
    made = np.full(len(held), np.inf)
    made[held] = mean + np.sqrt(spread * weight) * (db - mean)
    return dataclasses.replace(found, db=made)


def _spread_of_articles(db: Float[np.ndarray, " draw"], noise: Float[np.ndarray, " draw"]) -> float:
    """Expected variance of what articles differ by, all being as likely before: zero only where ``db`` agree.

    A difference of moments is zero, and all intervals with it, wherever chance makes the spread less than the
    noise (Morris 1983, J. Am. Stat. Assoc. 78). A noise estimated from few records errs to either side: by
    simulation the spread comes out right where noise is small, and up to 1.8 times too wide where it is twice
    what articles differ by.
    """
    tried = np.linspace(0.0, 4.0, TRIED)[1:, None] * np.var(db, ddof=1)
    if not np.any(tried):
        return 0.0
    weight = 1.0 / (tried + noise)
    every = weight.sum(axis=1)
    off = db - (weight @ db / every)[:, None]
    likely = 0.5 * (np.log(weight).sum(axis=1) - np.log(every) - np.sum(weight * off**2, axis=1))
    part = np.exp(likely - likely.max())
    return float(part @ tried[:, 0] / part.sum())


def _side_by_side(loops: Sequence[_Loop], slips: DrawnSlips, first: int) -> list[SlidingLoops]:
    """Loops of one compensator together, if of as many records: they differ in their poles by little."""
    joints, groups = slips.slip_torque.shape[1], []
    for _, each in itertools.groupby(loops, lambda loop: (loop.name, len(loop.records))):
        own = list(each)
        draws, most = [first + loop.draw for loop in own], max(len(loop.form.poles) for loop in own)
        groups.append(
            SlidingLoops(
                poles=np.array([_filled(loop.form.poles, most, -1.0) for loop in own]),
                drives=np.array([_filled(loop.form.drives, most, 0.0) for loop in own]),
                reads=np.array([_filled(loop.form.reads[:joints], most, 0.0) for loop in own]),
                stiffness=slips.stiffness[draws],
                slip_torque=slips.slip_torque[draws],
                records=len(own[0].records),
            )
        )
    return groups


def _filled(values: np.ndarray, most: int, rest: complex) -> np.ndarray:
    gap = [(0, 0)] * (values.ndim - 1) + [(0, most - values.shape[-1])]
    return np.pad(values, gap, constant_values=rest)


def _joined(parts: Sequence[Slipped]) -> Slipped:
    return Slipped(
        **{
            key: np.concatenate([getattr(p, key) for p in parts])
            for key in ("db", "variance", "travel", "sticks")
        }
    )
