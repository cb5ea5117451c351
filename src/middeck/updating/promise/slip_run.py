"""Decibels that dry friction of joints adds to a compensator's, found in time.

The linear loop's mean square is known exactly. What friction makes of it is simulated under noise that
repeats, and counts only against the same noise without friction: the error of a short record, common to both,
drops out. The noise is Gaussian line by line: of one size and random phase, lines would be too few for what
friction makes of a narrow mode.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Complex, Float

from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import MOST_PADE, pade_order
from middeck.control.law.partition import partition_modes
from middeck.errors import ConfigError
from middeck.joints.sliding import SlidingLoops, slide
from middeck.systems.plants.plant import Plant, select_ports
from middeck.updating.promise.plan import Plan
from middeck.updating.promise.slip import DrawnSlips
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
told beside twice that noise comes out a quarter too wide, or by chance twice."""
TRIED = 400
"""Variances that are weighed, evenly up to four times what draws have."""
MOST = 15_000_000
"""Numbers of responses, or samples, that are held at once."""


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
    """How every compensator, and under the key None no compensator, is simulated on all draws alike.

    Attributes:
        order: Of the Pade approximation of the loop's delay, for the band of the noise. One for modes far
            above it is no better there, and its poles nearly coincide with those of a compensator designed
            on one: their residues cancel (7 % of a joint's answer within a step, at order 40 of 30 ms).
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
    def answers(self) -> dict[str | None, Complex[np.ndarray, "line command read"]]:
        """Those that `answer_of` keeps."""
        return {}

    def answer_of(self, name: str | None) -> Complex[np.ndarray, "line command read"] | None:
        """What a compensator answers on the lines of the noise: found once for all draws, unless all that
        are kept would be more than `MOST` numbers."""
        if name in self.answers:
            return self.answers[name]
        found = law_response(self.laws[name], self.time.lines_hz)
        if found is not None and found.size + sum(kept.size for kept in self.answers.values()) <= MOST:
            self.answers[name] = found
        return found


def set_run(first: Plant, laws: Mapping[str, Compensator], slips: DrawnSlips, plan: Plan) -> SlipRun:
    """Length and step of the simulation, and the number of records, chosen by the ``first`` draw.

    Raises `ConfigError` for a joint whose torque does not turn its own angle, or that nothing brings to rest.
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
    uncertain = float(_run(run, _open_draws(run, [own], 0), None).variance[0])
    return dataclasses.replace(run, alone=ALONE * int(np.clip(np.ceil(uncertain / UNCERTAIN), 1, TIMES)))


