"""Figure 11: the payload held by encoder and bus: the order, the pair near 9 Hz, and the lead."""

from __future__ import annotations

from middeck.study.claims.row import Claim, at_most, largest, prediction_claims, row
from middeck.study.reach import Reach
from middeck.study.two_sensor_control import TwoSensorControl

PAIR_HZ = (8.0, 10.0)
AT_PAIR = "{:g} to {:g}".format(*PAIR_HZ)
SUSPENSION_HZ = 1.0  # below, the modes of the suspension, which ten states do not hold
SPILLS_HZ = 15.0  # the modes from 17 Hz on, which twelve states do not hold


def figure_11_claims(control: TwoSensorControl) -> list[Claim]:
    """Which orders fail and where, how far the loop goes with the lead and without, and what was measured."""
    bare, lead, loop = control.without_lead, control.with_lead, control.payload
    moves = ", ".join(f"{r.percent:+g}" if r.percent else "0" for r in loop.on_rig)
    return [
        *(_order(reach) for reach in control.smaller),
        row(
            f"{bare.states} states without lead are stopped near 9 Hz; at [Hz]",
            _at_pair(bare),
            bare.stopped_hz,
            AT_PAIR,
            "Hz",
        ),
        row(
            "and that before 18 dB; at the last stable level [dB]",
            bare.predicted_db is not None and bare.predicted_db > -18.0,
            bare.predicted_db,
            "> -18",
            "dB",
        ),
        at_most(
            f"with the lead the same design reaches 20 dB with the pair moved by {moves} %; least [dB]",
            lead.least_db,
            -20.0,
        ),
        at_most(
            "the loop with the lead reduces the payload by over 20 dB, measured [dB]", loop.measured_db, -20.0
        ),
        at_most(
            f"that loop, kept as it is, still reaches 20 dB with the pair moved by {moves} %; least [dB]",
            largest(rig.improvement_db for rig in loop.on_rig),
            -20.0,
        ),
        *prediction_claims((loop,), "payload penalty"),
    ]


def _order(reach: Reach) -> Claim:
    """What the paper's programme saw with few states; from 16 on it is the pair that stops."""
    hz = reach.stopped_hz
    if reach.states <= 10:
        text, good = "lets go of the suspension at any authority, below 1 Hz", _at_once(reach)
        asked = f"< {SUSPENSION_HZ:g}"
    elif reach.states <= 12:
        text, good = "spills over into a mode that it does not hold", hz is not None and hz > SPILLS_HZ
        asked = f"> {SPILLS_HZ:g}"
    else:
        text, good, asked = "does neither: the pair near 9 Hz stops it", _at_pair(reach), AT_PAIR
    return row(f"a design on {reach.states} states {text}; at [Hz]", good, hz, asked, "Hz")


def _at_once(reach: Reach) -> bool:
    return reach.log10_authority is None and reach.stopped_hz is not None and reach.stopped_hz < SUSPENSION_HZ


def _at_pair(reach: Reach) -> bool:
    return reach.stopped_hz is not None and PAIR_HZ[0] <= reach.stopped_hz <= PAIR_HZ[1]
