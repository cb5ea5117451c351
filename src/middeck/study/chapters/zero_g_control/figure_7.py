"""Figure 7: closed-loop performance against authority; where a loop is unstable there are no decibels."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.control.loop.authority import FirstInstability
from middeck.plot.style import COLOUR, LABEL, new_figure, note, styled
from middeck.study.chapters.zero_g_control.computation import ZeroGControl
from middeck.values import record

TARGET_DB = -40.0  # the paper's wish for the 0-g system


@record(kw_only=True)
class Curve:
    """One line: which sub-model, where it is evaluated, how it looks."""

    which: str
    environment: str
    label: str
    line: str
    marker: str


FIGURE_7A = (
    Curve(which="all", environment="orbit", label="0-g, full model", line="-", marker="o"),
    Curve(which="rigid", environment="orbit", label="0-g, without flexible modes", line="--", marker="s"),
    Curve(which="all", environment="lab", label="1-g, full model", line="-", marker="o"),
    Curve(which="rigid", environment="lab", label="1-g, without flexible modes", line="--", marker="s"),
)
FIGURE_7B = (
    Curve(which="flexible", environment="orbit", label="0-g, flexible modes only", line="-", marker="o"),
    Curve(which="flexible", environment="lab", label="1-g, flexible modes only", line="-", marker="o"),
)


@styled
def figure_7(control: ZeroGControl, curves: tuple[Curve, ...], title: str) -> Figure:
    """Some sub-models over authority, and below them where their 1-g loops are unstable."""
    figure = new_figure(4.4)
    curves = _swept(control, curves)
    lab = [curve for curve in curves if curve.environment == "lab"]
    performance, strip = figure.subplots(2, 1, sharex=True, height_ratios=[9.0, 0.55 + 0.45 * len(lab)])
    draw_performance(performance, control, curves)
    _draw_strip(strip, control, lab)
    performance.set_title(title)
    strip.set_xlabel("log10 of control authority")
    return figure


figure_7a = partial(figure_7, curves=FIGURE_7A, title="0-g controllers on the full and the rigid model")
figure_7b = partial(figure_7, curves=FIGURE_7B, title="0-g controllers on the flexible modes alone")


def _swept(control: ZeroGControl, curves: tuple[Curve, ...]) -> tuple[Curve, ...]:
    """Curves of sub-models that the article has."""
    swept = dict(control.sweeps)
    return tuple(curve for curve in curves if curve.which in swept)


def draw_performance(axes: Axes, control: ZeroGControl, curves: tuple[Curve, ...] = FIGURE_7A) -> None:
    """Decibels of every stable loop, and a line with the mode's name where the 1-g loop is first unstable."""
    sweeps, curves = dict(control.sweeps), _swept(control, curves)
    for curve in curves:
        sweep = sweeps[curve.which].sweep
        row = sweep.plants.index(curve.environment)
        level = np.where(sweep.stable[row], sweep.db[row], np.nan)
        axes.plot(
            control.log10_authority, level, curve.line, marker=curve.marker, markersize=4.0,
            markerfacecolor=COLOUR["orbit"] if curve.environment == "orbit" else "white",
            color=COLOUR[curve.environment], label=curve.label,
        )  # fmt: skip
    if any(curve.which == "all" for curve in curves):
        axes.axhline(TARGET_DB, color=COLOUR["ink"], linewidth=0.8, linestyle=":")
        note(axes, "0-g target: 40 dB", (control.log10_authority[0], TARGET_DB), (2, 3))
    axes.margins(y=0.06)
    onsets = [(curve, first) for curve in curves if curve.environment == "lab"
              if (first := sweeps[curve.which].first_instability)]  # fmt: skip
    for place, (curve, first) in enumerate(onsets):
        _draw_onset(axes, float(control.log10_authority[-1]), first, curve, place)
    axes.set_ylabel("performance [dB re 0-g under PD alone]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.12))


def _draw_onset(axes: Axes, last: float, first: FirstInstability, curve: Curve, place: int) -> None:
    """A line where the loop is first unstable, and in the upper right corner the mode that leads."""
    where = f"first unstable at {first.log10_authority:.2f}"
    if first.log10_authority <= last:
        axes.axvline(first.log10_authority, color=COLOUR["lab"], linewidth=1.0, linestyle=curve.line)
    else:
        where += ", beyond this plot"
    how = f"{first.frequency_hz:.2f} Hz" if first.frequency_hz > 0.0 else "divergence"
    who = f"{first.mode_name}, {how}, share {first.participation:.2f}"
    axes.annotate(
        f"{curve.label}: {where}\n{who}",
        (0.995, 0.985 - 0.11 * place),
        xycoords="axes fraction",
        va="top",
        ha="right",
        fontsize=7.5,
        color=COLOUR["lab"],
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _draw_strip(axes: Axes, control: ZeroGControl, curves: list[Curve]) -> None:
    """Every level at which the 1-g loop is unstable, one row for each sub-model."""
    sweeps = dict(control.sweeps)
    for row, curve in enumerate(curves):
        sweep = sweeps[curve.which].sweep
        bad = ~sweep.stable[sweep.plants.index("lab")]
        levels = control.log10_authority
        axes.plot(levels[~bad], np.full(np.sum(~bad), row), ".", color=COLOUR["ghost"], markersize=3.0)
        axes.plot(levels[bad], np.full(np.sum(bad), row), "x", color=COLOUR["lab"], markersize=5.0)
    names = {"all": "full", "rigid": "rigid", "flexible": "flexible"}
    axes.set_yticks(range(len(curves)), [f"{LABEL['lab']} {names[c.which]}" for c in curves])
    axes.set_ylim(len(curves) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_title("× unstable   · stable", fontsize=8.0, pad=2.0)
