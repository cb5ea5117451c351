"""One sentence for each figure: what it shows, in the numbers of numbers.json."""

from __future__ import annotations

import numpy as np

from middeck.plot.ports import port_words
from middeck.report.words import Numbers, fixed, percent

COUPLED = 0.1  # cross-orthogonality from which on two modes are said to mix
TOLD = 3.0  # deviations from the axis, from which on the side of a zero is told
LOOPS = {"low": "CL1", "high": "CL2", "robust": "CL3"}
PAIRED = 0.9  # and above which a flexible mode has kept its pair


def figure_3(figures: Numbers) -> str:
    """What hanging does to the shape."""
    lab = figures["figure_4"]["lab"]
    load = sum(lab["reactions_n"].values())
    joint, torque = max(lab["holding_torque_nm"].items(), key=lambda item: abs(item[1]))
    return (
        f"The article as it floats in 0-g and as it hangs in 1-g, where its cables carry {fixed(load, 1)}"
        " N and"
        f" the gimbal motor {joint} has to hold {fixed(torque, 2)} N m."
    )


def figure_4(figures: Numbers) -> str:
    """Stiffening and softening."""
    numbers = figures["figure_4"]
    hung = [f for f, k in zip(numbers["lab"]["frequency_hz"], numbers["lab"]["kind"], strict=True)
            if k == "suspension"]  # fmt: skip
    ratio = np.array(numbers["ratio"])
    low, high = (f"{fixed(f, 3)}" for f in (min(hung, default=0.0), max(hung, default=0.0)))
    return (
        f"The {len(hung)} rigid-body modes of 0-g become suspension and pendulum modes of {low} to {high} Hz"
        + (
            f", and the flexible modes shift by {fixed(100.0 * (ratio.min() - 1.0), 2)} to"
            f" {fixed(100.0 * (ratio.max() - 1.0), 2)} %."
            if len(ratio)
            else "; no flexible mode is among those compared."
        )
    )


def figure_5(figures: Numbers) -> str:
    """Who couples."""
    matrix = np.array(figures["figure_5"]["matrix"])
    pairs = np.array(figures["figure_4"]["pairs"], dtype=int).reshape(-1, 2)
    sides = [figures["figure_4"][side]["kind"] for side in ("orbit", "lab")]
    rigid, hung = ([i for i, k in enumerate(kinds) if k != "flexible"] for kinds in sides)
    mixed = int(np.count_nonzero(matrix[np.ix_(rigid, hung)] > COUPLED))
    said = (
        "Without gravity's effects the matrix would be diagonal; here"
        f" {mixed} of the {len(rigid) * len(hung)} entries between rigid-body and suspension modes exceed"
        f" {COUPLED:g}"
    )
    return said + (f", {_flexible_couplings(matrix, pairs)}." if len(pairs) > 1 else ".")


def _flexible_couplings(matrix: np.ndarray, pairs: np.ndarray) -> str:
    paired = float(matrix[pairs[:, 0], pairs[:, 1]].min())
    block = matrix[np.ix_(pairs[:, 0], pairs[:, 1])] * (1.0 - np.eye(len(pairs)))
    row, column = (int(k) for k in np.unravel_index(np.argmax(block), block.shape))
    keeps = "every flexible mode keeps" if paired > PAIRED else "not every flexible mode keeps"
    beside = "the next one" if abs(row - column) == 1 else "not the next one"
    return (
        f"while {keeps} its pair (the weakest {fixed(paired, 3)}) and the largest coupling beside the pairs"
        f" is {fixed(float(block.max()), 3)} (0-g mode {pairs[row, 0]} with 1-g mode {pairs[column, 1]},"
        f" {beside})"
    )


def title_6a(figures: Numbers) -> str:
    """Heading of the payload's figure."""
    return f"Figure 6a: {_title_6(figures, 0)}"


def title_6b(figures: Numbers) -> str:
    """Heading of the bus's figure."""
    return f"Figure 6b: {_title_6(figures, 1)}"


def _title_6(figures: Numbers, output: int) -> str:
    numbers = figures["figure_6"]
    return f"{port_words(numbers['input'])} torque to {port_words(numbers['outputs'][output])}"


def figure_6a(figures: Numbers) -> str:
    """The payload."""
    return _figure_6(figures, 0)


def figure_6b(figures: Numbers) -> str:
    """The bus."""
    return _figure_6(figures, 1)


def _figure_6(figures: Numbers, output: int) -> str:
    numbers = figures["figure_6"]
    name, band = port_words(numbers["outputs"][output]), numbers["magnitude_error_band_hz"]
    if band is None:
        follows = f"Nothing of the {name} is measured in 0.3 to 30 Hz, where models are compared"
    else:
        errors = {env: fixed(e[output], 2) for env, e in numbers["magnitude_error_db"].items()}
        follows = (
            f"In the {name} the 1-g model follows the simulated rig's magnitude within {errors['lab']} dB rms"
            f" from {band[0]:g} to {band[1]:g} Hz, the 0-g model within {errors['orbit']} dB"
        )
    if numbers["phase_gap_s"] is None:
        return f"{follows}; nothing is measured above 5 Hz, where the phase would show the rig's delay."
    return (
        f"{follows}, and what is left in phase above 5 Hz is a delay of"
        f" {fixed(1e3 * numbers['phase_gap_s'][output], 2)} ms, the rig's own being"
        f" {fixed(1e3 * numbers['delay_s'], 2)} ms."
    )


