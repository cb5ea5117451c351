"""Figure 6 in numbers.json."""

from __future__ import annotations

from middeck.files.json_results import response_numbers
from middeck.study.chapters.gravity_responses.claims import figure_6_claims
from middeck.study.chapters.gravity_responses.computation import GravityResponses
from middeck.study.words import Numbers


def figure_6(responses: GravityResponses) -> Numbers:
    """Rates of payload and bus per torque, in this order of the outputs."""
    sides = {"orbit": responses.orbit, "lab": responses.lab, "rig": responses.rig}
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
