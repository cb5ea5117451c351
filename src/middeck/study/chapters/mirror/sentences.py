"""What the mirror's figure shows."""

from __future__ import annotations

from middeck.study.words import Line, Numbers, fixed, percent


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


def result(figures: Numbers) -> Line:
    """The largest held-out error beside the largest published one."""
    numbers = figures["mirror"]
    ours, theirs = (max(numbers[key]) for key in ("held_out_nrmse", "published_nrmse"))
    return Line(
        f"On a real mirror the model leaves at most {percent(ours)} of a held-out record unexplained;"
        f" {percent(theirs)} is published.",
        "mirror",
    )
