"""Figure 6 in numbers.json, with the claims."""

import numpy as np

from middeck.files.json.results import response_numbers
from middeck.study.chapters.gravity_responses.computation import GravityResponses
from middeck.study.words import Claim, Numbers, below, fields


def figure_6(responses: GravityResponses) -> Numbers:
    """Rates of payload and bus per torque, in this order of the outputs."""
    sides = fields(responses, "orbit", "lab", "rig")
    names = ("payload_z_rate", "bus_z_rate")
    error = responses.magnitude_error
    return {
        **{
            side: {name: response_numbers(r, output=i) for i, name in enumerate(names)}
            for side, r in sides.items()
        },
        "phase_gap_s": responses.phase_gap_s,
        "delay_s": responses.delay_s,
        "input": responses.rig.inputs[0].name,
        "outputs": [port.name for port in responses.rig.outputs],
        "magnitude_error_band_hz": error and error.band_hz,
        "magnitude_error_db": {"orbit": error and error.orbit_db, "lab": error and error.lab_db},
        "claims": figure_6_claims(responses),
    }


def figure_6_claims(responses: GravityResponses) -> list[Claim]:
    """Delay explains the phase; gravity and suspension bring the model to the data."""
    gap = responses.phase_gap_s
    largest = None if gap is None else 1e3 * float(np.max(np.abs(gap - responses.delay_s)))
    error = responses.magnitude_error
    names = [port.name for port in responses.rig.outputs]
    rows = [
        below(
            "the phase of the rig relative to the model above 5 Hz is that of its"
            " delay within 0.2 ms; largest difference [ms]",
            largest,
            0.2,
            "ms",
        )
    ]
    for k, name in enumerate(names):
        where = "where both are measured" if error is None else "in {:g}-{:g} Hz".format(*error.band_hz)
        ratio = None if error is None else float(error.lab_db[k] / error.orbit_db[k])
        text = (
            f"{name}: the log-magnitude error of the 1-g model {where} is below that of the 0-g model; ratio"
        )
        rows.append(below(text, ratio, 1.0, ""))
    return rows
