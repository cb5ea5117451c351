"""What `modes` says of an article that has a hinge which settles, beside a motor and a spring."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli_runner import middeck

NODE = """\
schema = 1
name = "hung"
node = [{name = "bus", x_m = 0.0, mass_kg = 3.0, inertia_kg_m2 = [0.1, 0.1, 0.1]}]
"""
JOINT = """\
[[revolute]]
name = "KIND"
parent = "bus"
axis = [0.0, 0.0, 1.0]
mass_kg = 0.5
cg_m = [0.0, -0.2, 0.0]
inertia_kg_m2 = [0.01, 0.01, 0.01]
state = "KIND"
"""
STAND = """\
schema = 1
name = "stand"
constants = {gravity_m_s2 = 9.81}
clamp = [{node = "bus"}]
"""


def test_nothing_holds_a_hinge(capfd: pytest.CaptureFixture[str], tmp_path: Path):
    sprung = JOINT.replace("KIND", "sprung") + "stiffness_nm_per_rad = 4.0\nrest_deg = 0.0\n"
    article, stand = tmp_path / "hung.toml", tmp_path / "stand.toml"
    article.write_text(NODE + sprung + "".join(JOINT.replace("KIND", k) for k in ("free", "hinged")))
    stand.write_text(STAND)
    shown = middeck(capfd, "modes", article, "--environment", stand)
    lines = [" ".join(line.split()) for line in shown.out.splitlines()]
    assert {"sprung 0.00000 its spring", "free 0.00000 its motor", "hinged 0.00000 nothing"} <= set(lines)
