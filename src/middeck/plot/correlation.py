"""A model beside a test: the MAC of all pairs, and the frequencies of both."""

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.style import COLOUR, draw_stems, new_figure, styled
from middeck.structure.correlation.correlate import Correlation
from middeck.structure.correlation.evaluation import Evaluation
from middeck.structure.correlation.frequencies import FrequencyComparison
from middeck.structure.modes.solve import Modes

# Above this number of columns the values are not written into their squares.
WRITTEN = 14
FLOOR = 0.05  # below this a MAC is drawn white


@styled
def correlation_figure(found: Correlation) -> Figure:
    """Left: MAC of every candidate (rows) and measured mode; circles are pairs. Right: frequency errors."""
    mac, pairs, measured = found.evaluation.mac, found.evaluation.pairs, found.measured.frequency_hz
    figure = new_figure(1.6 + 0.26 * max(len(mac), len(measured)), 9.0)
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    image = left.imshow(
        np.ma.masked_less(mac, FLOOR),
        cmap="viridis_r",
        vmin=0.0,
        vmax=1.0,
        aspect="auto",
        interpolation="nearest",
    )
    left.plot(pairs[:, 1], pairs[:, 0], "o", mfc="none", mec=COLOUR["lab"], markersize=13)
    if mac.shape[1] <= WRITTEN:
        for (i, j), value in np.ndenumerate(mac):
            if value >= FLOOR:
                colour = "white" if value > 0.5 else "black"
                left.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=6.0, color=colour)
    modes = found.modes
    left.set_yticks(range(len(mac)), [f"{i}: {modes.frequency_hz[i]:.4g} Hz" for i in found.candidates])
    left.set_xticks(range(len(measured)), [f"{j}: {f:.4g}" for j, f in enumerate(measured, 1)], rotation=60)
    left.set_xlabel("measured mode [Hz]")
    left.set_ylabel("mode of the model")
    left.set_title("MAC; circles: pairs")
    left.grid(visible=False)
    figure.colorbar(image, ax=left, fraction=0.05, pad=0.02)
    _draw_errors(
        right,
        [f"test {j + 1}, {measured[j]:.4g} Hz: {modes.name[i]}" for i, j in found.pairs],
        found.evaluation,
    )
    figure.suptitle(f"{_heading(modes)}\n{found.profile.name}: {found.verdict}", fontsize=9.5)
    return figure


@styled
def frequencies_figure(found: FrequencyComparison) -> Figure:
    """Frequency errors of the pairs; a question mark where another mode of the model fits too."""
    measured, names = found.measured.frequency_hz, found.modes.name
    figure = new_figure(1.6 + 0.3 * len(found.pairs), 6.5)
    doubts = [" ?" * (j in found.undecided) for _, j in found.pairs]
    rows = [
        f"test {j + 1}, {measured[j]:.4g} Hz{doubt}: {names[i]}"
        for (i, j), doubt in zip(found.pairs, doubts, strict=True)
    ]
    _draw_errors(figure.subplots(), rows, found)
    doubt = "\n?: another mode of the model fits too" if found.undecided else ""
    figure.suptitle(f"{_heading(found.modes)}{doubt}", fontsize=9.5)
    return figure


def _heading(modes: Modes) -> str:
    return fill(f"{modes.equilibrium.model.structure.title} in {modes.equilibrium.environment.title}", 100)


def _draw_errors(axes: Axes, names: list[str], found: Evaluation | FrequencyComparison) -> None:
    """Frequency errors of pairs, one a row, whose name is beside it."""
    error = 100.0 * found.frequency_error
    draw_stems(axes, error, 0.0, names, "{:+.2f}")
    axes.tick_params(axis="y", labelright=True, labelleft=False)
    span = max(float(np.abs(error).max(initial=0.0)), 0.1)
    axes.set_xlim(-1.15 * span, 1.7 * span)
    axes.axvline(0.0, color="black", linewidth=0.7)
    axes.set_xlabel("model over measured frequency, less one [%]")
    axes.set_title("frequencies of the pairs")
