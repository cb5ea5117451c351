"""What holds for every plant: coordinates do not matter, more authority costs more and moves less."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from random_plants import random_plant

from middeck.control.law.partition import partition_modes
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.systems.norms.band_rms import band_rms
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import unit_weights

BAND = (0.05, 20.0)
WEIGHTS = unit_weights(("a", "b"), np.full(2, 1e-4), outputs=2, inputs=2)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_lqg_stabilises_and_its_output_cost_falls_with_authority(seed):
    plant = random_plant(seed)
    kalman = design_filter(plant, WEIGHTS)
    whole = []
    for authority in (0.1, 1.0, 10.0, 100.0):
        law = design_lqg(plant, WEIGHTS, authority, kalman=kalman)
        loop = close_loop(plant, law)
        assert loop.stable
        assert law.regulator.residual < 1e-12
        # E[z'z] + rho E[u'u] falls as rho does: its slope in rho is E[u'u].
        whole.append(law.cost)
    assert np.all(np.diff(whole) < 0.0)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_coordinates_of_the_plant_do_not_matter(seed):
    plant = random_plant(seed)
    system = plant.system
    T, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal(system.A.shape))
    turned = StateSpace(T @ system.A @ T.T, T @ system.B, system.C @ T.T, system.D)
    other = dataclasses.replace(plant, dynamics=turned)
    laws = [design_lqg(p, WEIGHTS, 10.0) for p in (plant, other)]
    rms = [
        band_rms(close_loop(p, law).system, np.eye(2), BAND)
        for p, law in zip((plant, other), laws, strict=True)
    ]
    # Two Riccati equations with a double pole at the origin, ten states: half the digits are lost at most.
    np.testing.assert_allclose(rms[0], rms[1], rtol=1e-8)
    assert abs(laws[0].cost / laws[1].cost - 1.0) < 1e-8


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), inert=st.sets(st.integers(0, 4), max_size=4))
def test_inert_modes_change_nothing(seed, inert):
    plant = random_plant(seed, rigid=0)
    modal = plant.dynamics
    rows = sorted(inert)
    psi, phi = modal.psi.copy(), modal.phi.copy()
    psi[rows], phi[:, rows] = 0.0, 0.0
    quiet = dataclasses.replace(plant, dynamics=dataclasses.replace(modal, psi=psi, phi=phi))
    part = partition_modes(quiet)
    assert part.inert == tuple(f"mode {i}" for i in rows)
    law = design_lqg(quiet, WEIGHTS, 10.0)
    assert law.inert == part.inert
    loops = [close_loop(p, law) for p in (quiet, part.active)]
    assert loops[0].system == loops[1].system
