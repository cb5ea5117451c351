"""Sentences and tables of fitted modes and measured loops, from their entries in numbers.json."""

from operator import itemgetter

from middeck.study.words import UNDETERMINED, Line, Numbers, Table, cells, deviation, fixed, percent, signed


def changed(loop: Numbers) -> str:
    """The change of the rms angle in words, as predicted and as measured."""
    predicted, measured = loop["predicted_db"], loop["measured_db"]
    foreseen = (
        "an amount that cannot be predicted (the fit or its loop is undamped in the band)"
        if predicted is None
        else f"{fixed(predicted, 2)} dB predicted"
    )
    if not loop["stable"]:
        return f"{foreseen} and unstable on the rig"
    return f"{foreseen} and {fixed(measured, 2)} dB measured"


def held(loop: Numbers) -> str:
    """The shifts of the pair at which a loop is stable on the rig, and those at which it is not."""
    parts: list[str] = []
    for stable, word in ((True, "stable"), (False, "unstable")):
        moved = [on["percent"] for on in loop["rig"] if on["stable"] is stable and on["percent"]]
        parts += (
            [f"{word} with the mode pair shifted by {' or '.join(map(signed, moved))} %"] if moved else []
        )
    return " but ".join(parts) or "not tried with the mode pair shifted"


def decibels(loop: Numbers) -> str:
    """The measured change alone."""
    return "unstable" if loop["measured_db"] is None else f"{fixed(loop['measured_db'], 1)} dB"


def lost(who: str, loop: Numbers, section: str) -> list[Line]:
    """A line for a loop that the rig, as it was or shifted, makes unstable."""
    return [] if all(on["stable"] for on in loop["rig"]) else [Line(f"{who} is {held(loop)}.", section)]


def poles_table(caption: str, numbers: Numbers) -> Table:
    """Natural frequencies and damping of a fit, each with one standard deviation."""
    columns = (numbers[k] for k in ("natural_hz", "natural_hz_deviation", "damping", "damping_deviation"))
    rows = [
        [fixed(f, 4), deviation(df), percent(z, 3), UNDETERMINED if dz is None else percent(dz, 3)]
        for f, df, z, dz in sorted(zip(*columns, strict=True), key=itemgetter(0, 2))
    ]
    head = ("natural frequency [Hz]", "± [Hz]", "damping", "±")
    return Table(f"{caption}, one standard deviation", head, rows)


def loops_table(caption: str, loops: Numbers) -> Table:
    """The performance of each loop by its name, predicted and measured."""
    digits = {"log10_authority": 2, "predicted_db": 3, "measured_db": 3, "rms_error_db": 3,
              "worst_error_db": 2, "worst_hz": 2, "control_rms_nm": 3}  # fmt: skip
    rows = [[name, *cells(loop, digits)] for name, loop in loops.items()]
    head = ("loop", "log10 authority", "predicted [dB]", "measured [dB]", "error of rms [dB]",
            "largest error on a frequency line [dB]", "at [Hz]", "rms control torque [N m]")  # fmt: skip
    return Table(caption, head, rows)


def modes_table(loops: Numbers, which: str = "CL1, CL2, CL3") -> Table:
    """Modes of the fit down, loops across; an unmeasured loop has no values."""
    frequencies = next((loop["modes"] for loop in loops.values() if loop["modes"]), [])
    rows = [["static", *(fixed(loop["static_db"], 1) for loop in loops.values())]]
    for k, mode in enumerate(frequencies):
        peaks = (fixed(loop["modes"][k]["db"] if loop["modes"] else None, 1) for loop in loops.values())
        rows.append([f"{mode['frequency_hz']:.2f} Hz", *peaks])
    head = ("payload at", *(f"{name} [dB]" for name in loops))
    return Table(f"Measured peaks relative to open loop, {which}", head, rows)


def rig_table(loops: Numbers, pair_hz: float | None) -> Table:
    """Stability and margins of each loop on the rig, with the pair of modes near ``pair_hz`` shifted."""
    digits = {"improvement_db": 2, "gain_margin_db": 1, "gain_margin_hz": 2, "phase_margin_deg": 1,
              "phase_margin_hz": 2}  # fmt: skip
    rows = [
        [
            name,
            fixed(on["percent"], 0),
            "stable" if on["stable"] else f"unstable at {fixed(on['growth_hz'], 2)} Hz",
            *cells(on, digits),
        ]
        for name, loop in loops.items()
        for on in loop["rig"]
    ]
    pair = "the pair" if pair_hz is None else f"the pair near {pair_hz:g} Hz"
    head = ("loop", "shift [%]", "stability", "payload [dB]", "gain margin [dB]", "at [Hz]",
            "phase margin [deg]", "at [Hz]")  # fmt: skip
    return Table(f"Rig without limits and noise, with {pair} shifted: {', '.join(loops)}", head, rows)
