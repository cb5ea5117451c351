"""Figure 6: gimbal torque to payload and bus rates, in 0-g, in 1-g and measured on the rig."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from middeck.plot.curves import bode_figure, draw_bode, wrapped_phase_deg
from middeck.plot.port_words import port_words
from middeck.plot.style import COLOUR, DASHES, LABEL, styled
from middeck.study.chapters.gravity_responses.computation import GravityResponses
from middeck.study.words import fields


@styled
def figure_6(responses: GravityResponses, output: int) -> Figure:
    """The first rate, the payload's, or the second, the bus's at the torque wheels."""
    figure, magnitude, phase = bode_figure(4.6, responses.orbit.frequency_hz)
    sides = fields(responses, "rig", "orbit", "lab")
    for side, response in sides.items():
        H, width = response.H[:, output, 0], 2.4 if side == "rig" else 1.1
        style: dict[str, Any] = {"color": COLOUR[side], "linewidth": width, "linestyle": DASHES[side]}
        draw_bode(magnitude, phase, response.frequency_hz, H, label=LABEL[side], **style)
    _draw_delay(phase, responses, output)
    magnitude.set_ylabel("magnitude [dB re 1 rad/s per N m]")
    rate, torque = responses.rig.outputs[output].name, responses.rig.inputs[0].name
    magnitude.set_title(f"{port_words(rate)} per {port_words(torque)} torque")
    magnitude.legend(loc="best")
    return figure


def _draw_delay(phase: Axes, responses: GravityResponses, output: int) -> None:
    """The 1-g model behind the rig's delay: where it covers the measurement, delay explains the phase."""
    f, H = responses.lab.frequency_hz, responses.lab.H[:, output, 0]
    delayed = H * np.exp(-2j * np.pi * f * responses.delay_s)
    gap = responses.phase_gap_s
    text = f"1-g behind {1e3 * responses.delay_s:.2f} ms of delay"
    text += "" if gap is None else f"; the gap above 5 Hz is {1e3 * gap[output]:.2f} ms"
    phase.plot(
        f,
        wrapped_phase_deg(delayed),
        label=text,
        color=COLOUR["prediction"],
        linewidth=1.2,
        linestyle=(0, (1.0, 1.5)),
    )
    handles, labels = phase.get_legend_handles_labels()
    phase.figure.legend(handles[-1:], labels[-1:], loc="outside lower center")
