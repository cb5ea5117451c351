"""The one entry: a response from a record, by the method that suits it."""

import dataclasses
import warnings
from typing import Literal, get_args

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, DataError
from middeck.identification.faults.detect import biasing_faults, clipped_channels
from middeck.identification.faults.unlike_experiments import find_unlike_experiments
from middeck.identification.model.refused_data import check_record
from middeck.identification.spectra import response_under_feedback
from middeck.identification.spectra.averages import estimate_spectra
from middeck.identification.spectra.change_over_periods import warnings_on_change
from middeck.identification.spectra.excess_variance import INDEPENDENT
from middeck.identification.spectra.h1_h2_hv import spectra_response
from middeck.identification.spectra.local_models import scatter_of_local_models
from middeck.identification.spectra.periods import excited_lines, period_moments, scatter_of_periods
from middeck.identification.spectra.start_up import steadied
from middeck.identification.spectra.variance_of_lines import ResponseScatter, trusted
from middeck.signals.excitation.driven_band import floor_variance
from middeck.signals.excitation.recognition import recognise_excitation
from middeck.signals.excitation.repetition import blocks_of
from middeck.signals.record import Record, RecordStream, stream_record
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import require_kind

# A run is read as periods if it has so many, and its inputs differ between them by no more than this share.
FEWEST_PERIODS, REPEATED = 2, 0.01
# Deviations of a gain common to all lines by which noise of an input may change it before a warning.
MOVED = 2.0

Method = Literal["periods", "local polynomial", "local rational", "h1", "h2", "hv"]


@named_kinds
def estimate_response(
    record: Record | RecordStream,
    *,
    band_hz: tuple[float, float] | None = None,
    method: Method | None = None,
    reference: response_under_feedback.Reference | None = None,
    controller: response_under_feedback.Controller | None = None,
    segment: int | None = None,
) -> FrequencyResponse:
    """The frequency response of a record, on its excited lines.

    Args:
        record: Whole steady periods, or any other record; several experiments are used together. A record
            longer than memory (`RecordStream`) is read in pieces by every method; local models hold the lines
            of ``band_hz``, all others a period or some segments.
        band_hz: Lowest and highest frequency to keep; all excited lines above zero by default.
        method:
            - ``"periods"``: period averages, without leakage and window. The default for periodic records; it
              takes as many independent experiments as inputs.
            - ``"local rational"``: smooth models of response and transient around each line, with a
              denominator where it predicts better; no leakage, no window. The default for all others.
            - ``"local polynomial"``: the same without denominators: linear in the data, but resonances
              narrower than some ten lines are rounded off.
            - ``"h1"``, ``"h2"``, ``"hv"``: of averaged spectra (`spectra_response`); for pictures. Welch's
              windows put 10 to 40 % on 1 % damping; whole periods have none.
        reference: Channels of a closed-loop record that no noise of the loop gets into, by name, or their
            samples [experiment, period, sample, reference]. The response is that of the plant, from the
            inputs that are left to the outputs that are left.
        controller: Instead: K with u = r + K y, as it ran, from all outputs to all inputs.
        segment: Samples of Welch's segments.

    The response's ``variance`` is the one for a weighted fit, which takes lines as independent: the total
    variance (noise and nonlinear distortion, no less than the noise) where it is known, otherwise the noise
    variance (over periods), otherwise None; ``covariance`` belongs to it. Neighbouring lines of local models
    share data and err together: their variance is that of a line's own data, larger than the error of the
    response, which is in `response_scatter` with its degrees of freedom. The response has the hold of the
    record's inputs in it (``hold_s``); where the record does not say, and the inputs are commands, a fit
    tests it (``perhaps_held_s``).

    Faults that bias all lines alike (samples lost, runs joined, feedback, a long delay, experiments that
    contradict each other, a gain or a delay that changes over the periods) and noise of the inputs are warned
    of: the response keeps these ``warnings``, and a fit of it repeats them. Transients that were taken out
    are warned of, too; the variance counts what they leave.

    Raises `DataError` if a channel is constant or not finite, no line in the band is excited, the inputs
    cannot be distinguished, or the record is too short or too long for the method; `ConfigError` for a
    method, reference or controller that does not fit the record.

    >>> import numpy as np
    >>> from middeck.signals.ports import Port
    >>> u = np.random.default_rng(0).standard_normal((1, 2, 64, 1))
    >>> u[:, 1] = u[:, 0]                                   # two periods of one signal
    >>> y = 2.0 * np.roll(u, 1, axis=2)                     # a gain of two, one sample late
    >>> G = estimate_response(Record(sample_hz=64.0, u=u, y=y, inputs=(Port("u", "V"),), outputs=(Port("y",
    ...     "m"),), periodic=True))
    >>> quarter = G.H[15, 0, 0]                             # at 16 Hz, a quarter of the sampling rate
    >>> round(float(abs(quarter)), 9), round(float(np.angle(quarter, deg=True)), 9)
    (2.0, -90.0)
    """
    require_kind(record, Record | RecordStream, "record", "load_record(path)")
    found = response_scatter(
        record, band_hz=band_hz, method=method, reference=reference, controller=controller, segment=segment
    )
    variance, covariance = trusted(found)
    smoothed = method in ("h1", "h2", "hv")
    hold_s = None if record.held is None else 1.0 / record.sample_hz if record.held else 0.0
    inputs, outputs = response_under_feedback.plant_ports(record, reference)
    faults: list[str] = []
    if isinstance(record, Record) and reference is None and controller is None and variance is not None:
        faults = [*_biasing_faults(record), *_noise_of_inputs(record, found, variance), *found.changes]
    for what in faults:
        warnings.warn(what, UserWarning, stacklevel=3)
    return FrequencyResponse(
        frequency_hz=found.frequency_hz,
        H=found.H,
        inputs=inputs,
        outputs=outputs,
        variance=variance,
        covariance=covariance,
        hold_s=hold_s,
        perhaps_held_s=1.0 / record.sample_hz if found.commanded and record.held is None else None,
        alike=None if smoothed or found.line_inverse_power is not None else INDEPENDENT,
        warnings=tuple(faults),
    )


