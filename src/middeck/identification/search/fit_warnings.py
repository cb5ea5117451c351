"""Warnings of a fit: which of its numbers should not be trusted."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import FitError
from middeck.identification.model.fit_options import is_rate, is_velocity
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    natural_hz,
)
from middeck.identification.start.start import HEAVY, NARROW
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.parameter_deviations import distinct_poles, uncertainty_of
from middeck.systems.plants.response import FrequencyResponse

# A steady record of a test article repeats itself within a few per cent, sensor noise and weak
# nonlinearity included (the mirror's 300 mV: 5 %); a model worth using explains nine tenths.
SCATTER = 0.1
LEFT = 0.1
# Fewer degrees of freedom give an interval of which Student's t is a tenth wider than the normal law.
FEW_DEGREES = 12.0
# Standard deviation over value: from here on the linearised interval reaches zero.
HALF = 0.5
# Squared residual over variance of a line: beyond three standard deviations it is not noise.
ABOVE_NOISE = 9.0
# Squared response over variance of a line that stands out: no noise does by chance, of some thousand lines.
STANDS_OUT = 25.0
# Inflation of a variance by the other unknowns: errors of the model are amplified as much.
CONFOUNDED = 1e4
# Least squares leave no more than the response itself; twice that means that the search has failed.
FAILED = 2.0
# Ratio of frequencies from the band beyond which a pole is none of the article.
FAR = 100.0
# Ratio of frequencies from the band within which a pair below this damping ratio passes for a mode.
BESIDE, LIGHT = 1.1, 0.1
UNDETERMINED = "is not determined by the data"


def warnings_on_record(
    measured: FrequencyResponse, residual: Complex[np.ndarray, "line output input"]
) -> list[str]:
    """Warnings for outputs whose periods or experiments disagree; ``residual`` is E - H of a fit."""
    if measured.variance is None:
        return []
    scatter = _share(measured, residual, measured.variance)
    return [
        f"output {port.name}: the response scatters by {share:.0%} between periods or experiments; is the "
        "record steady, without drift, spikes or dropouts?"
        for port, share in zip(measured.outputs, scatter, strict=True)
        if share > SCATTER
    ]


def _share(
    measured: FrequencyResponse,
    residual: Complex[np.ndarray, "line output input"],
    squares: Float[np.ndarray, "line output input"],
) -> Float[np.ndarray, " output"]:
    """Rms of a part of the response over that of the whole; without lines that are all noise, if less.

    Lines that a sweep hardly excites are most of the rms, and the model is not led by them: each that does
    not stand out of its noise counts for no more than the model's response there. The weights of a fit would
    not do: the peak of a mode that moves while it is measured scatters, and weighs nothing.
    """
    whole = np.abs(measured.H) ** 2
    plain = _ratio(squares, whole)
    if measured.variance is None:
        return np.sqrt(plain)
    clear, modelled = whole > STANDS_OUT * measured.variance, np.abs(measured.H + residual) ** 2
    part = np.where(clear, squares, np.fmin(squares, modelled))
    return np.sqrt(np.fmin(plain, _ratio(part, np.where(clear, whole, modelled))))


def _ratio(
    part: Float[np.ndarray, "line output input"], whole: Float[np.ndarray, "line output input"]
) -> Float[np.ndarray, " output"]:
    return np.sum(part, axis=(0, 2)) / np.sum(whole, axis=(0, 2))


def refuse_failed(measured: FrequencyResponse, error: Float[np.ndarray, " output"]) -> None:
    """Raise `FitError` for a model that is worse than none."""
    if np.any(error > FAILED):
        worst = int(np.argmax(error))
        raise FitError(
            f"the best model found leaves {error[worst]:.0f} times the response itself",
            where=f"output {measured.outputs[worst].name}",
            hint="ask for more states, or for a band without half a mode at its edge",
        )


def warnings_on_model(
    measured: FrequencyResponse,
    error: Float[np.ndarray, " output"],
    model_error: float,
    residual: Complex[np.ndarray, "line output input"],
) -> list[str]:
    """Warnings for outputs that the model does not explain, or errors that deviations do not cover.

    ``model_error`` is the share of the assumed variance that is not noise; ``residual`` is E - H. Raises
    `FitError` for a model that is worse than none.
    """
    refuse_failed(measured, error)
    poor = [
        f"output {port.name}: the model leaves {left:.0%} of the response unexplained; its parameters mean "
        "little. Look at the record, the band and the order"
        for port, left in zip(
            measured.outputs, _share(measured, residual, np.abs(residual) ** 2), strict=True
        )
        if left > LEFT
    ]
    if poor or model_error <= 0.5 or measured.variance is None:
        return poor
    of_rms = 100.0 * np.sqrt(np.mean(error**2))
    return [
        f"most of the residual is not noise but modes that the model lacks: it is {of_rms:.2g}% of the "
        f"response's rms over the band{_wrong_lines(measured, residual)}; the standard deviations include "
        "this residual, but not a bias that is common to all lines"
    ]


def _wrong_lines(measured: FrequencyResponse, residual: Complex[np.ndarray, "line output input"]) -> str:
    """Lines where a small part of the rms is most of the line, and more than its noise."""
    assert measured.variance is not None
    left = np.abs(residual) ** 2
    above = (left > HALF**2 * np.abs(measured.H) ** 2) & (left > ABOVE_NOISE * measured.variance)
    wrong = np.any(above, axis=(1, 2))
    if not wrong.any():
        return ""
    first, last = measured.frequency_hz[wrong][[0, -1]]
    return (
        f", and exceeds half of the response on {wrong.sum()} of {len(wrong)} frequency lines, "
        f"{first:.4g}-{last:.4g} Hz"
    )


def warnings_on_deviations(
    measured: FrequencyResponse, covariance: ModelCovariance, *, of_samples: bool = False
) -> list[str]:
    """Warnings for standard deviations that are too small or poorly known.

    ``of_samples``: the samples of a record were fitted, with their transient. A mode narrower than the
    spacing of the lines then shows in all samples.
    """
    return [
        *_warnings_on_variance(measured, covariance),
        *list(confounded_delays(measured, covariance).values()),
        *_warnings_on_modes(measured, covariance, of_samples=of_samples),
    ]


def _warnings_on_variance(measured: FrequencyResponse, covariance: ModelCovariance) -> list[str]:
    if measured.variance is None:
        return [
            "the record has one period, in which noise and errors of the model cannot be separated: the "
            "standard deviations follow from the residual"
        ]
    # Blows under a window are few, and their scatter counts beside that of lines.
    if covariance.degrees < FEW_DEGREES and (measured.alike or 1.0) == 1.0:
        return [
            f"the noise, and with it every standard deviation, is estimated with {covariance.degrees:.0f} "
            "degrees of freedom only; record more periods"
        ]
    return []


def confounded_delays(measured: FrequencyResponse, covariance: ModelCovariance) -> dict[int, str]:
    """Outputs whose delay is confounded or biased, with a warning each."""
    at, structure = covariance.at, covariance.structure
    found: dict[int, str] = {}
    standing = _stands_for_phase(measured, covariance.model)
    unknown = np.isinf(uncertainty_of(covariance).delay_s)
    for o in np.flatnonzero(at.delay >= 0):
        port, inflation = covariance.model.outputs[o], covariance.inflation[at.delay[o]]
        name, delay_ms = port.name, 1e3 * covariance.model.delay_s[o]
        if unknown[o] or inflation > CONFOUNDED:
            loose = f"its standard deviation is {np.sqrt(inflation):.0f} times that with known residues"
            found[int(o)] = (
                f"output {name}: the delay is confounded with the residues, only their sum is certain: "
                f"{f'it {UNDETERMINED}' if unknown[o] else loose}; fit real constants, or no delay"
            )
        elif structure.with_direct and not structure.real_constants and is_velocity(port):
            found[int(o)] = (
                f"output {name}: the standard deviation of the delay of {delay_ms:.4g} ms is too small: "
                "only the constant term separates it from the residues, and modes outside the band add to "
                "that term; fit velocities separately, with --delay output --relative-degree 1"
            )
        elif standing:
            found[int(o)] = (
                f"output {name}: the standard deviation of the delay of {delay_ms:.4g} ms is too small: "
                "the band is narrow, and poles outside it that are not modes represent phase too; take a "
                "wider band"
            )
    return found


def _stands_for_phase(measured: FrequencyResponse, model: MeasurementModel) -> bool:
    """Whether a narrow band has heavily damped or far poles outside, whose phase in it is like a delay's."""
    f, zeta, lines = natural_hz(model), damping_ratio(model), measured.frequency_hz
    outside = (f < lines[0]) | (f > lines[-1])
    far = (f < lines[0] / FAR) | (f > FAR * lines[-1])
    return is_narrow(measured) and bool(np.any(outside & (far | (zeta > HEAVY))))


