"""Nonlinearity of the article from periodic records: power on lines without excitation.

A multisine on odd lines only, some of them left silent at random, shows a nonlinearity at once (the fast
method: Pintelon and Schoukens 2012, section 4.3.1). Even powers of the signal fall on even lines, odd powers
on odd lines, excited or silent, and noise is what differs between periods. Several realisations of the phases
give the same level without silent lines (the robust method): it is ``distortion`` of `response_scatter`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import DataError
from middeck.identification.spectra import periods
from middeck.identification.spectra.averages import checked_stream
from middeck.identification.spectra.excited_lines import in_band, refuse_silence
from middeck.signals.ports import Port
from middeck.signals.record import Record, RecordStream
from middeck.values import record as frozen


@frozen(kw_only=True)
class Distortion:
    """Output power line by line, averaged over experiments: of excitation, distortion and noise.

    Attributes:
        kind: 1 for an excited line, 3 for a silent odd one and 2 for an even one: the lowest power of the
            input that gets there.
        power: Mean square of the output on the line, 2 |Y|^2 / N^2 [unit^2]; on silent lines less the
            response to what input is measured there.
        noise: The part of it that noise explains, from the scatter over periods; None with one period.
    """

    frequency_hz: Float[np.ndarray, " line"]
    kind: Int[np.ndarray, " line"]
    power: Float[np.ndarray, "line output"]
    noise: Float[np.ndarray, "line output"] | None
    outputs: tuple[Port, ...]

    def level(self, kind: int) -> Float[np.ndarray, " output"]:
        """Mean power of the lines of a kind, noise taken off: 1 linear response, 2 even, 3 odd distortion."""
        here = self.kind == kind
        if not here.any():
            name = {1: "excited", 2: "silent even", 3: "silent odd"}[kind]
            raise DataError(
                f"no {name} line in the band", hint="an odd random multisine, with silent lines among the odd"
            )
        power = self.power[here].mean(axis=0)
        return power if self.noise is None else np.maximum(power - self.noise[here].mean(axis=0), 0.0)


def estimate_distortion(record: Record | RecordStream) -> Distortion:
    """Levels of response, even and odd distortion and noise between the lowest and highest excited line.

    Args:
        record: Whole steady periods of a multisine that leaves lines silent; of several experiments with the
            same lines the powers are averaged.

    Raises `DataError` if the record is not periodic, or leaves no line silent.
    """
    stream = checked_stream(record)
    if stream.period is None:
        raise DataError(
            "distortion shows on silent lines of periodic records only", hint="an odd random multisine"
        )
    moments = periods.period_moments(stream)
    excited = periods.designed_lines(moments) & in_band(moments.frequency_hz, None)
    refuse_silence(excited, None)
    first, last = np.flatnonzero(excited)[[0, -1]]
    lines = np.arange(first, last + 1)
    if (np.flatnonzero(excited) % 2 == 0).any():
        raise DataError(
            "even lines are excited: distortion hides below the response, and even looks like odd",
            hint="an odd random multisine, or several realisations and `response_scatter(...).distortion`",
        )
    kind = np.where(excited[lines], 1, np.where(lines % 2 == 1, 3, 2))
    scale = 2.0 / stream.period**2
    left = periods.silent_outputs(moments, excited, lines)
    Y = np.where(excited[lines][:, None, None], moments.mean[lines][:, :, moments.inputs :], left)
    return Distortion(
        frequency_hz=moments.frequency_hz[lines],
        kind=kind,
        power=scale * np.mean(np.abs(Y) ** 2, axis=1),
        noise=_noise(moments, lines, scale),
        outputs=stream.outputs,
    )


def _noise(moments: periods.PeriodMoments, lines: np.ndarray, scale: float) -> np.ndarray | None:
    if moments.periods < 2:
        return None
    outputs = np.real(np.linalg.diagonal(moments.scatter[lines]))[:, moments.inputs :]
    return scale * outputs / (moments.mean.shape[1] * (moments.periods - 1) * moments.periods)
