"""Faults in the relation of outputs to inputs: lost samples, feedback, delays of half a record.

Both sides are whitened first, each by the prediction from its own past: the response of a lightly damped mode
then lasts for few samples, and the correlation of the two is noise but where one responds to the other.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.ndimage
from jaxtyping import Bool, Float
from scipy.fft import next_fast_len

from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.signals.excitation.driven_band import driven_band
from middeck.signals.excitation.repetition import find_repetition
from middeck.signals.fault import RecordFault
from middeck.signals.ports import Port
from middeck.signals.record import Record

Signal = Float[np.ndarray, " sample"]
# Past samples from which the next is predicted, and the share of white noise that keeps that determined.
PAST, FLOOR = 24, 1e-9
# A signal that its past predicts but for this share is no noise: nothing is concluded from it.
FORETOLD = 1e-3
# Parts of a record that are compared, by how many samples they may be apart, and over how many a response is.
PARTS, APART, ANSWER = 9, 40, 48
FEWEST_SAMPLES = 300
# Events in a record, such as steps, from which each part shows a response; and from which what later
# inputs tell is no matter of the samples about a release or two, where more may be left than elsewhere.
FEWEST_EVENTS, FEWEST_STEPS = 100.0, 3.0
# Correlation of two parts' responses from which they are one response, and by how much it must be better
# than without a shift.
ALIKE, BETTER = 0.45, 0.2
# Share of the parts that must be alike.
MOST_ALIKE = 0.6
# Shares of all lines between which a band is looked at alone: in less, a response and one that is a period of
# its sines later are alike.
MOST_NARROW, WHOLE = 0.1, 0.9
# Gain required of a regression: in deviations of its chi-square law, and as a share of the prediction error.
SURE, SHARE = 7.0, 0.02
# Factors on the length of the past with which feedback is tested again, samples for each of its unknowns, and
# samples of which an even subset suffices. With fewer samples for each unknown chance may hide a loop: what
# later inputs explain must then fall to this part, both without what so many unknowns fit by chance.
LONGER, ROWS, ENOUGH = (1.5, 2, 4, 8), 4, 20_000
FEWEST_ROWS, FALLS_TO = 1.6, 0.3
# What an input's past does not foretell, over its median, from which it jumps (of noise, a sample in 16,000),
# and the share of a record that must be free of jumps for feedback to be looked for there alone.
# So many samples before and after a joint a jump may be its cause.
JUMPS, CALM, BEFORE = 6.0, 0.6, 3
# Residuals whose largest, a hundredth but no fewer than so many, tell the tail of noise; chance is beyond it
# in one of e^BEYOND, and a residual below LEAP times the median is none in any case.
# Computed samples leave rounding alone: below LEAST, in rms of the output, nothing is concluded.
FEWEST_LARGE, BEYOND, LEAP, LEAST = 20, 12.0, 12.0, 1e-4
# Noise behind a spike over that before it: of so few samples, it is below by chance in all but 1e-9.
AS_BEFORE = 2.0
# Of so few samples as follow a spike at an edge, the largest residual over the deviation of those before. The
# last sample of a difference is computed from one side, and less than so many rms from what is foretold.
GONE, STANDS_OUT = 5.0, 3.0
# In shorter records samples lost on one side may look like feedback: inputs seem to follow the past.
TELLS_LOSS = 1000
# Samples by which an output may lead without a loop: differences and filters that look ahead, and what an
# input does between samples. Before it begins, an answer that a filter cuts off near half the rate follows a
# sum of (-1)^n / n^k of inputs n samples later: so many powers k are enough.
LEADS, TAILS = 2, 3
# Deviations of a correlation from which it is a response: the largest of 1e4 of noise is 4.
ANSWERED = 7.0
# A delay is reported from so many samples, and this share of the record.
LONG, LONG_SHARE = 32, 0.02


def find_relation_faults(record: Record) -> list[RecordFault]:
    """Shifts within the record, feedback and long delays, of each experiment."""
    found: list[RecordFault] = []
    for e in range(len(record.u)):
        u, y = (x[e].reshape(-1, x.shape[3]).T for x in (record.u, record.y))
        if u.shape[1] < FEWEST_SAMPLES:
            continue
        U, Y = np.array([whitened(x) for x in u]), np.array([whitened(x) for x in y])
        own = _shifts(record, U, Y) or _shifts_in_band(record, U, Y, record.u[e]) or _residuals(record, u, y)
        found += [f.at("output", port, e) for f, port in own]
        found += [f.at("output", port, e) for f, port in _long_delays(record, U, Y)]
    return found


Place = tuple[FaultDraft, Port]


def whitened(x: Signal) -> Signal:
    """Linear prediction error of a signal, of unit rms; zero for a signal that is fully predictable."""
    x = x - x.mean()
    past = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: PAST + 1]
    if past[0] == 0.0:
        return x
    column = past[:-1] + np.eye(1, PAST)[0] * FLOOR * past[0]
    weights = scipy.linalg.solve_toeplitz(column, past[1:])
    left = np.convolve(np.concatenate([[1.0], -weights]), x)[: len(x)]
    left[:PAST] = 0.0
    size = float(left.std())
    return left / size if size > FORETOLD * float(x.std()) else np.zeros_like(x)


def correlation(
    U: Float[np.ndarray, "input sample"], Y: Float[np.ndarray, "output sample"], first: int, last: int
) -> Float[np.ndarray, "output input lag"]:
    """Sum of u[n - lag] y[n] over its deviation without a relation, for lags ``first`` to ``last``."""
    count, lags = U.shape[1], np.arange(first, last + 1)
    size = int(next_fast_len(count + max(last, -first), real=True))
    spectra = np.conj(np.fft.rfft(U, size))
    cross = np.stack([np.fft.irfft(spectra * np.fft.rfft(y, size), size)[:, lags] for y in Y])
    size_u = np.maximum(np.sum(U**2, axis=1), 1e-300)
    deviation = np.sqrt(size_u * np.sum(Y**2, axis=1)[:, None] / count + 1e-300)
    return cross / deviation[:, :, None]


# Samples that were lost, or repeated.


def _shifts_in_band(record: Record, U: np.ndarray, Y: np.ndarray, u: np.ndarray) -> list[Place]:
    """The shifts that show in the band alone that the inputs drive: beyond it is noise, made as large."""
    low, high = driven_band(u.reshape(1, -1, u.shape[-1]), record.sample_hz)
    f = np.fft.rfftfreq(U.shape[1], 1.0 / record.sample_hz)
    driven = (f >= low) & (f <= high)
    if not MOST_NARROW < driven.mean() < WHOLE:
        return []
    within = [np.fft.irfft(np.fft.rfft(x, axis=1) * driven, U.shape[1], axis=1) for x in (U, Y)]
    return _shifts(record, *within, share=float(driven.mean()))


def _shifts(record: Record, U: np.ndarray, Y: np.ndarray, share: float = 1.0) -> list[Place]:
    """Outputs whose response shifts in time against the inputs: either side lost samples.

    Both are noise on a ``share`` of all lines: as many of their samples are independent.
    """
    length = Y.shape[1] // PARTS
    parts = [slice(k * length // 2, k * length // 2 + length) for k in range(2 * PARTS - 1)]
    answers = np.stack([correlation(U[:, p], Y[:, p], -APART, ANSWER) for p in parts], axis=1)
    found: list[Place] = []
    for o, y in enumerate(Y):
        # All inputs together show most; where one alone lost samples, only it shows that.
        every = list(range(len(U)))
        tried = (
            _shift(U[of], y, parts, answers[o][:, of], share)
            for of in ([every] if len(U) == 1 else [every, *([k] for k in every)])
        )
        step = next((s for s in tried if s is not None), None)
        if step is not None:
            found.append((_lost(record, *step), record.outputs[o]))
    return found


def _lost(record: Record, near: int, shift: int) -> FaultDraft:
    here, there, way = ("lost", "repeated", "earlier") if shift < 0 else ("repeated", "lost", "later")
    what = (
        f"answers {abs(shift)} samples {way} from near sample {near} ({near / record.sample_hz:.6g} s) on: "
        f"samples were {here} there, or {there} in the inputs"
    )
    hint = "cut the record there and fit the longer part, or shift what follows; check buffers and clocks"
    return fault("shift", what, hint, samples=((max(near - 1, 0), near + 1),))


def _shift(
    U: Float[np.ndarray, "input sample"],
    y: Signal,
    parts: list[slice],
    answers: Float[np.ndarray, "part input lag"],
    share: float,
) -> tuple[int, int] | None:
    """Sample near which, and samples by which, the response shifts within the record; None for no shift."""
    if not y.any() or _events(U) < FEWEST_EVENTS:
        return None
    lags = _lags(answers)
    step = None if lags is None else _best_step(lags)
    at = None if step is None else _where(U, y, parts, *step, share)
    return None if step is None or at is None else (at, step[1])


def _events(U: Float[np.ndarray, "input sample"]) -> float:
    """Number of samples of equal size with the power of the inputs; for steps, their number."""
    power = U**2
    return float(np.max(power.sum(axis=1) ** 2 / np.maximum(np.sum(power**2, axis=1), 1e-300)))


def _lags(answers: Float[np.ndarray, "part input lag"]) -> Float[np.ndarray, " part"] | None:
    """Lag of each part's response behind the one that most parts resemble; NaN where it resembles none."""
    size = np.sqrt(np.sum(answers**2, axis=(1, 2)))
    spectra = np.fft.rfft(answers, 2 * answers.shape[2], axis=2)
    cross = np.fft.irfft(np.einsum("ail,bil->abl", spectra, spectra.conj()), axis=2)
    cross /= (size[:, None] * size + 1e-300)[:, :, None]
    near = np.concatenate([cross[:, :, -APART:], cross[:, :, : APART + 1]], axis=2)
    peak, lag = near.max(axis=2), near.argmax(axis=2) - APART
    alike = peak > ALIKE
    moved = alike & (peak > near[:, :, APART] + BETTER)
    reference = int(np.argmax(np.sum(alike, axis=1)))
    if alike[reference].mean() < MOST_ALIKE:
        return None
    return np.where(alike[:, reference], np.where(moved[:, reference], lag[:, reference], 0), np.nan)


