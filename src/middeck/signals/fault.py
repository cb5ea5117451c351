"""A fault of a record, as a value."""

from typing import Literal

from middeck.values import record

Severity = Literal["unusable", "serious", "note"]
Side = Literal["input", "output"]
# More runs than these are counted, not listed.
MOST_RUNS = 100


@record(kw_only=True)
class RecordFault:
    """One fault of one channel of a record.

    Attributes:
        kind: One word: gap, dead, clipping, dropout, spike, offset, drift, quantisation, transient,
            repeat, sign, delay, duplicate, held, gain, swap, shift, joint, feedback, unlike, truncated,
            format, rate.
        severity: ``unusable``: no estimate can be had from the channel; ``serious``: estimates are wrong or
            much worse; ``note``: worth knowing.
        side, channel: Port of the record.
        experiment: Counted from zero; None where all are meant.
        samples: Runs (first, last + 1), counted through the periods of the experiment; the first hundred.
        what, hint: Sentences for people: what was found with its figures, and what to try.
    """

    kind: str
    severity: Severity
    side: Side
    channel: str
    experiment: int | None
    samples: tuple[tuple[int, int], ...]
    what: str
    hint: str

    def __str__(self) -> str:
        place = f"{self.side} {self.channel}"
        if self.experiment is not None:
            place += f", experiment {self.experiment}"
        return f"{place}: {self.what}\n  try: {self.hint}"

    @property
    def in_a_line(self) -> str:
        """The fault and its remedy in one line, for a list of warnings."""
        return str(self).replace("\n  try:", ";")
