"""The table under the mirror's figure."""

from __future__ import annotations

from middeck.study.words import Numbers, Table, percent


def mirror_tables(figures: Numbers) -> list[Table]:
    """Held-out error beside the published one."""
    numbers = figures["mirror"]
    outputs = list(dict.fromkeys(entry["output"] for entry in numbers["entries"]))
    columns = (numbers[k] for k in ("held_out_nrmse", "published_nrmse", "relative_error"))
    rows = [
        [name, percent(ours), percent(theirs), "yes" if ours <= theirs else "no", percent(error)]
        for name, ours, theirs, error in zip(outputs, *columns, strict=True)
    ]
    head = ("output", "held-out NRMSE", "published", "no worse", "relative error of the fit")
    return [Table(f"{numbers['states']} states on the 300 mV record", head, rows)]
