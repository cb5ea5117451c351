"""Friction and play of a study's gimbals: from its keys, in SI, and only where the keys say how."""

import re
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.studies.documents import load_study
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction

ROOT = Path(__file__).parents[2]


def study_with(tmp_path, *lines):
    """The study of the paper with other ``lines`` about friction and play under its [rig]."""
    text = (ROOT / "studies/mace-1993.toml").read_text().replace('"../', f'"{ROOT}/')
    text, count = re.subn(r"(?m)^gimbal_(friction|viscous|presliding)_.*\n", "", text)
    assert count == 3
    path = tmp_path / "study.toml"
    path.write_text(text.replace("[rig]", "\n".join(["[rig]", *lines, "# the rest:"]), 1))
    return load_study(path)


RUBS = ("gimbal_friction_nm = 0.002", "gimbal_viscous_nms_per_rad = 0.001")
SMOOTH = ("gimbal_friction_nm = 0", "gimbal_viscous_nms_per_rad = 0")


def test_the_study_as_it_stands_has_friction_and_no_play():
    (friction,) = load_study(ROOT / "studies/mace-1993.toml").rig.gimbal_elements
    assert isinstance(friction, Friction)
    assert (friction.slip_torque, friction.viscous) == (0.002, 0.001)


@pytest.mark.parametrize("more", [(), ("gimbal_presliding_deg = 0.05",)])
def test_without_friction_there_is_none(tmp_path, more):
    assert study_with(tmp_path, *SMOOTH, *more).rig.gimbal_elements == ()


def test_friction_that_could_not_act_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="needs 'gimbal_presliding_deg' beside it"):
        study_with(tmp_path, *RUBS)
    with pytest.raises(ConfigError, match="has no effect where gimbal_friction_nm is 0"):
        study_with(tmp_path, SMOOTH[0], RUBS[1], "gimbal_presliding_deg = 0.05")


def test_keys_become_elements_in_radians(tmp_path):
    rig = study_with(
        tmp_path,
        *RUBS,
        "gimbal_presliding_deg = 0.05",
        "gimbal_deadband_deg = 0.1",
        "gimbal_flank_nm_per_rad = 30.0",
    ).rig
    friction, gap = rig.gimbal_elements
    assert isinstance(friction, Friction)
    assert (friction.slip_torque, friction.viscous) == (0.002, 0.001)
    assert friction.slip_angle == pytest.approx(0.05 * np.pi / 180.0, rel=1e-15)
    assert isinstance(gap, Deadband)
    assert (gap.stiffness, gap.preload) == (30.0, 0.0)
    assert gap.gap == pytest.approx(0.1 * np.pi / 180.0, rel=1e-15)


@pytest.mark.parametrize("line", ["gimbal_deadband_deg = 0.1", "gimbal_flank_nm_per_rad = 3.0"])
def test_a_gap_without_flanks_and_flanks_without_a_gap_are_refused(tmp_path, line):
    with pytest.raises(ConfigError, match="give both or neither"):
        study_with(tmp_path, *SMOOTH, line)
