"""The figure of frequency and damping against amplitude: it draws what moves, modes at rest do no harm."""

import numpy as np
import pytest

import middeck as md
from middeck.plot.amplitude import amplitude
from middeck.structure.gimbals.amplitude import sweep_amplitude
from middeck.systems.deadband import Deadband


@pytest.fixture(scope="module")
def curves():
    article = md.load_structure("articles/mace-simple.toml")
    modes = md.solve_modes(md.solve_equilibrium(article, md.Environment.orbit()))
    return sweep_amplitude(
        modes, joint="pri_x", elements=[Deadband(1e-3, 20.0)], amplitudes=np.geomspace(5e-4, 0.1, 30)
    )


def test_it_shows_the_modes_that_move_and_where_harmonic_balance_is_a_sketch(curves, tmp_path):
    figure = amplitude(curves)
    middle = figure.axes[1]
    labels = middle.get_legend_handles_labels()[1]
    assert labels[0].startswith("gimbal pri x, 0.00 to 1.6")
    assert not any("translation" in text or "gimbal sec" in text for text in labels)
    faint, sound = middle.get_lines()[:2]
    drawn = ~np.isnan(np.asarray(sound.get_ydata(), dtype=float))
    assert np.array_equal(drawn, curves.distortion[:, 6] <= 0.1)
    assert not drawn.all()
    assert len(faint.get_xdata()) == 30
    figure.savefig(tmp_path / "amplitude.svg")
    assert (tmp_path / "amplitude.svg").stat().st_size > 10_000


def test_it_shows_what_is_asked_for(curves):
    labels = amplitude(curves, show=[10, 11]).axes[1].get_legend_handles_labels()[1]
    assert [text.split(",")[0] for text in labels] == ["first bending x-y", "first bending x-z"]
