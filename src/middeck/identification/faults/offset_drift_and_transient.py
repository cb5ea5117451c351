"""Faults of level, scale and period: offset, drift, coarse steps, slower rates, unsteady periods."""

import numpy as np

from middeck.identification.faults.equal_runs import FaultDraft, Levels, Signal, fault

# Level over swing (rms) from which an offset is reported: an output that hardly crosses zero; a command may
# have one by intention (a binary sequence of 0 and 1 has 1).
OFFSET_OUTPUT, OFFSET_INPUT = 1.0, 3.0
# Change over the record, over the rms of the signal, from which a drift is reported.
DRIFT, PERIODIC_DRIFT = 0.3, 0.1
# Lowest lines that a drift must exceed, and how many of its standard deviations it must have. With nineteen
# degrees of freedom Student's t passes 8 in one of 1e7.
LINES, SURE = 10, 8.0
# Noise of the steps over the signal (step / sqrt(12) / rms): 1 % is the noise of a good bench.
COARSE, TOO_COARSE = 0.01, 0.1
# First period less last one, over the signal's rms, from which a transient is reported; and how much of it
# must die out from the first to the last quarter of a period, or from the first two to the last two periods.
TRANSIENT, SERIOUS, DIES = 0.01, 0.1, 4.0
# Scatter of the input over its periods, as a share of their mean.
REPEATS = 0.5


def find_offset(x: Signal, unit: str, *, is_input: bool) -> list[FaultDraft]:
    """A mean that is large relative to the signal's rms."""
    level, swing = float(x.mean()), float(x.std())
    if abs(level) <= (OFFSET_INPUT if is_input else OFFSET_OUTPUT) * swing:
        return []
    # A mean scatters as the lowest lines do: few slow cycles have a level without an offset.
    lowest = np.abs(np.fft.rfft(x - level)[1 : LINES + 1]) / len(x)
    if abs(level) <= SURE * np.sqrt(np.mean(lowest**2)):
        return []
    what = f"offset of {level:.3g} {unit}, {abs(level) / swing:.1f} times its swing".replace("  ", " ")
    hint = "responses leave it out; check range and zero of the sensor"
    return [fault("offset", what, hint, severity="note")]


def find_drift(x: Signal, unit: str, *, period: int | None) -> list[FaultDraft]:
    """A trend that the signal's own slow motion does not explain."""
    swing, periods = float(x.std()), 1 if period is None else len(x) // period
    change, sure = _trend(x, periods)
    least = (DRIFT if periods == 1 else PERIODIC_DRIFT) * swing
    if sure <= SURE or abs(change) <= least:
        return []
    what = f"drifts by {change:.3g} {unit} over the record, {abs(change) / swing:.0%} of its rms".replace(
        "  ", " "
    )
    hint = "let sensors and article warm up; take the drift out before a fit of slow modes"
    return [fault("drift", what, hint)]


def _trend(x: Signal, periods: int) -> tuple[float, float]:
    """Change over the record, and that in standard deviations.

    A ramp of D has the lines X_k / N = j D / (2 pi k), all of one phase; a random signal has any phases.
    Times k, the lines of a ramp are equal; the scatter of the rest is its standard deviation. A signal that
    repeats ``periods`` times has only every ``periods``-th line: these lines are left out.
    """
    k = np.arange(1, 2 * LINES + 1)
    k = (k[k % periods != 0] if periods > 1 else k)[:LINES]
    if len(x) < 4 * k[-1]:
        return 0.0, 0.0
    level = np.fft.rfft(x - x.mean())[k] / len(x) * 2.0 * np.pi * k
    change = float(np.imag(level).mean())
    rest = np.concatenate([np.real(level), np.imag(level) - change])
    scatter = np.sqrt(np.sum(rest**2) / (2 * LINES - 1))
    return change, abs(change) / max(scatter / np.sqrt(LINES), 1e-300)


def find_coarse_steps(x: Signal, levels: Levels) -> list[FaultDraft]:
    """Quantisation steps that are a large part of the signal."""
    step, swing = levels.step, float(x.std())
    noise = step / np.sqrt(12.0) / swing
    if noise <= COARSE:
        return []
    what = f"coarse steps of {step:.3g}: their noise is {noise:.1%} of the signal"
    hint = "amplify before the converter, or choose a smaller range"
    return [fault("quantisation", what, hint, severity="serious" if noise > TOO_COARSE else "note")]


def find_held(x: Signal) -> list[FaultDraft]:
    """A channel that changes at every n-th sample only."""
    every, _ = held_at(x)
    if every < 2:
        return []
    what = f"moves at every {every}. sample only: recorded at a {every} times slower rate and held"
    hint = "resample all channels to the slower rate, or take the hold into account"
    return [fault("held", what, hint)]


def held_at(x: Signal) -> tuple[int, int]:
    """Samples for which each value is held, and the first that begins one; (1, 0) if none are.

    >>> held_at(np.repeat(np.arange(30.0), 3))
    (3, 0)
    """
    moves = np.flatnonzero(np.diff(x))
    if len(moves) < 20:
        return 1, 0
    gaps = np.diff(moves)
    every = int(np.median(gaps))
    if every < 2 or np.mean(gaps % every == 0) < 0.95 or np.mean(gaps == every) < 0.8:
        return 1, 0
    return every, int(moves[0] + 1) % every


def find_transient(x: Signal, period: int) -> list[FaultDraft]:
    """A first period that differs from the last by a decaying transient."""
    rows = x.reshape(-1, period)
    if len(rows) < 2:
        return []
    rest = rows[0] - rows[-1]
    rest = rest - rest.mean()
    size = float(np.sqrt(np.mean(rest**2)) / x.std())
    if size <= TRANSIENT or not (_dies(rest) or _dies_over_periods(rows)):
        return []
    what = f"not steady: the first period differs from the last by {size:.1%} of the rms"
    hint = "leave the first period out, or wait longer before recording"
    grade = "serious" if size > SERIOUS else "note"
    return [fault("transient", what, hint, severity=grade, samples=((0, period),))]


def _dies(rest: Signal) -> bool:
    quarter = len(rest) // 4
    first, last = (float(np.sum(part**2)) for part in (rest[:quarter], rest[-quarter:]))
    return first > DIES * last


def _dies_over_periods(rows: np.ndarray) -> bool:
    if len(rows) < 4:
        return False
    change = np.sum((np.diff(rows, axis=0) - np.diff(rows, axis=0).mean(axis=1, keepdims=True)) ** 2, axis=1)
    return bool(change[0] > DIES * change[-1])


def find_unsteady_input(u: Signal, period: int) -> list[FaultDraft]:
    """An input declared periodic that does not repeat."""
    rows = u.reshape(-1, period)
    if len(rows) < 2:
        return []
    mean = rows.mean(axis=0)
    scatter, size = float(np.sqrt(np.mean((rows - mean) ** 2))), float(mean.std())
    if scatter <= REPEATS * size:
        return []
    what = f"does not repeat: it scatters by {scatter / max(size, 1e-300):.0%} of its mean period"
    return [fault("repeat", what, "count the periods; record only steady ones", severity="unusable")]