def _best_step(lags: Float[np.ndarray, " part"]) -> tuple[int, int] | None:
    """The first part after the largest step between two plateaus of three parts or more, and the step."""
    seen = np.flatnonzero(np.isfinite(lags))
    for k in range(2, len(seen) - 1):
        before, after = lags[seen[max(k - 3, 0) : k]], lags[seen[k : k + 3]]
        if np.ptp(before) <= 1.0 and np.ptp(after) <= 1.0 and abs(after.mean() - before.mean()) > 0.75:
            later = lags[seen[k:]]
            return int(seen[k]), round(float(np.median(later[:3]) - np.median(before)))
    return None


def _where(U: np.ndarray, y: Signal, parts: list[slice], part: int, shift: int, share: float) -> int | None:
    """Sample from which a shifted response explains the output better; None if it may be chance."""
    low, high = parts[max(part - 3, 0)].start, parts[min(part + 2, len(parts) - 1)].stop
    until = parts[max(part - 2, 0)].stop
    told = np.zeros_like(y)
    answers = correlation(U[:, :until], y[None, :until], 0, ANSWER)[0]
    for u, g in zip(U, answers, strict=True):
        told += np.convolve(u, np.where(np.sqrt(share) * np.abs(g) > 4.0, g, 0.0) / np.sqrt(until))[: len(u)]
    moved = np.roll(told, shift)
    # Before the step the shift explains less: the sum rises up to there, and falls from there on.
    gain = np.cumsum((y - moved)[low:high] ** 2 - (y - told)[low:high] ** 2)
    at = int(np.argmax(gain))
    # In noise of the output's size either sum would deviate from its own by twice the root of the squares.
    apart = np.cumsum((moved - told)[low:high] ** 2) / share
    rise, fall = gain[at], gain[at] - gain[-1]
    sure = rise > SURE * np.sqrt(apart[at]) and fall > SURE * np.sqrt(apart[-1] - apart[at])
    return low + at + 1 if sure else None


