"""Classical shaping of a compensator: leads, lags, notches and roll-off in series."""

from middeck.control.shaping.sections import (
    design_pd,
    first_order_section,
    notch,
    roll_off,
    second_order_section,
    shape_compensator,
)

__all__ = [
    "design_pd",
    "first_order_section",
    "notch",
    "roll_off",
    "second_order_section",
    "shape_compensator",
]