def figure_7a(figures: Numbers) -> str:
    """Better in 0-g, unstable in 1-g."""
    numbers = figures["figure_7"]
    top, first = numbers["all"]["orbit"]["db"][-1], numbers["all"]["first_instability"]
    change = (
        ""
        if top is None
        else f"{'improve' if top < 0.0 else 'worsen'} 0-g performance by {fixed(abs(top), 1)} dB"
    )
    gain = f"{change} at the top level" if change else "are unstable in 0-g itself at the top level"
    if first is None:
        return f"Controllers designed on the 0-g model {gain} and stay stable in 1-g."
    return (
        f"Controllers designed on the 0-g model {gain}, and in 1-g they are"
        f" {_first_unstable(numbers, first)}, where {_leads(first)}"
        " (crosses: unstable, so no decibels)."
    )


def figure_7b(figures: Numbers) -> str:
    """The flexible pair parts late."""
    numbers = figures["figure_7"]
    flexible = numbers["flexible"]
    first, apart = flexible["first_instability"], flexible["reference_db_lab_pd"]
    onset = (
        "stable throughout the search"
        if first is None
        else f"{_first_unstable(numbers, first)}, where {_leads(first)}"
    )
    return (
        f"With the flexible modes alone 1-g is {fixed(apart, 1)} dB from 0-g already under PD, and the"
        f" loop is {onset}."
    )


def _first_unstable(numbers: Numbers, first: Numbers) -> str:
    """Stability may return above; and below the first level nothing was searched."""
    level = f"log10 authority {fixed(first['log10_authority'], 2)}"
    if first["log10_authority"] <= numbers["log10_authority"][0]:
        return f"unstable already at the first level, {level}"
    return f"first unstable at {level}"


def _leads(first: Numbers) -> str:
    """Who goes first, and whether it oscillates."""
    if first["unstable_pairs"] == 0:
        return f"{first['mode_name']} leads a divergence (a real pole, no oscillation)"
    return f"{first['mode_name']} leads at {fixed(first['frequency_hz'], 2)} Hz"


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
    return (
        f"Controllers designed on the fit change the {angle} rms angle by {_change(numbers['low'])} at low"
        f" authority (CL1), by {_change(numbers['high'])} at high (CL2), and by {_change(numbers['robust'])}"
        f" where the design is for two records at once (CL3), the second with {pair} at"
        f" {signed(numbers['drifted']['shift_percent'])} %. With that pair moved,"
        f" {'; '.join(f'{who} is {held(numbers[key])}' for key, who in LOOPS.items())}."
    )


def title_10a(figures: Numbers) -> str:
    """Heading of the encoder's figure."""
    return f"Figure 10a: {_title_10(figures['figure_10a'])}"


def title_10b(figures: Numbers) -> str:
    """Heading of the bus's figure."""
    return f"Figure 10b: {_title_10(figures['figure_10b'])}"


def _title_10(numbers: Numbers) -> str:
    return f"{port_words(numbers['input'])} torque to {port_words(numbers['output'])} angle"


def figure_10a(figures: Numbers) -> str:
    """The encoder."""
    return _figure_10(figures["figure_10a"])


def figure_10b(figures: Numbers) -> str:
    """The bus."""
    return _figure_10(figures["figure_10b"])


def _figure_10(numbers: Numbers) -> str:
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
    """On which side of the axis a zero lies; both for one that its deviation may put on either."""
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
    """How far the loop goes, and what the lead does for it."""
    numbers = figures["figure_11"]
    *_, bare, lead = numbers["reach"]
    return (
        f"With encoder and bus fed back, a design on {bare['states']} states {_goes(bare)}; with a lead about"
        f" the pair near 9 Hz it {_goes(lead)}. The loop shown has the lead: it changes the payload's rms"
        f" angle by {_change(numbers['payload'])}, and is {held(numbers['payload'])}."
    )


def figure_12a(figures: Numbers) -> str:
    """The payload."""
    numbers = figures["figure_12"]
    above, deeper = numbers["payload_db_above_10_hz"]["both"], numbers["payload_deeper_db_7_to_9_hz"]
    return (
        f"A penalty on payload and bus changes the payload's rms angle by {_change(numbers['both'])}, and the"
        f" loop is {held(numbers['both'])}; above"
        f" 10 Hz it is {_apart(above)} in open loop, and at 7-9 Hz (shaded) {_apart(deeper)} under the"
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
    """As far as a design goes, and what ends it."""
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


def held(loop: Numbers) -> str:
    """On which shifts of the pair a loop stays stable on the rig, and on which it does not."""
    parts: list[str] = []
    for stable, word in ((True, "stable"), (False, "unstable")):
        moved = [on["percent"] for on in loop["rig"] if on["stable"] is stable and on["percent"]]
        parts += [f"{word} with the pair at {' and '.join(map(signed, moved))} %"] if moved else []
    return " but ".join(parts) or "not tried with the pair moved"


def signed(value: float) -> str:
    """With its sign.

    >>> signed(2.0)
    '+2'
    """
    return f"{value:+g}".replace("-", "\N{MINUS SIGN}")


def _change(loop: Numbers) -> str:
    predicted, measured = loop["predicted_db"], loop["measured_db"]
    foreseen = (
        "an amount that cannot be predicted (the fit or its loop is undamped in the band)"
        if predicted is None
        else f"{fixed(predicted, 2)} dB predicted"
    )
    if not loop["stable"]:
        return f"{foreseen} and unstable on the rig"
    return f"{foreseen} and {fixed(measured, 2)} dB measured"


def mirror(figures: Numbers) -> str:
    """Real data."""
    numbers = figures["mirror"]
    ours = " / ".join(fixed(100.0 * e, 2) for e in numbers["held_out_nrmse"])
    theirs = " / ".join(fixed(100.0 * e, 2) for e in numbers["published_nrmse"])
    return (
        f"On measurements of a real spacecraft steering mirror a model of {numbers['states']} states"
        f" leaves {ours} %"
        f" of the three outputs of a held-out record unexplained, where {theirs} % is published."
    )
