"""Promise against outcome at a glance, and three ways to a compensator side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from middeck.plot.promises import promise_figure
from middeck.plot.style import COLOUR, new_figure, styled
from middeck.study.chapters.promise import numbers, text
from middeck.study.chapters.promise.computation import PromiseKept
from middeck.updating.outlook import LEVELS

WAYS = {"sheet": ("ghost", "s"), "refined": ("orbit", "o"), "measured": ("lab", "^")}


def promised_and_came(kept: PromiseKept) -> Figure:
    """Intervals promised before flight, and what the rig in orbit then showed."""
    came = {
        v.name: {"value": o.value, "stable": o.stable, "inside": v.inside}
        for v, o in zip(kept.verdicts, kept.outcomes, strict=True)
    }
    return promise_figure(kept.there, list(LEVELS), came, "Promised from 1-g for orbit; dots: what came")


@styled
def routes(kept: PromiseKept) -> Figure:
    """Decibels on the rig in orbit over authority."""
    figure = new_figure(3.4)
    axes = figure.subplots()
    said = numbers.promise(kept)
    level = np.asarray(said["authority_log10"])
    for way, decibels in numbers.routes(said).items():
        colour, marker = WAYS[way]
        db = np.array([np.nan if value is None else value for value in decibels])
        axes.plot(level, db, marker=marker, color=COLOUR[colour], label=f"designed on: {text.ROUTES[way]}")
    axes.set_xlabel("log10 of control authority")
    axes.set_ylabel("payload angle on the rig in orbit\n[dB re analogue loops alone]")
    axes.set_title("Three ways to a compensator for orbit")
    axes.legend()
    return figure
