"""Responses and anti-resonances that a test measured beside its modes, with their uncertainty."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.identification.spectra.excess_variance import NEIGHBOURS, by_output, line_degrees, spread_of
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Lines are no nearer than this part of their frequency: nearer ones show the same model error.
SPACING = 0.005
# Relative noise of a response beyond which a line has no useful logarithm.
NOISY = 0.3
WHERE = "response of a survey"


@record(kw_only=True)
class AntiResonance:
    """A zero of one path between its modes, at |s| = 2 pi ``frequency_hz``, and its standard deviation."""

    output: str
    input: str
    frequency_hz: float
    std_hz: float

    def __post_init__(self) -> None:
        if not (0.0 < self.frequency_hz < np.inf and 0.0 < self.std_hz < np.inf):
            raise ConfigError(
                f"an anti-resonance at {self.frequency_hz} Hz +- {self.std_hz} Hz",
                where=f"{self.input} to {self.output}",
                hint="both positive",
            )


@record(kw_only=True)
class MeasuredResponse:
    """Responses that a test measured beside its modes, between actuators and sensors of the article.

    Attributes:
        response: Measured, with its ``variance``, or the covariance of a fitted model, whose lines err
            together; ports are named as the article's.
        delay_s: Delay of every path, as far as it is known.
        band_hz: Lines that count; None for all of a measured response.
        modal_error: Assumed relative standard deviation of the errors of the model's modal constants.
        line_error: Further error of each mode's part at each line.

    Raises `ConfigError` for nothing measured, a response without variance, a fitted one without a band, an
    error or a band that cannot be, and for a path of which the response and anti-resonances are given: the
    one holds the other.
    """

    response: FrequencyResponse | ModelCovariance | None = None
    anti_resonances: tuple[AntiResonance, ...] = ()
    delay_s: float = 0.0
    band_hz: tuple[float, float] | None = None
    modal_error: float = 0.02
    line_error: float = 0.002

    def __post_init__(self) -> None:
        for what, hint in self._faults():
            raise ConfigError(what, where=WHERE, hint=hint)

    def _faults(self) -> Iterator[tuple[str, str]]:
        errors = (self.delay_s, self.modal_error, self.line_error)
        if not all(0.0 <= e < np.inf for e in errors) or not self.line_error > 0.0:
            what = f"a delay of {self.delay_s} s, errors of {self.modal_error} and {self.line_error}"
            yield what, "zero or positive, the error of a line above zero"
        if self.band_hz is not None and not 0.0 <= self.band_hz[0] < self.band_hz[1] < np.inf:
            yield f"a band of {self.band_hz} Hz", "low < high"
        if self.response is None and not self.anti_resonances:
            yield "nothing measured", "a response, or anti-resonances"
        if isinstance(self.response, FrequencyResponse):
            if self.response.variance is None:
                what = "the response does not state how well it is known"
                yield what, "its variance, as `estimate_response` gives it"
            if self.response.hold_s:
                yield "the response includes the hold of its inputs", "`release_hold`"
        if isinstance(self.response, ModelCovariance) and not (self.band_hz and self.band_hz[0] > 0.0):
            yield "a fitted response without its band", "band_hz, from above 0"
        for zero in self.anti_resonances:
            if (zero.output, zero.input) in self._measured_pairs:
                what = f"the response from {zero.input} to {zero.output} is given"
                yield f"{what}, its anti-resonances again", "either"

    @property
    def _measured_pairs(self) -> list[tuple[str, str]]:
        """Output and input of each path of the response."""
        if self.response is None:
            return []
        of = self.response.model if isinstance(self.response, ModelCovariance) else self.response
        return [(o.name, i.name) for o in of.outputs for i in of.inputs]

    @property
    def ports(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of inputs and outputs, each once."""
        paths = [*self._measured_pairs, *((z.output, z.input) for z in self.anti_resonances)]
        return tuple(dict.fromkeys(i for _, i in paths)), tuple(dict.fromkeys(o for o, _ in paths))

    @property
    def top_hz(self) -> float:
        """Highest frequency [Hz] that counts."""
        ends = [z.frequency_hz for z in self.anti_resonances]
        if self.band_hz is not None:
            ends.append(self.band_hz[1])
        elif isinstance(self.response, FrequencyResponse):
            ends.append(float(self.response.frequency_hz[-1]))
        return max(ends)


