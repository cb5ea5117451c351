"""Sentences and tables of Figures 9a and 9b."""

from middeck.plot.port_words import port_words
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
from middeck.study.words import Line, Numbers, Table, deviation, fixed, percent, signed

LOOPS = {"low": "CL1", "high": "CL2", "robust": "CL3"}
DESIGNS = {
    "low": "CL1 (low authority)",
    "high": "CL2 (high authority)",
    "robust": "CL3 (designed for two records)",
}


def figure_9a(figures: Numbers) -> str:
    """The fit."""
    numbers = figures["figure_9a"]
    low, high = numbers["fit_band_hz"]
    below = numbers["mode_below_fit"]
    outside = (
        ""
        if below is None
        else f"; the {below['kind']} mode at {fixed(below['frequency_hz'], 2)} Hz, below that band, lies"
        " outside the fit"
    )
    return (
        f"A fit of {numbers['states']} states and a delay of {fixed(1e3 * numbers['delay_s'], 2)} ms follows"
        f" the measured response from {low:g} to {high:g} Hz within {percent(numbers['relative_error'])}"
        f" (relative complex error){outside}."
    )


def figure_9b(figures: Numbers) -> str:
    """Prediction and measurement."""
    numbers = figures["figure_9b"]
    angle = port_words(figures["figure_9a"]["output"])
    pair = f"the pair of modes near {numbers['pair_shift_hz']:g} Hz"
    changes = "; ".join(f"{words} {changed(numbers[key])}" for key, words in DESIGNS.items())
    return (
        f"Change of the {angle} rms angle by controllers designed on the fit: {changes}. The second record of"
        f" CL3 has {pair} shifted by {signed(numbers['drifted']['shift_percent'])} %. On the rig,"
        f" {'; '.join(f'{who} is {held(numbers[key])}' for key, who in LOOPS.items())}."
    )


def result(figures: Numbers) -> Line:
    """The measured change of each loop."""
    nine = figures["figure_9b"]
    loops = ", ".join(f"{words} {decibels(nine[key])}" for key, words in DESIGNS.items())
    return Line(
        f"Payload rms angle on the simulated rig, controllers designed on measured responses: {loops}.",
        "figure-9b",
    )


def shortfalls(figures: Numbers) -> list[Line]:
    """Loops that a moved pair of modes makes unstable."""
    loops = figures["figure_9b"]
    return [line for key, who in LOOPS.items() for line in lost(f"The loop {who}", loops[key], "figure-9b")]


def fit_tables(figures: Numbers) -> list[Table]:
    """The fitted poles and delay."""
    numbers = figures["figure_9a"]
    delay_ms = 1e3 * numbers["delay_s"]
    rows = [
        ["states of the fit", str(numbers["states"])],
        ["states of the design plant, Padé delay included", str(numbers["plant_states"])],
        ["delay [ms]", f"{fixed(delay_ms, 4)} {deviation(numbers['delay_deviation_s'], 1e-3, '± ')}"],
        ["band of the fit [Hz]", " to ".join(f"{f:g}" for f in numbers["fit_band_hz"])],
        ["relative complex error in that band", percent(numbers["relative_error"], 3)],
    ]  # fmt: skip
    return [poles_table("Fitted modes", numbers), Table("The fit", ("quantity", "value"), rows)]


def loop_tables(figures: Numbers) -> list[Table]:
    """The three loops, mode by mode, and on the shifted rig."""
    numbers = figures["figure_9b"]
    loops = {who: numbers[key] for key, who in LOOPS.items()}
    drifted, fitted = numbers["drifted"], figures["figure_9a"]
    both = zip(sorted(fitted["natural_hz"]), sorted(drifted["natural_hz"]), strict=True)
    return [
        loops_table("Payload rms angle in the band, relative to open loop", loops),
        modes_table(loops),
        rig_table(loops | {"LQG for one record at CL3's authority": {"rig": numbers["one_model"]}},
                   numbers["pair_shift_hz"]),
        Table("Fitted modes of the two records for which CL3 is designed",
              ("first record [Hz]", f"pair at {signed(drifted['shift_percent'])} % [Hz]"),
              [[fixed(f, 4), fixed(g, 4)] for f, g in both]),
    ]  # fmt: skip
