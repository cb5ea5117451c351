"""A promise and its outcome at a glance: intervals row by row, outcomes as points."""

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, note, styled

ROW_IN = 0.26
LOST_DB = 3.0  # to which an interval is drawn whose upper end is lost
Came = Mapping[tuple[str, str], Any]
INSIDE, OUTSIDE = COLOUR["prediction"], COLOUR["lab"]


@styled
def promise_figure(place: Mapping[str, Any], shares: list[float], came: Came, title: str) -> Figure:
    """One environment of a promise: frequencies about the promised ones, decibels of each compensator.

    ``came`` has the verdicts of a comparison by their kinds and names; without any the promise stands alone.
    """
    modes, loops = place["modes"], place.get("compensators", [])
    figure = new_figure(1.2 + ROW_IN * max(len(modes), len(loops)), 10.0)
    left, right = figure.subplots(1, 2)
    _draw_modes(left, place, came)
    _draw_loops(right, place, {share: k for k, share in enumerate(shares)}, came)
    figure.suptitle(title, fontsize=9.5)
    return figure


def _draw_modes(axes: Axes, place: Mapping[str, Any], came: Came) -> None:
    rows = place["modes"]
    for y, mode in enumerate(rows):
        hz = mode["frequency_hz"]
        low, high = (100.0 * (end / hz - 1.0) for end in mode["interval_95_hz"])
        seen = mode["seen"] >= 0.5
        axes.hlines(y, low, high, color=COLOUR["orbit"], linewidth=4.0 if seen else 1.5, alpha=0.5)
        verdict = came.get(("mode", f"{place['name']}: mode {y + 1}"))
        if verdict is not None:
            _point(axes, 100.0 * (verdict["value"] / hz - 1.0), y, verdict["inside"])
    axes.axvline(0.0, color="black", linewidth=0.7)
    axes.set_yticks(range(len(rows)), [f"{m['name']}, {m['frequency_hz']:.4g} Hz" for m in rows])
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.set_xlabel("per cent above the promised frequency")
    axes.set_title("modes, 95 %; thin: not seen on the ground")


def _draw_loops(axes: Axes, place: Mapping[str, Any], at: Mapping[float, int], came: Came) -> None:
    """About each median; where that is unstable, nothing but the share that is not."""
    rows = place.get("compensators", [])
    for y, row in enumerate(rows):
        low, middle, high, cautious = (row["db"][at[s]] for s in (0.025, 0.5, 0.975, 0.99))
        if row["probability_stable"] < 1.0:
            words = f"stable in {100.0 * row['probability_stable']:.1f} %"
            note(axes, words, (0.0, y), (4, 9), va="center", color=OUTSIDE)
        verdict = came.get(("compensator", f"{place['name']}: {row['name']}"))
        if verdict is not None and not verdict["stable"]:
            axes.plot(0.0, y, "X", color=OUTSIDE, markersize=8.0)
        if middle is None:
            continue
        end = LOST_DB if high is None else high - middle
        axes.hlines(y, low - middle, end, color=COLOUR["orbit"], linewidth=4.0, alpha=0.5)
        if cautious is not None:
            axes.plot(cautious - middle, y, "|", color=COLOUR["ink"], markersize=10.0)
        levels = row.get("without_friction_db")
        without = None if levels is None else levels[at[0.5]]
        if without is not None:
            axes.plot(without - middle, y, "D", color=COLOUR["ink"], markerfacecolor="none", markersize=4.0)
        if verdict is not None and verdict["stable"]:
            _point(axes, verdict["value"] - middle, y, verdict["inside"])
    axes.axvline(0.0, color="black", linewidth=0.7)
    axes.set_yticks(range(len(rows)), [_called(row, at) for row in rows])
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.margins(x=0.1)
    axes.set_xlabel("dB above the promised median")
    legend = "95 % of draws; bar: 99 % reach this" if rows else "no compensator"
    axes.set_title(f"{legend}\nopen: without friction" if "friction" in place else legend)


def _called(row: Mapping[str, Any], at: Mapping[float, int]) -> str:
    middle = row["db"][at[0.5]]
    return f"{row['name']}, unstable" if middle is None else f"{row['name']}, {middle:.1f} dB"


def _point(axes: Axes, x: float, y: float, inside: bool) -> None:
    axes.plot(x, y, "o" if inside else "X", color=INSIDE if inside else OUTSIDE, markersize=5.5, zorder=4)
