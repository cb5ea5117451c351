"""Sweeps over authority, the first instability, participation: toys with known answers, then Figure 7."""

import dataclasses
from functools import partial

import mace_like
import numpy as np
import pytest

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import close_inner_loop
from middeck.control.loop.authority import find_first_instability, find_participation, sweep_authority
from middeck.control.loop.closed_loop import close_loop, leave_open
from middeck.control.loop.performance import Performance, loop_metric, loop_rms
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.signals.ports import Port
from middeck.systems.norms.band_rms import band_rms_by_quadrature
from middeck.systems.state_space.statespace import StateSpace, gain_system
from plant_builders import grouped_plant

LEVELS = np.logspace(-1.5, 4.5, 25)


def third_order():
    """G = 1/(s + 1)^3: gain feedback -k is stable up to k = 8, where it oscillates at sqrt 3 rad/s."""
    A = -np.eye(3) + np.diag(np.ones(2), 1)
    ports = (Port("f", "N"),), (Port("x", "m"),)
    system = StateSpace(A, np.eye(3)[:, 2:], np.eye(3)[:1], [[0.0]])
    return grouped_plant(system, ports[0], ports[1], state_names=("first", "second", "third"))


def gain_law(authority):
    return Compensator(gain_system([[-authority]]), (Port("x", "m"),), (Port("f", "N"),))


def test_first_instability_of_a_known_threshold():
    found = find_first_instability(gain_law, third_order(), first=-1.5)
    # The unstable end of an interval not wider than 0.005.
    assert np.log10(8.0) < found.log10_authority <= np.log10(8.0) + 0.005
    assert found.frequency_hz == pytest.approx(np.sqrt(3.0) / (2.0 * np.pi), rel=5e-3)
    # Equal lags around a loop: each takes part alike.
    assert found.participation == pytest.approx(1.0 / 3.0, rel=1e-9)
    assert found.compensator_share == 0.0


def test_no_instability_is_none():
    # 1/(s + 1) under gain feedback has its pole at -1 - k.
    lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    stable = dataclasses.replace(third_order(), dynamics=lag, state_names=("lag",))
    assert find_first_instability(gain_law, stable, first=-1.5) is None


def test_unstable_from_the_start_reports_the_first_level():
    found = find_first_instability(gain_law, third_order(), first=1.0)
    assert found.log10_authority == 1.0


def test_stability_that_returns_does_not_hide_the_first():
    def bump(authority):
        return gain_law(20.0 if 10.0 < authority < 100.0 else 1.0)

    found = find_first_instability(bump, third_order(), first=-1.5)
    assert 1.0 < found.log10_authority <= 1.005


def test_an_unstable_loop_has_infinite_rms():
    performance = Performance(np.ones(1), np.eye(1), (0.1, 60.0))
    loop = close_loop(third_order(), gain_law(9.0))
    assert not loop.stable
    assert loop_rms(loop, performance)[0] == np.inf
    assert loop_metric(loop, performance) == np.inf


def test_participation_sums_to_one_and_ignores_the_scaling_of_states():
    plant = close_inner_loop(mace_like.build("lab"), mace_like.pd_loops())
    law = design_lqg(plant, mace_like.weights(2e-6), 10.0)
    part = find_participation(close_loop(plant, law))
    assert part.shares.sum() + part.compensator == pytest.approx(1.0, abs=1e-12)
    assert np.all(part.shares >= 0.0)
    system = plant.system
    t = 10.0 ** np.random.default_rng(0).uniform(-3.0, 3.0, len(system.A))
    scaled = StateSpace(system.A * t[:, None] / t, system.B * t[:, None], system.C / t, system.D)
    again = find_participation(close_loop(dataclasses.replace(plant, dynamics=scaled), law))
    # Eigenvectors of a 98-state loop before and after six decades of scaling.
    np.testing.assert_allclose(again.shares, part.shares, atol=1e-7)
    assert again.pole == pytest.approx(part.pole, rel=1e-8)


