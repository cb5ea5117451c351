"""The frozen case "Updating and promise" with friction in both gimbals: decibels as promised, and on the rig.

The outcome is the exact one of the truth with linear joints, and what friction adds to it on the rig in time,
under one noise with and without.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from measured.kept import kept
from measured.promise import AUTHORITY, LEAST_DB, case
from measured.rows import miss_row, row
from middeck.campaign.cases import Case
from middeck.updating.promise.promise import design_ladder, promise

# Disturbance [N m rms to 60 Hz]: the largest error of a promise there [dB], and how long the rig runs
# without a compensator [s]. Friction does most there, and most at the smaller one: 400 s, or 2000, err by
# as much as a promise does.
TORQUES = {0.3: (0.5, 2000.0), 0.03: (2.0, 8000.0)}
# The least and the most of 39 draws hold 95 % of others.
SEEDS, DRAWS = 8, 39
LAW_S = 240.0


class Came(NamedTuple):
    """One compensator: promised levels, the median without friction, what came, and CPU seconds a draw."""

    median: float
    low: float
    high: float
    cautious: float
    linear: float
    db: float
    seconds: float


def rows(options: Any) -> list[dict[str, Any]]:
    """Both disturbances."""
    of_truths = kept(slips_of_truth, SEEDS, options)
    return [
        one
        for torque in TORQUES
        for one in _rows(torque, [Came(*c) for each in of_truths for c in each[str(torque)]])
    ]


def slips_of_truth(truth: Case, _: Any) -> dict[str, list[list[float]]]:
    """Each compensator's `Came`, by disturbance."""
    return {str(torque): [list(c) for c in _compensators(truth.index, torque)] for torque in TORQUES}


def _rows(torque: float, found: list[Came]) -> list[dict[str, Any]]:
    some = [c for c in found if np.isfinite(c.db) and c.db <= LEAST_DB]
    error = np.array([abs(c.median - c.db) for c in some])
    missed = 100.0 * np.mean([not c.low <= c.db <= c.high for c in some])
    without = [abs(c.linear - c.db) for c in some]
    title = f"slip, promise at {torque:g} N m rms, {len(some)} compensators of {SEEDS} truths"
    return [
        row(title, "|promised median - truth|, median", "dB", np.median(error), TORQUES[torque][0]),
        row(title, "the same, largest", "dB", error.max()),
        row(title, "the same, friction left out, median", "dB", np.median(without)),
        miss_row(title, "95 % intervals that miss", missed),
        row(title, "pessimism at 99 %, median", "dB", np.median([c.cautious - c.db for c in some]), 3.0),
        row(title, "a draw of a compensator", "CPU s", np.median([c.seconds for c in found])),
    ]  # fmt: skip


def _compensators(seed: int, torque: float) -> list[Came]:
    refined, alone_s = case.refined(seed), TORQUES[torque][1]
    asked = case.with_slips(case.plan(AUTHORITY, DRAWS), torque)
    start = time.process_time()
    (found,) = promise(refined, asked).values()
    seconds = (time.process_time() - start) / (DRAWS * len(found.outlooks))
    laws = design_ladder(case.modes_in_orbit(refined), asked)
    truth = case.true_plant(seed, asked)
    rigs = case.true_rigs(seed, truth, asked)
    alone = case.friction_db(seed, rigs, asked, None, alone_s)
    came: list[Came] = []
    for outlook, law in zip(found.outlooks, laws.values(), strict=True):
        assert outlook.friction is not None
        db = case.true_db(truth, law, asked) + case.friction_db(seed, rigs, asked, law, LAW_S) - alone
        levels = [outlook.level_db(share) for share in (0.5, 0.025, 0.975, 0.99)]
        came.append(Came(*levels, float(np.median(outlook.friction.without_db)), db, seconds))
    return came
