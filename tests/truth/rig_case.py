"""Records of the frozen case "Updating and promise": its truths on a rig in 1-g, with friction and noise.

Every motor is driven in every record, so that both gimbal axes slip. Five records tell the motors apart, a
sixth at a third of the drive tells friction from the structure.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import updating_case as case

from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.runs import run_open_loop
from middeck.laboratory.tested_article import RigArticle, rig_article_plant
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.record import Record

INPUTS = ("bus_x", "bus_y", "bus_z", "pri_rel_x", "pri_rel_z")
OUTPUTS = ("bus_x", "bus_y", "bus_z", "pri_in_x", "pri_in_z", "pri_rel_x", "pri_rel_z")
GIMBALS = INPUTS[3:]
# That of the study's rig.
BEARING = Friction(slip_torque=0.002, stiffness=0.002 / np.radians(0.05), viscous=0.001)
BAND_HZ = (0.1, 30.0)
SAMPLE_HZ, DELAY_S = 500.0, 0.010
PERIOD_S, PERIODS, SETTLE = 64.0, 3, 2
TORQUE_NM = (0.1, 0.1, 0.1, 0.3, 0.3)
WEAKER = 1.0 / 3.0
NOISE = 0.01


def true_delay(article: RigArticle) -> float:
    """From command to sample [s]."""
    return DELAY_S + (0.0 if article.hidden is None else article.hidden.delay_s)


def take_records(
    article: RigArticle,
    rng: np.random.Generator,
    *,
    friction: Friction | None = BEARING,
    weaker: int = 1,
    period_s: float = PERIOD_S,
) -> Record:
    """Five experiments of three periods, and ``weaker`` more at a third of the drive; 1 % of noise."""
    plant = rig_article_plant(article, inputs=INPUTS, outputs=OUTPUTS)
    joints = [] if friction is None else [JointElements(name, name, (friction,)) for name in GIMBALS]
    rig = build_rig(plant, joints=joints, sample_hz=SAMPLE_HZ, delay_s=true_delay(article))
    limits = [Limits(rms=rms) for rms in TORQUE_NM]
    drive = design_multisine(BAND_HZ, period_s, SAMPLE_HZ, limits, rng, inputs=len(INPUTS)).u
    gains = {} if article.hidden is None else dict(article.hidden.gain)
    gain = np.array([gains.get(name, 1.0) for name in OUTPUTS])
    taken: list[Record] = []
    for u in [*drive, *(WEAKER * drive[:weaker])]:
        run = run_open_loop(rig, u, periods=PERIODS, rng=rng, settle=SETTLE, rest_s=0.0)
        assert run.record is not None, run.cause
        y = gain * run.record.y
        rms = np.sqrt(np.mean(y**2, axis=(0, 1, 2)))
        taken.append(dataclasses.replace(run.record, y=y + NOISE * rms * rng.standard_normal(y.shape)))
    u, y = (np.concatenate([getattr(r, name) for r in taken]) for name in ("u", "y"))
    return dataclasses.replace(taken[0], u=u, y=y)


def records_of(seed: int, number: int) -> Record:
    """Of the truth ``seed``, gimbals straight (0) or turned (1)."""
    _, lab = case.sheet()
    article = case.true_article(seed, lab, (case.STRAIGHT, case.TURNED)[number])
    return take_records(article, np.random.default_rng([seed, number, 192]))
