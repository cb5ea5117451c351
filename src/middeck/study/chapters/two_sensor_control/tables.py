"""Tables under Figures 10 to 12."""

from __future__ import annotations

from middeck.plot.ports import port_words
from middeck.study.chapters.two_sensor_control.sentences import half_plane
from middeck.study.measured_loop.tables import loops_table, modes_table, poles_table, rig_table
from middeck.study.words import Numbers, Table, cells, deviation, fixed, percent


def encoder_tables(figures: Numbers) -> list[Table]:
    """Common poles, then what is the encoder's own."""
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
        ["fitted anew with all zeros held in the left half-plane",
         "–" if numbers["mirrored_error"] is None else percent(numbers["mirrored_error"], 1)],
    ]  # fmt: skip
    head = ("frequency [Hz]", "± [Hz]", "damping", "half-plane")
    return [Table(f"Zeros of the {name}", head, zeros),
            Table(f"The fit of the {name}", ("quantity", "value"), rows)]  # fmt: skip


def reach_tables(figures: Numbers) -> list[Table]:
    """How far each design goes, then the loop that was measured."""
    numbers = figures["figure_11"]
    digits = {"log10_authority": 2, "predicted_db": 2, "least_db": 2, "stopped_hz": 2, "stopped_percent": 0}
    rows = [[reach["what"], *cells(reach, digits)] for reach in numbers["reach"]]
    head = ("design on", "last stable log10 authority", "predicted [dB]", "least on the rig [dB]",
            "then unstable at [Hz]", "with the pair at [%]")  # fmt: skip
    loops = {"payload": numbers["payload"]}
    return [
        Table("How far each design goes, with the pair moved to either side and not", head, rows),
        loops_table("Payload rms angle in the band, over the open loop's, payload penalty", loops),
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
        loops_table("Payload rms angle in the band, over the open loop's, both penalties", loops),
        Table("Measured rms in parts of the band, over the open loop's", head, rows),
        modes_table(loops, "both penalties"),
        rig_table(loops, figures["figure_9b"]["pair_shift_hz"] if "figure_9b" in figures else None),
    ]
