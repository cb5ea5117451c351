"""Headings, sentences and tables of Figures 10 to 12."""

from middeck.plot.port_words import port_words
from middeck.study.chapters.two_sensor_control.half_planes import EITHER, half_plane
from middeck.study.measured_loop.text import (
    changed,
    decibels,
    held,
    loops_table,
    lost,
    modes_table,
    poles_table,
    rig_table,
)
from middeck.study.words import Line, Numbers, Table, cells, deviation, fixed, percent, signed


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
    zeros = f"In that band it has {_on_the_right(inside) or 'no zero in the right half-plane'}"
    more = _on_the_right(beyond)
    zeros += f". Outside the band, where nothing is fitted, it has {more}" if more else ""
    return (
        f"Fitted together with the other sensors by {numbers['states']} states and a delay of"
        f" {fixed(1e3 * numbers['delay_s'], 2)} ms, the {name} angle follows its measured response from"
        f" {low:g} to {high:g} Hz within {percent(numbers['relative_error'])} (relative complex error)."
        f" {zeros}."
    )


def _on_the_right(zeros: list[Numbers]) -> str:
    """Zeros in the right half-plane, and those that may lie there."""
    clauses: list[str] = []
    for side, words in (
        ("right", "non-minimum-phase zeros"),
        (EITHER, "zeros that may lie in either half-plane"),
    ):
        there = [z for z in zeros if half_plane(z) == side]
        listed = " and ".join(
            f"{'a pair' if z['pair'] else 'a real one'} at {fixed(z['frequency_hz'], 2)} Hz" for z in there
        )
        clauses += [f"{words}: {listed}"] if there else []
    return ", and ".join(clauses)


def figure_11(figures: Numbers) -> str:
    """The limit of the loop, with and without the lead."""
    numbers = figures["figure_11"]
    *_, bare, lead = numbers["reach"]
    return (
        f"With encoder and bus fed back, a design on {bare['states']} states"
        f" {_goes(bare)}. With a lead filter"
        f" around the mode pair near 9 Hz it {_goes(lead)}. The loop shown has"
        " the lead filter: it changes the"
        f" payload's rms angle by {changed(numbers['payload'])}, and is {held(numbers['payload'])}."
    )


def figure_12a(figures: Numbers) -> str:
    """The payload."""
    numbers = figures["figure_12"]
    above, deeper = numbers["payload_db_above_10_hz"]["both"], numbers["payload_deeper_db_7_to_9_hz"]
    return (
        f"Penalties on payload and bus change the payload's rms angle by {changed(numbers['both'])}."
        f" The loop is {held(numbers['both'])}. Above 10 Hz the angle is {_apart(above)} in open loop; at"
        f" 7-9 Hz (shaded) it is {_apart(deeper)} under the payload penalty alone."
    )


def figure_12b(figures: Numbers) -> str:
    """The bus."""
    bus = figures["figure_12"]["bus_db_7_to_9_hz"]
    return (
        f"At 7-9 Hz (shaded) the bus angle is {_apart(bus['both'])} in open loop under both penalties, and"
        f" {_apart(bus['payload'])} in open loop under the payload penalty alone."
    )


def _goes(reach: Numbers) -> str:
    """The limit of a design, and the mode that sets it."""
    if reach["log10_authority"] is None:
        return f"is unstable at every authority, at {fixed(reach['stopped_hz'], 2)} Hz"
    reached = f"reaches {fixed(reach['predicted_db'], 1)} dB"
    if reach["stopped_hz"] is None:
        return f"{reached} at the highest authority tried"
    return (
        f"{reached} before a pole at {fixed(reach['stopped_hz'], 2)} Hz becomes unstable (pair shifted by"
        f" {signed(reach['stopped_percent'])} %)"
    )


def _apart(db: float | None) -> str:
    if db is None:
        return "not measured, so it cannot be compared with that"
    return f"{fixed(abs(db), 1)} dB {'lower' if db < 0.0 else 'higher'} than"


