"""Figure 10: zeros and delays of the three paths."""

from __future__ import annotations

import numpy as np

from middeck.identification.measurement_model import path_delay
from middeck.study.claims.row import Claim, row
from middeck.study.measured_sensors import MeasuredSensors

WORSE = 2.0  # 6 dB


def figure_10_claims(sensors: MeasuredSensors) -> list[Claim]:
    """The bus needs zeros in the right half-plane where payload and encoder need none."""
    low, high = sensors.fit_band_hz
    words = [port.name for port in sensors.measured.outputs]
    wrong = [
        float(np.count_nonzero(z.is_nonminimum_phase & (z.frequency_hz >= low) & (z.frequency_hz <= high)))
        for z in (sensor.zeros for sensor in sensors.sensors)
    ]
    bus = sensors.sensors[2]
    ratio = None if bus.mirrored_error is None else bus.mirrored_error / float(sensors.fit.error[2])
    late = float(np.max(np.abs(path_delay(sensors.fit.model) - sensors.delay_s)) * 1e3)
    where = f"from {low:g} to {high:g} Hz"
    return [
        row(
            f"{words[2]}: non-minimum-phase zeros {where}; zeros or pairs",
            wrong[2] > 0.0,
            wrong[2],
            "\u2265 1",
        ),
        *(row(f"{words[k]}: none {where}; zeros or pairs", wrong[k] == 0.0, wrong[k], "= 0") for k in (0, 1)),
        row(
            f"{words[2]}: fitted anew, all zeros held in the left half-plane, it errs over {WORSE:g} times as"
            " much; ratio",
            ratio is not None and ratio > WORSE,
            ratio,
            f"> {WORSE:g}",
        ),
        row(
            "the fitted delays are the rig's within 0.2 ms; largest difference [ms]",
            late < 0.2,
            late,
            "< 0.2",
            "ms",
        ),
    ]
