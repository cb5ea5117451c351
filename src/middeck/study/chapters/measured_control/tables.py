"""Tables under Figures 9a and 9b."""

from __future__ import annotations

from middeck.study.chapters.measured_control.sentences import LOOPS
from middeck.study.measured_loop.tables import loops_table, modes_table, poles_table, rig_table
from middeck.study.words import Numbers, Table, deviation, fixed, percent, signed


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
        loops_table("Payload rms angle in the band, over the open loop's", loops),
        modes_table(loops),
        rig_table(loops | {"LQG for one record at CL3's authority": {"rig": numbers["one_model"]}},
                   numbers["pair_shift_hz"]),
        Table("Modes of the two records that CL3 is for",
              ("first record [Hz]", f"pair at {signed(drifted['shift_percent'])} % [Hz]"),
              [[fixed(f, 4), fixed(g, 4)] for f, g in both]),
    ]  # fmt: skip
