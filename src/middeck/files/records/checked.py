"""Checks of every record, whatever file it comes from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.errors import DataError
from middeck.signals.ports import Port
from middeck.signals.record import Record


def check_channels(sample_hz: float, inputs: Sequence[Port], outputs: Sequence[Port], where: str) -> None:
    """Refuse records without channels on a side, with two of one name, or without a rate."""
    for side, ports in (("input", inputs), ("output", outputs)):
        if not ports:
            hint = 'name both: name_columns(["torque [N m]"], ["angle [rad]"])'
            raise DataError(f"no {side} channels", where=where, hint=hint)
        names = [p.name for p in ports]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise DataError(f"two channels are named {twice[0]!r}", where=where, hint="rename one of them")
    if not (np.isfinite(sample_hz) and sample_hz > 0.0):
        raise DataError(f"sample_hz is {sample_hz}; must be > 0 Hz", where=where, hint="state the rate")


def check_shape(record: Record, where: str) -> Record:
    """``record``, unless it has no channels, no rate or no samples."""
    check_channels(record.sample_hz, record.inputs, record.outputs, where)
    if 0 in record.u.shape:
        raise DataError(f"no samples: u has shape {record.u.shape}", where=where, hint="record it again")
    return record


def check_finite(record: Record, where: str) -> Record:
    """``record``, unless a sample is not a finite number."""
    for ports, x in ((record.inputs, record.u), (record.outputs, record.y)):
        for port, channel in zip(ports, np.moveaxis(x, 3, 0), strict=True):
            bad = np.argwhere(~np.isfinite(channel))
            if len(bad):
                e, p, k = bad[0]
                raise DataError(
                    f"{len(bad)} samples are not finite numbers, the first in experiment {e}, period {p}, "
                    f"sample {k}",
                    where=f"{where}, channel {port.name}",
                    hint="cut the record before the gap or repair the channel",
                )
    return record
