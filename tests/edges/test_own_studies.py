"""A study of an article unlike the paper's: a mast without joints, clamped, hung or turned over."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck
from middeck.files.setups import load_setup
from middeck.structure.gravity.compare_modes import compare_modes
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.study.chapters.gravity_modes.figure_3 import figure_3

MAST = """
schema = 1
name = "mast"
wheel_node = "base"
[damping]
flexible = 0.004
suspension = 0.02
[material.cfrp]
E_pa = 110.0e9
nu = 0.3
rho_kg_m3 = 1600.0
[section.leg]
material = "cfrp"
outer_diameter_m = 0.030
inner_diameter_m = 0.027
[[node]]
name = "base"
x_m = 0.0
mass_kg = 25.0
size_m = 0.1
cg_m = [0.0, 0.05, 0.0]
inertia_kg_m2 = [0.9, 1.2, 0.9]
$feet[[node]]
name = "top"
x_m = 0.0
y_m = 1.6
mass_kg = 3.0
cg_m = [0.0, 0.03, 0.0]
inertia_kg_m2 = [0.02, 0.03, 0.02]
[[sensor]]
name = "top_x"
frame = "top"
axis = [1.0, 0.0, 0.0]
[suspension]
nodes = ["foot", "left", "right"]
offsets_m = [[0.0, $above, 0.0], [0.0, $above, 0.0], [0.0, $above, 0.0]]
""" + "".join(
    f'[[strut]]\nsection = "leg"\nfrom = "{a}"\nto = "{b}"\n'
    for a in ("base", "top")
    for b in ("foot", "left", "right")
)
FEET = "".join(
    f'[[node]]\nname = "{name}"\nx_m = {x}\nz_m = {z}\nmass_kg = 0.4\n'
    "inertia_kg_m2 = [0.0004, 0.0004, 0.0004]\n"
    for name, x, z in (("foot", 0.4, 0.0), ("left", -0.2, 0.35), ("right", -0.2, -0.35))
)
GRAVITY = """
schema = 1
name = "lab"
[constants]
gravity_m_s2 = 9.80665
gravity_direction = [0.0, -1.0, 0.0]
"""
LABS = {
    "hung": """
[suspension]
cable_length_m = 4.0
bounce_hz = 0.25
[suspension.held]
foot = "xyz"
left = "yz"
right = "y"
""",
    "clamped": '[[clamp]]\nnode = "foot"\n',
}
CONTROL = """
schema = 1
title = "mast"
seed = 1
[article]
own = "mast.toml"
[environment]
orbit = "orbit.toml"
lab = "lab.toml"
[control]
article = "own"
modes_kept = 14
inputs = ["bus_x"]
disturbances = ["bus_x"]
angles = ["bus_x", "top_x"]
pd_loops = ["bus_x"]
pd_kp_nm_per_rad = [0.28]
pd_kd_nms_per_rad = [1.5]
metric = ["top_x"]
metric_weights = [1.0]
input_weight = [1.0]
angle_noise_rad_per_rthz = 2.0e-5
rate_noise_rad_per_s_per_rthz = 2.0e-4
actuator_noise_ratio = 1.0e-5
three_sigma_deg = 1.0
band_hz = [0.1, 60.0]
log10_authority_first = -3.0
log10_authority_last = 3.0
levels = 2
"""


def written(folder: Path, lab: str, above: float) -> Path:
    """The mast and a laboratory; it hangs from points ``above`` its feet [m]."""
    (folder / "mast.toml").write_text(MAST.replace("$above", str(above)).replace("$feet", FEET))
    (folder / "lab.toml").write_text(GRAVITY + LABS[lab])
    (folder / "orbit.toml").write_text('schema = 1\nname = "orbit"\n')
    (folder / "study.toml").write_text(CONTROL)
    return folder


@pytest.mark.parametrize("lab", LABS)
def test_it_runs_to_a_report_without_empty_tables_and_sentences(lab, tmp_path, capfd):
    folder = written(tmp_path, lab, 0.5)
    ended = middeck(capfd, "study", folder / "study.toml", "-o", tmp_path / "out")
    assert ended.code == 0, ended.err
    assert "warning" not in ended.err
    page = (tmp_path / "out/report.html").read_text()
    figures = json.loads((tmp_path / "out/numbers.json").read_text())["figures"]
    assert "</thead><tbody></tbody>" not in re.sub(r"\s+", "", page)
    assert ("as it hangs in 1-g, where its cables carry" in page) == (lab == "hung")
    assert ("as it stands in 1-g." in page) == (lab == "clamped")
    assert ("no mode is one of a suspension" in page) == (lab == "clamped")
    assert ("rigid" in figures["figure_7"]) == (lab == "hung")
    assert "entries between rigid-body" in page or lab == "clamped"


def test_a_motor_of_a_clamped_node_is_reported(tmp_path, capfd):
    folder = written(tmp_path, "clamped", 0.5)
    (folder / "lab.toml").write_text(GRAVITY + '[[clamp]]\nnode = "base"\n')
    ended = middeck(capfd, "study", folder / "study.toml", "-o", tmp_path / "out")
    assert ended.code == 5
    assert "do not move the metric" in ended.err
    assert "not clamped" in ended.err


@pytest.mark.parametrize(("lab", "above"), [("hung", 0.5), ("hung", 0.0), ("clamped", 0.5)])
def test_every_view_shows_the_whole_article(lab, above, tmp_path):
    """Tall as it is, and upside down where it hangs from its feet."""
    structure, environment = load_setup(written(tmp_path, lab, above) / "mast.toml", tmp_path / "lab.toml")
    orbit, rest = (
        solve_modes(solve_equilibrium(structure, place)) for place in (Environment.orbit(), environment)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = figure_3(compare_modes(orbit, rest))
        figure.canvas.draw()
    at = rest.equilibrium.poses.p[:, 1]
    drawn = np.array([node.position[1] for node in structure.nodes])
    for axes, heights in zip(figure.axes, (drawn, drawn, at, at), strict=True):
        low, high = sorted(axes.get_ylim())
        assert low < heights.min() < heights.max() < high
    top = at[rest.equilibrium.model.frames.index("top")]
    assert top < -1.5 if above == 0.0 else top > 1.5
