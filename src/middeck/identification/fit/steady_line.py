"""A sine in the outputs that no input makes, by its name."""

from __future__ import annotations

from middeck.values import record

# Mains are held within so much of their frequency, in any grid that a test hall is likely to be on.
MAINS_HZ, MAINS_WITHIN = (50.0, 60.0), 0.005


@record
class SteadyLine:
    """A sine that goes on through the record, not made by its inputs.

    Parameters
    ----------
    hz:
        Its frequency.
    deviation_hz:
        Standard deviation of that.
    name:
        "mains 50 Hz", "harmonic 3 of mains 50 Hz", or "steady line".
    """

    hz: float
    deviation_hz: float
    name: str


def name_line(hz: float, deviation_hz: float) -> str:
    """By the mains and its harmonics, within half a per cent.

    >>> name_line(150.2, 0.01), name_line(43.0, 0.01), name_line(59.98, 0.01)
    ('harmonic 3 of mains 50 Hz', 'steady line', 'mains 60 Hz')
    """
    for mains in MAINS_HZ:
        order = max(round(hz / mains), 1)
        if abs(hz - order * mains) <= MAINS_WITHIN * order * mains + deviation_hz:
            return f"mains {mains:g} Hz" if order == 1 else f"harmonic {order} of mains {mains:g} Hz"
    return "steady line"
