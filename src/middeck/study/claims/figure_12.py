"""Figures 12a and 12b: payload and bus held together, and what the bus costs and gains."""

from __future__ import annotations

from middeck.study.claims.row import Claim, at_most, prediction_claims, row
from middeck.study.two_sensor_control import ABOVE_HZ, FLEXIBLE_HZ, TwoSensorControl

ORDER_DB = -20.0


def figure_12_claims(control: TwoSensorControl) -> list[Claim]:
    """The bus at 7-9 Hz, the payload above 10 Hz, and the paper's further order of magnitude."""
    both = control.both
    without, above = control.above_without_bus_db, control.above_db[1]
    more = None if without is None or above is None else above - without
    band = "{:g}-{:g} Hz".format(*FLEXIBLE_HZ)
    beyond = f"above {ABOVE_HZ[0]:g} Hz"
    return [
        at_most(
            "with payload and bus penalised the payload is down by 20 dB, measured [dB]",
            both.measured_db,
            -20.0,
        ),
        at_most(
            f"the bus at {band} is lower than in open loop by at least 12 dB [dB]", control.bus_db[1], -12.0
        ),
        row(
            f"the payload {beyond} is raised over the open loop [dB]",
            above is not None and above > 0.0,
            above,
            "> 0",
            "dB",
        ),
        row(
            "and more than with no bus penalty and all else, authority and no lead, the same [dB]",
            more is not None and more > 0.0,
            more,
            "> 0",
            "dB",
        ),
        at_most(
            f"the payload at {band} falls by a further order of magnitude below the payload penalty's [dB]",
            control.deeper_db,
            ORDER_DB,
        ),
        at_most(
            f"at the mode near {control.mode_hz:.1f} Hz itself, between its half-power points, it does [dB]",
            control.deeper_at_mode_db,
            ORDER_DB,
        ),
        *prediction_claims((both,), "payload and bus penalty"),
    ]
