"""The one entry: a response from a record, by the method that suits it."""

from __future__ import annotations

from middeck.errors import DataError
from middeck.identification.checks import check_record
from middeck.identification.spectra.periods import scatter_of_periods
from middeck.identification.spectra.scatter import ResponseScatter
from middeck.systems.record import Record, RecordStream, stream_record
from middeck.systems.response import FrequencyResponse


def estimate_response(
    record: Record | RecordStream, *, band_hz: tuple[float, float] | None = None
) -> FrequencyResponse:
    """The frequency response of a periodic record, on its excited lines.

    Examples
    --------
    >>> import numpy as np
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


def response_scatter(
    record: Record | RecordStream, *, band_hz: tuple[float, float] | None = None
) -> ResponseScatter:
    """The response with the variance of its noise and its total variance; see `estimate_response`."""
    if isinstance(record, Record):
        check_record(record)
        if not record.periodic:
            raise DataError(
                "the record is not periodic, and a response is estimated from whole periods only",
                hint="excite with a periodic multisine, keep whole steady periods and say how many (--periods)",
            )
        record = stream_record(record)
    return scatter_of_periods(record, band_hz)
