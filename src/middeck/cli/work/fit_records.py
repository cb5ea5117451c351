"""From record files to a fitted model."""

import dataclasses
import warnings as python_warnings
from collections.abc import Callable, Sequence

import numpy as np

from middeck.cli.given.checked_options import FitSettings
from middeck.cli.shown.file_of_an_error import reading
from middeck.errors import ConfigError
from middeck.files.records import Columns, check_finite, join_records, read_record, split_periods
from middeck.identification.faults.detect import detect_faults
from middeck.identification.fit.fit_response import FitResult, fit_asked
from middeck.identification.friction.find import JointFriction, find_friction
from middeck.identification.friction.remove import without_friction
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.model.measurement_model import MeasurementModel, rank_of
from middeck.identification.record_fit.fit_record import HELD_ABOVE, below_half_rate, fit_samples
from middeck.identification.record_fit.residual_tests import named_cause
from middeck.identification.spectra.averages import estimate_spectra, warnings_on_window
from middeck.identification.spectra.estimate import estimate_response
from middeck.identification.spectra.h1_h2_hv import spectra_response
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure
from middeck.identification.uncertainty.parameter_deviations import distinct_poles
from middeck.signals.excitation.recognition import cut_periods, recognise_excitation
from middeck.signals.record import Record
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.sampling.zero_order_hold import release_hold
from middeck.values import record

# Two periods distinguish noise from response.
FEWEST_PERIODS = 2


@record(kw_only=True)
class Identified:
    """A fit and its data; ``measured`` is None where the record itself was fitted.

    ``friction`` is what was taken out of the record before.
    """

    record: Record
    measured: FrequencyResponse | None
    fit: FitResult
    warnings: tuple[str, ...]
    asked_hz: tuple[float, float] | None = None
    friction: JointFriction | None = None

    @property
    def band_hz(self) -> tuple[float, float]:
        """First and last line of the fit; for samples, the band asked for or all up to half their rate."""
        if self.measured is None:
            return self.asked_hz or (0.0, 0.5 * self.record.sample_hz)
        return float(self.measured.frequency_hz[0]), float(self.measured.frequency_hz[-1])


def identify(
    files: Sequence[str],
    settings: FitSettings,
    named: Columns | None = None,
    show_stage: Callable[[str], None] = lambda _: None,
) -> Identified:
    """Fit the records together: the response of their periods, or the samples of one that has none.

    ``show_stage`` is called with what is done next.
    """
    show_stage("reading")
    taken, seen = load_periods(files, settings.periods, named)
    taken = taken if settings.held is None else dataclasses.replace(taken, held=settings.held)
    with reading(*files):
        show_stage("looking for faults")
        seen = (*seen, *_faults(taken))
        if settings.friction:
            show_stage("looking for friction")
            found = _friction(taken, settings)
            done = _fit_response(without_friction(taken, found), settings, seen)
            return dataclasses.replace(done, friction=found)
        if settings.method == "samples" or not (taken.periodic or settings.method or settings.reference):
            return _fit_record(taken, settings, seen, show_stage)
        if taken.periodic and settings.method is None and len(taken.u) < len(taken.inputs):
            few = f"{len(taken.u)} experiments cannot tell {len(taken.inputs)} inputs apart line by line"
            return _fit_record(taken, settings, (*seen, f"{few}: the samples are fitted"), show_stage)
        show_stage("estimating and fitting the response")
        return _fit_response(taken, settings, seen)


def response_of(found: Identified) -> FrequencyResponse:
    """The fitted response, or one estimated from the samples of a record."""
    if found.measured is not None:
        return found.measured
    return _as_fitted(estimate_response(found.record), found.fit)


def _as_fitted(measured: FrequencyResponse, fit: FitResult) -> FrequencyResponse:
    """The measured response, without its hold if the model excludes it."""
    held_s = fit.model.hold_s
    return release_hold(dataclasses.replace(measured, hold_s=held_s)) if held_s else measured


