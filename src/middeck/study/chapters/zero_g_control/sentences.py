"""What Figures 7a and 7b show."""

from __future__ import annotations

from middeck.study.words import Line, Numbers, fixed


def figure_7a(figures: Numbers) -> str:
    """Better in 0-g, unstable in 1-g."""
    numbers = figures["figure_7"]
    top, first = numbers["all"]["orbit"]["db"][-1], numbers["all"]["first_instability"]
    change = (
        ""
        if top is None
        else f"{'improve' if top < 0.0 else 'worsen'} 0-g performance by {fixed(abs(top), 1)} dB"
    )
    gain = f"{change} at the top level" if change else "are unstable in 0-g itself at the top level"
    if first is None:
        return f"Controllers designed on the 0-g model {gain} and stay stable in 1-g."
    return (
        f"Controllers designed on the 0-g model {gain}, and in 1-g they are"
        f" {_first_unstable(numbers, first)}, where {_leads(first)}"
        " (crosses: unstable, so no decibels)."
    )


def figure_7b(figures: Numbers) -> str:
    """The flexible sub-models differ at high authority only."""
    numbers = figures["figure_7"]
    flexible = numbers["flexible"]
    first, apart = flexible["first_instability"], flexible["reference_db_lab_pd"]
    onset = (
        "stable throughout the search"
        if first is None
        else f"{_first_unstable(numbers, first)}, where {_leads(first)}"
    )
    return (
        f"With the flexible modes alone 1-g is {fixed(apart, 1)} dB from 0-g already under PD, and the"
        f" loop is {onset}."
    )


def _first_unstable(numbers: Numbers, first: Numbers) -> str:
    """Stability may return above; and below the first level nothing was searched."""
    level = f"log10 authority {fixed(first['log10_authority'], 2)}"
    if first["log10_authority"] <= numbers["log10_authority"][0]:
        return f"unstable already at the first level, {level}"
    return f"first unstable at {level}"


def _leads(first: Numbers) -> str:
    """Who goes first, and whether it oscillates."""
    if first["unstable_pairs"] == 0:
        return f"{first['mode_name']} leads a divergence (a real pole, no oscillation)"
    return f"{first['mode_name']} leads at {fixed(first['frequency_hz'], 2)} Hz"


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
    return Line(f"Controllers designed for 0-g: in 0-g {orbit}; in 1-g {lab}.", "figure-7a")
