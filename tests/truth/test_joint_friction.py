"""Friction found in records and taken out of them: its own law, a rig with it, the linear article behind."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck import estimate_response, fit_response
from middeck.errors import ConfigError, DataError, FitError
from middeck.identification.friction.find import find_friction
from middeck.identification.friction.remove import without_friction
from middeck.identification.friction.slider import slider_torque
from middeck.identification.model.measurement_model import natural_hz
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.signals.record import Record
from repeats import repeats
from rubbing_joint import BAND, BEARING, DELAY, HZ, JOINTS, records


@pytest.mark.parametrize("seed", repeats(range(20), 3))
def test_its_torque_is_that_of_the_bearing_step_by_step(seed: int):
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.standard_normal((200, 3)), axis=0)
    angle -= np.linspace(0.0, 1.0, 200)[:, None] * (angle[-1] - angle[0])
    slip = rng.uniform(0.3, 3.0, 3)
    found = slider_torque(angle, slip)
    for series in range(3):
        bearing, state = Friction(slip_torque=1.0, stiffness=1.0 / slip[series]), 0.0
        for lap in range(2):
            for k, now in enumerate(angle[:, series].tolist()):
                torque, state = bearing.resist(now, state)
                if lap:
                    assert found[k, series] == pytest.approx(torque, abs=1e-9)


@pytest.fixture(scope="module")
def rubbing() -> Record:
    return records([JointElements("joint", "joint", (BEARING,))])


@pytest.fixture(scope="module")
def smooth() -> Record:
    return records([])


def test_slip_torque_slip_angle_and_delay_are_found(rubbing: Record):
    found = find_friction(rubbing, JOINTS, band_hz=BAND)
    assert found.before > 100.0
    assert 0.8 < found.after < 1.25
    # Four deviations, and half a per cent: the slider stands between samples too.
    within = 4.0 * found.slip_torque_std[0] + 5e-3 * BEARING.slip_torque
    assert abs(found.slip_torque[0] - BEARING.slip_torque) < within
    assert found.slip_angle[0] == pytest.approx(BEARING.slip_angle, rel=0.05)
    assert found.delay_s == pytest.approx(DELAY, abs=3e-4)
    np.testing.assert_allclose(found.stiffness, found.slip_torque / found.slip_angle)
    reported = find_friction(rubbing, JOINTS, band_hz=BAND, delay_s=DELAY)
    assert reported.delay_s == pytest.approx(DELAY, abs=1e-12)
    assert reported.slip_torque[0] == pytest.approx(found.slip_torque[0], rel=5e-3)


def test_behind_the_friction_the_article_is_linear(rubbing: Record):
    """Modes within four deviations of the truth, where those of the record as taken are far off."""

    def modes_of(record: Record) -> tuple[np.ndarray, np.ndarray]:
        measured = estimate_response(record, band_hz=BAND)
        fit = fit_response(measured, states=6, delay="common")
        order = np.argsort(natural_hz(fit.model))
        return natural_hz(fit.model)[order], fit.uncertainty.natural_hz[order]

    found = find_friction(rubbing, JOINTS, band_hz=BAND)
    hz, std = modes_of(without_friction(rubbing, found))
    assert np.all(np.abs(hz - HZ) < 4.0 * std + 2e-5 * HZ)
    raw, _ = modes_of(dataclasses.replace(rubbing, u=rubbing.u[:2], y=rubbing.y[:2]))
    assert np.max(np.abs(raw / HZ - 1.0)) > 20.0 * np.max(np.abs(hz / HZ - 1.0))


def test_where_there_is_no_friction_next_to_none_is_found(smooth: Record):
    found = find_friction(smooth, JOINTS, band_hz=BAND, delay_s=DELAY)
    assert abs(found.slip_torque[0]) < max(5.0 * found.slip_torque_std[0], 1e-3 * BEARING.slip_torque)
    assert found.after <= found.before
    assert found.before == pytest.approx(1.0, abs=0.2)


def test_experiments_are_brought_to_one_noise(rubbing: Record):
    found = find_friction(rubbing, JOINTS, band_hz=BAND)
    linear = without_friction(rubbing, found)
    noise = linear.y.std(axis=1, ddof=1).mean(axis=(1, 2))
    assert noise == pytest.approx(noise[:1].repeat(3), rel=0.1)
    gain = linear.y[:, 0, :, 0].std(axis=1) / rubbing.y[:, 0, :, 0].std(axis=1)
    np.testing.assert_allclose(linear.u[..., 0], gain[:, None, None] * rubbing.u[..., 0], rtol=1e-9)


def test_what_cannot_tell_friction_is_refused(rubbing: Record):
    two = dataclasses.replace(rubbing, u=rubbing.u[:2], y=rubbing.y[:2])
    with pytest.raises(DataError, match="2 experiments for 2 inputs"):
        find_friction(two, JOINTS, band_hz=BAND)
    short = dataclasses.replace(rubbing, u=rubbing.u[:, :1], y=rubbing.y[:, :1])
    with pytest.raises(DataError, match="two or more"):
        find_friction(short, JOINTS, band_hz=BAND)
    quiet = dataclasses.replace(rubbing, y=np.broadcast_to(rubbing.y[:, :1], rubbing.y.shape))
    with pytest.raises(DataError, match="without any noise"):
        find_friction(quiet, JOINTS, band_hz=BAND)
    with pytest.raises(ConfigError, match="no output named 'elbow'"):
        find_friction(rubbing, [("joint", "elbow")], band_hz=BAND)
    with pytest.raises(ConfigError, match="no joint"):
        find_friction(rubbing, [], band_hz=BAND)
    with pytest.raises(ConfigError, match="no line between"):
        find_friction(rubbing, JOINTS, band_hz=(0.21, 0.22))
    with pytest.raises(FitError, match="does not drive"):
        find_friction(dataclasses.replace(rubbing, y=rubbing.y * [1.0, -1.0]), JOINTS, band_hz=BAND)
    loose = dataclasses.replace(rubbing, periodic=False)
    with pytest.raises(DataError, match="not periodic"):
        without_friction(loose, find_friction(rubbing, JOINTS, band_hz=BAND))