def _fit_response(taken: Record, settings: FitSettings, seen: tuple[str, ...]) -> Identified:
    method = None if settings.method == "samples" else settings.method
    with python_warnings.catch_warnings(record=True) as caught:
        python_warnings.simplefilter("always")
        measured = estimate_response(
            taken, band_hz=settings.band_hz, method=method, reference=tuple(settings.reference) or None
        )
    seen = tuple(dict.fromkeys((*seen, *(str(one.message) for one in caught))))
    reaches = measured.frequency_hz[-1] > HELD_ABOVE * taken.sample_hz
    sampled = _is_sampled(settings, reaches=bool(reaches))
    with named_cause(taken):
        fit = fit_asked(measured, _asked(settings, taken.sample_hz if sampled else None), settings.cost)
    warnings = _chosen(settings, float(measured.frequency_hz[-1]), taken) if reaches else []
    if method in ("h1", "h2", "hv") and not taken.periodic:
        spectra = estimate_spectra(taken)
        warnings += warnings_on_window(spectra_response(spectra, method), spectra)
    each = tuple(dict.fromkeys((*seen, *warnings, *fit.warnings)))
    return Identified(record=taken, measured=_as_fitted(measured, fit), fit=fit, warnings=each)


def _friction(taken: Record, settings: FitSettings) -> JointFriction:
    """The friction of the settings' joints; refused with a fit of samples, which keeps the friction."""
    if settings.method == "samples" or settings.reference:
        raise ConfigError("friction is found in periods of open-loop records", hint="leave the other out")
    joints = [tuple(part.strip() for part in name.split("=", 1)) for name in settings.friction]
    band_hz = settings.band_hz or recognise_excitation(taken).band_hz
    return find_friction(taken, [(joint[0], joint[-1]) for joint in joints], band_hz=band_hz)


def _faults(taken: Record) -> list[str]:
    """Faults by `detect_faults` that harm a fit."""
    faults = (f for f in detect_faults(taken) if f.severity != "note")
    return [f.in_a_line for f in faults]


def _fit_record(
    taken: Record, settings: FitSettings, seen: tuple[str, ...], show_stage: Callable[[str], None]
) -> Identified:
    if settings.cost != "weighted":
        raise ConfigError(
            "the samples of a record that is not periodic can only be fitted by likelihood",
            hint="--method 'local rational' fits an estimated response instead",
        )
    _refuse_unlike(settings)
    asked_hz = below_half_rate(settings.band_hz, taken.sample_hz)
    fit = fit_samples(taken, _asked(settings), sampled=settings.sampled, band_hz=asked_hz, tell=show_stage)
    sampled = fit.model.sample_hz is not None
    band_hz = asked_hz or recognise_excitation(taken).band_hz
    held = sampled or fit.model.hold_s is not None  # the record or the data show the hold
    reaches = not held and band_hz[1] > HELD_ABOVE * taken.sample_hz
    warnings = _chosen(settings, band_hz[1], taken, of_samples=True) if reaches else []
    shown_hz = asked_hz if sampled else band_hz
    return Identified(
        record=taken, measured=None, fit=fit, warnings=(*seen, *warnings, *fit.warnings), asked_hz=shown_hz
    )


def _asked(settings: FitSettings, sample_hz: float | None = None) -> FitOptions:
    """The options that both fits share."""
    return FitOptions(
        states=settings.states,
        sample_hz=sample_hz,
        constants=settings.constants,
        delay=False if settings.delay == "none" else settings.delay,
        residuals=settings.residuals,
        full_rank=settings.full_rank,
        rigid=settings.rigid,
        integrators=settings.integrators,
        relative_degree=settings.relative_degree,
    )


def _only_continuous(settings: FitSettings) -> str:
    """The options that only a continuous model has, as given; empty for none."""
    asked = {
        "--constants real": settings.constants == "real",
        f"--delay {settings.delay}": settings.delay not in (None, "none"),
        f"--rigid {settings.rigid}": settings.rigid > 0,
        f"--integrators {settings.integrators}": settings.integrators > 0,
        "--residuals": settings.residuals,
        "--relative-degree 2": settings.relative_degree == 2,
    }
    return ", ".join(option for option, is_asked in asked.items() if is_asked)


def _is_sampled(settings: FitSettings, *, reaches: bool) -> bool:
    """Whether to fit a sampled model: as requested, else by the band and the options."""
    _refuse_unlike(settings)
    asked = _only_continuous(settings)
    return reaches and not asked if settings.sampled is None else settings.sampled


