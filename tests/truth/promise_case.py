"""The frozen case "Updating and promise", one axis: promised on ground surveys, and the truth beside it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from rig_case import BEARING, GIMBALS
from updating_case import STRAIGHT, TURNED, sheet, sheet_unknowns, survey, true_modes

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops
from middeck.control.qualification import decibels
from middeck.control.robust.verification.monte_carlo import noise_on, uncontrolled_rms
from middeck.control.sampled.emulation import emulate
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.hidden_errors import draw_hidden_errors
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Sampler
from middeck.laboratory.rig.rig import Rig, build_rig
from middeck.laboratory.rig.runs import run_closed_loop
from middeck.laboratory.tested_article import RigArticle, rig_article_plant
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays, require_modal
from middeck.systems.state_space.statespace import StateSpace
from middeck.updating.promise.draws import LoopSpread
from middeck.updating.promise.plan import Ladder, Plan, close_inner, weights_of
from middeck.updating.promise.slip import JointSlip
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import set_up

INPUT, OUTPUT = "pri_rel_z", "pri_in_z"
DELAY_S, DELAY_TOLERANCE_S, GAIN_TOLERANCE = 0.010, 0.001, 0.02
# Of the local loops, as in studies/mace-1993.toml.
PD = PDLoops(
    ("bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z"),
    np.array([0.007619, 0.3142, 0.3629, 0.01004, 0.01406]),
    np.array([0.04042, 1.667, 1.925, 0.01997, 0.02798]),
)
ALL_ANGLES = (OUTPUT, *PD.names)
TORQUE_NM, TO_HZ = 0.3, 60.0
# What a plan knows of the gimbals' friction.
SLIP_TOLERANCE, ANGLE_TOLERANCE = 0.1, 0.2
SLIPS = tuple(
    JointSlip(
        name=name,
        slip_torque=BEARING.slip_torque,
        slip_angle=BEARING.slip_angle,
        viscous=BEARING.viscous,
        slip_torque_tolerance=SLIP_TOLERANCE,
        slip_angle_tolerance=ANGLE_TOLERANCE,
    )
    for name in GIMBALS
)
RIG_HZ, RIG_SETTLE_S = 500.0, 30.0


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


def with_all_motors(asked: Plan) -> Plan:
    """The plan with its ladder for five motors and six angles, and a cable of up to 0.03 Hz in orbit."""
    assert asked.ladder is not None
    return dataclasses.replace(
        asked,
        ladder=dataclasses.replace(asked.ladder, drives=PD.names, reads=ALL_ANGLES),
        loop=dataclasses.replace(asked.loop, umbilical_hz=0.03),
    )


@functools.cache
def refined(seed: int, chosen: range = range(20)) -> Refined:
    """The sheet refined on two surveys of a truth."""
    article, _ = sheet()
    surveys = [survey(seed, k, angles, chosen) for k, angles in enumerate((STRAIGHT, TURNED))]
    return refine(article, surveys, sheet_unknowns(article))


def modes_in_orbit(found: Refined) -> Modes:
    """Of the refined article."""
    return set_up(found.structure, Environment.orbit(), (), found.unknowns).solve(found.x)


def with_slips(asked: Plan, torque_nm: float) -> Plan:
    """The plan with friction in both gimbals, under a disturbance of ``torque_nm`` rms."""
    return dataclasses.replace(asked, joints=SLIPS, intensity=asked.intensity * torque_nm / TORQUE_NM)


def true_plant(seed: int, asked: Plan | None = None, place: Environment | None = None) -> Plant:
    """The truth, by default in orbit: each mode its own damping, all modes to 200 Hz, its delay and gains.

    With the inner loops of the plan, and its joints' drag.
    """
    article, _ = sheet()
    hidden, modes = draw_hidden_errors(article, seed), true_modes(seed, place or Environment.orbit())
    sensors = (OUTPUT, *(name for loop in PD.names for name in (loop, f"{loop}_rate")))
    plant = rig_article_plant(
        RigArticle(modes.equilibrium, modes, hidden),
        inputs=PD.names, outputs=sensors, w=(INPUT,), z=(OUTPUT,), u=(INPUT,), y=(OUTPUT,),
    )  # fmt: skip
    gain = dict(hidden.gain)
    rows = np.array([gain[name.removesuffix("_rate")] for name in sensors])[:, None]
    modal = require_modal(plant)
    seen = dataclasses.replace(modal, phi=rows * modal.phi, phi_rate=rows * modal.phi_rate)
    whole = close_inner(asked or plan([1.0], 1), dataclasses.replace(plant, dynamics=seen))
    return delay_plant(whole, DELAY_S + hidden.delay_s)


def true_db(plant: Plant, law: Compensator, asked: Plan) -> float:
    """What came: decibels of ``law`` on the truth, ``inf`` where it is unstable."""
    weights = weights_of(asked, law.outputs, law.inputs)
    stable, rms, _ = noise_on([plant], law, weights)
    return decibels(float(rms[0]) if stable[0] else np.inf, float(uncontrolled_rms([plant], weights)[0]))


def true_rigs(seed: int, whole: Plant, asked: Plan) -> tuple[Rig, Rig]:
    """The rigs of a true plant, with friction drawn within the plan's tolerances and without.

    Commanded at the gimbal; the first output is the angle as it is, the second as a law reads it.
    """
    rng = np.random.default_rng([seed, 24])
    joints = [JointElements(name, name, (_bearing(rng),)) for name in GIMBALS]
    system, at = remove_delays(whole).system, whole.output_indices([OUTPUT])[0]
    twice = StateSpace(
        system.A, system.B, np.vstack([system.C, system.C[at]]), np.vstack([system.D, system.D[at]])
    )
    ports = (*whole.outputs, dataclasses.replace(whole.outputs[at], name="read"))
    plant = Plant(dynamics=twice, inputs=whole.inputs, outputs=ports)
    noise = asked.noise["rad"] * np.sqrt(RIG_HZ)
    return tuple(
        build_rig(
            plant, sample_hz=RIG_HZ, delay_s=float(whole.delay_s[0, 0]), motors={INPUT: Motor()},
            sensors={OUTPUT: Sampler(), "read": Sampler(noise)}, joints=rubs,
        )
        for rubs in (joints, [])
    )  # fmt: skip


def _bearing(rng: np.random.Generator) -> Friction:
    return Friction(
        slip_torque=BEARING.slip_torque * (1.0 + SLIP_TOLERANCE * rng.uniform(-1.0, 1.0)),
        stiffness=BEARING.stiffness / (1.0 + ANGLE_TOLERANCE * rng.uniform(-1.0, 1.0)),
    )


def friction_db(
    seed: int, rigs: tuple[Rig, Rig], asked: Plan, law: Compensator | None, seconds: float
) -> float:
    """What friction adds to the rms on the rig, under one noise of the plan's intensity to `TO_HZ`."""
    samples = int((RIG_SETTLE_S + seconds) * RIG_HZ)
    rng = np.random.default_rng([seed, 25])
    lines = np.fft.rfftfreq(samples, 1.0 / RIG_HZ) <= TO_HZ
    size = asked.intensity[0] * np.sqrt(0.5 * samples * RIG_HZ)
    u = np.fft.irfft(size * lines * (rng.standard_normal((len(lines), 2)) @ [1.0, 1.0j]), samples)
    sampled = None
    if law is not None:
        read = dataclasses.replace(law.inputs[0], name="read")
        sampled = emulate(dataclasses.replace(law, inputs=(read,)), 1.0 / RIG_HZ)
    square: list[float] = []
    for rig in rigs:
        noise = np.random.default_rng([seed, 26])
        run = run_closed_loop(
            rig, sampled, u[:, None], periods=1, rng=noise, settle=0, rest_s=0.0, steady=True
        )
        assert run.record is not None, run.cause
        square.append(float(np.mean(run.record.y[0, 0, int(RIG_SETTLE_S * RIG_HZ) :, 0] ** 2)))
    return 10.0 * float(np.log10(square[0] / square[1]))
