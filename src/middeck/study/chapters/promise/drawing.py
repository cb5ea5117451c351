"""Promise against outcome at a glance, and three ways to a compensator side by side."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from middeck.plot.promises import promise_figure
from middeck.plot.style import COLOUR, new_figure, styled
from middeck.study.chapters.promise import numbers_and_claims, text
from middeck.study.chapters.promise.computation import PromiseKept
from middeck.updating.promise.stability_probability import LEVELS

WAYS = {"sheet": ("rig", "s"), "refined": ("orbit", "o")}


def promised_and_came(kept: PromiseKept) -> Figure:
    """Intervals promised before flight, and results of the rig in orbit."""
    came: dict[tuple[str, str], Any] = {
        (v.kind, v.name): {"value": o.value, "stable": o.stable, "inside": v.inside}
        for v, o in zip(kept.verdicts, kept.outcomes, strict=True)
    }
    return promise_figure(kept.there, list(LEVELS), came, "Promised from 1-g for orbit; dots: what came")


@styled
def routes(kept: PromiseKept) -> Figure:
    """Loss of two designs against one on a record from orbit, over authority."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    document = numbers_and_claims.promise(kept)
    by = {way: np.array(db, dtype=float) for way, db in numbers_and_claims.routes(document).items()}
    for way, (colour, marker) in WAYS.items():
        axes.plot(
            document["authority_log10"], by[way] - by["measured"], marker=marker, color=COLOUR[colour],
            label=text.ROUTES[way],
        )  # fmt: skip
    axes.axhline(0.0, color=COLOUR["ink"], linewidth=0.8)
    axes.set_xlabel("log10 of control authority")
    axes.set_ylabel("behind the design on a record\nfrom orbit, on the rig [dB]")
    axes.set_title("Payload angle in orbit, by what the compensator was designed on")
    axes.margins(y=0.2)
    axes.legend()
    return figure
