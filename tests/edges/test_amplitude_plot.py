"""The figure of frequency and damping against amplitude: it draws what moves, modes at rest do no harm."""

import numpy as np
import pytest

import middeck as md
from middeck.joints.deadband import Deadband
from middeck.plot.amplitude import draw_amplitude
from middeck.structure.gimbals.amplitude import sweep_amplitude
from structure_builders import body, joint, node, structure


@pytest.fixture(scope="module")
def curves():
    article = md.load_structure("articles/mace-simple.toml")
    modes = md.solve_modes(md.solve_equilibrium(article, md.Environment.orbit()))
    return sweep_amplitude(
        modes, joint="pri_x", elements=[Deadband(1e-3, 20.0)], amplitudes=np.geomspace(5e-4, 0.1, 30)
    )


def test_it_shows_the_modes_that_move_and_where_harmonic_balance_is_a_sketch(curves, tmp_path):
    figure = draw_amplitude(curves)
    middle = figure.axes[1]
    labels = middle.get_legend_handles_labels()[1]
    assert labels[0].startswith("gimbal pri x, 0.00 to 1.6")
    assert not any("translation" in text or "gimbal sec" in text for text in labels)
    faint, sound = middle.get_lines()[:2]
    drawn = ~np.isnan(np.asarray(sound.get_ydata(), dtype=float))
    assert np.array_equal(drawn, (curves.distortion[:, 6] <= 0.1) & ~curves.doubtful[:, 6])
    assert not drawn.all()
    assert len(faint.get_xdata()) == 30
    figure.savefig(tmp_path / "amplitude.svg")
    assert (tmp_path / "amplitude.svg").stat().st_size > 10_000


def test_a_slide_is_drawn_in_its_own_units():
    """Millimetres and N/m; a joint that turns has degrees and N m/rad."""
    rail = joint("rail", "base", (1.0, 0.0, 0.0), body(2.0), slides=True)
    parts = structure([node("base", (0, 0, 0), body(5.0, inertia=(0.1,) * 3))], joints=[rail])
    modes = md.solve_modes(md.solve_equilibrium(parts, md.Environment.orbit()))
    A = np.geomspace(1e-4, 1e-2, 9)
    found = sweep_amplitude(modes, joint="rail", elements=[Deadband(1e-3, 200.0)], amplitudes=A)
    assert found.slides
    top, middle, bottom = draw_amplitude(found).axes
    assert top.get_ylabel() == "[N/m]"
    assert bottom.get_xlabel() == "amplitude of rail [mm]"
    assert np.array_equal(middle.get_lines()[0].get_xdata(), 1e3 * A)


def test_a_turning_joint_is_drawn_in_degrees(curves):
    assert not curves.slides
    top, middle, bottom = draw_amplitude(curves).axes
    assert top.get_ylabel() == "[N m/rad]"
    assert bottom.get_xlabel() == "amplitude of pri_x [deg]"
    assert np.array_equal(middle.get_lines()[0].get_xdata(), np.degrees(curves.amplitude))
