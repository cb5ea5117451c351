"""Shapes that a promise carries: whose channels, how many, and that they are those of the modes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
import structure_builders as build
from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.measured_modes import MeasurementNoise, measure_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.orbit.promise_shapes import NODES, promised_shapes
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

COUNT = 70
MODULUS = Unknown(name="modulus", parameters=("members.E",), spread=0.1)
STAND = Environment(title="stand", gravity=np.zeros(3), clamps=(Clamp(node="n0"),))
SURVEYED = (("n7", "y"), ("n69", "y"), ("n44", "z"), ("n61", "z"), ("n6-n7/1", "y"))


def chain() -> Structure:
    """A cantilever of more nodes than a document tells of, stiffer about one axis by a third."""
    section = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=130.0, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0)
    return build.structure(
        [build.node(f"n{k}", (2.0 * k / COUNT, 0.0, 0.0)) for k in range(COUNT)],
        [build.member(f"n{k}", f"n{k + 1}", section, 2 if k == 6 else 1) for k in range(COUNT - 1)],
    )


@pytest.fixture(scope="module")
def refined() -> Refined:
    modes = md.solve_modes(md.solve_equilibrium(chain(), STAND), 8)
    noise = MeasurementNoise(1e-3, 0.01)
    seen = measure_modes(modes, SURVEYED, chosen=range(4), noise=noise, rng=np.random.default_rng(1))
    return refine(chain(), [Survey(name="stand", measured=seen, environment=STAND)], [MODULUS])


def test_they_are_those_of_the_modes_at_the_channels_of_the_surveys_and_at_some_nodes(refined: Refined):
    predicted = predict_modes(refined, STAND, count=5)
    estimated = promised_shapes(refined, predicted)
    channels = list(zip(estimated.node, estimated.direction, strict=True))
    assert tuple(channels[: len(SURVEYED)]) == SURVEYED
    assert len(set(estimated.node)) <= NODES + len(SURVEYED)
    assert ("n0", "x") in channels
    own = measure_modes(predicted.modes, channels, chosen=predicted.index.tolist()).shape
    alike = modal_assurance(estimated.shape, own)
    np.testing.assert_allclose(np.diag(alike), 1.0, atol=1e-6)
    assert np.abs(estimated.shape).max(axis=0).tolist() == [1.0] * 5
    np.testing.assert_array_equal(estimated.shape, np.round(estimated.shape, 4))


def test_a_channel_that_is_not_there_in_flight_is_left_out(refined: Refined):
    """As an angle of a joint that is held there; here, of a node that is gone."""
    predicted = predict_modes(refined, STAND, count=2)
    shorter = chain()
    shorter = build.structure(shorter.nodes[:-1], shorter.members[:-1])
    modes = md.solve_modes(md.solve_equilibrium(shorter, STAND), 8)
    estimated = promised_shapes(refined, dataclasses.replace(predicted, modes=modes))
    assert "n69" not in estimated.node
    assert "n7" in estimated.node
