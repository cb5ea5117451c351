"""Frequency responses between ports: magnitude over phase."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from middeck.plot.curves import bode_figure, decibels, wrapped_phase_deg
from middeck.plot.style import styled
from middeck.systems.plants.response import FrequencyResponse

CYCLE = ("#0072B2", "#D55E00", "#009E73", "#B0508A", "#E69F00", "#4D4D4D")
LINES = ("-", (0, (5, 1.5)), (0, (1, 1)))
SAMPLES, AROUND = 1200, 41
# Without a band of its own a single frequency is shown within this factor both ways.
DECADE = 10.0


def response_lines(
    at_hz: Float[np.ndarray, " line"], mode_hz: Float[np.ndarray, " mode"], zeta: Float[np.ndarray, " mode"]
) -> Float[np.ndarray, " line"]:
    """Frequencies from the lowest to the highest asked for, so dense around modes that no peak is missed.

    >>> lines = response_lines(np.array([1.0, 100.0]), np.array([10.0]), np.array([1e-5]))
    >>> 10.0 in lines and bool(lines[0] == 1.0 and lines[-1] == 100.0)
    True
    """
    low, high = float(at_hz.min()), float(at_hz.max())
    if high <= low:
        low, high = low / DECADE, high * DECADE
    inside = (mode_hz > low) & (mode_hz < high)
    off = np.sinh(np.linspace(-6.0, 6.0, AROUND))  # from a hundredth to 200 half-power widths
    near = mode_hz[inside, None] * (1.0 + np.maximum(zeta[inside, None], 1e-6) * off)
    lines = np.concatenate([np.geomspace(low, high, SAMPLES), near.ravel(), at_hz])
    return np.unique(lines[(lines >= low) & (lines <= high)])


@styled
def response_figure(response: FrequencyResponse, asked: FrequencyResponse, title: str) -> Figure:
    """Every pair of ports as a curve, with dots at the frequencies ``asked`` for."""
    figure, magnitude, phase = bode_figure(5.2, response.frequency_hz)
    pairs = [(o, i) for o in range(len(response.outputs)) for i in range(len(response.inputs))]
    for k, (o, i) in enumerate(pairs):
        u, y = response.inputs[i], response.outputs[o]
        look: dict[str, Any] = {
            "color": CYCLE[k % len(CYCLE)],
            "linestyle": LINES[k // len(CYCLE) % len(LINES)],
        }
        label = f"{u.name} to {y.name} [{y.unit} per {u.unit}]"
        # All of the lines: they are dense where peaks are, and a bin would show the phase in steps.
        magnitude.plot(response.frequency_hz, decibels(response.H[:, o, i]), label=label, **look)
        phase.plot(response.frequency_hz, wrapped_phase_deg(response.H[:, o, i]), **look)
        H = asked.H[:, o, i]
        magnitude.plot(asked.frequency_hz, decibels(H), "o", color=look["color"])
        phase.plot(asked.frequency_hz, wrapped_phase_deg(H), "o", color=look["color"])
    magnitude.set_ylabel("magnitude [dB]")
    figure.suptitle(title, fontsize=9.5)
    figure.legend(*magnitude.get_legend_handles_labels(), loc="outside lower left", ncols=2)
    return figure
