"""Frequency responses from periodic records: whole periods, so no leakage and no window."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import DataError
from middeck.identification.checks import check_record
from middeck.systems.record import Record
from middeck.systems.response import FrequencyResponse
from middeck.values import record as frozen

# A line counts as excited when its amplitude exceeds this share of the strongest line (80 dB below it) and
# stands 20 dB above the scatter of the periods: an input that is measured has noise between its lines.
FAINTEST = 1e-4
CLEAR_OF_NOISE = 100.0
# Beyond this the inputs of one line cannot be told apart in double precision and real noise.
WORST_CONDITION = 1e6


@frozen
class ResponseScatter:
    """A measured response with what scatters it.

    Parameters
    ----------
    H:
        Estimate on the excited lines ``frequency_hz``.
    noise:
        Variance of H from the scatter over periods: what does not repeat. None with one period.
    total:
        Variance of H from the scatter over experiments: noise and the part of nonlinear distortion that
        changes with the signal (Pintelon and Schoukens 2012, ch. 4). None without more experiments than
        inputs.

    Both are variances of the complex number: real and imaginary part together.
    """

    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]
    noise: Float[np.ndarray, "line output input"] | None
    total: Float[np.ndarray, "line output input"] | None


def estimate_response(record: Record, *, band_hz: tuple[float, float] | None = None) -> FrequencyResponse:
    """The frequency response of a periodic record, on its excited lines.

    Parameters
    ----------
    record:
        Whole steady periods, at least as many independent experiments as inputs.
    band_hz:
        Lowest and highest frequency to keep; all excited lines above zero by default.

    Returns
    -------
    The response. Its ``variance`` is the one a weighted fit should use: the total variance (noise and
    nonlinear distortion, over experiments) where there are more experiments than inputs, otherwise the
    noise variance (over periods), otherwise None. `response_scatter` returns both.

    Raises
    ------
    DataError
        If the record is not periodic, a channel is constant or not finite, no line in the band is excited,
        or the inputs cannot be told apart.

    Examples
    --------
    >>> from middeck.systems.ports import Port
    >>> u = np.random.default_rng(0).standard_normal((1, 2, 64, 1))
    >>> u[:, 1] = u[:, 0]                                   # two periods of one signal
    >>> y = 2.0 * np.roll(u, 1, axis=2)                     # a gain of two, one sample late
    >>> G = estimate_response(Record(64.0, u, y, (Port("u", "V"),), (Port("y", "m"),), periodic=True))
    >>> quarter = G.H[15, 0, 0]                             # at 16 Hz, a quarter of the sampling rate
    >>> round(float(abs(quarter)), 9), round(float(np.angle(quarter, deg=True)), 9)
    (2.0, -90.0)
    """
    found = response_scatter(record, band_hz=band_hz)
    variance = found.noise if found.total is None else found.total
    return FrequencyResponse(found.frequency_hz, found.H, record.inputs, record.outputs, variance)


def response_scatter(record: Record, *, band_hz: tuple[float, float] | None = None) -> ResponseScatter:
    """The response with the variance of its noise and its total variance; see `estimate_response`."""
    check_record(record)
    if not record.periodic:
        raise DataError(
            "the record is not periodic, and a response is estimated from whole periods only",
            hint="excite with a periodic multisine, keep whole steady periods and say how many (--periods)",
        )
    samples = record.u.shape[2]
    frequency = np.fft.rfftfreq(samples, 1.0 / record.sample_hz)
    U, Y = (np.fft.rfft(x, axis=2).transpose(2, 0, 1, 3) for x in (record.u, record.y))
    keep = _excited(U) & _in_band(frequency, band_hz)
    if not keep.any():
        raise DataError(f"no excited line in the band {band_hz} Hz", hint="a band that the excitation covers")
    H, inverse = _solve(U[keep].mean(axis=2), Y[keep].mean(axis=2), frequency[keep])
    # E is what each period of each experiment leaves: the noise of measured inputs is in it too.
    E = Y[keep] - np.einsum("koi,kepi->kepo", H, U[keep])
    noise, total = _noise_variance(E), _total_variance(E, inputs=H.shape[2])
    return ResponseScatter(
        frequency[keep],
        H,
        None if noise is None else noise[:, :, None] * inverse[:, None, :],
        None if total is None else total[:, :, None] * inverse[:, None, :],
    )


def _in_band(frequency: np.ndarray, band_hz: tuple[float, float] | None) -> np.ndarray:
    low, high = band_hz or (0.0, np.inf)
    # A band edge that is a line belongs to the band, whatever the rounding of the line's frequency.
    slack = 1e-9 * frequency[1]
    # Zero and the Nyquist frequency have no phase.
    inner = (np.arange(len(frequency)) > 0) & (np.arange(len(frequency)) < len(frequency) - 1)
    return inner & (frequency >= low - slack) & (frequency <= high + slack)


def _excited(U: Complex[np.ndarray, "line experiment period input"]) -> np.ndarray:
    mean = U.mean(axis=2)
    power = np.sum(np.abs(mean) ** 2, axis=(1, 2))
    excited = power > FAINTEST**2 * power[1:].max()
    periods = U.shape[2]
    if periods > 1:
        scatter = np.sum(np.abs(U - mean[:, :, None]) ** 2, axis=(1, 2, 3)) / (periods * (periods - 1))
        excited &= power > CLEAR_OF_NOISE * scatter
    return excited


def _solve(
    U: Complex[np.ndarray, "line experiment input"],
    Y: Complex[np.ndarray, "line experiment output"],
    frequency: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """H = Y U^H (U U^H)^-1 per line, and the diagonal of (U U^H)^-1 that scales its variance."""
    experiments, inputs = U.shape[1:]
    if experiments < inputs:
        raise DataError(
            f"{experiments} experiments cannot tell {inputs} inputs apart",
            hint=f"at least {inputs} experiments with independent inputs",
        )
    left, size, right = np.linalg.svd(U, full_matrices=False)
    if (bad := size[:, -1] * WORST_CONDITION <= size[:, 0]).any():
        raise DataError(
            f"the inputs cannot be told apart at {bad.sum()} lines, first at {frequency[bad][0]:.6g} Hz",
            hint="experiments with independent inputs, such as orthogonal multisines",
        )
    pseudo = np.swapaxes(right.conj(), 1, 2) / size[:, None, :] @ np.swapaxes(left.conj(), 1, 2)
    H = np.swapaxes(pseudo @ Y, 1, 2)
    return H, np.sum(np.abs(pseudo) ** 2, axis=2)


def _noise_variance(E: Complex[np.ndarray, "line experiment period output"]) -> np.ndarray | None:
    """Variance of a period average of the output, pooled over experiments."""
    experiments, periods = E.shape[1:3]
    if periods < 2:
        return None
    scatter = np.sum(np.abs(E - E.mean(axis=2, keepdims=True)) ** 2, axis=(1, 2))
    return scatter / (experiments * (periods - 1) * periods)


def _total_variance(
    E: Complex[np.ndarray, "line experiment period output"], inputs: int
) -> np.ndarray | None:
    """Variance of one experiment's averaged output about the common response."""
    experiments = E.shape[1]
    if experiments <= inputs:
        return None
    return np.sum(np.abs(E.mean(axis=2)) ** 2, axis=1) / (experiments - inputs)
