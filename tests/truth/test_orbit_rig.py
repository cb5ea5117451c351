"""The rig in orbit: the same hardware, one argument changed; records in open and in closed loop."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.files.setups import load_environment, load_structure
from middeck.files.studies.documents import load_study
from middeck.laboratory.article_rig import build_article_rig, build_rig_article
from middeck.laboratory.rig.linear_view import close_rig, linearise_rig
from middeck.laboratory.rig.runs import run_closed_loop, run_open_loop
from middeck.signals.excitation.multisine import random_multisine
from middeck.structure.model.environment import Environment
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.stability import growth_rates
from middeck.systems.sampling.sampling import tustin
from middeck.systems.state_space.statespace import StateSpace
from repeats import repeats
from rig_checks import on_rig

ROOT = Path(__file__).resolve().parents[2]
LOOPS = ("bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z")
OUTPUTS = (*LOOPS, "pri_in_z")
KP = np.array([0.007619, 0.3142, 0.3629, 0.01004, 0.01406])  # of the sheet, [control]
KD = np.array([0.04042, 1.667, 1.925, 0.01997, 0.02798])
PERIOD_S, RATE = 16.0, 500.0


@pytest.fixture(scope="module")
def settings():
    return dataclasses.replace(load_study(ROOT / "studies/mace-1993.toml").rig, hidden_seed=5)


@pytest.fixture(scope="module")
def rigs(settings):
    dm = load_structure(ROOT / "articles" / "mace-dm.toml")
    places = {"orbit": Environment.orbit(), "lab": load_environment(ROOT / "environments" / "lab.toml")}
    return {
        name: build_article_rig(
            build_rig_article(dm, place, settings), settings, inputs=LOOPS, outputs=OUTPUTS
        )
        for name, place in places.items()
    }


def pd_loops():
    """The sheet's loops behind a roll-off at 2 Hz: the delay turns faster modes of the wheels' paths over."""
    w, n = 2.0 * np.pi * 2.0, len(LOOPS)
    A = np.kron(np.eye(n), [[0.0, 1.0], [-(w**2), -1.4 * w]])
    B = np.hstack([np.kron(np.eye(n), [[0.0], [w**2]]), np.zeros((2 * n, 1))])
    C = np.zeros((n, 2 * n))
    C[np.arange(n), 2 * np.arange(n)], C[np.arange(n), 2 * np.arange(n) + 1] = -KP, -KD
    return tustin(StateSpace(A, B, C, np.zeros((n, n + 1))), 1.0 / RATE)


def excitation():
    u = np.zeros((round(PERIOD_S * RATE), len(LOOPS)))
    u[:, 4] = random_multisine((0.5, 20.0), PERIOD_S, RATE, 0.3, np.random.default_rng(1))
    return u


def test_it_is_the_same_hardware_about_another_rest_state(rigs):
    orbit, lab = rigs["orbit"], rigs["lab"]
    for name in ("sensors", "joints", "sample_hz", "inputs", "outputs"):
        assert getattr(orbit, name) == getattr(lab, name), name
    # The payload of this article hangs straight down; in orbit nothing is held at all.
    assert [m.torque_limit for m in orbit.motors] == [m.torque_limit for m in lab.motors]
    assert all(m.holding == 0.0 for m in orbit.motors)
    # Suspension modes have gone; an umbilical at one point leaves five rigid-body modes as they are.
    slowest = [np.sort(np.abs(growth_rates(linearise_rig(r).sampled)))[:10] for r in (orbit, lab)]
    # 8 Hz of 500: the angle's own pole and its rate's are defective, split by the root of rounding.
    assert np.sum(slowest[0] < 1e-3) == 10
    assert slowest[1].min() > 2.0 * np.pi * 0.1


@pytest.mark.parametrize("closed", repeats([True, False]))
def test_a_record_of_the_orbit_rig_is_its_response(rigs, closed):
    """Noise, friction, steps and all, at the lines where the payload answers."""
    rig, law = rigs["orbit"], pd_loops()
    linear = linearise_rig(rig).sampled
    u = excitation()
    settings = {"periods": 3, "rng": np.random.default_rng(3), "settle": 1, "rest_s": 30.0}
    if closed:
        poles = growth_rates(close_rig(rig, law)).real
        # The sums of four gyros are on no other state's way; everything else comes to rest.
        assert np.sum(poles > -1e-3) == 4
        run = run_closed_loop(rig, on_rig(rig, law), u, **settings)
        system = close_rig(rig, law)
    else:
        run = run_open_loop(rig, u, **settings)
        system = linear
    assert run.cause == ""
    assert run.record.y.shape == (1, 3, len(u), len(OUTPUTS))
    assert run.events.saturated.max() == run.events.rotor_full.max() == 0.0
    assert np.any(run.control) == closed
    lines = np.arange(16, 320)  # 1 to 20 Hz
    hz = lines / PERIOD_S
    # In orbit and in open loop the payload wanders off. A taper over all periods keeps that off the lines.
    long = 3 * len(u)
    taper = np.hanning(long + 1)[:-1, None]
    Y, U = (np.fft.rfft(taper * x.reshape(long, -1), axis=0)[3 * lines] for x in (run.record.y, run.record.u))
    H = Y / U[:, 4:5]
    exact = statespace_response(system, 2.0 * np.pi * hz)[:, : len(OUTPUTS), 4]
    for name in ("pri_rel_z", "pri_in_z"):
        o = OUTPUTS.index(name)
        near = np.abs(exact[:, o]) > 0.1 * np.abs(exact[:, o]).max()
        assert np.sum(near) > 10
        # Friction of 2 mN m beside a torque of 300: a hundredth, taken three times.
        error = np.abs(H[near, o] / exact[near, o] - 1.0)
        assert np.sqrt(np.mean(error**2)) < 0.03, name