def result(figures: Numbers) -> Line:
    """The measured change of both loops."""
    one, both = figures["figure_11"]["payload"], figures["figure_12"]["both"]
    return Line(
        f"Payload rms angle with encoder and bus fed back: {decibels(one)}; with"
        f" a penalty on the bus as well: {decibels(both)}.",
        "figure-11",
    )


def shortfalls(figures: Numbers) -> list[Line]:
    """Loops that a moved pair of modes makes unstable."""
    return [
        *lost("The loop of Figure 11", figures["figure_11"]["payload"], "figure-11"),
        *lost("The loop of Figure 12", figures["figure_12"]["both"], "figure-12a"),
    ]


def encoder_tables(figures: Numbers) -> list[Table]:
    """Common poles, then the encoder's own zeros and delay."""
    numbers = figures["figure_10a"]
    return [poles_table("Poles common to the three sensors", numbers), *_path_tables(numbers)]


def bus_tables(figures: Numbers) -> list[Table]:
    """Numbers of the bus alone."""
    return _path_tables(figures["figure_10b"])


def _path_tables(numbers: Numbers) -> list[Table]:
    zeros = [
        [fixed(z["frequency_hz"], 4), deviation(z["frequency_deviation_hz"]),
         percent(z["damping"], 2) if z["pair"] else "real", half_plane(z)]
        for z in numbers["zeros"]
    ]  # fmt: skip
    name = port_words(numbers["output"])
    rows = [
        ["states of the fit", str(numbers["states"])],
        ["states of the design plant, Padé delays included", str(numbers["plant_states"])],
        ["delay [ms]",
         f"{fixed(1e3 * numbers['delay_s'], 4)} {deviation(numbers['delay_deviation_s'], 1e-3, '± ')}"],
        ["relative complex error", percent(numbers["relative_error"], 3)],
        ["relative complex error with all zeros constrained to the left half-plane",
         "–" if numbers["mirrored_error"] is None else percent(numbers["mirrored_error"], 1)],
    ]  # fmt: skip
    head = ("frequency [Hz]", "± [Hz]", "damping", "half-plane")
    return [Table(f"Zeros of the {name}", head, zeros),
            Table(f"The fit of the {name}", ("quantity", "value"), rows)]  # fmt: skip


def reach_tables(figures: Numbers) -> list[Table]:
    """Limit of each design, then the loop that was measured."""
    numbers = figures["figure_11"]
    digits = {"log10_authority": 2, "predicted_db": 2, "least_db": 2, "stopped_hz": 2, "stopped_percent": 0}
    rows = [[reach["what"], *cells(reach, digits)] for reach in numbers["reach"]]
    head = ("design on", "highest stable log10 authority", "predicted [dB]", "least reduced on the rig [dB]",
            "above it unstable at [Hz]", "with the pair shifted by [%]")  # fmt: skip
    loops = {"payload": numbers["payload"]}
    return [
        Table(
            "Highest stable authority of each design, with the pair near 9 Hz unshifted and shifted",
            head,
            rows,
        ),
        loops_table("Payload rms angle in the band, relative to open loop, payload penalty", loops),
        modes_table(loops, "payload penalty"),
        rig_table(loops, figures["figure_9b"]["pair_shift_hz"] if "figure_9b" in figures else None),
    ]


def both_tables(figures: Numbers) -> list[Table]:
    """The loop under both penalties beside the one under the payload's alone."""
    numbers = figures["figure_12"]
    loops = {"payload and bus": numbers["both"]}
    rows = [
        [name, fixed(numbers["bus_db_7_to_9_hz"][key], 2), fixed(numbers["payload_db_above_10_hz"][key], 2)]
        for key, name in (("payload", "payload"), ("both", "payload and bus"))
    ]
    head = ("penalty", "bus at 7-9 Hz [dB]", "payload above 10 Hz [dB]")
    return [
        loops_table("Payload rms angle in the band, relative to open loop, both penalties", loops),
        Table("Measured rms in parts of the band, relative to open loop", head, rows),
        modes_table(loops, "both penalties"),
        rig_table(loops, figures["figure_9b"]["pair_shift_hz"] if "figure_9b" in figures else None),
    ]
