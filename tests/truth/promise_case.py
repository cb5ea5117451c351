"""The frozen case "Updating and promise", one axis: promised on ground surveys, and the truth beside it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from updating_case import STRAIGHT, TURNED, sheet, sheet_unknowns, survey, true_modes

from middeck.control.law.classical import PDLoops
from middeck.control.law.compensator import Compensator
from middeck.control.qualification import decibels
from middeck.control.robust.monte_carlo import noise_on, uncontrolled_rms
from middeck.laboratory.article import RigArticle, rig_article_plant
from middeck.laboratory.hidden_errors import draw_hidden_errors
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.systems.plant import Plant, delay_plant, require_modal
from middeck.updating.draws import LoopSpread
from middeck.updating.plan import Ladder, Plan, close_inner, weights_of
from middeck.updating.refine import Refined, refine
from middeck.updating.surveys import set_up

INPUT, OUTPUT = "pri_rel_z", "pri_in_z"
DELAY_S, DELAY_TOLERANCE_S, GAIN_TOLERANCE = 0.010, 0.001, 0.02
# Of the local loops, as in studies/mace-1993.toml.
PD = PDLoops(
    ("bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z"),
    np.array([0.007619, 0.3142, 0.3629, 0.01004, 0.01406]),
    np.array([0.04042, 1.667, 1.925, 0.01997, 0.02798]),
)
TORQUE_NM, TO_HZ = 0.3, 60.0


def plan(
    authority: Sequence[float], draws: int, *, bounded: int = 0, laws: Mapping[str, Compensator] | None = None
) -> Plan:
    """Gimbal torque to payload angle in orbit, disturbed at the gimbal."""
    return Plan(
        environments={"orbit": Environment.orbit()},
        performance=(OUTPUT,),
        weights=np.ones(1),
        disturbances=(INPUT,),
        intensity=np.array([TORQUE_NM / np.sqrt(2.0 * TO_HZ)]),
        noise={"rad": 2e-5},
        inner=PD,
        loop=LoopSpread(delay_s=DELAY_S, delay_tolerance_s=DELAY_TOLERANCE_S, gain_tolerance=GAIN_TOLERANCE),
        modes=26,
        draws=draws,
        seed=1993,
        probability=0.99,
        bounded=bounded,
        laws=laws or {},
        ladder=Ladder(drives=(INPUT,), reads=(OUTPUT,), authority=np.asarray(authority, dtype=float)),
    )


def refined(seed: int, chosen: Sequence[int] = range(20)) -> Refined:
    """The sheet refined on two surveys of a truth."""
    article, _ = sheet()
    surveys = [survey(seed, k, angles, chosen) for k, angles in enumerate((STRAIGHT, TURNED))]
    return refine(article, surveys, sheet_unknowns(article))


def modes_in_orbit(found: Refined) -> Modes:
    """Of the refined article."""
    return set_up(found.structure, Environment.orbit(), (), found.unknowns).solve(found.x)


def true_plant(seed: int) -> Plant:
    """The truth in orbit, each mode with its own damping, all modes to 200 Hz, its delay and its gains."""
    article, _ = sheet()
    hidden, modes = draw_hidden_errors(article, seed), true_modes(seed, Environment.orbit())
    sensors = (OUTPUT, *(name for loop in PD.names for name in (loop, f"{loop}_rate")))
    plant = rig_article_plant(
        RigArticle(modes.equilibrium, modes, hidden),
        inputs=PD.names, outputs=sensors, w=(INPUT,), z=(OUTPUT,), u=(INPUT,), y=(OUTPUT,),
    )  # fmt: skip
    gain = dict(hidden.gain)
    rows = np.array([gain[name.removesuffix("_rate")] for name in sensors])[:, None]
    modal = require_modal(plant)
    seen = dataclasses.replace(modal, phi=rows * modal.phi, phi_rate=rows * modal.phi_rate)
    whole = close_inner(plan([1.0], 1), dataclasses.replace(plant, dynamics=seen))
    return delay_plant(whole, DELAY_S + hidden.delay_s)


def true_db(plant: Plant, law: Compensator, asked: Plan) -> float:
    """What came: decibels of ``law`` on the truth, ``inf`` where it is unstable."""
    weights = weights_of(asked, law.outputs, law.inputs)
    stable, rms, _ = noise_on([plant], law, weights)
    return decibels(float(rms[0]) if stable[0] else np.inf, float(uncontrolled_rms([plant], weights)[0]))