def is_narrow(measured: FrequencyResponse) -> bool:
    """Whether the band is so narrow that delays half a period apart differ in it by little but a sign."""
    return bool(measured.frequency_hz[-1] < NARROW * measured.frequency_hz[0])


def _warnings_on_modes(
    measured: FrequencyResponse, covariance: ModelCovariance, *, of_samples: bool
) -> list[str]:
    """Modes in rising frequency; those outside the band together in one sentence."""
    f = natural_hz(covariance.model)
    of = uncertainty_of(covariance)
    lines = measured.frequency_hz
    poles = sorted(distinct_poles(covariance.model), key=lambda m: f[m])
    unknown = [m for m in poles if of.natural_hz[m] > HALF * f[m]]
    beyond = _beyond(measured, covariance.model)
    terms = _has_pairs_for_terms(covariance)
    told = [m for m in beyond if not terms or _passes_for_a_mode(measured, covariance.model, m)]
    found = [
        f"mode at {f[m]:.4g} Hz: its frequency {_loose(of.natural_hz[m], f'{of.natural_hz[m]:.3g} Hz')}"
        for m in unknown
        if m not in beyond
    ]
    if told:
        places = ", ".join(f"{f[m]:.4g}" for m in told)
        one = len(told) == 1
        found.append(
            f"mode{'' if one else 's'} at {places} Hz: {'it lies' if one else 'they lie'} outside the band "
            f"{lines[0]:.4g}-{lines[-1]:.4g} Hz, and represent{'s' if one else ''} all modes beyond it"
            f"{_lost([f[m] for m in told if np.isinf(of.natural_hz[m])], len(told))}"
        )
    within = [m for m in poles if covariance.model.is_pair[m] and m not in beyond and m not in unknown]
    for m in within:
        found += _warnings_on_damping(measured, covariance, m, of_samples=of_samples)
    return found


