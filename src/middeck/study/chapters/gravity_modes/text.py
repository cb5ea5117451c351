"""Sentences and tables of Figures 3, 4 and 5."""

from __future__ import annotations

import numpy as np

from middeck.study.words import Line, Numbers, Table, fixed

COUPLED = 0.1  # cross-orthogonality from which on two modes are said to mix
PAIRED = 0.9  # and above which a flexible mode has kept its pair


def figure_3(figures: Numbers) -> str:
    """The shape under gravity."""
    lab = figures["figure_4"]["lab"]
    load = sum(lab["reactions_n"].values())
    joint, torque = max(lab["holding_torque_nm"].items(), key=lambda item: abs(item[1]))
    return (
        f"The article as it floats in 0-g and as it hangs in 1-g, where its cables carry {fixed(load, 1)} N"
        f" and the gimbal motor {joint} has to hold {fixed(torque, 2)} N m."
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
    """Coupling between modes."""
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


def result(figures: Numbers) -> Line:
    """The shift of the flexible modes."""
    ratio = figures["figure_4"]["ratio"]
    if not ratio:
        return Line("No flexible mode is among those compared.", "figure-4")
    low, high = (fixed(100.0 * (r - 1.0), 1) for r in (min(ratio), max(ratio)))
    return Line(f"Gravity and suspension shift the flexible modes by {low} to {high} %.", "figure-4")


def rest_tables(figures: Numbers) -> list[Table]:
    """What the cables carry and the motors hold in 1-g."""
    lab = figures["figure_4"]["lab"]
    return [
        Table("Pinned reactions (1-g)", ("attach point", "reaction [N]"),
              [[name, fixed(v, 2)] for name, v in lab["reactions_n"].items()]),
        Table("Holding torques (1-g)", ("joint", "torque [N m]"),
              [[name, fixed(v, 4)] for name, v in lab["holding_torque_nm"].items()]),
        Table("Rotation of the nodes at rest (1-g)", ("node", "x [deg]", "y [deg]", "z [deg]"),
              [[name, *(fixed(a, 4) for a in v)] for name, v in lab["node_rotation_deg"].items()]),
    ]  # fmt: skip


def mode_tables(figures: Numbers) -> list[Table]:
    """All modes of both environments, flexible ones beside their pair."""
    numbers = figures["figure_4"]
    orbit, lab = numbers["orbit"], numbers["lab"]
    ratio = {j: (i, r) for (i, j), r in zip(numbers["pairs"], numbers["ratio"], strict=True)}
    partner = {j: i for j, (i, _) in ratio.items()}
    unpaired = [i for i in range(len(orbit["name"])) if i not in partner.values()]
    rest = iter(unpaired)
    rows: list[list[str]] = []
    for j, name in enumerate(lab["name"]):
        i = partner[j] if j in partner else next(rest, None)
        left = (
            ["–", "–", "–"] if i is None else [str(i), orbit["name"][i], fixed(orbit["frequency_hz"][i], 4)]
        )
        quotient = fixed(ratio[j][1], 4) if j in ratio else "–"
        rows.append([str(j), name, fixed(lab["frequency_hz"][j], 4), *left, quotient])
    head = ("1-g", "mode in 1-g", "[Hz]", "0-g", "mode in 0-g", "[Hz]", "ratio")
    return [Table("Frequencies; rigid-body and suspension modes are not paired", head, rows)]


def orthogonality_tables(figures: Numbers) -> list[Table]:
    """The pairs, and the rigid subspace."""
    numbers, matrix, mac = figures["figure_4"], figures["figure_5"]["matrix"], figures["figure_5"]["mac"]
    rows = [
        [str(j), numbers["lab"]["name"][j], str(i), fixed(matrix[i][j], 4), fixed(mac[i][j], 4)]
        for i, j in numbers["pairs"]
    ]
    angles = [[str(k + 1), fixed(a, 3)] for k, a in enumerate(numbers["subspace_angle_deg"])]
    return [
        Table("Pairs of flexible modes", ("1-g", "mode in 1-g", "0-g", "cross-orthogonality", "MAC"), rows),
        Table("Angles between rigid-body and suspension subspace", ("angle", "[deg]"), angles),
    ]
