"""The article on the rig: finer, in shear, wrong by a seed, tied in orbit; and its motors and sensors."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_structure
from middeck.files.studies.documents import load_study
from middeck.laboratory.article_rig import build_article_rig, build_rig_article
from middeck.laboratory.hidden_errors import draw_hidden_errors
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro
from middeck.laboratory.rig.plant.drifting_modes import Drift, nearest_modes
from middeck.laboratory.rig.runs import run_open_loop
from middeck.laboratory.tested_article import (
    rig_article_plant,
    solve_rig_article,
)
from middeck.structure.model.environment import Environment
from middeck.structure.model.finer_mesh import TUBE_SHEAR
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from middeck.systems.poles.stability import growth_rates
from rig_checks import hidden

ROOT = Path(__file__).resolve().parents[2]
PORTS = {"inputs": ("pri_rel_z", "bus_z"), "outputs": ("pri_in_z", "pri_rel_z")}


@pytest.fixture(scope="module")
def settings():
    return load_study(ROOT / "studies" / "mace-1993.toml").rig


def flexible(modes):
    return modes.frequency_hz[np.array(modes.kind) == "flexible"]


def test_as_coarse_and_without_shear_it_is_the_article(dm, lab):
    article = solve_modes(solve_equilibrium(dm, lab))
    same = solve_rig_article(dm, lab, mesh_factor=1, shear=None)
    assert np.array_equal(same.modes.omega, article.omega)
    erring = solve_rig_article(dm, lab, hidden(), mesh_factor=1, shear=None)
    np.testing.assert_allclose(erring.modes.frequency_hz, article.frequency_hz, rtol=1e-9)


def test_finer_and_in_shear_it_is_softer_and_has_its_modes_to_200_hz(dm):
    """A finer mesh (Rayleigh) and shear both lower every frequency; shear does so by most at the top."""
    orbit = Environment.orbit()
    coarse, finer, sheared = (
        flexible(solve_rig_article(dm, orbit, mesh_factor=f, shear=k).modes)[:16]
        for f, k in ((1, None), (2, None), (2, TUBE_SHEAR))
    )
    assert np.all(finer <= coarse * (1.0 + 1e-9))
    lost = 1.0 - sheared / finer
    assert np.all(lost >= -1e-9)
    # The sheet says about 1 % near 45 Hz.
    assert 0.003 < lost.max() < 0.03
    assert lost[0] < 1e-3
    modes = solve_rig_article(dm, orbit, mesh_factor=2).modes
    plant = rig_article_plant(solve_rig_article(dm, orbit, mesh_factor=2), **PORTS)
    assert len(plant.dynamics.omega) == np.sum(modes.frequency_hz < 200.0)
    assert plant.dynamics.omega[-1] > 2.0 * np.pi * 100.0


def test_cowpers_coefficient():
    m, nu = 0.0130 / 0.0254, 0.37
    inside = (1.0 + m**2) ** 2
    cowper = 6.0 * (1.0 + nu) * inside / ((7.0 + 6.0 * nu) * inside + (20.0 + 12.0 * nu) * m**2)
    assert pytest.approx(cowper, abs=5e-3) == TUBE_SHEAR


def test_hidden_modulus_is_a_factor_of_all_free_frequencies(dm):
    orbit = Environment.orbit()
    stiff = solve_rig_article(dm, orbit, hidden(modulus=1.21), mesh_factor=1)
    plain = solve_rig_article(dm, orbit, mesh_factor=1)
    np.testing.assert_allclose(flexible(stiff.modes)[:20], 1.1 * flexible(plain.modes)[:20], rtol=1e-9)


def test_hidden_errors_are_drawn_within_their_ranges(dm):
    drawn = [draw_hidden_errors(dm, seed) for seed in range(40)]
    assert drawn[3] == draw_hidden_errors(dm, 3)
    assert drawn[3] != drawn[4]

    def spread(values):
        return np.min(values), np.max(values)

    for values, centre, half in (
        ([d.modulus for d in drawn], 1.0, 0.15),
        ([f for d in drawn for _, f in d.strut], 0.975, 0.025),
        ([f for d in drawn for _, f in d.mass], 1.0, 0.05),
        ([f for d in drawn for _, three in d.inertia for f in three], 1.0, 0.1),
        ([f for d in drawn for _, three in d.payload_inertia for f in three], 1.0, 0.1),
        ([f for d in drawn for _, f in d.payload_cg], 1.0, 0.1),
        ([d.bounce for d in drawn], 1.0, 0.1),
        ([d.cable_length for d in drawn], 1.0, 0.05),
        ([d.delay_s for d in drawn], 0.0, 1e-3),
        ([f for d in drawn for _, f in d.gain], 1.0, 0.02),
    ):
        low, high = spread(values)
        assert centre - half <= low < centre - 0.5 * half
        assert centre + 0.5 * half < high <= centre + half
    assert [name for name, _ in drawn[0].mass] == ["n1", "n3", "n5"]
    assert [name for name, _ in drawn[0].payload_inertia] == ["pri_z"]


def test_each_mode_has_its_own_hidden_damping(dm, lab):
    drawn = np.linspace(-2.0, 2.0, 200)
    article = solve_rig_article(dm, lab, hidden(damping=drawn), mesh_factor=1)
    plant = rig_article_plant(article, **PORTS)
    sheet = np.where(np.array(article.modes.kind) == "suspension", 0.03, 0.01)[: len(plant.dynamics.zeta)]
    expected = sheet * np.exp(0.3 * drawn[: len(sheet)])
    np.testing.assert_allclose(plant.dynamics.zeta, expected, rtol=1e-12)


def test_in_orbit_an_umbilical_ties_it_weakly(dm, lab, settings):
    tied = solve_rig_article(dm, Environment.orbit(), mesh_factor=1, umbilical_hz=settings.umbilical_hz).modes
    free = solve_rig_article(dm, Environment.orbit(), mesh_factor=1).modes
    assert np.sum(free.omega == 0.0) == 8
    # Tied at one point: three translations have a frequency, of the sheet's size; rotations about it do not.
    assert np.sum(tied.omega == 0.0) == 5
    assert tied.frequency_hz[5] == pytest.approx(settings.umbilical_hz, rel=1e-3)
    # Beside the centre of mass the tie moves less than the whole mass; half of it at the least.
    assert np.all(tied.frequency_hz[5:8] > 0.999 * settings.umbilical_hz)
    assert np.all(tied.frequency_hz[5:8] < 1.5 * settings.umbilical_hz)
    np.testing.assert_allclose(flexible(tied), flexible(free), rtol=1e-3)
    hung = [solve_rig_article(dm, lab, mesh_factor=1, umbilical_hz=hz).modes.omega for hz in (0.0, 0.02)]
    assert np.array_equal(*hung)


def test_the_motor_holds_the_payload_and_has_that_much_less(lab, settings):
    simple = load_structure(ROOT / "articles" / "mace-simple.toml")
    article = build_rig_article(simple, lab, dataclasses.replace(settings, mesh_factor=1))
    # 5 kg, 0.08 m below the axes, turned by 45 degrees; the article itself rolls by a little.
    weight = 5.0 * 9.80665 * 0.08 * np.sin(np.pi / 4.0)
    joints = [j.name for j in article.equilibrium.model.structure.joints]
    held = article.equilibrium.holding_torque[joints.index("pri_x")]
    assert abs(held) == pytest.approx(weight, rel=0.05)
    rig = build_article_rig(
        article, settings, inputs=("pri_rel_x", "bus_x"), outputs=("pri_in_x", "pri_rel_x")
    )
    gimbal, wheel = rig.motors
    assert gimbal.holding == held
    assert gimbal.torque_limit == 5.0
    assert gimbal.rotor is None
    assert wheel.rotor.inertia == 0.006
    assert wheel.holding == 0.0
    assert wheel.resolution == pytest.approx(2.0 * 0.5 / 65536)
    gyro, encoder = rig.sensors
    assert isinstance(gyro, Gyro)
    assert isinstance(encoder, Encoder)
    assert encoder.step == pytest.approx(2.0 * np.pi / 262144)
    with pytest.raises(ConfigError, match="no actuator"):
        build_article_rig(article, settings, inputs=("fin",), outputs=("pri_in_x",))


def test_a_study_rig_runs_drifted_and_rubbing(dm, lab, settings):
    rubs = dataclasses.replace(settings, mesh_factor=1, rest_s=1.0)
    article = build_rig_article(dm, lab, dataclasses.replace(rubs, hidden_seed=0))
    pair = nearest_modes(rig_article_plant(article, **PORTS), 9.0)
    poles = []
    for age in (0.0, 10.0):
        rig = build_article_rig(
            article,
            rubs,
            inputs=("pri_rel_z",),
            outputs=("pri_in_z",),
            drifts=[Drift(pair, 2.0, 10.0)],
            age_s=age,
        )
        assert {j.torque for j in rig.joints} == {"pri_rel_x", "pri_rel_z"}
        poles.append(np.abs(growth_rates(linearise_rig(rig).sampled).imag) / (2.0 * np.pi))
    near = [np.unique(np.round(p[(p > 8.3) & (p < 10.0)], 6)) for p in poles]
    # Viscous drag in the bearings moves the damped frequency by next to nothing.
    np.testing.assert_allclose(near[1] / near[0], 1.02, rtol=1e-4)
    ports = {"inputs": ("pri_rel_z",), "outputs": ("pri_in_z",)}
    goes_on = build_article_rig(
        article, rubs, **ports, drifts=[Drift(pair, 2.0, 10.0)], age_s=10.0, drifting=True
    )
    assert rig.ageing is None
    # Switched on it is the one that halted at that age, and goes on from there: 2 % of it as new in 10 s.
    assert goes_on.plant == rig.plant
    assert goes_on.ageing.age_s == 10.0
    new = nearest_modes(goes_on.ageing.plant, 9.0)
    assert new == pair
    assert goes_on.ageing.drifts == (Drift(pair, 2.0, 10.0),)
    u = 0.1 * np.sin(2.0 * np.pi * 1.0 * np.arange(500) / 500.0)[:, None]
    run = run_open_loop(rig, u, periods=1, rng=np.random.default_rng(0), settle=1, rest_s=1.0)
    assert run.cause == ""
    assert np.std(run.record.y) > 1e-4
