"""Promise and outcome in numbers.json, with the claims."""

import numpy as np

from middeck.files.promises.promise_documents import limits_of
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.uncertainty.parameter_deviations import stated
from middeck.study.chapters.promise.computation import MEASURED, SHEET, PromiseKept
from middeck.study.chapters.promise.ground import GroundTest
from middeck.study.words import Claim, Numbers, above, at_most, fields, row
from middeck.updating.promise.stability_probability import LEVELS
from middeck.updating.refinement.findings import findings

PERCENT, LEAST_TIMES = 0.1, 8.0  # error of the first flexible frequencies, and the sheet's error over it
COVERED = 90.0  # per cent of outcomes within 95 % intervals
WITH_FRICTION_DB, ROUTES_DB, ENOUGH_DB = 0.5, 3.0, -20.0
NEAR_REST_HZ = 0.1


def promise(kept: PromiseKept) -> Numbers:
    """Ground tests, promise and outcome."""
    f, law = kept.frequencies, kept.ground_law
    return {
        "tests": [_test(one) for one in kept.ground.tests],
        "frequencies": {**fields(f, "true_hz", "refined_hz", "sheet_hz")},
        "draws": kept.plan.draws,
        "shares": LEVELS,
        "orbit": kept.there,
        "not_valid_for": limits_of(kept.plan, {"orbit": kept.promise}),
        "authority_log10": np.log10(kept.plan.ladder.authority) if kept.plan.ladder else [],
        "came": [
            {
                "name": one.name,
                "stable": one.stable,
                "linear_db": one.db,
                "rig_db": one.rig_db,
                "cause": one.cause,
            }
            for one in kept.flown
        ],
        "verdicts": {v.name: {"inside": v.inside, "pessimism_db": v.pessimism} for v in kept.verdicts},
        "score": {
            **fields(kept.score, "count", "coverage", "brier"),
            "pessimism_db": kept.score.pessimism,
        },
        "measured": {
            "states": kept.measured.model.states,
            "natural_hz": natural_hz(kept.measured.model),
            "natural_hz_deviation": stated(kept.measured.uncertainty.natural_hz),
            "damping": damping_ratio(kept.measured.model),
            "damping_deviation": stated(kept.measured.uncertainty.damping),
            "relative_error": kept.measured.error[0],
        },
        "ground_law": {
            "log10_authority": law.log10_authority,
            "stable_on_the_ground": law.lab.stable,
            "stable_in_orbit": law.orbit.stable,
            "growth_hz": law.orbit.frequency_hz,
        },
        "warnings": [
            *findings(kept.ground.refined),
            *(f"record from orbit: {warning}" for warning in kept.measured.warnings),
        ],
    }


def _test(one: GroundTest) -> Numbers:
    joints = one.friction.inputs
    return {
        "name": one.survey.name,
        "modes": len(one.survey.measured.frequency_hz),
        "slip_torque_nm": dict(zip(joints, one.friction.slip_torque.tolist(), strict=True)),
        "slip_angle_deg": dict(zip(joints, np.degrees(one.friction.slip_angle).tolist(), strict=True)),
    }


def promise_claims(numbers: Numbers) -> list[Claim]:
    """Claims on refinement, promise and outcome."""
    law = numbers["ground_law"]
    refined, sheet = (frequency_error(numbers, which) for which in ("refined_hz", "sheet_hz"))
    turned = law["stable_on_the_ground"] and not law["stable_in_orbit"]
    near_rest = turned and law["growth_hz"] <= NEAR_REST_HZ
    return [
        at_most(
            "rms error of the first flexible frequencies in 0-g, model refined in 1-g [%]",
            refined,
            PERCENT,
            "%",
        ),
        above(
            f"the nominal model has over {LEAST_TIMES:g} times that error; ratio",
            sheet / refined,
            LEAST_TIMES,
            "times",
        ),
        row(
            "outcomes within their promised 95 % intervals [%]",
            100.0 * numbers["score"]["coverage"] >= COVERED,
            100.0 * numbers["score"]["coverage"],
            f"\u2265 {COVERED:g}",
            "%",
        ),
        at_most(
            "difference of the promised median rms from the rms on the rig in 0-g,"
            " median of the compensators [dB]",
            median_error_db(numbers),
            WITH_FRICTION_DB,
        ),
        at_most(
            f"a design on the model refined in 1-g is at most {ROUTES_DB:g} dB worse"
            f" than one on a 0-g record, if both reach {-ENOUGH_DB:g} dB; largest difference [dB]",
            route_gap_db(numbers),
            ROUTES_DB,
        ),
        row(
            "a design for all motors on a 1-g record is stable in 1-g, and unstable near 0"
            " Hz in 0-g; unstable at [Hz]",
            near_rest,
            law["growth_hz"] if turned else None,
            f"\u2264 {NEAR_REST_HZ:g}",
            "Hz",
        ),
    ]


def frequency_error(numbers: Numbers, which: str) -> float:
    """Rms of the relative errors [%]."""
    hz = numbers["frequencies"]
    return float(100.0 * np.sqrt(np.mean(np.log(np.array(hz[which]) / np.array(hz["true_hz"])) ** 2)))


def _came_db(numbers: Numbers) -> dict[str, float | None]:
    """Decibels on the rig; None for a loop that is not stable, whatever the rig's limits make of it."""
    return {c["name"]: c["rig_db"] if c["stable"] else None for c in numbers["came"]}


def median_error_db(numbers: Numbers) -> float | None:
    """|promised median - rig| of the compensators that have both."""
    middle = {
        c["name"]: c["db"][list(numbers["shares"]).index(0.5)] for c in numbers["orbit"]["compensators"]
    }
    came = _came_db(numbers)
    apart = [abs(db - came[name]) for name, db in middle.items() if db is not None and came[name] is not None]
    return float(np.median(apart)) if apart else None


def route_gap_db(numbers: Numbers) -> float | None:
    """Largest loss of a refined design against the design on the record, where both are good."""
    came = _came_db(numbers)
    pairs = [(came[name], came[MEASURED.format(name)]) for name in came if MEASURED.format(name) in came]
    gaps = [a - b for a, b in pairs if a is not None and b is not None and max(a, b) <= ENOUGH_DB]
    return max(gaps, default=None)


def routes(numbers: Numbers) -> dict[str, list[float | None]]:
    """Decibels on the rig by kind of design, over the authorities."""
    came = _came_db(numbers)
    plain = [name for name in came if SHEET.format(name) in came]
    return {
        "sheet": [came[SHEET.format(name)] for name in plain],
        "refined": [came[name] for name in plain],
        "measured": [came[MEASURED.format(name)] for name in plain],
    }
