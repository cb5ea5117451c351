"""The half-plane in which a fitted zero lies, or that its deviation allows either."""

from middeck.study.words import Numbers

CERTAIN = 3.0  # standard deviations from the axis beyond which the half-plane of a zero is certain
EITHER = "left or right"


def half_plane(zero: Numbers) -> str:
    """The half-plane of a zero of numbers.json; both where its deviation allows either."""
    deviation = zero["damping_deviation"]
    if deviation is None or abs(zero["damping"]) < CERTAIN * deviation:
        return EITHER
    return "right" if zero["nonminimum_phase"] else "left"
