"""The frozen case "Updating and promise" from records: rig in 1-g, friction out, fit, survey, refined, orbit.

Twelve records of 192 s a truth, six at each of two gimbal angles, with friction in both gimbal axes and 1 %
of noise: five that tell the motors apart, one at a third of the drive that tells friction from the structure.
"""

from __future__ import annotations

import importlib
import time
import warnings
from typing import Any, NamedTuple

import numpy as np

from measured import prediction
from measured.kept import kept
from measured.rows import row
from middeck import estimate_response, fit_response
from middeck.campaign.cases import Case
from middeck.identification import FitResult
from middeck.identification.friction.find import JointFriction, find_friction
from middeck.identification.friction.remove import without_friction
from middeck.updating.residuals.fitted_survey import survey_from_fit
from middeck.updating.residuals.surveys import Survey

# Shared with the tests; `prediction` has put their folder on the path.
case = prediction.case
rig_case = importlib.import_module("rig_case")

# A truth takes two minutes.
SEEDS = 50
# Two for each of the sheet's modes in the band, then more where the fit has to doubt what it finds.
STATES = (36, 38, 40)
ENOUGH = 14
GAIN_STD = 0.02 / np.sqrt(3.0)
JOINTS = [(name, name) for name in rig_case.GIMBALS]


class Identified(NamedTuple):
    """What one set of six records gives, and how long that took."""

    friction: JointFriction
    fit: FitResult
    seconds: float


class Angle(NamedTuple):
    """Variance over noise with friction and without it, the slip torque's largest error, and CPU seconds."""

    before: float
    after: float
    slip: float
    seconds: float


def rows(options: Any) -> list[dict[str, Any]]:
    """Of as many truths as `SEEDS`."""
    of_truths = kept(rig_of_truth, SEEDS, options)
    title = "rig, two angles, friction on"
    angles = [Angle(*angle) for of_truth in of_truths for angle in of_truth["angles"]]
    outcomes = [prediction.Outcome(**of_truth["outcome"]) for of_truth in of_truths]
    return [
        *prediction.rows_of(title, outcomes, level=True),
        row(title, "variance over noise by friction, median", "", np.median([a.before for a in angles])),
        row(title, "the same, friction found", "", np.median([a.after for a in angles])),
        row(title, "slip torque, largest error", "", max(a.slip for a in angles)),
        row(title, "friction and fit of one angle, median", "CPU s", np.median([a.seconds for a in angles])),
    ]


def rig_of_truth(truth: Case, _: Any) -> dict[str, Any]:
    """Its outcome in orbit, and both angles."""
    both = [identified(truth.index, number) for number in (0, 1)]
    outcome = prediction.outcome(truth.index, surveys_of(both), *prediction.sheet_modes())
    return {"outcome": outcome._asdict(), "angles": [list(_angle(one)) for one in both]}


def _angle(one: Identified) -> Angle:
    slip = np.max(np.abs(one.friction.slip_torque / rig_case.BEARING.slip_torque - 1.0))
    return Angle(one.friction.before, one.friction.after, float(slip), one.seconds)


def identified(seed: int, number: int) -> Identified:
    """From the records of one truth at one gimbal angle."""
    record = rig_case.records_of(seed, number)
    start = time.process_time()
    friction = find_friction(record, JOINTS, band_hz=rig_case.BAND_HZ, delay_s=rig_case.DELAY_S)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        measured = estimate_response(without_friction(record, friction), band_hz=rig_case.BAND_HZ)
    fits: list[FitResult] = []
    for states in STATES:
        # Dampers at joints make the modes complex.
        fits.append(fit_response(measured, states=states, constants="complex", delay="common"))
        if fits[-1].standing.count("sound") >= ENOUGH:
            break
    best = max(fits, key=lambda fit: fit.standing.count("sound"))
    if best.standing.count("sound") == 0:
        # What friction leaves can look like a delay of one output: the warning says to fit each.
        best = fit_response(measured, states=STATES[0], constants="complex", delay="output")
    return Identified(friction, best, time.process_time() - start)


def surveys_of(both: list[Identified]) -> list[Survey]:
    """Of both gimbal angles."""
    article, lab = case.sheet()
    return [
        Survey(
            name=f"test {number}",
            measured=survey_from_fit(article, one.fit, gain_std=GAIN_STD),
            environment=lab,
            settings=settings,
        )
        for number, (one, settings) in enumerate(zip(both, (case.STRAIGHT, case.TURNED), strict=True))
    ]
