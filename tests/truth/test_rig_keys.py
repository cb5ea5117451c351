"""Every key of a study's [rig], one by one: what it does to the rig, and that it does nothing else."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pytest

from middeck.files.studies.documents import load_study
from middeck.files.studies.form import RigForm
from middeck.files.studies.rig_table import build_rig_settings
from middeck.joints.attachment import add_viscous
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.article_rig import build_article_rig, build_rig_article
from middeck.laboratory.linear_rig_record import rig_plant, run_rig_experiment
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.tested_article import rig_article_plant
from middeck.structure.model.environment import Environment
from middeck.systems.plants.response import statespace_response

ROOT = Path(__file__).resolve().parents[2]
PORTS = {"inputs": ("pri_rel_z", "bus_z"), "outputs": ("pri_in_z", "pri_rel_z")}


@pytest.fixture(scope="module")
def form():
    rig = RigForm.model_validate(tomllib.loads((ROOT / "studies/mace-1993.toml").read_text())["rig"])
    gear = {"gimbal_deadband_deg": 0.1, "gimbal_flank_nm_per_rad": 30.0, "mesh_factor": 1}
    slews = {"gimbal_slew_nm_per_s": 100.0, "wheel_slew_nm_per_s": 50.0}
    return rig.model_copy(update=gear | slews)


def facts(dm, lab, form):
    """What can be said of a rig, by name, each from the rig itself or from its response."""
    settings = build_rig_settings(form)
    on_ground = build_rig_article(dm, lab, settings)
    in_orbit = build_rig_article(dm, Environment.orbit(), settings)
    rig = build_article_rig(on_ground, settings, **PORTS)
    (gimbal, wheel), (gyro, encoder) = rig.motors, rig.sensors
    friction, gap = rig.joints[0].elements
    assert isinstance(friction, Friction)
    assert isinstance(gap, Deadband)
    member = on_ground.equilibrium.model.structure.members[0]
    plant = rig_article_plant(
        on_ground, inputs=("pri_rel_z", "pri_rel_x"), outputs=("pri_rel_z", "pri_rel_x")
    )
    omega = np.array([2.0 * np.pi * 1.0])
    sampled = statespace_response(linearise_rig(rig).sampled, omega)[0, 1, 0]
    prompt = statespace_response(add_viscous(plant, rig.joints), omega)[0, 0, 0]
    return {
        "rate": rig.sample_hz,
        "late": -float(np.angle(sampled / prompt) / omega[0]),
        "wheel torque": wheel.torque_limit,
        "rotor inertia": wheel.rotor.inertia,
        "rotor speed": wheel.rotor.speed_limit,
        "wheel slew": wheel.slew_limit,
        "wheel step": wheel.resolution,
        "gimbal torque": gimbal.torque_limit,
        "gimbal slew": gimbal.slew_limit,
        "gimbal step": gimbal.resolution,
        "slip torque": friction.slip_torque,
        "drag": friction.viscous,
        "slip angle": friction.slip_angle,
        "gap": gap.gap,
        "flank": gap.stiffness,
        "count": encoder.step,
        "noise": gyro.noise,
        "bias": gyro.bias,
        "walk": gyro.bias_walk,
        "bandwidth": gyro.bandwidth_hz,
        "anti-alias": gyro.anti_alias_hz,
        "gyro step": gyro.resolution,
        "gyro range": gyro.range,
        "modes": len(rig_article_plant(on_ground, **PORTS, to_hz=settings.modes_hz).dynamics.omega),
        "elements": member.elements,
        "shear": member.section.GA_y,
        "lightest tie": float(in_orbit.modes.frequency_hz[5]),
        "hidden": on_ground.hidden,
    }


CHANGES = {  # key: a factor or a value, and by how much which facts change
    "sample_hz": (2.0, {"rate": 2.0}),
    "delay_s": (2.0, {"late": 2.0}),
    "wheel_torque_nm": (2.0, {"wheel torque": 2.0, "wheel step": 2.0}),
    "wheel_rotor_inertia_kg_m2": (2.0, {"rotor inertia": 2.0}),
    "wheel_speed_rad_s": (2.0, {"rotor speed": 2.0}),
    "gimbal_torque_nm": (2.0, {"gimbal torque": 2.0, "gimbal step": 2.0}),
    "gimbal_friction_nm": (2.0, {"slip torque": 2.0}),
    "gimbal_viscous_nms_per_rad": (2.0, {"drag": 2.0}),
    "gimbal_presliding_deg": (2.0, {"slip angle": 2.0}),
    "gimbal_deadband_deg": (2.0, {"gap": 2.0}),
    "gimbal_flank_nm_per_rad": (2.0, {"flank": 2.0}),
    "encoder_counts": (2, {"count": 0.5}),
    "gyro_noise_rad_per_s_per_rthz": (2.0, {"noise": 2.0}),
    "gyro_bias_rad_s": (2.0, {"bias": 2.0}),
    "gyro_bias_walk_rad_per_s_per_rts": (2.0, {"walk": 2.0}),
    "gyro_bandwidth_hz": (2.0, {"bandwidth": 2.0}),
    "converter_bits": (0.5, {"wheel step": 256.0, "gimbal step": 256.0, "gyro step": 256.0}),
    "anti_alias_hz": (2.0, {"anti-alias": 2.0}),
    "umbilical_hz": (2.0, {"lightest tie": 2.0}),
    "gimbal_slew_nm_per_s": (2.0, {"gimbal slew": 2.0}),
    "wheel_slew_nm_per_s": (2.0, {"wheel slew": 2.0}),
    "gyro_range_rad_s": (2.0, {"gyro range": 2.0, "gyro step": 2.0}),
    "modes_hz": (0.5, {"modes": None}),
    "mesh_factor": (2, {"elements": 2.0}),
    "shear_coefficient": (0.5, {"shear": 0.5}),
    "hidden_seed": (
        None,
        {"hidden": None, "shear": None, "late": None, "lightest tie": None},
    ),
    "rest_s": (2.0, {}),  # of a run, not of the rig: see `Bench`
    "identification_noise": (2.0, {}),  # of the linear rig, below
}


MEASURED = ("late", "lightest tie")  # not given but seen in a response


def test_no_key_is_forgotten():
    assert set(CHANGES) == set(RigForm.model_fields)


@pytest.fixture(scope="module")
def plain(dm, lab, form):
    return facts(dm, lab, form)


@pytest.mark.parametrize("key", CHANGES)
def test_a_key_does_what_it_says_and_nothing_else(dm, lab, form, plain, key):
    factor, expected = CHANGES[key]
    old = getattr(form, key)
    new = 3 if factor is None else type(old)(factor * old)
    changed = facts(dm, lab, form.model_copy(update={key: new}))
    for name, value in plain.items():
        if name not in expected and value is not None:
            # What the plant's response says of the delay depends a little on all that moves the plant.
            assert changed[name] == pytest.approx(value, rel=1e-3 if name in MEASURED else 1e-12), name
        elif name not in expected:
            assert changed[name] is None, name
        elif expected[name] is None:
            assert changed[name] != value, name
        else:
            assert changed[name] == pytest.approx(expected[name] * value, rel=1e-3), name


def test_the_rig_of_the_study_is_richer_than_what_anyone_designs_with(dm, lab):
    study = load_study(ROOT / "studies" / "mace-1993.toml")
    article = build_rig_article(dm, lab, study.rig)
    for mine, theirs in zip(article.equilibrium.model.structure.members, dm.members, strict=True):
        assert mine.elements == 3 * theirs.elements
        assert np.isfinite([mine.section.GA_y, mine.section.GA_z]).all()
        assert np.isinf([theirs.section.GA_y, theirs.section.GA_z]).all()
    modes = rig_article_plant(article, **PORTS, to_hz=study.rig.modes_hz).dynamics
    assert study.rig.modes_hz == 200.0
    assert 150.0 < modes.omega[-1] / (2.0 * np.pi) < 200.0
    assert len(modes.omega) > study.siso.states


def test_identification_noise_is_a_part_of_the_rms_of_each_output(dm, lab, form):
    settings = build_rig_settings(form)
    article = build_rig_article(dm, lab, settings)
    plant = rig_plant(article.modes, "pri_rel_z", ("pri_in_z", "bus_z"))
    test = dataclasses.replace(load_study(ROOT / "studies/mace-1993.toml").loop_test, period_s=16.0)
    share = []
    for part in (0.01, 0.02):
        taken = run_rig_experiment(
            plant, dataclasses.replace(settings, noise_share=part), test, np.random.default_rng(0)
        )
        y = taken.y[0]
        noise = np.std(np.diff(y, axis=0), axis=(0, 1)) / np.sqrt(2.0)
        share.append(noise / np.std(y.mean(axis=0), axis=0))
    # 16,000 differences: the rms is known to 0.6 %, taken four times.
    np.testing.assert_allclose(share, [[0.01, 0.01], [0.02, 0.02]], rtol=0.025)
