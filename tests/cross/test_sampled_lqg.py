"""Sampled LQG of the paper's single loop beside python-control's (sampled_lqg/make_sampled_lqg.py)."""

import json
from pathlib import Path

import numpy as np
import pytest

from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.signals.ports import Port
from middeck.systems.plants.plant import delay_plant
from plant_builders import grouped_plant, sum_of_modes

NUMBERS = json.loads((Path(__file__).parent / "sampled_lqg" / "numbers.json").read_text())
UNIT = 2.0 * np.pi * 3.0


def late_gimbal():
    omega = 2.0 * np.pi * np.array([1.1, 1.7, 7.0, 8.8, 9.4])
    phi = UNIT**2 * np.array([[1.0, 0.6, 0.6, 0.8, 0.7]])
    modal = sum_of_modes(omega, 0.01, np.ones((5, 1)), phi)
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    return delay_plant(
        grouped_plant(modal, ports[0], ports[1]),
        0.010,
    )


@pytest.mark.parametrize("row", NUMBERS, ids=lambda row: f"{row['rate_hz']:g} Hz")
def test_gains(row):
    weights = LQGWeights(
        output=[1.0], input=[1.0], disturbed=("torque",), process=[[1.0 / UNIT]], sensor=[1e-6 / UNIT]
    )
    law = design_sampled_lqg(late_gimbal(), weights, 100.0, 1.0 / row["rate_hz"])
    # Both solvers keep ten digits of a pencil whose poles reach from 0 to 0.99 on states that differ in size.
    for found, theirs in ((law.regulator.gain, row["K"]), (law.estimator.gain, row["L"])):
        np.testing.assert_allclose(found.ravel(), theirs, atol=1e-9 * np.abs(theirs).max())
    assert np.abs(law.regulator.poles).max() == pytest.approx(row["regulator_radius"], rel=1e-9)
    assert np.abs(law.estimator.poles).max() == pytest.approx(row["estimator_radius"], rel=1e-9)
