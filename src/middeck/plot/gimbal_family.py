"""Frequencies and holding torques of an article against the angle of one of its gimbal axes."""

from collections.abc import Sequence
from textwrap import fill, wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from middeck.errors import ConfigError
from middeck.plot.style import COLOUR, new_figure, styled
from middeck.structure.gimbals.family import GimbalFamily

COLOURS = ("orbit", "lab", "prediction", "low", "high", "ink")
LINES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "v", "D", "x", "P")
APART = 0.2  # logarithm of the frequency ratio of two names that can be read
LINEAR_HZ = 0.1  # within which the logarithmic scale passes through zero
TICKS_HZ = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 1e4, 1e5)
MOVES = 0.02
"""Part of its frequency by which a mode must change over the sweep to be worth a colour and a name."""


@styled
def draw_gimbal_family(
    family: GimbalFamily, joint: str | None = None, *, others: Sequence[float] | None = None
) -> Figure:
    """Frequency of every branch, and the torque of every swept axis, against the angle of ``joint``.

    ``others`` are the angles [rad] of the other swept joints, in their order, at which the grid is cut: by
    default those of the family's origin. A mode that grows is drawn below zero, at minus its rate over 2 pi;
    one that hardly moves is grey, with its name at its end.
    Raises `ConfigError` for a joint that was not swept or angles that are not on the grid.
    """
    joint = family.joints[0] if joint is None else joint
    cut = _cut(family, joint, others)
    degrees = np.degrees(family.angle[cut, family.joints.index(joint)])
    figure = new_figure(6.2)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2.0, 1.0])
    _draw_frequencies(top, family, cut, degrees)
    lost = [x for x in family.limits if x.joint == joint and x.unstable in cut]
    for limit in lost:
        top.axvline(np.degrees(limit.angle), color=COLOUR["lab"], linewidth=0.9, linestyle=":")
    top.set_title("\n".join([_case(family), *(x.sentence for x in lost)]))
    _draw_torques(bottom, family, cut, degrees)
    bottom.set_xlabel(f"angle of {joint} [deg]")
    figure.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _case(family: GimbalFamily) -> str:
    rest = family.rests[family.origin]
    assert rest is not None
    return fill(f"{rest.model.structure.title}; {rest.environment.title}", 95)


def _cut(family: GimbalFamily, joint: str, others: Sequence[float] | None) -> list[int]:
    """Points along ``joint`` at the angles of the others."""
    if joint not in family.joints:
        raise ConfigError(f"joint {joint!r} was not swept", hint=f"one of {', '.join(family.joints)}")
    axis = family.joints.index(joint)
    rest = [i for i in range(len(family.joints)) if i != axis]
    at = family.angle[family.origin, rest] if others is None else np.asarray(others, dtype=float)
    if len(at) != len(rest):
        raise ConfigError(f"{len(at)} angles for {len(rest)} other joints", hint="one each, in their order")
    on = np.flatnonzero(np.all(np.isclose(family.angle[:, rest], at, rtol=0.0, atol=1e-9), axis=1))
    if not len(on):
        raise ConfigError(
            "no point of the grid has these angles of the other joints", hint="take grid angles"
        )
    return [int(p) for p in on]


def _draw_frequencies(axes: Axes, family: GimbalFamily, cut: list[int], degrees: np.ndarray) -> None:
    f = family.frequency_hz[cut]
    shown, grey = 0, list[tuple[float, str]]()
    for branch, name in enumerate(family.name):
        values = f[:, branch]
        if not np.any(np.isfinite(values)) or np.nanmax(np.abs(values)) == 0.0:
            continue
        moves = np.ptp(values[np.isfinite(values)]) > MOVES * np.nanmax(np.abs(values))
        if moves and shown < len(COLOURS) * len(LINES):
            # Colour, line and marker all change from one mode to the next: no two look alike.
            colour, line = COLOUR[COLOURS[shown % len(COLOURS)]], LINES[(shown // len(COLOURS)) % len(LINES)]
            marker = MARKERS[shown % len(MARKERS)]
            axes.plot(degrees, values, line, marker=marker, markersize=3.5, color=colour, label=name)
            shown += 1
        else:
            axes.plot(degrees, values, color=COLOUR["ghost"], linewidth=0.8, zorder=1)
            grey.append((float(values[np.isfinite(values)][-1]), name))
    _name_ends(axes, degrees, grey)
    _scale_frequencies(axes, f)


def _name_ends(axes: Axes, degrees: np.ndarray, grey: list[tuple[float, str]]) -> None:
    """Names of modes that hardly move, at the right end of their lines; near ones share a line."""
    groups: list[tuple[float, list[str]]] = []
    for value, name in sorted(grey):
        if groups and value > 0.0 and groups[-1][0] > 0.0 and np.log(value / groups[-1][0]) < APART:
            groups[-1][1].append(name)
        else:
            groups.append((value, [name]))
    for value, names in groups:
        axes.annotate(
            "\n".join(wrap(", ".join(names), 26)), (float(degrees[-1]), value), xytext=(4, 0),
            textcoords="offset points", va="center", fontsize=5.5, color=COLOUR["rig"], annotation_clip=False,
        )  # fmt: skip


def _scale_frequencies(axes: Axes, f: np.ndarray) -> None:
    """Logarithmic; where a mode grows through zero to below it, else from what there is."""
    grows = float(np.nanmin(f)) < 0.0
    if grows:
        axes.axhline(0.0, color=COLOUR["ink"], linewidth=0.7)
        axes.axhspan(1.5 * float(np.nanmin(f)), 0.0, color=COLOUR["shade"], zorder=0)
        axes.set_yscale("symlog", linthresh=LINEAR_HZ, linscale=0.5)
    else:
        axes.set_yscale("log")
    signs = (-1.0, 1.0) if grows else (1.0,)
    axes.yaxis.set_major_locator(FixedLocator(sorted({*(s * t for s in signs for t in TICKS_HZ), 0.0})))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("frequency [Hz]; below 0 growth / 2π" if grows else "frequency [Hz]")


def _draw_torques(axes: Axes, family: GimbalFamily, cut: list[int], degrees: np.ndarray) -> None:
    for i, name in enumerate(family.joints):
        colour = COLOUR[COLOURS[i % len(COLOURS)]]
        axes.plot(degrees, family.holding_torque[cut, i], LINES[i % len(LINES)], color=colour, label=name)
        limit = float(family.torque_limit[i])
        if np.isfinite(limit):
            for sign, label in ((-1.0, None), (1.0, f"limit of {name}")):
                axes.axhline(sign * limit, color=colour, linewidth=0.8, linestyle=":", label=label)
    axes.set_ylabel("holding torque [N m]")
    axes.legend(loc="best")
