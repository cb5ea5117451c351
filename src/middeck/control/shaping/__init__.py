"""Shaping of a law by hand: leads, lags, notches and roll-off in series with it."""

from middeck.control.shaping.sections import (
    first_order_section,
    notch,
    roll_off,
    second_order_section,
    shape_compensator,
)

__all__ = ["first_order_section", "notch", "roll_off", "second_order_section", "shape_compensator"]
