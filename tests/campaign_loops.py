"""The module of docs/how-to/a-campaign-of-many-cases.md: one compensator on plants of a campaign."""

import functools

import numpy as np

import middeck as md
from middeck.campaign import Parameter, Uniform

DRIFT = md.Uncertainty(shifts=(md.ModeShift(("first bending x-y",), 0.1),), gain=0.1, delay=1.0)
# Positions in the box of `DRIFT`, in its order.
WITHIN = [Parameter(name, Uniform(-1.0, 1.0)) for name in ("frequency", "gain", "delay")]
WEIGHTS = md.LQGWeights(output=[1.0], input=[1.0], disturbed=("pri_rel_z",), process=[[1e-4]], sensor=[4e-10])


@functools.cache
def hung_plant(article, environment):
    hung = md.solve_modes(md.solve_equilibrium(*md.load_setup(article, environment)))
    ports = {"inputs": ["pri_rel_z"], "outputs": ["pri_in_z"]}
    groups = {"w": ["pri_rel_z"], "u": ["pri_rel_z"], "z": ["pri_in_z"], "y": ["pri_in_z"]}
    return md.delay_plant(md.build_plant(hung, count=12, **ports, **groups), 0.010)


def closed(case, inputs):
    """Stability and decibels on the plant at the case's position."""
    plant = hung_plant(inputs["article"], inputs["environment"])
    law = md.load_compensator(inputs["law"])
    (found,) = md.control.verify_robustness(
        plant, law, WEIGHTS, uncertainty=DRIFT, positions=np.atleast_2d(case.values)
    ).outcomes
    return {"stable": bool(found.stable[0]), "db": found.db[0]}
