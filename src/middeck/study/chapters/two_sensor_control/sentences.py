"""Headings of Figure 10, and what Figures 10 to 12 show."""

from __future__ import annotations

from middeck.plot.ports import port_words
from middeck.study.measured_loop.sentences import changed, decibels, held, lost
from middeck.study.words import Line, Numbers, fixed, percent, signed

TOLD = 3.0  # deviations from the axis, from which on the side of a zero is told


def title_10(figures: Numbers, entry: str) -> str:
    """From torque to angle."""
    torque, angle = (port_words(figures[entry][port]) for port in ("input", "output"))
    return f"{entry.replace('_', ' ').capitalize()}: {torque} torque to {angle} angle"


def figure_10(figures: Numbers, entry: str) -> str:
    """The fit of one path and its zeros in the right half-plane."""
    numbers = figures[entry]
    low, high = numbers["fit_band_hz"]
    name = port_words(numbers["output"])
    inside = [z for z in numbers["zeros"] if low <= z["frequency_hz"] <= high]
    beyond = [z for z in numbers["zeros"] if z not in inside]
    zeros = f"in that band it takes {_on_the_right(inside) or 'no zero in the right half-plane'}"
    more = _on_the_right(beyond)
    zeros += f", and outside it, where nothing is fitted, {more}" if more else ""
    return (
        f"Fitted together with the other sensors by {numbers['states']} states and a delay of"
        f" {fixed(1e3 * numbers['delay_s'], 2)} ms, the {name} angle follows its measured response from"
        f" {low:g} to {high:g} Hz within {percent(numbers['relative_error'])} (relative complex error);"
        f" {zeros}."
    )


def half_plane(zero: Numbers) -> str:
    """The half-plane of a zero; both where its deviation allows either."""
    deviation = zero["damping_deviation"]
    if deviation is None or abs(zero["damping"]) < TOLD * deviation:
        return "left or right"
    return "right" if zero["nonminimum_phase"] else "left"


def _on_the_right(zeros: list[Numbers]) -> str:
    """Those of the right half-plane, and those that may lie there."""
    said: list[str] = []
    for side, words in (
        ("right", "non-minimum-phase zeros"),
        ("left or right", "zeros of either half-plane"),
    ):
        there = [z for z in zeros if half_plane(z) == side]
        listed = " and ".join(
            f"{'a pair' if z['pair'] else 'a real one'} at {fixed(z['frequency_hz'], 2)} Hz" for z in there
        )
        said += [f"{words}: {listed}"] if there else []
    return ", and ".join(said)


def figure_11(figures: Numbers) -> str:
    """The limit of the loop, with and without the lead."""
    numbers = figures["figure_11"]
    *_, bare, lead = numbers["reach"]
    return (
        f"With encoder and bus fed back, a design on {bare['states']} states {_goes(bare)}; with a lead about"
        f" the pair near 9 Hz it {_goes(lead)}. The loop shown has the lead: it changes the payload's rms"
        f" angle by {changed(numbers['payload'])}, and is {held(numbers['payload'])}."
    )


def figure_12a(figures: Numbers) -> str:
    """The payload."""
    numbers = figures["figure_12"]
    above, deeper = numbers["payload_db_above_10_hz"]["both"], numbers["payload_deeper_db_7_to_9_hz"]
    return (
        f"A penalty on payload and bus changes the payload's rms angle by {changed(numbers['both'])}, and the"
        f" loop is {held(numbers['both'])}; above"
        f" 10 Hz the angle is {_apart(above)} in open loop, and at 7-9 Hz (shaded) {_apart(deeper)} under the"
        " payload penalty alone."
    )


def figure_12b(figures: Numbers) -> str:
    """The bus."""
    bus = figures["figure_12"]["bus_db_7_to_9_hz"]
    return (
        f"At 7-9 Hz (shaded) the bus is {_apart(bus['both'])} in open loop under both penalties, and"
        f" {_apart(bus['payload'])} there under the payload penalty alone."
    )


def _goes(reach: Numbers) -> str:
    """The limit of a design, and the mode that sets it."""
    if reach["log10_authority"] is None:
        return f"is unstable at any authority, at {fixed(reach['stopped_hz'], 2)} Hz"
    reached = f"reaches {fixed(reach['predicted_db'], 1)} dB"
    if reach["stopped_hz"] is None:
        return f"{reached} at the highest authority asked for"
    return (
        f"{reached} before {fixed(reach['stopped_hz'], 2)} Hz goes unstable (with that pair at"
        f" {signed(reach['stopped_percent'])} %)"
    )


def _apart(db: float | None) -> str:
    if db is None:
        return "not measured, so not to be compared with that"
    return f"{fixed(abs(db), 1)} dB {'below' if db < 0.0 else 'above'} that"


def result(figures: Numbers) -> Line:
    """The measured change of both loops."""
    one, both = figures["figure_11"]["payload"], figures["figure_12"]["both"]
    return Line(
        f"With encoder and bus fed back: {decibels(one)}; with the bus penalised too {decibels(both)}.",
        "figure-11",
    )


def shortfalls(figures: Numbers) -> list[Line]:
    """Loops that a moved pair of modes makes unstable."""
    return [
        *lost("The loop of Figure 11", figures["figure_11"]["payload"], "figure-11"),
        *lost("The loop of Figure 12", figures["figure_12"]["both"], "figure-12a"),
    ]
