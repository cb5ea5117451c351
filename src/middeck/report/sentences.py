"""One sentence for each figure: what it shows, in the numbers of numbers.json."""

from __future__ import annotations

import numpy as np

from middeck.report.words import Numbers, fixed, percent


def figure_3(figures: Numbers) -> str:
    """What hanging does to the shape."""
    lab = figures["figure_4"]["lab"]
    load = sum(lab["reactions_n"].values())
    joint, torque = max(lab["holding_torque_nm"].items(), key=lambda item: abs(item[1]))
    return (
        f"The article as it floats in 0-g and as it hangs in 1-g, where its cables carry {fixed(load, 1)}"
        " N, the"
        f" bus sags between them and the gimbal motor {joint} has to hold {fixed(torque, 2)} N m."
    )


def figure_4(figures: Numbers) -> str:
    """Stiffening and softening."""
    numbers = figures["figure_4"]
    hung = [f for f, k in zip(numbers["lab"]["frequency_hz"], numbers["lab"]["kind"], strict=True)
            if k == "suspension"]  # fmt: skip
    ratio = np.array(numbers["ratio"])
    return (
        f"The {len(hung)} rigid-body modes of 0-g become suspension and pendulum modes of"
        f" {fixed(min(hung), 3)} to"
        f" {fixed(max(hung), 3)} Hz, and the flexible modes shift by"
        f" {fixed(100.0 * (ratio.min() - 1.0), 2)} to"
        f" {fixed(100.0 * (ratio.max() - 1.0), 2)} %."
    )


def figure_5(figures: Numbers) -> str:
    """Who couples."""
    matrix = np.array(figures["figure_5"]["matrix"])
    pairs = np.array(figures["figure_4"]["pairs"])
    paired = matrix[pairs[:, 0], pairs[:, 1]]
    block = matrix[np.ix_(pairs[:, 0], pairs[:, 1])] * (1.0 - np.eye(len(pairs)))
    row, column = np.unravel_index(np.argmax(block), block.shape)
    return (
        "Without gravity's effects the matrix would be diagonal: the rigid-body modes mix into one coupled"
        f" subspace, while flexible modes keep their pairs ({fixed(float(paired.min()), 3)} or more) and"
        " couple"
        f" mostly to neighbours (largest {fixed(float(block.max()), 3)}, 0-g mode {pairs[row, 0]} with"
        " 1-g mode"
        f" {pairs[column, 1]})."
    )


def figure_6a(figures: Numbers) -> str:
    """The payload."""
    return _figure_6(figures, 0, "payload")


def figure_6b(figures: Numbers) -> str:
    """The bus."""
    return _figure_6(figures, 1, "bus")


def _figure_6(figures: Numbers, output: int, name: str) -> str:
    numbers = figures["figure_6"]
    errors = {env: fixed(e[output], 2) for env, e in numbers["magnitude_error_db"].items()}
    return (
        f"In the {name} rate the 1-g model follows the simulated rig's magnitude within {errors['lab']}"
        " dB rms from"
        f" 0.3 to 30 Hz, the 0-g model within {errors['orbit']} dB, and what is left in phase above 5 Hz"
        " is a delay"
        f" of {fixed(1e3 * numbers['phase_gap_s'][output], 2)} ms, the rig's own being"
        f" {fixed(1e3 * numbers['delay_s'], 2)} ms."
    )


def figure_7a(figures: Numbers) -> str:
    """Better in 0-g, unstable in 1-g."""
    numbers = figures["figure_7"]
    top, first = numbers["all"]["orbit"]["db"][-1], numbers["all"]["first_instability"]
    gain = (
        f"improve 0-g performance by {fixed(-top, 1)} dB" if top is not None else "are unstable in 0-g itself"
    )
    if first is None:
        return f"Controllers designed on the 0-g model {gain} and stay stable in 1-g."
    return (
        f"Controllers designed on the 0-g model {gain} at the top level, but in 1-g they are unstable"
        " from log10"
        f" authority {fixed(first['log10_authority'], 2)} on, where {first['mode_name']} at"
        f" {fixed(first['frequency_hz'], 2)} Hz leads (crosses: unstable, so no decibels)."
    )


def figure_7b(figures: Numbers) -> str:
    """The flexible pair parts late."""
    numbers = figures["figure_7"]["flexible"]
    first, apart = numbers["first_instability"], numbers["reference_db_lab_pd"]
    onset = (
        "never within the search"
        if first is None
        else f"only from log10 authority {fixed(first['log10_authority'], 2)} on ({first['mode_name']})"
    )
    return (
        f"With the flexible modes alone 1-g is {fixed(apart, 1)} dB from 0-g already under PD, and the"
        " loop goes"
        f" unstable {onset}."
    )


def figure_9a(figures: Numbers) -> str:
    """The fit."""
    numbers = figures["figure_9a"]
    low, high = numbers["fit_band_hz"]
    return (
        f"A fit of {numbers['states']} states and a delay of {fixed(1e3 * numbers['delay_s'], 2)} ms"
        " follows the"
        f" measured response from {low:g} to {high:g} Hz within {percent(numbers['relative_error'])}"
        " (relative"
        " complex error); the suspension mode below that band lies outside the fit."
    )


def figure_9b(figures: Numbers) -> str:
    """Prediction and measurement."""
    numbers = figures["figure_9b"]
    parts = [
        f"{fixed(loop['predicted_db'], 2)} dB predicted and "
        + (f"{fixed(loop['measured_db'], 2)} dB measured" if loop["stable"] else "unstable on the rig")
        + f" at {name} authority"
        for name, loop in ((name, numbers[name]) for name in ("low", "high"))
    ]
    return f"Controllers designed on the fit change the payload's rms angle by {' and '.join(parts)}."


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