def run_slips(run: SlipRun, plants: Sequence[Plant], start: int = 0) -> dict[str | None, Slipped]:
    """Every compensator on ``plants``, which are draw ``start`` and those behind it.

    Several records of each draw tell the error.
    """
    own = [_own_ports(p, run.laws.values(), run.wiring) for p in plants]
    lines = run.time.lines_hz
    together = max(1, MOST // max(1, len(lines) * len(own[0].inputs) * len(own[0].outputs)))
    parts: dict[str | None, list[Slipped]] = {name: [] for name in run.laws}
    for first in range(0, len(plants), together):
        some = _open_draws(run, own[first : first + together], start + first)
        for name in run.laws:
            parts[name].append(_run(run, some, name))
    return {name: _joined(each) for name, each in parts.items()}


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
class _Draws:
    """Draws that fit into memory, and their responses on the lines of the noise."""

    plants: tuple[Plant, ...]
    responses: Complex[np.ndarray, "draw line output input"]
    stiffness: Float[np.ndarray, "draw joint"]
    slip_torque: Float[np.ndarray, "draw joint"]
    first: int


def _open_draws(run: SlipRun, own: Sequence[Plant], first: int) -> _Draws:
    drawn = slice(first, first + len(own))
    return _Draws(
        plants=tuple(own),
        responses=np.array([evaluate_open(p, run.time.lines_hz) for p in own]),
        stiffness=run.slips.stiffness[drawn],
        slip_torque=run.slips.slip_torque[drawn],
        first=first,
    )


def _run(asked: SlipRun, some: _Draws, name: str | None) -> Slipped:
    law = asked.laws[name]
    around = [around_sliders(p, law, asked.wiring, asked.order) for p in some.plants]
    forms = [pole_form(loop) for loop in around]
    held = {i: form for i, form in enumerate(forms) if form is not None}
    count, joints = some.stiffness.shape
    db, variance, travel = np.full(count, np.inf), np.zeros(count), np.full((count, joints), np.inf)
    if held:
        at = list(held)
        db[at], variance[at], travel[at] = _with_friction(asked, some, name, held)
    sticks = hold_while_sticking(around, some.stiffness)
    return Slipped(db=db, variance=variance, travel=travel, sticks=sticks)


def _with_friction(
    asked: SlipRun, some: _Draws, name: str | None, forms: Mapping[int, SlipPoles]
) -> tuple[Float[np.ndarray, " draw"], Float[np.ndarray, " draw"], Float[np.ndarray, "draw joint"]]:
    """Decibels by friction, their variance by the noise, and rms angles, of the draws that have a form."""
    time, joints, law = asked.time, len(asked.wiring.joints), asked.laws[name]
    hz, answer = time.lines_hz, asked.answer_of(name)
    size = noise_intensity(asked.plan, law) * np.sqrt(2.0 / time.record_s)
    low, high = asked.plan.band_hz or (0.0, np.inf)
    acts = ((hz >= low) & (hz <= high))[:, None, None]
    coloured = {
        i: size * noise_response(some.plants[i], some.responses[i], law, answer, asked.wiring, hz) * acts
        for i in forms
    }
    every = [(i, record) for i in forms for record in range(asked.alone if law is None else RECORDS)]
    together = max(1, MOST // ((time.settling + time.samples) * (joints + len(asked.plan.weights))))
    square, travel = np.empty((2, len(every))), np.empty((len(every), joints))
    for first in range(0, len(every), together):
        mine = slice(first, first + together)
        which = [i for i, _ in every[mine]]
        loops = _side_by_side([forms[i] for i in which], some.stiffness[which], some.slip_torque[which])
        seeds = [[asked.plan.seed, some.first + i, record] for i, record in every[mine]]
        free = _free(time, [coloured[i] for i in which], seeds)
        made = slide(loops, free, 1.0 / time.sample_hz)[time.settling :]
        for k, z in enumerate((made, free[time.settling :])):
            square[k, mine] = _mean_square(asked.plan.weights * z[:, :, joints:], asked.plan.band_hz, time)
        travel[mine] = np.mean(made[:, :, :joints] ** 2, axis=0)
    db, variance = _ratio_db(*square.reshape(2, len(forms), -1))
    return db, variance, np.sqrt(np.mean(travel.reshape(len(forms), -1, joints), axis=1))


def _ratio_db(
    upper: Float[np.ndarray, "draw record"], lower: Float[np.ndarray, "draw record"]
) -> tuple[Float[np.ndarray, " draw"], Float[np.ndarray, " draw"]]:
    """Decibels of the ratio of two sums over records, and their variance (Cochran 1977, chapter 6)."""
    above, records = upper.sum(axis=1), upper.shape[1]
    ratio = above / lower.sum(axis=1)
    off = (upper - ratio[:, None] * lower) / above[:, None]
    scale = 10.0 / np.log(10.0)
    return scale * np.log(ratio), scale**2 * records / (records - 1) * np.sum(off**2, axis=1)


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
    noise (Morris 1983, J. Am. Stat. Assoc. 78). A noise told from few records errs to either side: by
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


def _mean_square(
    z: Float[np.ndarray, "sample loop output"], band_hz: tuple[float, float] | None, time: SlipTime
) -> Float[np.ndarray, " loop"]:
    """Mean square of all outputs together; in a band by the noise's lines, half a step off zero."""
    if band_hz is None:
        return np.mean(np.sum(z**2, axis=2), axis=0)
    half = np.exp(-1j * np.pi * np.arange(len(z)) / len(z))[:, None, None]
    hz = np.abs(np.fft.fftfreq(len(z), 1.0 / time.sample_hz) + 0.5 * time.sample_hz / len(z))
    lines = np.fft.fft(half * z, axis=0, norm="forward")[(hz >= band_hz[0]) & (hz <= band_hz[1])]
    return np.sum(np.abs(lines) ** 2, axis=(0, 2))


def _free(
    time: SlipTime, coloured: Sequence[Complex[np.ndarray, "line output noise"]], seeds: Sequence[list[int]]
) -> Float[np.ndarray, "sample loop output"]:
    """Angles and performance without friction, by Gaussian noise that comes again with the other sign."""
    samples, settle = time.samples, time.settling
    lines, outputs, noises = coloured[0].shape
    half = np.exp(1j * np.pi * np.arange(samples) / samples)[:, None]
    free = np.empty((settle + samples, len(seeds), outputs))
    for k, (filtered, seed) in enumerate(zip(coloured, seeds, strict=True)):
        real, imaginary = np.random.default_rng(seed).standard_normal((2, noises, lines))
        spectrum = np.zeros((samples, outputs), dtype=complex)
        spectrum[:lines] = np.einsum("fon,nf->fo", filtered, real + 1j * imaginary)
        free[settle:, k] = np.real(half * np.fft.ifft(spectrum, axis=0, norm="forward"))
    free[:settle] = -free[samples:]
    return free


def _side_by_side(forms: Sequence[SlipPoles], stiffness: np.ndarray, slip_torque: np.ndarray) -> SlidingLoops:
    most = max(len(f.poles) for f in forms)

    def filled(values: np.ndarray, rest: complex) -> np.ndarray:
        gap = [(0, 0)] * (values.ndim - 1) + [(0, most - values.shape[-1])]
        return np.pad(values, gap, constant_values=rest)

    return SlidingLoops(
        poles=np.array([filled(f.poles, -1.0) for f in forms]),
        drives=np.array([filled(f.drives, 0.0) for f in forms]),
        reads=np.array([filled(f.reads, 0.0) for f in forms]),
        stiffness=stiffness,
        slip_torque=slip_torque,
    )


def _joined(parts: Sequence[Slipped]) -> Slipped:
    return Slipped(
        **{
            key: np.concatenate([getattr(p, key) for p in parts])
            for key in ("db", "variance", "travel", "sticks")
        }
    )
