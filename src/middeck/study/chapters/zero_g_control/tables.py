"""Tables under Figure 7."""

from __future__ import annotations

from middeck.study.words import Numbers, Table, cells, fixed, significant

SUB_MODELS = {"all": "full", "rigid": "rigid", "flexible": "flexible"}


def authority_tables(figures: Numbers) -> list[Table]:
    """Disturbance, reference, first instabilities and all decibels."""
    numbers = figures["figure_7"]
    intensity, metric = numbers["disturbance_psd_two_sided"], numbers["metric_3sigma_deg_pd"]
    references = [[f"1-g under PD alone, {name} [dB]", fixed(numbers[which]["reference_db_lab_pd"], 3)]
                  for which, name in SUB_MODELS.items()]  # fmt: skip
    rows = [
        ["disturbance intensity S_w, two-sided [(N m)²/Hz]", significant(intensity, 6)],
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
        *cells(first, {"mode_frequency_hz": 4, "participation": 3, "compensator_share": 3}),
    ]


def _decibels(side: Numbers, level: int) -> str:
    return fixed(side["db"][level], 2) if side["stable"][level] else "unstable"
