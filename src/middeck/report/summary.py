"""The first screen: what came out, in a line each, and what does not hold, with its number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from middeck.report.sentences import LOOPS, held
from middeck.report.words import Numbers, fixed, percent, significant


class Line(NamedTuple):
    """One line and the section that shows it."""

    text: str
    section: str


class ClaimRow(NamedTuple):
    """One row of the claims: where it is shown, what is claimed, whether it holds, its number and limit."""

    section: str
    claim: str
    holds: bool
    number: str
    asked: str


class Warned(NamedTuple):
    """A warning of a fit or of modes, and the section whose numbers it is about."""

    section: str
    text: str


# Where the warnings of each figure's numbers are shown.
SECTIONS = {
    "figure_4": "figure-4",
    "figure_5": "figure-5",
    "figure_6": "figure-6b",
    "figure_7": "figure-7b",
    "figure_9a": "figure-9a",
    "figure_9b": "figure-9b",
    "figure_10a": "figure-10a",
    "figure_10b": "figure-10b",
    "figure_11": "figure-11",
    "figure_12": "figure-12b",
    "mirror": "mirror",
}


def warned(figures: Numbers) -> list[Warned]:
    """Every warning that stands anywhere in ``figures``; one that several figures share, once."""
    found: dict[str, str] = {}
    for figure, numbers in figures.items():
        for text in _warnings(numbers):
            found.setdefault(text, SECTIONS[figure])
    return [Warned(section, text) for text, section in found.items()]


def _warnings(numbers: object) -> Iterator[str]:
    if isinstance(numbers, dict):
        for key, value in numbers.items():
            yield from value if key == "warnings" else _warnings(value)
    elif isinstance(numbers, list):
        for value in numbers:
            yield from _warnings(value)


def came_out(figures: Numbers, claims: list[ClaimRow]) -> list[Line]:
    """The result of each part of the study that was run."""
    lines = (
        [Line(f"{sum(row.holds for row in claims)} of {len(claims)} claims hold.", "claims")]
        if claims
        else []
    )
    parts = {
        "figure_4": _modes,
        "figure_7": _zero_g,
        "figure_9b": _measured,
        "figure_12": _both,
        "mirror": _mirror,
    }
    return [*lines, *(part(figures) for figure, part in parts.items() if figure in figures)]


def does_not_hold(figures: Numbers, claims: list[ClaimRow]) -> list[Line]:
    """Claims that fail, loops that a moved pair of modes makes unstable, and what warns."""
    lines = [
        Line(f"{row.claim.partition(' [')[0]}: {row.number}, asked {row.asked}.", row.section)
        for row in claims
        if not row.holds
    ]
    loops = {f"The loop {who}": ("figure-9b", figures["figure_9b"][key])
             for key, who in LOOPS.items() if "figure_9b" in figures}  # fmt: skip
    for figure, key, who in (("figure_11", "payload", "The loop of Figure 11"),
                             ("figure_12", "both", "The loop of Figure 12")):  # fmt: skip
        if figure in figures:
            loops[who] = ("figure-11" if key == "payload" else "figure-12a", figures[figure][key])
    lines += [
        Line(f"{who} is {held(loop)}.", section)
        for who, (section, loop) in loops.items()
        if not all(on["stable"] for on in loop["rig"])
    ]
    warnings = warned(figures)
    if warnings:
        many = "s" if len(warnings) > 1 else ""
        lines.append(Line(f"{len(warnings)} warning{many}, beside the figures that they are about.",
                          warnings[0].section))  # fmt: skip
    return lines


def _modes(figures: Numbers) -> Line:
    ratio = figures["figure_4"]["ratio"]
    if not ratio:
        return Line("No flexible mode is among those compared.", "figure-4")
    low, high = (fixed(100.0 * (r - 1.0), 1) for r in (min(ratio), max(ratio)))
    return Line(f"Gravity and suspension shift the flexible modes by {low} to {high} %.", "figure-4")


def _zero_g(figures: Numbers) -> Line:
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


def _measured(figures: Numbers) -> Line:
    nine = figures["figure_9b"]
    loops = ", ".join(f"{who} {_db(nine[key])}" for key, who in LOOPS.items())
    return Line(f"Designed on a measured response, payload angle on the simulated rig: {loops}.", "figure-9b")


def _both(figures: Numbers) -> Line:
    one, both = figures["figure_11"]["payload"], figures["figure_12"]["both"]
    return Line(
        f"With encoder and bus fed back: {_db(one)}; with the bus penalised too {_db(both)}.", "figure-11"
    )


def _db(loop: Numbers) -> str:
    return "unstable" if loop["measured_db"] is None else f"{fixed(loop['measured_db'], 1)} dB"


def _mirror(figures: Numbers) -> Line:
    numbers = figures["mirror"]
    ours, theirs = (max(numbers[key]) for key in ("held_out_nrmse", "published_nrmse"))
    return Line(
        f"On a real mirror, a held-out record is left unexplained to {percent(ours)} at most;"
        f" published are {percent(theirs)}.",
        "mirror",
    )


def with_unit(value: float | str | None, unit: str) -> str:
    """A number of a claim and its unit.

    >>> with_unit(-4.4861, "dB"), with_unit(None, "dB"), with_unit(3.0, "")
    ('−4.486 dB', '–', '3')
    """
    return significant(value) if value in (None, "") else f"{significant(value)} {unit}".rstrip()