def _refuse_unlike(settings: FitSettings) -> None:
    """Raise `ConfigError` for a sampled model with what only a continuous one has."""
    asked = _only_continuous(settings)
    if settings.sampled and asked:
        raise ConfigError(
            f"a sampled model has no {asked}",
            hint="--continuous in place of --sampled, or leave out what only a continuous model has",
        )


def _chosen(settings: FitSettings, last_hz: float, taken: Record, *, of_samples: bool = False) -> list[str]:
    """Warning of a kind of model that was chosen by default, where the lines reach far."""
    if settings.sampled is not None:
        return []
    reach = f"the lines reach {last_hz:g} Hz, past 1/8 of {taken.sample_hz:g} Hz"
    asked = _only_continuous(settings)
    if asked or of_samples:
        if taken.held is not None:
            return []
        why = f" for {asked}" if asked else ""
        return [
            f"a continuous model was chosen{why}, though {reach}: if the inputs were held, it mistakes the "
            "hold for dynamics; give --held if they were, or --continuous if they were band-limited"
        ]
    return [
        f"a sampled model was chosen, as {reach}: it has no delay and fits one by poles; if there is a "
        "delay, use --continuous or end --band earlier"
    ]


def load_periods(
    files: Sequence[str], periods: int | None, named: Columns | None = None
) -> tuple[Record, tuple[str, ...]]:
    """The records together, in whole steady periods where they have any, and remarks on them.

    The number of periods is the one given, otherwise the file's, otherwise that of the input.
    """
    readings = [read_record(path, named) for path in files]
    whole = [check_finite(one.record, str(path)) for one, path in zip(readings, files, strict=True)]
    if periods is not None:
        whole = split_each(whole, periods, files)
    taken = join_records(whole, list(files))
    with reading(*files):
        mended = tuple(f.in_a_line for one in readings for f in one.faults if f.severity != "note")
        if taken.periodic:
            return taken, mended
        found = recognise_excitation(taken)
        if found.period is None or found.periods < FEWEST_PERIODS:
            return taken, (*mended, f"not cut into periods: {found.what}")
        if found.steady_from:
            dying = f"the first {found.steady_from} of its periods contain a transient"
            return taken, (*mended, f"not cut into periods: {found.what}, but {dying}; --periods cuts it")
        cut = cut_periods(taken, found)
        how = f"cut into {cut.u.shape[1]} steady periods of {cut.u.shape[2]} samples: {found.what}"
        return cut, (*mended, how)


def split_each(records: Sequence[Record], periods: int, files: Sequence[str]) -> list[Record]:
    """Each record in whole steady periods; errors name the file."""
    found: list[Record] = []
    for one, file in zip(records, files, strict=True):
        with reading(file):
            found.append(split_periods(one, periods))
    return found


def alike(settings: FitSettings, model: MeasurementModel, covariance: ModelCovariance | None) -> FitSettings:
    """``settings``, with open choices as in ``model``; sampled or continuous as the model is."""
    modes = distinct_poles(model)
    rigid, integrators = rank_of(model.rigid), rank_of(model.integral)
    kind: dict[str, object] = {
        # A residue of full rank has its pole several times, but in the order once.
        "states": int(np.sum(np.where(model.is_pair, 2, 1)[modes])) + 2 * rigid + integrators,
        "full_rank": len(modes) < len(model.poles),
        "rigid": rigid,
        "integrators": integrators,
    }
    if model.hold_s is not None:
        kind["held"] = model.hold_s > 0.0
    if covariance is not None and model.sample_hz is None:
        kind |= _choices(model, covariance.structure)
    default = FitSettings()
    left = {name: value for name, value in kind.items() if getattr(settings, name) == getattr(default, name)}
    return settings.model_copy(update={**left, "sampled": model.sample_hz is not None})


def _choices(model: MeasurementModel, structure: ModelStructure) -> dict[str, object]:
    delay_of = "common" if structure.common_delay else "output" if model.path_delay_s is None else "path"
    return {
        "constants": "real" if structure.real_constants else "complex",
        "delay": delay_of if structure.with_delay else "none",
        "residuals": structure.with_lower,
        "relative_degree": _relative_degree(structure),
    }


def _relative_degree(structure: ModelStructure) -> int | None:
    """None where it is that of the constants, or of residual terms, anyway."""
    if structure.relative_degree_two:
        return 2
    if structure.with_lower or structure.with_direct is not structure.real_constants:
        return None
    return 0 if structure.with_direct else 1
