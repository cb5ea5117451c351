"""Sentences and tables of Figures 3, 4 and 5."""

import numpy as np

from middeck.study.words import Line, Numbers, Table, fixed

COUPLED = 0.1  # cross-orthogonality from which two modes are called coupled
PAIRED = 0.9  # and above which a flexible mode has kept its pair


def figure_3(figures: Numbers) -> str:
    """The shape under gravity."""
    lab = figures["figure_4"]["lab"]
    loads, torques = lab["reactions_n"], lab["holding_torque_nm"]
    facts = [f"its cables carry {fixed(sum(loads.values()), 1)} N"] if loads else []
    if torques:
        joint, torque = max(torques.items(), key=lambda item: abs(item[1]))
        facts.append(f"the gimbal motor {joint} has to hold {fixed(torque, 2)} N m")
    where = f", where {' and '.join(facts)}" if facts else ""
    return f"The article as it floats in 0-g and as it {'hangs' if loads else 'stands'} in 1-g{where}."


def figure_4(figures: Numbers) -> str:
    """Stiffening and softening."""
    numbers = figures["figure_4"]
    hung = [f for f, k in zip(numbers["lab"]["frequency_hz"], numbers["lab"]["kind"], strict=True)
            if k == "suspension"]  # fmt: skip
    ratio = np.array(numbers["ratio"])
    flexible = "no flexible mode is among those compared"
    if len(ratio):
        low, high = (fixed(100.0 * (r - 1.0), 2) for r in (ratio.min(), ratio.max()))
        flexible = f"the flexible modes shift by {low} to {high} %"
    if not hung:
        return f"In 1-g no mode is one of a suspension; {flexible}."
    span = f"{fixed(min(hung), 3)} to {fixed(max(hung), 3)} Hz{', and' if len(ratio) else ';'}"
    return (
        f"The {len(hung)} rigid-body modes of 0-g become suspension and pendulum modes of {span} {flexible}."
    )


def figure_5(figures: Numbers) -> str:
    """Coupling between modes."""
    matrix = np.array(figures["figure_5"]["matrix"])
    pairs = np.array(figures["figure_4"]["pairs"], dtype=int).reshape(-1, 2)
    sides = [figures["figure_4"][side]["kind"] for side in ("orbit", "lab")]
    rigid, hung = ([i for i, k in enumerate(kinds) if k != "flexible"] for kinds in sides)
    ideal = "Without gravity and suspension the matrix would be diagonal."
    parts = []
    if rigid and hung:
        mixed = int(np.count_nonzero(matrix[np.ix_(rigid, hung)] > COUPLED))
        parts.append(
            f" {mixed} of the {len(rigid) * len(hung)} entries between rigid-body and suspension modes exceed"
            f" {COUPLED:g}."
        )
    if len(pairs) > 1:
        parts.append(_flexible_couplings(matrix, pairs))
    return ideal + "".join(parts)


def _flexible_couplings(matrix: np.ndarray, pairs: np.ndarray) -> str:
    paired = float(matrix[pairs[:, 0], pairs[:, 1]].min())
    block = matrix[np.ix_(pairs[:, 0], pairs[:, 1])] * (1.0 - np.eye(len(pairs)))
    row, column = (int(k) for k in np.unravel_index(np.argmax(block), block.shape))
    keeps = "Every flexible mode keeps" if paired > PAIRED else "Not every flexible mode keeps"
    beside = "its neighbour" if abs(row - column) == 1 else "not its neighbour"
    return (
        f" {keeps} its pair: the smallest entry of a pair is {fixed(paired, 3)}."
        " The largest entry outside the"
        f" pairs is {fixed(float(block.max()), 3)} (0-g mode {pairs[row, 0]} with 1-g mode"
        f" {pairs[column, 1]}, {beside})."
    )


def result(figures: Numbers) -> Line:
    """The shift of the flexible modes."""
    ratio = figures["figure_4"]["ratio"]
    if not ratio:
        return Line("No flexible mode is among those compared.", "figure-4")
    low, high = (fixed(100.0 * (r - 1.0), 1) for r in (min(ratio), max(ratio)))
    return Line(f"Gravity and suspension shift the flexible modes by {low} to {high} %.", "figure-4")


def rest_tables(figures: Numbers) -> list[Table]:
    """Loads of the cables and torques of the motors in 1-g."""
    lab = figures["figure_4"]["lab"]
    tables = [
        Table("Pinned reactions (1-g)", ("attach point", "reaction [N]"),
              [[name, fixed(v, 2)] for name, v in lab["reactions_n"].items()]),
        Table("Holding torques (1-g)", ("joint", "torque [N m]"),
              [[name, fixed(v, 4)] for name, v in lab["holding_torque_nm"].items()]),
        Table("Rotation of the nodes at rest (1-g)", ("node", "x [deg]", "y [deg]", "z [deg]"),
              [[name, *(fixed(a, 4) for a in v)] for name, v in lab["node_rotation_deg"].items()]),
    ]  # fmt: skip
    return [table for table in tables if table.rows]


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
    tables = [
        Table("Pairs of flexible modes", ("1-g", "mode in 1-g", "0-g", "cross-orthogonality", "MAC"), rows),
        Table("Angles between rigid-body and suspension subspace", ("angle", "[deg]"), angles),
    ]
    return [table for table in tables if table.rows]
