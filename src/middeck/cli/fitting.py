"""From record files to a fitted model."""

from __future__ import annotations

from collections.abc import Sequence

from middeck.cli.blame import reading
from middeck.cli.settings import FitSettings
from middeck.files.records import load_records, split_periods
from middeck.identification.fit import FitResult, fit_response
from middeck.identification.spectra import estimate_response
from middeck.systems.record import Record
from middeck.systems.response import FrequencyResponse
from middeck.values import record

# Above this share of the sampling rate a held input is weakened by more than 2.5 % (sin(x)/x, x = pi/8): a
# continuous model would take that for dynamics.
HELD_ABOVE = 1.0 / 8.0


@record
class Identified:
    """What was fitted to what."""

    measured: FrequencyResponse
    sample_hz: float
    fit: FitResult
    warnings: tuple[str, ...]


def identify(files: Sequence[str], settings: FitSettings) -> Identified:
    """Estimate the response of the records together and fit it, sampled where the band asks for it."""
    taken = load_periods(files, settings.periods)
    with reading(*files):
        measured = estimate_response(taken, band_hz=settings.band_hz)
        reaches = measured.frequency_hz[-1] > HELD_ABOVE * taken.sample_hz
        sampled = bool(reaches) if settings.sampled is None else settings.sampled
        fit = fit_response(
            measured,
            states=settings.states,
            sample_hz=taken.sample_hz if sampled else None,
            cost=settings.cost,
        )
    chosen = settings.sampled is None and sampled
    warnings = (_chosen(measured.frequency_hz[-1], taken.sample_hz),) if chosen else ()
    return Identified(measured, taken.sample_hz, fit, (*warnings, *fit.warnings))


def _chosen(last_hz: float, sample_hz: float) -> str:
    return (
        f"a sampled model was chosen, as the lines reach {last_hz:g} Hz, past 1/8 of {sample_hz:g} Hz: it "
        "has no delay, and poles stand in for one; if there is one, use --continuous or end --band earlier"
    )


def load_periods(files: Sequence[str], periods: int | None) -> Record:
    """The records together, each of so many whole periods if that is given."""
    taken = load_records(files)
    with reading(*files):
        return taken if periods is None else split_periods(taken, periods)
