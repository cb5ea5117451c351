"""Tests that seem to be one given twice, which would be counted twice.

Two measurements of one mode agree to a digit below their standard deviation once in some thirty times.
"""

from __future__ import annotations

import decimal
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.updating.residuals.static_tests import StaticTest
from middeck.updating.residuals.surveys import Survey

# So many frequencies that agree to such digits are no chance.
NO_CHANCE = 3
# A file of universal format keeps six digits; and parts of a deviation within which three modes of two tests
# agree by chance once in a hundred thousand times (twenty modes).
ROUNDING, MUCH_CLOSER = 5e-6, 3e-3
# The most lines of a spectrum up to the highest mode that are tried.
MOST_LINES = 100_000
CURE = (
    "leave one of them out: one measurement counted twice looks more certain than it is. A test that was "
    "repeated differs in the last digits: state these"
)


def refuse_repeated(surveys: Sequence[Survey]) -> None:
    """Raise `ConfigError` for surveys that share frequencies to digits that no two tests share."""
    for one, other in itertools.combinations(surveys, 2):
        shared = _shared(one, other)
        if np.sum(_fine(one) & shared) >= NO_CHANCE and not _on_lines(one):
            raise ConfigError(
                f"surveys {one.name!r} and {other.name!r} state {np.sum(shared)} frequencies that are "
                "the same to every digit, or but for rounding: one measurement given twice",
                where="survey",
                hint=CURE,
            )


def repeated_tests(surveys: Sequence[Survey], statics: Sequence[StaticTest]) -> Iterator[str]:
    """A sentence for each two tests that may be one, as one contains all of the other."""
    for one, other in itertools.combinations(surveys, 2):
        if np.all(_shared(one, other)) or np.all(_shared(other, one)):
            yield f"surveys {one.name!r} and {other.name!r} state the same frequencies to every digit: {CURE}"
    for first, second in itertools.combinations(statics, 2):
        if (
            [g.name for g in first.gauges] == [g.name for g in second.gauges]
            and np.array_equal(first.value, second.value)
            and np.any(first.value)
        ):
            yield f"static tests {first.name!r} and {second.name!r} state the same readings: {CURE}"


def _shared(one: Survey, other: Survey) -> np.ndarray:
    """Whether each frequency of ``one`` is among those of ``other``, but for rounding."""
    hz = one.measured.frequency_hz
    near = hz * np.minimum(ROUNDING, MUCH_CLOSER * one.std)
    return np.any(np.abs(hz[:, None] - other.measured.frequency_hz) <= near[:, None], axis=1)


def _fine(survey: Survey) -> np.ndarray:
    """Whether each frequency is stated to digits below its standard deviation."""
    hz = survey.measured.frequency_hz
    last = np.floor(np.log10(survey.std * hz)).astype(int)
    return np.array([round(f, -int(k)) != f for f, k in zip(hz.tolist(), last, strict=True)], dtype=bool)


def _on_lines(survey: Survey) -> bool:
    """Whether all frequencies may be lines of one spectrum, a standard deviation or more apart.

    Peaks read off at its lines are the same ones in most repeated tests, to every digit.
    """
    hz = survey.measured.frequency_hz
    last = min(decimal.Decimal(repr(f)).normalize().as_tuple().exponent for f in hz.tolist())
    rounding = 0.5 * 10.0 ** float(last) + 1e-12 * hz
    count = min(int(hz.max() / np.min(survey.std * hz)), MOST_LINES)
    step = hz.max() / np.arange(1, count + 1)[:, None]
    return bool(np.any(np.all(np.abs(hz - step * np.round(hz / step)) <= rounding, axis=1)))
