"""Frequency and damping of modes against the amplitude of a joint with friction or play."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, new_figure, styled
from middeck.structure.gimbals.amplitude import AmplitudeCurves

DISTORTED = 0.1
"""Part of higher harmonics above which a curve is drawn faint: harmonic balance is then a sketch."""
LEAST = 1e-3
"""Change of relative frequency and damping ratio together below which a mode is not worth a curve."""
MOST = 6
"""Modes shown."""
LINES = ("-", "--", "-.", ":")
COLOURS = ("orbit", "lab", "prediction", "low", "high", "ink")


@styled
def draw_amplitude(curves: AmplitudeCurves) -> Figure:
    """Equivalent stiffness of the joint, relative frequency and damping of each mode, over the amplitude.

    Shown are the modes whose frequency or damping moves, six at most.
    """
    shown = _movers(curves)
    figure = new_figure(6.4)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=[0.8, 1.2, 1.2])
    _draw_equivalents(top, curves)
    for place, m in enumerate(shown):
        _draw_mode(middle, curves, m, curves.omega[:, m] / curves.omega[:, m].max(), place)
        _draw_mode(bottom, curves, m, 100.0 * curves.zeta[:, m], place)
    middle.set_ylabel("frequency / its highest")
    bottom.set_ylabel("damping ratio [%]")
    bottom.set_ylim(bottom=0.0)
    bottom.set_xlabel(f"amplitude of {curves.joint} [{'mm' if curves.slides else 'deg'}]")
    if shown:
        figure.legend(*middle.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    top.set_title(
        f"{curves.joint}: faint where over {DISTORTED:.0%} of the swing are higher harmonics,\n"
        "or where a damped mode is several undamped ones at once"
    )
    return figure


def _movers(curves: AmplitudeCurves) -> list[int]:
    """The modes that amplitude changes most, relative frequency and damping ratio alike."""
    highest = curves.omega.max(axis=0)
    damping = np.where(np.isnan(curves.zeta), 0.0, curves.zeta)
    change = np.ptp(curves.omega, axis=0) / np.where(highest > 0.0, highest, 1.0) + np.ptp(damping, axis=0)
    first = np.argsort(-change, kind="stable")[:MOST]
    return sorted(int(m) for m in first if change[m] > LEAST)


def _shown_amplitude(curves: AmplitudeCurves) -> np.ndarray:
    """Degrees, or millimetres of a slide."""
    return 1e3 * curves.amplitude if curves.slides else np.degrees(curves.amplitude)


def _draw_equivalents(axes: Axes, curves: AmplitudeCurves) -> None:
    A = _shown_amplitude(curves)
    axes.plot(A, curves.stiffness, color=COLOUR["ink"], label="equivalent stiffness")
    axes.plot(A, curves.loss, "--", color=COLOUR["ink"], label="loss stiffness")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_ylabel("[N/m]" if curves.slides else "[N m/rad]")
    axes.legend(loc="best")


def _draw_mode(axes: Axes, curves: AmplitudeCurves, m: int, value: np.ndarray, place: int) -> None:
    """One curve, faint throughout; strong again where harmonic balance holds and the frequency is its own."""
    look: dict[str, Any] = {
        "color": COLOUR[COLOURS[place % len(COLOURS)]],
        "linestyle": LINES[place % len(LINES)],
    }
    A = _shown_amplitude(curves)
    axes.plot(A, value, alpha=0.3, **look)
    believed = (curves.distortion[:, m] <= DISTORTED) & ~curves.doubtful[:, m]
    sound = np.where(believed, value, np.nan)
    f = curves.frequency_hz[:, m]
    span = f"{curves.name[m]}, {f.min():.2f} to {f.max():.2f} Hz"
    axes.plot(A, sound, label=span, **look)
