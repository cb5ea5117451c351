"""The tables under each figure, from the numbers that go to numbers.json."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter

from middeck.plot.ports import port_words
from middeck.report.sentences import half_plane
from middeck.report.words import UNDETERMINED, Numbers, Table, deviation, fixed, percent, significant, yes_no

SUB_MODELS = {"all": "full", "rigid": "rigid", "flexible": "flexible"}


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
    numbers, five = figures["figure_4"], figures["figure_5"]
    rows = [
        [
            str(j),
            numbers["lab"]["name"][j],
            str(i),
            fixed(five["matrix"][i][j], 4),
            fixed(five["mac"][i][j], 4),
        ]
        for i, j in numbers["pairs"]
    ]
    angles = [[str(k + 1), fixed(a, 3)] for k, a in enumerate(numbers["subspace_angle_deg"])]
    return [
        Table("Pairs of flexible modes", ("1-g", "mode in 1-g", "0-g", "cross-orthogonality", "MAC"), rows),
        Table("Angles between rigid-body and suspension subspace", ("angle", "[deg]"), angles),
    ]


def response_tables(figures: Numbers) -> list[Table]:
    """Magnitude errors and the delay that explains the phase."""
    numbers = figures["figure_6"]
    error, gap, band = (
        numbers["magnitude_error_db"],
        numbers["phase_gap_s"],
        numbers["magnitude_error_band_hz"],
    )
    rows = [
        [
            port_words(name),
            *(fixed(error[side] and error[side][k], 3) for side in ("orbit", "lab")),
            fixed(gap and 1e3 * gap[k], 4),
            fixed(1e3 * numbers["delay_s"], 4),
        ]
        for k, name in enumerate(numbers["outputs"])
    ]
    head = ("output", "0-g error [dB]", "1-g error [dB]", "phase gap as delay [ms]", "rig's delay [ms]")
    where = "" if band is None else f" in {band[0]:g}-{band[1]:g} Hz"
    return [Table(f"Models against the simulated rig, rms of log magnitude{where}", head, rows)]


def authority_tables(figures: Numbers) -> list[Table]:
    """Disturbance, reference, first instabilities and all decibels."""
    numbers = figures["figure_7"]
    metric = numbers["metric_3sigma_deg_pd"]
    references = [[f"1-g under PD alone, {name} [dB]", fixed(numbers[which]["reference_db_lab_pd"], 3)]
                  for which, name in SUB_MODELS.items()]  # fmt: skip
    rows = [
        [
            "disturbance intensity S_w, two-sided [(N m)²/Hz]",
            significant(numbers["disturbance_psd_two_sided"], 6),
        ],
        ["3σ of the metric, 0-g, PD alone [deg]", fixed(metric["orbit"], 4)],
        ["3σ of the metric, 1-g, PD alone [deg]", fixed(metric["lab"], 4)],
        *references,
    ]
    onsets = [[name, *_onset(numbers[which]["first_instability"])] for which, name in SUB_MODELS.items()]
    head = ("model", "log10 authority", "pole [Hz]", "leading mode", "mode [Hz]", "participation",
            "compensator's share")  # fmt: skip
    columns = [(which, env) for which in SUB_MODELS for env in ("orbit", "lab")]
    levels = [
        [fixed(level, 2), *(_decibels(numbers[which][env], k) for which, env in columns)]
        for k, level in enumerate(numbers["log10_authority"])
    ]
    gravity = {"orbit": "0-g", "lab": "1-g"}
    names = tuple(f"{SUB_MODELS[which]} {gravity[env]} [dB]" for which, env in columns)
    return [
        Table("Disturbance and reference", ("quantity", "value"), rows),
        Table("First instability in 1-g", head, onsets),
        Table("Performance against authority", ("log10 authority", *names), levels),
    ]


def _onset(first: Numbers | None) -> list[str]:
    if first is None:
        return ["none found", *["–"] * 5]
    return [
        fixed(first["log10_authority"], 3),
        fixed(first["frequency_hz"], 4) if first["unstable_pairs"] else "divergence",
        first["mode_name"],
        fixed(first["mode_frequency_hz"], 4),
        fixed(first["participation"], 3),
        fixed(first["compensator_share"], 3),
    ]


def _decibels(side: Numbers, level: int) -> str:
    return fixed(side["db"][level], 2) if side["stable"][level] else "unstable"


def fit_tables(figures: Numbers) -> list[Table]:
    """The fitted poles and delay."""
    numbers = figures["figure_9a"]
    columns = (numbers[k] for k in ("natural_hz", "natural_hz_deviation", "damping", "damping_deviation"))
    modes = [
        [fixed(f, 4), deviation(df), percent(z, 3), UNDETERMINED if dz is None else percent(dz, 3)]
        for f, df, z, dz in sorted(zip(*columns, strict=True), key=itemgetter(0, 2))
    ]
    delay_ms = 1e3 * numbers["delay_s"]
    rows = [
        ["states of the fit", str(numbers["states"])],
        ["states of the design plant, Padé delay included", str(numbers["plant_states"])],
        ["delay [ms]", f"{fixed(delay_ms, 4)} {deviation(numbers['delay_deviation_s'], 1e-3, '± ')}"],
        ["band of the fit [Hz]", " to ".join(f"{f:g}" for f in numbers["fit_band_hz"])],
        ["relative complex error in that band", percent(numbers["relative_error"], 3)],
    ]  # fmt: skip
    head = ("natural frequency [Hz]", "± [Hz]", "damping", "±")
    return [
        Table("Fitted modes, one standard deviation", head, modes),
        Table("The fit", ("quantity", "value"), rows),
    ]


def loop_tables(figures: Numbers) -> list[Table]:
    """The three loops, mode by mode, and on the shifted rig."""
    numbers = figures["figure_9b"]
    loops = {f"CL{k + 1}": numbers[name] for k, name in enumerate(("low", "high", "robust"))}
    drifted, fitted = numbers["drifted"], figures["figure_9a"]
    both = zip(sorted(fitted["natural_hz"]), sorted(drifted["natural_hz"]), strict=True)
    shift = f"{drifted['shift_percent']:+g}".replace("-", "\N{MINUS SIGN}")
    return [
        _loops_table("Payload rms angle in the band, over the open loop's", loops),
        _modes_table(loops),
        _rig_table(loops | {"LQG for one record at CL3's authority": {"rig": numbers["one_model"]}},
                   numbers["pair_shift_hz"]),
        Table("Modes of the two records that CL3 is for",
              ("first record [Hz]", f"pair at {shift} % [Hz]"),
              [[fixed(f, 4), fixed(g, 4)] for f, g in both]),
    ]  # fmt: skip


def reach_tables(figures: Numbers) -> list[Table]:
    """How far each design goes, then the loop that was measured."""
    numbers = figures["figure_11"]
    rows = [
        [
            reach["what"],
            fixed(reach["log10_authority"], 2),
            fixed(reach["predicted_db"], 2),
            fixed(reach["least_db"], 2),
            fixed(reach["stopped_hz"], 2),
            "–" if reach["stopped_percent"] is None else fixed(reach["stopped_percent"], 0),
        ]
        for reach in numbers["reach"]
    ]
    head = ("design on", "last stable log10 authority", "predicted [dB]", "least on the rig [dB]",
            "then unstable at [Hz]", "with the pair at [%]")  # fmt: skip
    loops = {"payload": numbers["payload"]}
    return [
        Table("How far each design goes, with the pair moved to either side and not", head, rows),
        _loops_table("Payload rms angle in the band, over the open loop's, payload penalty", loops),
        _modes_table(loops, "payload penalty"),
        _rig_table(loops, figures["figure_9b"]["pair_shift_hz"] if "figure_9b" in figures else None),
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
        _loops_table("Payload rms angle in the band, over the open loop's, both penalties", loops),
        Table("Measured rms in parts of the band, over the open loop's", head, rows),
        _modes_table(loops, "both penalties"),
        _rig_table(loops, figures["figure_9b"]["pair_shift_hz"] if "figure_9b" in figures else None),
    ]


def _loops_table(caption: str, loops: Numbers) -> Table:
    rows = [
        [
            name,
            fixed(loop["log10_authority"], 2),
            fixed(loop["predicted_db"], 3),
            fixed(loop["measured_db"], 3),
            fixed(loop["rms_error_db"], 3),
            fixed(loop["worst_error_db"], 2),
            fixed(loop["worst_hz"], 2),
            fixed(loop["control_rms_nm"], 3),
        ]
        for name, loop in loops.items()
    ]
    head = ("loop", "log10 authority", "predicted [dB]", "measured [dB]", "error of rms [dB]",
            "largest error of a line [dB]", "at [Hz]", "torque of the law, rms [N m]")  # fmt: skip
    return Table(caption, head, rows)


def _modes_table(loops: Numbers, which: str = "CL1, CL2, CL3") -> Table:
    """Modes of the fit down, loops across; a loop that was not measured has none."""
    frequencies = next((loop["modes"] for loop in loops.values() if loop["modes"]), [])
    rows = [["static", *(fixed(loop["static_db"], 1) for loop in loops.values())]]
    for k, mode in enumerate(frequencies):
        cells = (fixed(loop["modes"][k]["db"] if loop["modes"] else None, 1) for loop in loops.values())
        rows.append([f"{mode['frequency_hz']:.2f} Hz", *cells])
    head = ("payload at", *(f"{name} [dB]" for name in loops))
    return Table(f"Measured peaks over the open loop's, {which}", head, rows)


def _rig_table(loops: Numbers, pair_hz: float | None) -> Table:
    rows = [
        [
            name,
            fixed(on["percent"], 0),
            "stable" if on["stable"] else f"unstable at {fixed(on['growth_hz'], 2)} Hz",
            fixed(on["improvement_db"], 2),
            fixed(on["gain_margin_db"], 1),
            fixed(on["gain_margin_hz"], 2),
            fixed(on["phase_margin_deg"], 1),
            fixed(on["phase_margin_hz"], 2),
        ]
        for name, loop in loops.items()
        for on in loop["rig"]
    ]
    pair = "the pair" if pair_hz is None else f"the pair near {pair_hz:g} Hz"
    head = ("loop", "shift [%]", "loop is", "payload [dB]", "gain margin [dB]", "at [Hz]",
            "phase margin [deg]", "at [Hz]")  # fmt: skip
    return Table(f"On the rig without limits and noise, {pair} shifted: {', '.join(loops)}", head, rows)


def encoder_tables(figures: Numbers) -> list[Table]:
    """Common poles, then what is the encoder's own."""
    numbers = figures["figure_10a"]
    columns = (numbers[k] for k in ("natural_hz", "natural_hz_deviation", "damping", "damping_deviation"))
    poles = [
        [fixed(f, 4), deviation(df), percent(z, 3), UNDETERMINED if dz is None else percent(dz, 3)]
        for f, df, z, dz in sorted(zip(*columns, strict=True), key=itemgetter(0, 2))
    ]
    head = ("natural frequency [Hz]", "± [Hz]", "damping", "±")
    return [Table("Poles common to the three sensors, one standard deviation", head, poles),
            *_path_tables(numbers)]  # fmt: skip


