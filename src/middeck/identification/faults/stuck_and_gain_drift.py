"""Faults of the response within a record: channels that stick for a while, and gains that drift slowly.

One regression predicts each output from its own past, which covers free motion, and from the inputs until
then. While an input truly rests, the residual is as elsewhere. It is larger while the input moves and its
channel sticks, or while an output sticks and the inputs move it. A gain that drifts changes the share of
the inputs in the prediction, whatever the poles are.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.faults.equal_runs import FaultDraft, Signal, equal_runs, fault
from middeck.identification.faults.lost_samples_and_feedback import ENOUGH, FEWEST_SAMPLES, beside
from middeck.signals.fault import RecordFault, Side
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.values import record as value

# Past samples from which the next is predicted: of the output, and of all inputs together; and how many
# samples each unknown takes.
PAST, PAST_OF_INPUTS, ROWS = 24, 48, 6
# The past by which a gain that changes is confirmed: of many modes a short one leaves a response that looks
# like a gain, which changes where the input does.
LONG_PAST = 96
# Share of the regressors' power that keeps their equations determined.
FLOOR = 1e-10
# An input that rests so long, and so many times as long as ever else, and moves at so many of the other
# samples, may be stuck; as an output from the first sample on.
RESTS, LONGER, MOVES, STARTS = 64, 3.0, 0.1, 60
# Power that is left where a channel stands still over that elsewhere, from which its response is left there.
# Of 300 sound records none has more than two. Below the second, in units of the output's, it is rounding.
LEFT, ROUNDED = 6.0, 1e-10
# Power that later inputs leave over that of the inputs as they are, below which the article has a dead time.
TELLS_MORE = 0.5
# Samples that a mean square of what is left is taken from.
FEWEST = 12
# Parts of a record whose gains are compared, by how much their line may change, and that in deviations
# (Student's t of fourteen degrees of freedom is beyond it in one of 1e5).
PARTS, CHANGE, SURE = 16, 0.02, 6.5
# What the inputs add in one part over that in the median part, and the share of an input's power that may
# move between eight bands of frequency from the first half of a record to the other: a sweep that meets other
# modes at another time does not distinguish a gain from a response.
UNEVEN, BANDS, MOVED = 4.0, 8, 0.3
# Pieces of a record, long against the memory of its modes, which distinguish a growing delay from a gain;
# and how many times as much it must explain (amplitude). Of ten records of two clocks the least was three.
PIECES, CLEARLY = 8, 2.0


@value
class _Regression:
    """One output: the predicted samples and their regressors [own past, inputs, one], from ``first`` on;
    ``past`` rows are its own.
    """

    told: Float[np.ndarray, " sample"]
    rows: Float[np.ndarray, "row sample"]
    first: int
    past: int

    def weights(self, leave_out: slice = slice(0, 0)) -> Float[np.ndarray, " row"]:
        """Least squares over the samples that are not left out."""
        right = self.rows @ self.told - self.rows[:, leave_out] @ self.told[leave_out]
        return np.linalg.solve(self._gram(leave_out), right)

    def left(self, leave_out: slice = slice(0, 0)) -> Signal:
        """The prediction error of all samples."""
        return self.told - self.weights(leave_out) @ self.rows

    def unsure(self, leave_out: slice, at: slice, power: float) -> float:
        """Mean variance of the prediction ``at`` samples, with the ``power`` of the noise elsewhere.

        Large where a mode moves only there. The floor keeps weights small that nothing else determines, as
        noise would of which they are no larger than one.
        """
        there, gram = self.rows[:, at], self._gram(leave_out)
        floor = FLOOR * float(np.trace(gram)) / len(gram)
        return max(power, floor) * float(np.mean(np.sum(there * np.linalg.solve(gram, there), axis=0)))

    def _gram(self, leave_out: slice) -> Float[np.ndarray, "row row"]:
        out = self.rows[:, leave_out]
        gram = self.rows @ self.rows.T - out @ out.T
        return gram + FLOOR * np.trace(gram) / len(gram) * np.eye(len(gram))


def find_stuck(record: Record) -> list[RecordFault]:
    """Inputs that stand still while the outputs show that they move, and outputs that respond only later."""
    found: list[RecordFault] = []
    for e, (u, y) in enumerate(_experiments(record)):
        at_inputs = [
            (i, run) for i, x in enumerate(u) if (run := _rest(x)) is not None and _others(u, i, run)
        ]
        starts = [next((r for r in equal_runs(x, STARTS) if r[0] == 0), None) for x in y]
        said = dict[tuple[Side, Port], tuple[int, int]]()
        for o, port in enumerate(record.outputs if at_inputs or any(starts) else ()):
            of = _regression(u, y[o])
            for i, run in at_inputs:
                if _answers_in(of, run, PAST):
                    said["input", record.inputs[i]] = run
            start = starts[o]
            if start and _answers_in(of, start, 0) and not _is_late(u, y[o], start[1]):
                said["output", port] = start
        found += [_stuck(record, run).at(side, port, e) for (side, port), run in said.items()]
    return found


def find_gain_drift(record: Record) -> list[RecordFault]:
    """Outputs whose gain from the inputs, or whose delay, changes over the record.

    If inputs are predictable, a growing delay looks like a gain to a prediction of one sample; the responses
    over longer pieces distinguish them.
    """
    found: list[RecordFault] = []
    for e, (u, y) in enumerate(_experiments(record)):
        if not all(_is_even(x) for x in u):
            continue
        every = 1 + y.shape[1] // ENOUGH
        for o, port in enumerate(record.outputs):
            change = _change(_regression(u, y[o], every))
            if change is not None and _change(_regression(u, y[o], past=LONG_PAST)) is not None:
                late = _slip(u, y[o])
                drift = _drifting(change) if late is None else _slipping(late / record.sample_hz)
                found.append(drift.at("output", port, e))
    return found


def _experiments(record: Record) -> list[tuple[np.ndarray, np.ndarray]]:
    """u[input, sample] and y[output, sample] in units of their rms, of experiments that are long enough."""
    each = zip(record.u, record.y, strict=True)
    runs = [(u.reshape(-1, u.shape[2]).T, y.reshape(-1, y.shape[2]).T) for u, y in each]
    enough = max(FEWEST_SAMPLES, ROWS * (PAST + PAST_OF_INPUTS + 4 * len(record.inputs)))
    return [(_scaled(u), _scaled(y)) for u, y in runs if u.shape[1] >= enough]


def _scaled(x: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, "channel sample"]:
    x = x - x.mean(axis=1, keepdims=True)
    return x / np.maximum(x.std(axis=1, keepdims=True), np.finfo(float).tiny)


def _regression(
    u: Float[np.ndarray, "input sample"], y: Signal, every: int = 1, late: int = 0, past: int = PAST
) -> _Regression:
    """The regression with inputs delayed by ``late`` samples."""
    first = past + late
    span = first, len(y) - first, every
    lags = range(-late - max(4, min(PAST, PAST_OF_INPUTS // len(u))), 1 - late)
    own, inputs = beside(y[None], range(-past, 0), *span), beside(u, lags, *span)
    return _Regression(y[first::every], np.vstack([own, inputs, np.ones(own.shape[1])]), first, past)


def _rest(x: Signal) -> tuple[int, int] | None:
    """The run in which an input that moves otherwise stands still, longer than ever else."""
    runs = sorted(equal_runs(x, 2), key=lambda run: run[0] - run[1])
    if not runs:
        return None
    a, b = runs[0]
    next_to_it = runs[1][1] - runs[1][0] if len(runs) > 1 else 1
    moves = np.count_nonzero(np.diff(x)) / max(len(x) - (b - a), 1)
    if b - a < max(RESTS, LONGER * next_to_it) or moves <= MOVES:
        return None
    # A sweep that rests at an end meets modes there that it does not meet elsewhere.
    at_an_end = a == 0 or b == len(x)
    return None if at_an_end and not _is_even(np.delete(x, slice(a, b))) else (a, b)


def _others(u: Float[np.ndarray, "input sample"], i: int, run: tuple[int, int]) -> bool:
    """Whether each other input moves outside the run about as strongly as in it, or more."""
    steps = np.delete(np.diff(u, axis=1), i, axis=0) ** 2
    here = steps[:, run[0] : run[1]]
    outside = (steps.sum(axis=1) - here.sum(axis=1)) / max(steps.shape[1] - here.shape[1], 1)
    return bool(np.all(outside > MOVES * here.mean(axis=1)))


def _answers_in(of: _Regression, run: tuple[int, int], after: int) -> bool:
    """Whether the residual is larger in a run, from ``after`` samples past its beginning, than elsewhere."""
    a, b = (k - of.first for k in run)
    inside = slice(max(a + after, 0), b - PAST)  # a response may be delayed
    around = slice(max(a - PAST, 0), min(b + PAST, len(of.told)))
    if inside.stop - inside.start < FEWEST or len(of.told) - (around.stop - around.start) < ROWS * len(
        of.rows
    ):
        return False
    left = of.left(around)
    elsewhere = float(np.mean(np.delete(left, around) ** 2))
    expected = LEFT * (elsewhere + of.unsure(around, inside, elsewhere))
    return bool(np.var(left[inside]) > max(expected, ROUNDED))


def _is_late(u: Float[np.ndarray, "input sample"], y: Signal, start: int) -> bool:
    """Whether inputs delayed by ``start - 1`` samples predict the rest far better: a dead time."""
    at_once, late = (_regression(u, y, late=late).left() for late in (0, start - 1))
    return float(np.sum(late**2)) < TELLS_MORE * float(np.sum(at_once[-len(late) :] ** 2))


def _stuck(record: Record, run: tuple[int, int]) -> FaultDraft:
    a, b = run
    when = f"from sample {a} to {b - 1} ({a / record.sample_hz:.6g} to {(b - 1) / record.sample_hz:.6g} s)"
    what = f"stands still {when}, while inputs and outputs say that it moves"
    hint = "leave that part of the record out; check cable, trigger and the start of the recording"
    return fault("stuck", what, hint, samples=(run,))


def _is_even(u: Signal) -> bool:
    """Whether an input has its power at the same frequencies in both halves of the record."""
    if len(u) < 4 * BANDS:
        return False
    halves = (u[: len(u) // 2], u[len(u) // 2 : 2 * (len(u) // 2)])
    powers = np.array([np.abs(np.fft.rfft(x)[1:]) ** 2 for x in halves])
    bands = np.array([[part.sum() for part in np.array_split(p, BANDS)] for p in powers])
    size = bands.sum(axis=1, keepdims=True)
    return bool(size.min() > 0.0 and 0.5 * np.abs(np.diff(bands / size, axis=0)).sum() < MOVED)


def _change(of: _Regression) -> float | None:
    """Relative change of the inputs' gain over the record, from a linear fit; None if it may be chance."""
    if of.rows.shape[1] < ROWS * len(of.rows):
        return None
    weights = of.weights()
    added = weights[of.past : -1] @ of.rows[of.past : -1]
    foretold = _Regression(added, np.vstack([of.rows[: of.past], of.rows[-1:]]), of.first, of.past)
    new, left = foretold.left(), of.told - weights @ of.rows
    parts = np.array_split(np.arange(len(new)), PARTS)
    power = np.array([np.sum(new[part] ** 2) for part in parts])
    if not power.min() > 0.0 or power.max() > UNEVEN * np.median(power):
        return None
    gains = np.array([left[part] @ new[part] for part in parts]) / power
    share, time = power / power.sum(), np.linspace(-0.5, 0.5, PARTS)
    time = time - share @ time
    spread = share @ time**2
    change = float(share @ (time * gains) / spread)
    rest = gains - share @ gains - change * time
    # The larger scatter, of all parts or weighted by place: the few at the ends may agree by chance.
    scatter = max(share**2 @ (time * rest) ** 2, (share**2 @ time**2) * (share @ rest**2))
    deviation = np.sqrt(scatter * PARTS / (PARTS - 2)) / spread
    return change if abs(change) > max(CHANGE, SURE * deviation) else None


