"""The table under Figure 6."""

from __future__ import annotations

from middeck.plot.ports import port_words
from middeck.study.words import Numbers, Table, fixed


def response_tables(figures: Numbers) -> list[Table]:
    """Magnitude errors and the delay that explains the phase."""
    numbers = figures["figure_6"]
    error, gap = numbers["magnitude_error_db"], numbers["phase_gap_s"]
    band = numbers["magnitude_error_band_hz"]
    rows = [
        [
            port_words(name),
            *(fixed(error[side] and error[side][k], 3) for side in ("orbit", "lab")),
            fixed(gap and 1e3 * gap[k], 4),
            fixed(1e3 * numbers["delay_s"], 4),
        ]
        for k, name in enumerate(numbers["outputs"])
    ]
    head = ("output", "0-g error [dB]", "1-g error [dB]", "phase gap as delay [ms]", "rig's delay [ms]")
    where = "" if band is None else f" in {band[0]:g}-{band[1]:g} Hz"
    return [Table(f"Models against the simulated rig, rms of log magnitude{where}", head, rows)]
