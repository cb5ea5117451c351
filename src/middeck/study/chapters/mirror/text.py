"""Sentences and table of the mirror."""

from middeck.study.words import Line, Numbers, Table, fixed, percent


def mirror(figures: Numbers) -> str:
    """Real data."""
    numbers = figures["mirror"]
    ours = " / ".join(fixed(100.0 * e, 2) for e in numbers["held_out_nrmse"])
    theirs = " / ".join(fixed(100.0 * e, 2) for e in numbers["published_nrmse"])
    return (
        f"On a held-out record of a real spacecraft steering mirror, the rms error of a model of"
        f" {numbers['states']} states is {ours} % of the rms of the three outputs. Published are {theirs} %."
    )


def result(figures: Numbers) -> Line:
    """The largest held-out error beside the largest published one."""
    numbers = figures["mirror"]
    ours, theirs = (max(numbers[key]) for key in ("held_out_nrmse", "published_nrmse"))
    return Line(
        f"Largest relative rms error on a held-out record of a real mirror: {percent(ours)}, published"
        f" {percent(theirs)}.",
        "mirror",
    )


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
