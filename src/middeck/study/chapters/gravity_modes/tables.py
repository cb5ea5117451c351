"""Tables under Figures 3, 4 and 5."""

from __future__ import annotations

from middeck.study.words import Numbers, Table, fixed


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