def test_participation_of_uncoupled_modes_is_all_one_mode():
    A = np.array([[0.0, 5.0, 0.0, 0.0], [-5.0, -0.1, 0.0, 0.0], [0.0, 0.0, 0.0, 9.0], [0.0, 0.0, -9.0, -1.0]])
    ports = (Port("f", "N"),), (Port("x", "m"),)
    system = StateSpace(A, np.ones((4, 1)), np.ones((1, 4)), [[0.0]])
    names = ("slow", "slow", "fast", "fast")
    part = find_participation(leave_open(grouped_plant(system, ports[0], ports[1], state_names=names)))
    assert part.names == ("slow", "fast")
    np.testing.assert_allclose(part.shares, [1.0, 0.0], atol=1e-14)


@pytest.fixture(scope="module")
def rehearsal():
    """Figure 7 on the made-up structure, the way the study goes: all modes, then the two sub-models."""
    pd, unit = mace_like.pd_loops(), Performance(mace_like.METRIC_WEIGHTS, np.eye(2), mace_like.BAND_HZ)
    found, intensity = {}, 0.0
    for part in ("all", "rigid", "flexible"):
        inner = {g: close_inner_loop(mace_like.build(g, part), pd) for g in ("orbit", "lab")}
        if part == "all":
            intensity = (np.deg2rad(1.0) / 3.0 / loop_metric(leave_open(inner["orbit"]), unit)) ** 2
        performance = dataclasses.replace(unit, intensity=intensity * np.eye(2))
        weights = mace_like.weights(intensity)
        design = partial(design_lqg, inner["orbit"], weights, kalman=design_filter(inner["orbit"], weights))
        reference = loop_metric(leave_open(inner["orbit"]), performance)
        sweep = sweep_authority(design, LEVELS, on=inner, performance=performance, reference=reference)
        first = find_first_instability(design, inner["lab"], first=-1.5)
        found[part] = inner, performance, design, reference, sweep, first
    return found


def test_rehearsal_disturbance_gives_three_sigma_of_one_degree(rehearsal):
    _, _, _, reference, _, _ = rehearsal["all"]
    assert 3.0 * np.rad2deg(reference) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("part", ["all", "rigid", "flexible"])
def test_rehearsal_orbit_is_stable_and_falls_with_authority(rehearsal, part):
    sweep = rehearsal[part][4]
    assert sweep.plants == ("orbit", "lab")
    assert sweep.stable[0].all()
    assert np.all(np.diff(sweep.db[0]) < 0.0)
    assert np.all(np.isinf(sweep.db[~sweep.stable]))
    assert np.all(np.isfinite(sweep.db[sweep.stable]))


def test_rehearsal_first_instability_agrees_with_the_sweep(rehearsal):
    inner, _, design, _, sweep, first = rehearsal["all"]
    unstable = np.log10(LEVELS)[~sweep.stable[1]]
    assert unstable[0] - 0.25 < first.log10_authority <= unstable[0]
    assert not close_loop(inner["lab"], design(10.0**first.log10_authority)).stable
    assert close_loop(inner["lab"], design(10.0 ** (first.log10_authority - 0.005))).stable
    assert first.mode_name.startswith("suspension")
    assert 0.0 < first.participation <= 1.0
    assert 0.0 < first.compensator_share < 1.0


def test_rehearsal_riccati_residuals(rehearsal):
    for part in ("all", "rigid", "flexible"):
        law = rehearsal[part][2](1e3)
        # Process noise and sensor noise lie ten decades apart; rounding after refinement.
        assert law.regulator.residual < 1e-12
        assert law.estimator.residual < 1e-12


def test_rehearsal_band_rms_agrees_with_quadrature(rehearsal):
    inner, performance, design, *_ = rehearsal["rigid"]
    loop = close_loop(inner["orbit"], design(100.0))
    exact = loop_rms(loop, performance)
    check = band_rms_by_quadrature(loop.system, performance.intensity, performance.band_hz)
    np.testing.assert_allclose(exact, check, rtol=1e-10)