def response_scatter(
    record: Record | RecordStream,
    *,
    band_hz: tuple[float, float] | None = None,
    method: Method | None = None,
    reference: response_under_feedback.Reference | None = None,
    controller: response_under_feedback.Controller | None = None,
    segment: int | None = None,
) -> ResponseScatter:
    """The response with its noise and total variance and their covariances; see `estimate_response`."""
    if isinstance(record, Record):
        check_record(record)
    if reference is None and controller is None:
        return _scatter(record, band_hz, method, segment)
    if reference is not None and controller is not None:
        raise ConfigError(
            "reference and controller are both given", hint="one of them; the reference if known"
        )
    _, outputs = response_under_feedback.plant_ports(record, reference)
    joint = _from_reference(record, reference, controller)
    return response_under_feedback.plant_scatter(_scatter(joint, band_hz, method, segment), len(outputs))


def _biasing_faults(record: Record) -> list[str]:
    """Faults that bias all lines alike; periods show by their scatter what does not repeat."""
    # Scale samples of any size by powers of two, which leave the digits as they are.
    u, y = (
        np.ldexp(x, -np.frexp(np.abs(x).max(axis=(0, 1, 2), initial=0.0))[1]) for x in (record.u, record.y)
    )
    sized = dataclasses.replace(record, u=u, y=y)
    if record.periodic:
        repeating = clipped_channels(sized) + find_unlike_experiments(sized)
        return [fault.in_a_line for fault in repeating]
    found, run = biasing_faults(sized), as_periods(sized)
    if run.periodic and not any(fault.kind == "unlike" for fault in found):
        found += find_unlike_experiments(run)
    return [fault.in_a_line for fault in found]