def _beyond(measured: FrequencyResponse, model: MeasurementModel) -> list[int]:
    """Poles outside the band, in rising frequency; of a sampled model pairs only."""
    f, lines = natural_hz(model), measured.frequency_hz
    may = model.is_pair | (model.sample_hz is None)
    beyond = [m for m in distinct_poles(model) if may[m] and not lines[0] <= f[m] <= lines[-1]]
    return sorted(beyond, key=lambda m: f[m])


def _passes_for_a_mode(measured: FrequencyResponse, model: MeasurementModel, m: int) -> bool:
    """Whether a pair outside the band is so near and so lightly damped that it is read as a mode.

    It stands for the modes further away, too, which its deviations do not count.
    """
    f, lines = natural_hz(model)[m], measured.frequency_hz
    near = lines[0] / BESIDE <= f <= BESIDE * lines[-1]
    return bool(near and damping_ratio(model)[m] < LIGHT)


def _has_pairs_for_terms(covariance: ModelCovariance) -> bool:
    """Whether a pair outside the band is the term for the modes there, and shares no phase with a delay.

    Modes above the band add s^2 to the response of an acceleration, s to that of a velocity: no model has
    these terms but as a pair, as every test with accelerometers asks for.
    """
    model, structure = covariance.model, covariance.structure
    free = structure.with_delay or structure.real_constants or model.sample_hz is not None
    return not free and structure.with_direct and all(is_rate(port) for port in model.outputs)


def words_on_terms_beyond(measured: FrequencyResponse, covariance: ModelCovariance) -> str:
    """Words for the reason of an order: poles of a fit of rates that are terms for modes beyond the band."""
    beyond = _beyond(measured, covariance.model) if _has_pairs_for_terms(covariance) else []
    if not beyond:
        return ""
    f, lines = natural_hz(covariance.model), measured.frequency_hz
    return (
        f"; poles outside the band {lines[0]:.4g}-{lines[-1]:.4g} Hz stand for all modes beyond it: "
        f"{', '.join(f'{f[m]:.4g}' for m in beyond)} Hz"
    )


def _lost(hz: list[float], beyond: int) -> str:
    """Modes outside the band, ``beyond`` in number, that the data do not determine."""
    if not hz:
        return ""
    if len(hz) == beyond:
        return f"; the data do not determine {'it' if beyond == 1 else 'them'}"
    places = ", ".join(f"{f:.4g}" for f in hz)
    return f"; the data do not determine {'that' if len(hz) == 1 else 'those'} at {places} Hz"


def _warnings_on_damping(
    measured: FrequencyResponse, covariance: ModelCovariance, m: int, *, of_samples: bool
) -> list[str]:
    """Warnings for one mode within the band."""
    f, zeta = natural_hz(covariance.model)[m], damping_ratio(covariance.model)[m]
    lines, deviation = measured.frequency_hz, uncertainty_of(covariance).damping[m]
    mode, found = f"mode at {f:.4g} Hz", list[str]()
    near = np.clip(np.searchsorted(lines, f), 1, max(len(lines) - 1, 1))
    spacing, width = lines[near] - lines[near - 1], 2.0 * zeta * f
    if width < spacing and not of_samples:
        found.append(
            f"{mode}: its half-power width is {width:.3g} Hz, the lines are {spacing:.3g} Hz apart: one "
            "or two lines determine its frequency and damping; use a longer period"
        )
    if deviation > HALF * zeta:
        found.append(f"{mode}: its damping of {zeta:.2%} {_loose(deviation, f'{deviation:.2%}')}")
    return found


def _loose(deviation: float, words: str) -> str:
    """Words for a number with a large standard deviation, or with none."""
    return f"has a standard deviation of {words}: not known" if np.isfinite(deviation) else UNDETERMINED