def _slip(u: Float[np.ndarray, "input sample"], y: Signal) -> float | None:
    """Growth of the output's delay over the record [samples]; None if a gain explains as much.

    P is the response to the inputs in each piece by the averaged transfer function. A delay that grows by d
    leaves the residual -d j omega P times the time, from -1/2 to 1/2.
    """
    size = u.shape[1] // PIECES
    U, Y = (_pieces(x, size) for x in (u, y[None]))
    power = np.einsum("kip,kjp->pij", U, U.conj())
    power += FLOOR * np.real(np.trace(power.mean(axis=0))) * np.eye(len(u))
    H = np.linalg.solve(power.mT, np.einsum("kp,kjp->pj", Y[:, 0], U.conj())[:, :, None])[:, :, 0]
    P = np.einsum("pi,kip->kp", H, U)
    time = np.linspace(-0.5, 0.5, len(P))[:, None]
    gain, late = time * P, -1j * np.pi * np.linspace(0.0, 1.0, P.shape[1]) * time * P
    told = [float(np.real(np.vdot(part, Y[:, 0] - P))) for part in (gain, late)]
    sizes = [float(np.linalg.norm(part)) for part in (gain, late)]
    if not min(sizes) > 0.0 or abs(told[1]) / sizes[1] < CLEARLY * abs(told[0]) / sizes[0]:
        return None
    return told[1] / sizes[1] ** 2


def _pieces(x: Float[np.ndarray, "channel sample"], size: int) -> Complex[np.ndarray, "piece channel line"]:
    """Spectra of pieces that overlap by half."""
    starts = range(0, x.shape[1] - size + 1, size // 2)
    return np.fft.rfft(np.array([x[:, k : k + size] for k in starts]) * np.hanning(size), axis=2)


def _slipping(seconds: float) -> FaultDraft:
    way = "later" if seconds > 0.0 else "earlier"
    what = (
        f"answers the inputs ever {way}, by some {1e3 * abs(seconds):.2g} ms from the beginning of the "
        "record to its end, as with two clocks (or its gain changes)"
    )
    hint = "sample inputs and outputs by one clock, or resample one of them; fit a shorter part"
    return fault("unlike", what, hint)


def _drifting(change: float) -> FaultDraft:
    what = (
        f"has a gain to the inputs that changes by {change:+.1%} from the beginning of the record to its end"
    )
    hint = "let sensors and amplifiers warm up, check the charge of batteries; fit a shorter part"
    return fault("unlike", what, hint)