def _noise_of_inputs(record: Record, found: ResponseScatter, variance: np.ndarray) -> list[str]:
    """Inputs whose noise makes the response of local models too small, more than its lines scatter."""
    R, left = found.line_inverse_power, found.total_covariance
    if R is None or left is None:
        return []
    experiments, samples = len(record.u), record.u.shape[1] * record.u.shape[2]
    floor = samples * floor_variance(record.u.reshape(experiments, samples, -1))
    size = np.abs(found.H) ** 2
    heard, left = np.einsum("koi,i->o", size, floor), np.einsum("koo->o", np.real(left))
    room = float(np.min(np.divide(left, heard, out=np.ones_like(left), where=heard > left)))
    # Noise of the estimate over its power, a mean over the lines with the best known response.
    power = 1.0 / np.real(np.einsum("kii->ki", R))
    known = np.sum(size / variance, axis=1)
    low = room * experiments * floor * np.sum(known, axis=0) / np.sum(known * power, axis=0)
    return [
        f"input {port.name}: noise of its samples makes the response {share:.1%} too small, {times:.0f} "
        "times what all its lines scatter together, and no variance counts it; take the command, or a signal "
        "that repeats"
        for port, share, times in zip(record.inputs, low, low * np.sqrt(2.0 * known.sum(axis=0)), strict=True)
        if times > MOVED
    ]


def _from_reference(
    record: Record | RecordStream,
    reference: response_under_feedback.Reference | None,
    controller: response_under_feedback.Controller | None,
) -> Record | RecordStream:
    if reference is not None and not isinstance(reference, np.ndarray):
        return response_under_feedback.from_channels(record, [str(name) for name in reference])
    if isinstance(record, RecordStream):
        raise ConfigError(
            "a record longer than memory takes references by name only", hint="record the reference with it"
        )
    joint = (
        response_under_feedback.from_controller(record, controller)
        if controller is not None
        else response_under_feedback.from_signal(record, np.asarray(reference, dtype=float))
    )
    check_record(joint)
    return joint


def _scatter(
    record: Record | RecordStream,
    band_hz: tuple[float, float] | None,
    method: Method | None,
    segment: int | None,
) -> ResponseScatter:
    periodic = record.period is not None if isinstance(record, RecordStream) else record.periodic
    if isinstance(record, Record) and method in (None, "periods"):
        record = record if periodic or method else as_periods(record)
        if record.periodic:
            return _scatter_of_run(record, band_hz)
    method = method or ("periods" if periodic else "local rational")
    if method == "periods":
        if not periodic:
            raise DataError(
                "the record is not periodic: it has no whole periods to average",
                hint="say how many periods it has, split_periods(record, periods), or use the local models",
            )
        return scatter_of_periods(_stream(record), band_hz)
    if method not in get_args(Method):
        raise ConfigError(f"no method {method!r}", hint=", ".join(get_args(Method)))
    if method in ("local polynomial", "local rational"):
        excited = excited_lines(period_moments(_stream(record))) if periodic else None
        return scatter_of_local_models(record, band_hz, rational=method == "local rational", excited=excited)
    spectra = estimate_spectra(record, segment=segment)
    if not periodic:
        return spectra_response(spectra, method, band_hz=band_hz)
    # Only periods show which lines of a measured input are noise, and what of the scatter repeats.
    found = scatter_of_periods(_stream(record), band_hz)
    excited = np.isin(spectra.frequency_hz, found.frequency_hz)
    found = dataclasses.replace(found, H=spectra_response(spectra, method, excited=excited).H)
    changes = warnings_on_change(record, found) if isinstance(record, Record) else []
    return dataclasses.replace(found, changes=tuple(changes))


def as_periods(record: Record) -> Record:
    """A run as all periods that its inputs show, its beginning included; itself where they do not repeat."""
    found = recognise_excitation(record)
    if found.period is None or found.periods < FEWEST_PERIODS or not (found.scatter or 0.0) < REPEATED:
        return record
    u, y = (blocks_of(x.reshape(len(x), -1, x.shape[3]), found.period, 1) for x in (record.u, record.y))
    return dataclasses.replace(record, u=u, y=y, periodic=True)


def _scatter_of_run(record: Record, band_hz: tuple[float, float] | None) -> ResponseScatter:
    """Scatter from whole periods, without the transient at their beginning; reports how."""
    started = steadied(record)
    if started.what:
        warnings.warn(started.what, UserWarning, stacklevel=6)
    found = scatter_of_periods(_stream(started.record), band_hz, started)
    found = dataclasses.replace(found, warnings=(started.what,) if started.what else ())
    # What is left of free motion is as often in quadrature to the response as in phase, and is no change.
    return dataclasses.replace(found, changes=tuple(warnings_on_change(started.record, found)))


def _stream(record: Record | RecordStream) -> RecordStream:
    return stream_record(record) if isinstance(record, Record) else record
