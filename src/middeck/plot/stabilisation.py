"""The stabilisation diagram: poles of rising orders over frequency, above the response they are in."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from middeck.identification.order.stabilisation import Stabilisation
from middeck.plot.curves import decibels
from middeck.plot.style import COLOUR, frequency_axis, new_figure, styled
from middeck.systems.plants.response import FrequencyResponse

# Where the axis begins, as a share of the lowest mode's frequency.
BELOW = 0.5


@styled
def stabilisation(
    diagram: Stabilisation, measured: FrequencyResponse, *, states: int | None = None
) -> Figure:
    """Stable poles filled, the others small; the sum of all entries' power beneath; ``states`` is marked."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    behind = axes.twinx()
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)
    level = np.mean(np.abs(measured.H) ** 2, axis=0, keepdims=True)
    power = np.sqrt(np.mean(np.abs(measured.H) ** 2 / level, axis=(1, 2)))
    behind.plot(measured.frequency_hz, decibels(power), color=COLOUR["ghost"], linewidth=0.8)
    behind.set_ylabel("all entries, each of rms 1 [dB]")
    behind.grid(visible=False)
    for hz in diagram.cluster_hz:
        axes.axvline(hz, color=COLOUR["shade"], linewidth=3.0, zorder=0.5)
    kinds: list[tuple[str, np.ndarray, dict[str, Any]]] = [
        ("new", ~diagram.stable_frequency, {"marker": ".", "color": COLOUR["rig"], "markersize": 3.0}),
        (
            "stable in frequency",
            diagram.stable_frequency & ~diagram.stable,
            {"marker": "x", "color": COLOUR["lab"], "markersize": 4.0},
        ),
        (
            "in damping and shape too",
            diagram.stable,
            {"marker": "o", "color": COLOUR["orbit"], "markersize": 4.0},
        ),
    ]
    for label, which, look in kinds:
        axes.plot(diagram.natural_hz[which], diagram.order[which], linestyle="none", label=label, **look)
    if states is not None:
        axes.axhline(states, color=COLOUR["ink"], linewidth=0.8, linestyle="--", label=f"{states} states")
    axes.set_ylabel("order [states]")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = measured.frequency_hz[[0, -1]]
    frequency_axis(axes, max(low, BELOW * min(diagram.cluster_hz, default=low)), high)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4)
    return figure