def bus_tables(figures: Numbers) -> list[Table]:
    """What is the bus's own."""
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


def mirror_tables(figures: Numbers) -> list[Table]:
    """Held-out error beside the published one."""
    numbers = figures["mirror"]
    outputs = list(dict.fromkeys(entry["output"] for entry in numbers["entries"]))
    columns = (numbers[k] for k in ("held_out_nrmse", "published_nrmse", "relative_error"))
    rows = [
        [name, percent(ours), percent(theirs), yes_no(ours <= theirs), percent(error)]
        for name, ours, theirs, error in zip(outputs, *columns, strict=True)
    ]
    head = ("output", "held-out NRMSE", "published", "no worse", "relative error of the fit")
    return [Table(f"{numbers['states']} states on the 300 mV record", head, rows)]


TABLES: dict[str, Callable[[Numbers], list[Table]]] = {
    "figure-3": rest_tables,
    "figure-4": mode_tables,
    "figure-5": orthogonality_tables,
    "figure-6b": response_tables,
    "figure-7b": authority_tables,
    "figure-9a": fit_tables,
    "figure-9b": loop_tables,
    "figure-10a": encoder_tables,
    "figure-10b": bus_tables,
    "figure-11": reach_tables,
    "figure-12b": both_tables,
    "mirror": mirror_tables,
}
