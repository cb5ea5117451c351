"""Sentences and tables of Figures 7a and 7b."""

from middeck.study.words import Line, Numbers, Table, cells, fixed, significant


def figure_7a(figures: Numbers) -> str:
    """Better in 0-g, unstable in 1-g."""
    numbers = figures["figure_7"]
    top, first = numbers["all"]["orbit"]["db"][-1], numbers["all"]["first_instability"]
    change = (
        ""
        if top is None
        else f"{'reduce' if top < 0.0 else 'raise'} the error in 0-g by {fixed(abs(top), 1)} dB"
    )
    gain = f"{change} at the highest authority" if change else "are unstable in 0-g at the highest authority"
    if first is None:
        return f"Controllers designed on the 0-g model {gain} and stay stable in 1-g."
    return (
        f"Controllers designed on the 0-g model {gain}. In 1-g they are {_first_unstable(numbers, first)}"
        f" with {_leads(first)}. Crosses mark unstable loops."
    )


def figure_7b(figures: Numbers) -> str:
    """The flexible sub-models differ at high authority only."""
    numbers = figures["figure_7"]
    flexible = numbers["flexible"]
    first, apart = flexible["first_instability"], flexible["reference_db_lab_pd"]
    onset = (
        "stable throughout the search"
        if first is None
        else f"{_first_unstable(numbers, first)} with {_leads(first)}"
    )
    side = "above" if apart >= 0.0 else "below"
    return (
        "In the model with the flexible modes alone and PD loops, the error in"
        f" 1-g is {fixed(abs(apart), 1)} dB {side} that in 0-g. The LQG loop in 1-g is {onset}."
    )


def _first_unstable(numbers: Numbers, first: Numbers) -> str:
    """Stability may return above; and below the first level nothing was searched."""
    level = f"log10 authority {fixed(first['log10_authority'], 2)}"
    if first["log10_authority"] <= numbers["log10_authority"][0]:
        return f"unstable already at the first level, {level}"
    return f"first unstable at {level}"


def _leads(first: Numbers) -> str:
    """The unstable pole and the mode of most participation."""
    if first["unstable_pairs"] == 0:
        pole = "a real pole (divergence)"
    else:
        pole = f"a pole at {fixed(first['frequency_hz'], 2)} Hz"
    return f"{pole}, in which {first['mode_name']} has the largest participation"


def result(figures: Numbers) -> Line:
    """The highest authority in 0-g, the first instability in 1-g."""
    numbers = figures["figure_7"]
    top, first = numbers["all"]["orbit"]["db"][-1], numbers["all"]["first_instability"]
    orbit = (
        "unstable at the highest authority" if top is None else f"{fixed(top, 1)} dB at the highest authority"
    )
    lab = (
        "stable at all that were tried"
        if first is None
        else f"unstable from log10 authority {fixed(first['log10_authority'], 2)} on ({first['mode_name']})"
    )
    return Line(
        f"Pointing error with controllers designed for 0-g: in 0-g {orbit}; in 1-g {lab}.", "figure-7a"
    )


SUB_MODELS = {"all": "full", "rigid": "rigid", "flexible": "flexible"}


def authority_tables(figures: Numbers) -> list[Table]:
    """Disturbance, reference, first instabilities and all decibels."""
    numbers = figures["figure_7"]
    known = {which: name for which, name in SUB_MODELS.items() if which in numbers}
    intensity, metric = numbers["disturbance_psd_two_sided"], numbers["metric_3sigma_deg_pd"]
    references = [[f"1-g under PD alone, {name} [dB]", fixed(numbers[which]["reference_db_lab_pd"], 3)]
                  for which, name in known.items()]  # fmt: skip
    rows = [
        ["disturbance intensity, two-sided [(N m)²/Hz]", significant(intensity, 6)],
        ["3σ of the metric, 0-g, PD alone [deg]", fixed(metric["orbit"], 4)],
        ["3σ of the metric, 1-g, PD alone [deg]", fixed(metric["lab"], 4)],
        *references,
    ]
    onsets = [[name, *_onset(numbers[which]["first_instability"])] for which, name in known.items()]
    head = ("model", "log10 authority", "pole [Hz]", "leading mode", "mode [Hz]", "participation",
            "compensator's share")  # fmt: skip
    columns = [(which, env) for which in known for env in ("orbit", "lab")]
    levels = [
        [fixed(level, 2), *(_decibels(numbers[which][env], k) for which, env in columns)]
        for k, level in enumerate(numbers["log10_authority"])
    ]
    gravity = {"orbit": "0-g", "lab": "1-g"}
    names = tuple(f"{known[which]} {gravity[env]} [dB]" for which, env in columns)
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
        *cells(first, {"mode_frequency_hz": 4, "participation": 3, "compensator_share": 3}),
    ]


def _decibels(side: Numbers, level: int) -> str:
    return fixed(side["db"][level], 2) if side["stable"][level] else "unstable"
