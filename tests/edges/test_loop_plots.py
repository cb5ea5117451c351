"""Nyquist's and Nichols's plots show what was computed."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from middeck.control.analysis.margins.margins import Margins, measure_margins
from middeck.control.analysis.margins.return_ratio import ReturnRatio, trace_return_ratio
from middeck.control.law.compensator import Compensator
from middeck.plot.nichols import draw_nichols
from middeck.plot.nyquist import draw_nyquist, title_of
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import gain_system

FORCE, WAY, RATE = Port("force", "N"), Port("way", "m"), Port("rate", "m/s")
MODES = ModalSystem(
    omega=[0.0, 9.0],
    zeta=[0.0, 0.02],
    psi=[[1.0], [0.5]],
    phi=[[1.0, 0.5], [0.0, 0.0]],
    phi_rate=[[0.0, 0.0], [1.0, 0.5]],
    names=("body", "one"),
)


def looked_at(delay_s: float) -> tuple[ReturnRatio, Margins]:
    delayed = delay_plant(Plant(dynamics=MODES, inputs=(FORCE,), outputs=(WAY, RATE)), delay_s)
    law = Compensator(gain_system(np.array([[-2.0, -1.5]])), (WAY, RATE), (FORCE,))
    return trace_return_ratio(delayed, law), measure_margins(delayed, law)


def drawn(figure: Figure, colour: str) -> np.ndarray:
    lines = [line for line in figure.axes[0].get_lines() if line.get_color() == colour]
    return np.asarray(lines[0].get_xydata())


def test_the_curve_passes_its_crossings_and_keeps_off_its_disk() -> None:
    ratio, margins = looked_at(0.05)
    curve = drawn(draw_nyquist(ratio, margins), "#0072B2")
    curve = curve[np.isfinite(curve[:, 0])] @ np.array([1.0, 1.0j])
    one = margins.loops[0]
    for point in [*-np.exp(1j * one.phase_rad), *(-1.0 / one.gain)]:
        # Steps of three degrees and a tenth of the gain.
        assert np.abs(curve - point).min() <= 0.06 * abs(point)
    low, high = one.disk.gain
    distance = np.abs(curve + 0.5 * (low + high))
    assert distance.min() == pytest.approx(0.5 * (high - low), rel=0.02)
    assert distance.min() >= 0.5 * (high - low) * (1.0 - 1e-9)


def test_nichols_shows_unit_gain_at_its_phase() -> None:
    ratio, margins = looked_at(0.05)
    dots = drawn(draw_nichols(ratio, margins), "#009E73")
    assert np.sort(dots[:, 0]) == pytest.approx(np.sort(np.degrees(margins.loops[0].phase_rad) - 180.0))
    assert not dots[:, 1].any()


def test_an_unstable_loop_is_reported_and_has_no_disk() -> None:
    ratio, margins = looked_at(0.9)
    assert not margins.stable
    figure = draw_nyquist(ratio, margins)
    assert not figure.axes[0].patches
    assert "unstable" in title_of(margins.loops[0], stable=False)
    assert "unstable" in figure.axes[0].get_title(loc="left")


def test_one_legend_stands_under_the_pictures_and_names_what_is_drawn() -> None:
    legends = ((draw_nyquist, ("unit circle", "disk of the disk margin")), (draw_nichols, ("|L/(1 + L)|",)))
    for draw, named in legends:
        figure = draw(*looked_at(0.05))
        assert not any(axes.get_legend() for axes in figure.axes)
        (legend,) = figure.legends
        texts = [text.get_text() for text in legend.get_texts()]
        assert all(any(text.startswith(name) for text in texts) for name in (*named, "L", "critical point"))