@record(kw_only=True)
class MeasuredPath:
    """One path of a response on the lines that count.

    Attributes:
        noise: Standard deviation of H, real and imaginary part together, each line by itself.
        common: What errors that lines and paths share do to H, one deviation each.
    """

    output: str
    input: str
    hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, " line"]
    noise: Float[np.ndarray, " line"]
    common: Complex[np.ndarray, "line common"]


def measured_paths(test: MeasuredResponse) -> tuple[MeasuredPath, ...]:
    """Every path of the response, lines that are mostly noise left out."""
    if test.response is None:
        return ()
    if isinstance(test.response, ModelCovariance):
        return tuple(_without_noisy_lines(path) for path in _fitted(test, test.response))
    return tuple(_without_noisy_lines(path) for path in _measured(test, test.response))


def _measured(test: MeasuredResponse, response: FrequencyResponse) -> list[MeasuredPath]:
    lines, variance = _lines(response.frequency_hz, test.band_hz), _known_variance(response)
    return [
        MeasuredPath(
            output=output.name,
            input=input.name,
            hz=response.frequency_hz[lines],
            H=response.H[lines, o, i],
            noise=np.sqrt(variance[lines, o, i]),
            common=np.zeros((len(lines), 0), complex),
        )
        for o, output in enumerate(response.outputs)
        for i, input in enumerate(response.inputs)
    ]


def _known_variance(response: FrequencyResponse) -> Float[np.ndarray, "line output input"]:
    """Averaged over neighbours where few periods estimate it: a line that was quiet by chance would rule."""
    assert response.variance is not None
    if line_degrees(response) >= 2 * NEIGHBOURS + 1:
        return response.variance
    return by_output(spread_of(response, relative=False).variance)


def _fitted(test: MeasuredResponse, known: ModelCovariance) -> list[MeasuredPath]:
    """Lines of even spacing in logarithms, whose errors are those of the fit's unknowns."""
    assert test.band_hz is not None
    low, high = test.band_hz
    hz = np.geomspace(low, high, 2 + int(np.log(high / low) / SPACING))
    found: list[MeasuredPath] = []
    for o, output in enumerate(known.model.outputs):
        for i, input in enumerate(known.model.inputs):
            entry = entry_slopes(known.model, known.structure, 2j * np.pi * hz, o, i)
            found.append(
                MeasuredPath(
                    output=output.name,
                    input=input.name,
                    hz=hz,
                    H=entry.H,
                    noise=np.zeros(len(hz)),
                    common=entry.by.T @ known.root[entry.place],
                )
            )
    return found


def _without_noisy_lines(path: MeasuredPath) -> MeasuredPath:
    off = np.hypot(path.noise, np.linalg.norm(path.common, axis=1))
    clear = np.isfinite(path.H) & np.isfinite(off) & (off < NOISY * np.abs(path.H))
    rows = {name: getattr(path, name)[clear] for name in ("hz", "H", "noise", "common")}
    return dataclasses.replace(path, **rows)


def _lines(hz: Float[np.ndarray, " line"], band_hz: tuple[float, float] | None) -> np.ndarray:
    """Lines in the band, no nearer than `SPACING`."""
    low, high = band_hz or (0.0, np.inf)
    kept: list[int] = []
    for k in np.flatnonzero((hz >= low) & (hz <= high) & (hz > 0.0)).tolist():
        if not kept or hz[k] >= hz[kept[-1]] * (1.0 + SPACING):
            kept.append(k)
    return np.array(kept, dtype=int)