# Samples lost in all channels at once, and feedback.


def _residuals(record: Record, u: np.ndarray, y: np.ndarray) -> list[Place]:
    """Feedback (later inputs predict the output's noise) and joints (samples are missing).

    Each output is regressed on its own past and on the inputs until then; the residual is noise. Only a
    feedback loop correlates later inputs with it (Sims 1972). A loop that acts within some samples and has
    no memory looks like a direct term and is not detected, nor is the tail of a filter. A residual with a
    single large sample shows that samples were lost before it.
    """
    u, y = (x - x.mean(axis=1, keepdims=True) for x in (u, y))
    U, Y = (x / np.maximum(x.std(axis=1, keepdims=True), 1e-300) for x in (u, y))
    lags = max(4, PAST // len(U))
    later = max(2, lags // 2) + LEADS
    span = lags, U.shape[1] - lags - later
    after = beside(U, range(LEADS + 1, later + 1), *span)
    until = np.vstack([beside(U, range(-lags, LEADS + 1), *span), _tails(after, len(U))])
    repeated = record.periodic or find_repetition(record.u.reshape(len(record.u), -1, len(u))) is not None
    tells = not repeated and _events(np.diff(u)) >= FEWEST_STEPS
    found: list[Place] = []
    for o, port in enumerate(record.outputs):
        x = Y[o, lags : Y.shape[1] - later]
        own = np.vstack([beside(Y[o : o + 1], range(-lags, 0), *span), until])
        left = _left(x, own)
        at = _alone(left)
        if at is None and tells and float(left.std()) > FORETOLD:
            share = _told_later(x, own, after)
            calm = None if share is None else _calm(U, lags, later)
            if calm is not None and not calm.all():
                share = _told_later(x[calm], own[:, calm], after[:, calm])
            if share is not None and not _is_of_the_past(Y[o : o + 1], U, later, lags):
                found.append((_fed_back(share, U.shape[1]), port))
        if at is None:
            found += [(f, port) for f in _spikes_at_edges(record, U, Y[o])]
        else:
            # Predicted from its past, a spike is gone; after a joint the next samples are wrong, too.
            mended = Y[o].copy()
            mended[lags + at] -= left[at]
            past = np.vstack([beside(mended[None], range(-lags, 0), *span), until])
            after_it = _left(mended[lags : lags + len(x)], past)[at + 1 : at + 1 + PAST]
            gone = (
                at > PAST
                and len(after_it) > 0
                and float(np.std(after_it)) < AS_BEFORE * float(np.std(left[:at]))
            )
            jumps = bool(_jumps(U)[max(at + lags - BEFORE, 0) : at + lags + BEFORE + 1].any())
            place = _stands_out(record, at + lags) if gone else _joined(record, at + lags, jumps=jumps)
            found.append((place, port))
    return found


def _spikes_at_edges(record: Record, U: Float[np.ndarray, "input sample"], y: Signal) -> list[FaultDraft]:
    """A spike among the last samples, which have no later inputs, and the first, foretold backwards."""
    lags, count = max(4, PAST // len(U)), len(y)
    calm = ~np.convolve(_jumps(U), np.ones(2 * BEFORE + 1), "same").astype(bool)
    found = []
    for way in (1, -1):
        own, inputs = y[None, ::way], U[:, ::way]
        span = lags, count - lags
        rows = np.vstack([beside(own, range(-lags, 0), *span), beside(inputs, range(-lags, 1), *span)])
        left = _left(own[0, lags:], rows)
        at = _alone(left)
        if at is None or at < len(left) - PAST - lags or abs(left[at]) < STANDS_OUT:
            continue
        # Predicted from its past, a spike is gone, and so is what it foretold of the samples after it.
        mended = own.copy()
        mended[0, lags + at] -= left[at]
        rows[:lags] = beside(mended, range(-lags, 0), *span)
        after_it = _left(mended[0, lags:], rows)[at + 1 :]
        place = range(count)[::way][lags + at]
        before = float(np.std(left[:at]))
        if calm[place] and float(np.max(np.abs(after_it), initial=0.0)) < GONE * before:
            found.append(_stands_out(record, place))
    return found


def _tails(after: Float[np.ndarray, "row sample"], inputs: int) -> Float[np.ndarray, "tail sample"]:
    """Weighted sums of later samples of each input, for a response band-limited between samples."""
    n = np.arange(LEADS + 1.0, LEADS + 1 + len(after) // inputs)
    powers = np.arange(1.0, min(TAILS, len(n) // 2) + 1)
    weights = np.cos(np.pi * n) * n ** -powers[:, None]
    return np.einsum("kn,nis->kis", weights, after.reshape(len(n), inputs, -1)).reshape(-1, after.shape[1])


def _alone(left: Signal) -> int | None:
    """The first residual too large for noise: those after it are predicted from it, and wrong too."""
    size = np.abs(left)
    at = int(np.argmax(size))
    rest: np.ndarray = np.sort(np.delete(size, slice(max(at - 2, 0), at + PAST)))
    large = rest[-max(FEWEST_LARGE, len(rest) // 100) :]
    slope = float(np.mean(np.log(large / max(float(large[0]), 1e-300))))
    limit = float(large[0]) * np.exp(slope * (np.log(len(large)) + BEYOND))
    limit = max(limit, LEAP * float(rest[len(rest) // 2]), LEAST)
    first = max(at - PAST, 0)
    return first + int(np.argmax(size[first : at + 1] > limit)) if size[at] > limit else None


def _joined(record: Record, at: int, *, jumps: bool) -> FaultDraft:
    between = ", or an input jumps there, faster than its samples tell" if jumps else ""
    what = (
        f"does not go on at sample {at} ({at / record.sample_hz:.6g} s) as it was: samples of all channels "
        f"were lost there, or two runs joined{between}"
    )
    hint = "cut the record there: each part is a record of its own, with a state to begin with"
    hint += "; fade signals in and out, or filter them" if jumps else ""
    return fault("joint", what, hint, samples=((at, at + 1),))


def _stands_out(record: Record, at: int) -> FaultDraft:
    what = f"1 spike at {at} ({at / record.sample_hz:.6g} s), which neither its past nor the inputs foretell"
    hint = "check for loose contacts and switching nearby; repair the sample, or leave the period out"
    return fault("spike", what, hint, samples=((at, at + 1),))


def _told_later(x: Signal, own: np.ndarray, after: np.ndarray) -> float | None:
    """Share of the residual of ``x`` that later inputs explain; None if it may be chance."""
    before, then = (float(np.sum(_left(x, rows) ** 2)) for rows in (own, np.vstack([own, after])))
    added, free = len(after), len(x) - len(own) - len(after)
    gain, share = (before - then) / max(then, 1e-300) * free, 1.0 - then / max(before, 1e-300)
    return share if gain > added + SURE * np.sqrt(2.0 * added) and share > SHARE else None


def _calm(U: Float[np.ndarray, "input sample"], lags: int, later: int) -> Bool[np.ndarray, " sample"]:
    """Samples whose regression rows contain no jump of an input; all samples if too few have none.

    Where a sweep breaks off, its samples do not determine the input between them and would bias the fit.
    """
    near = np.convolve(_jumps(U), np.ones(lags + later + 1))[lags + later :]
    calm = near[: U.shape[1] - lags - later] < 0.5
    return calm if calm.mean() > CALM else np.ones_like(calm)


def _jumps(U: Float[np.ndarray, "input sample"]) -> Bool[np.ndarray, " sample"]:
    """Samples at which an input does what its past does not foretell, or a rest of it begins or ends."""
    left = np.abs([whitened(u) for u in U])
    still = np.diff(U, prepend=np.nan) == 0.0
    rests = scipy.ndimage.binary_opening(still, np.ones((1, PAST)))
    edges = np.diff(rests, prepend=rests[:, :1])
    large = left > JUMPS * np.maximum(np.median(left, axis=1, keepdims=True), 1e-300)
    return np.any(large | edges, axis=0)


def _unflattered(x: Signal, own: np.ndarray, after: np.ndarray) -> float:
    """The share of `_told_later`, each sum of squares over its degrees of freedom."""
    rows = own, np.vstack([own, after])
    before, then = (float(np.sum(_left(x, r) ** 2)) / max(len(x) - len(r), 1) for r in rows)
    return 1.0 - then / max(before, 1e-300)


def _is_of_the_past(y: np.ndarray, U: np.ndarray, later: int, lags: int) -> bool:
    """Whether later inputs explain nothing more once the regression has a longer past.

    Later values of predictable inputs, such as sums of sines, reveal far earlier ones. The response of
    lightly damped modes to those is no sign of feedback.
    """
    first: float | None = None
    for past in (lags, *(int(lags * longer) for longer in LONGER)):
        count = U.shape[1] - past - later
        rows = count / ((1 + len(U)) * past)
        if rows < FEWEST_ROWS:
            break
        span = past, count, 1 + count // ENOUGH
        after = beside(U, range(LEADS + 1, later + 1), *span)
        own = [beside(y, range(-past, 0), *span), beside(U, range(-past, LEADS + 1), *span)]
        own, x = np.vstack([*own, _tails(after, len(U))]), beside(y, range(1), *span)[0]
        if first is None:
            first = _unflattered(x, own, after)
            continue
        told = _told_later(x, own, after) if rows >= ROWS else _unflattered(x, own, after)
        if told is None or (rows < ROWS and told < FALLS_TO * first):
            return True
    return False


def _fed_back(share: float, samples: int) -> FaultDraft:
    lost = (
        f"; or samples were lost within it, which {samples} samples do not tell from feedback"
        if samples < TELLS_LOSS
        else ""
    )
    what = (
        f"sends its noise back into the inputs: they tell, later, {share:.0%} of what its past leaves. There "
        "is feedback in the record, or the inputs were recorded late, or with noise, which makes gains too "
        f"small{lost}"
    )
    hint = (
        "fit from a signal outside the loop (--reference CHANNEL), or with the controller known: from the "
        "inputs directly one finds something between the plant and 1/K; for noisy "
        "inputs a signal that repeats, or the command itself"
    )
    return fault("feedback", what, hint)


def beside(
    x: Float[np.ndarray, "channel sample"], shifts: range, first: int, count: int, every: int = 1
) -> Float[np.ndarray, "row sample"]:
    """Each ``every``-th of ``count`` samples from ``first``, shifted by each of ``shifts``."""
    return np.vstack([x[:, first + k : first + k + count : every] for k in shifts])


def _left(x: Signal, rows: Float[np.ndarray, "row sample"]) -> Signal:
    gram = rows @ rows.T
    gram += 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram))
    return x - np.linalg.solve(gram, rows @ x) @ rows


# Delays.


def _long_delays(record: Record, U: np.ndarray, Y: np.ndarray) -> list[Place]:
    """Outputs that respond to no input within many samples."""
    found: list[Place] = []
    count = U.shape[1]
    for o, port in enumerate(record.outputs):
        heard = [k for u in U if u.any() for k in _first_answers(u, Y[o], count // 2)]
        if not heard:
            continue
        first = min(heard)
        if first >= max(LONG, LONG_SHARE * count):
            what = (
                f"answers {first} samples ({first / record.sample_hz:.4g} s) after the inputs, and not before"
            )
            hint = "shift the output by that before a fit; check triggers, and that it is this test's record"
            found.append((fault("delay", what, hint), port))
    return found


def _first_answers(u: Signal, y: Signal, most: int) -> list[int]:
    r = correlation(u[None], y[None], 0, most)[0, 0]
    return [int(np.argmax(np.abs(r) > ANSWERED))] if np.any(np.abs(r) > ANSWERED) else []
