"""Promises as sealed documents."""

import math
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from middeck import __version__
from middeck.campaign.confidence_of_draws import draws_needed, level
from middeck.files.disk.digest import sha256_of
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.promises.form import PROMISE
from middeck.structure.gravity.budget import EFFECTS
from middeck.updating.orbit.deflections import Deflection
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.orbit.promise_shapes import promised_shapes
from middeck.updating.orbit.released_clamps import released_clamps
from middeck.updating.orbit.removed_ground_effects import removed_terms
from middeck.updating.promise.draws import LoopSpread
from middeck.updating.promise.performance_bound import RobustBound
from middeck.updating.promise.plan import Plan
from middeck.updating.promise.promise import Promise
from middeck.updating.promise.refined_slips import with_refined
from middeck.updating.promise.robustness_sweep import Swept
from middeck.updating.promise.slip_time import SlipTime
from middeck.updating.promise.stability_probability import LEVELS, FrictionOutlook, Outlook
from middeck.updating.promise.weak_cable import TRIED_HZ
from middeck.updating.refinement.findings import findings
from middeck.updating.refinement.refine import Refined, RefinedFriction

# A mode of which the surveys saw less than half was not seen.
SEEN = 0.5
_DEGREE = np.pi / 180.0
# Digits that are promised: more would hang on the machine.
DIGITS = 6
SHARE_DIGITS, TRAVEL_DIGITS = 4, 3


def promise_document(
    refined: Refined,
    plan: Plan,
    promises: Mapping[str, Promise],
    *,
    files: Sequence[tuple[str, str]],
    date: str,
    plants: tuple[str, str] | None = None,
) -> dict[str, Any]:
    """The sealed document: what was promised when, on what, by which versions and seed.

    ``plants`` are name and seal of the file of its plants (`plants_document`).
    """
    plan = with_refined(plan, refined)
    said = {
        "seed": plan.seed,
        "draws": plan.draws,
        "draws_needed": draws_needed(plan.probability),
        "probability": plan.probability,
        "band_hz": plan.band_hz,
        "performance": dict(zip(plan.performance, plan.weights.tolist(), strict=True)),
        "disturbance_per_rthz": dict(zip(plan.disturbances, plan.intensity.tolist(), strict=True)),
        "noise_per_rthz": dict(plan.noise),
        "shares": LEVELS,
        "not_valid_for": [
            *limits_of(plan, promises),
            *(
                f"{name}: {said}"
                for name in promises
                if (said := released_clamps(refined, plan.environments[name]))
            ),
        ],
        "environments": [
            promised_there(name, p, plan) | _of_shape(refined, p.modes) for name, p in promises.items()
        ],
    }
    if plants is not None:
        said["plants"] = dict(zip(("name", SEAL), plants, strict=True))
    return seal(_head(refined, files, date) | said)


def loads_document(
    refined: Refined,
    environment: str,
    deflections: Sequence[Deflection],
    modes: Prediction | None,
    *,
    files: Sequence[tuple[str, str]],
    date: str,
) -> dict[str, Any]:
    """The sealed document of readings under load cases, and of frequencies beside them."""
    place: dict[str, Any] = {
        "name": environment,
        "modes": [] if modes is None else _modes(modes, LoopSpread().damping_std),
        "load_cases": [_case(case) for case in deflections],
    }
    if modes is not None:
        place |= _of_shape(refined, modes)
    content = {
        "not_valid_for": ["contact, yielding and creep: members are elastic at any strain"],
        "environments": [place],
    }
    return seal(_head(refined, files, date) | content)


def _of_shape(refined: Refined, modes: Prediction) -> dict[str, Any]:
    """Shapes of promised modes, and how much of their frequency on the ground was taken out, by effect."""
    removed = removed_terms(refined, modes)
    found: dict[str, Any] = {"shapes": promised_shapes(refined, modes)}
    if removed is not None:
        both = zip(removed.share_hz, modes.frequency_hz, strict=True)
        found["removed"] = {
            "survey": removed.survey,
            "effects": EFFECTS,
            "share_hz": [[_beside(x, hz) for x in shares.tolist()] for shares, hz in both],
            "unclear": (np.flatnonzero(removed.unclear) + 1).tolist(),
        }
    return found


def _beside(value: float, whole: float) -> float:
    """``value`` rounded to the last decimal that is promised of ``whole``, of which it is a part."""
    return round(value, DIGITS - 1 - math.floor(math.log10(whole))) + 0.0


def hash_files(files: Sequence[Path]) -> tuple[tuple[str, str], ...]:
    """Name and SHA-256 of each file, to be taken before the work, so that later changes do not count."""
    return tuple((file.name, sha256_of(file)) for file in files)


def _head(refined: Refined, files: Sequence[tuple[str, str]], date: str) -> dict[str, Any]:
    return {
        "schema": PROMISE,
        "article": refined.structure.title,
        "date": date,
        "versions": versions(),
        "files": [{"name": name, "sha256": digest} for name, digest in files],
        "refined": _refined(refined),
    }


def _case(case: Deflection) -> dict[str, Any]:
    """Readings in SI, angles in degrees for whoever compares them with a table."""
    return {
        "name": case.name,
        "strained_as_in_the_tests": few(case.seen),
        "readings": [
            {
                "gauge": gauge.name,
                "at": gauge.at,
                "unit": "deg" if gauge.unit == "rad" else gauge.unit,
                "value": few(case.value[k] / size),
                "std": few(case.std[k] / size),
                "interval_95": [few(end / size) for end in case.interval[k]],
                "of_the_refined_article": few(case.of_the_article[k] / size),
            }
            for k, gauge in enumerate(case.gauges)
            for size in [_DEGREE if gauge.unit == "rad" else 1.0]
        ],
    }


def versions() -> dict[str, str]:
    """Versions of the programs that computed a document."""
    return {
        "middeck": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


def _refined(refined: Refined) -> dict[str, Any]:
    rows = zip(refined.unknowns, refined.x, refined.estimate.x_std, strict=True)
    return {
        "unknowns": [{"name": u.name, "x": few(x), "std": few(std)} for u, x, std in rows],
        "model_error": {s: few(tau) for s, tau in zip(refined.sorts, refined.estimate.tau, strict=True)},
        **({"friction": [_slips(f) for f in refined.friction()]} if refined.friction() else {}),
        "warnings": findings(refined),
    }


def _slips(refined: RefinedFriction) -> dict[str, Any]:
    torque, angle = (refined.value * [1.0, 1.0 / _DEGREE]).tolist()
    return {
        "joint": refined.joint,
        "slip_torque_nm": few(torque),
        "slip_angle_deg": few(angle),
        "log_deviation": [few(std) for std in refined.log_std.tolist()],
    }


def limits_of(plan: Plan, promises: Mapping[str, Promise]) -> list[str]:
    """Effects that the plants of the promise lack."""
    limits = ["friction, play and saturation: every plant is linear"]
    if plan.joints:
        limits = [
            "play, saturation, and friction except at the stated joints",
            "disturbances of another intensity: with friction the decibels depend on it",
            *(
                f"drag of {j.name} other than {j.viscous:g} N m s/rad, inseparable from damping in surveys"
                for j in plan.joints
            ),
        ]
        limits += [
            f"{name}: slow motions, whose decay asks for more than the {p.slip_time.record_s:.0f} s simulated"
            for name, p in promises.items()
            if p.slip_time is not None and p.slip_time.short
        ]
    if plan.draws + 1 < 1.0 / (1.0 - LEVELS[-1]):
        held = 100.0 * plan.draws / (plan.draws + 1)
        limits.append(f"quantiles beyond {held:.3g} %, where the worst of {plan.draws} draws is given")
    limits += [
        f"{name}: modes above {p.modes.frequency_hz[-1]:.4g} Hz, the last of {plan.modes} modes{_too_few(p)}"
        for name, p in promises.items()
    ]
    for name, p in promises.items():
        if p.lost_to_cable is not None:
            tried = " or ".join(f"{hz:g} Hz" for hz in TRIED_HZ)
            falls = f"; one of {tried} makes {', '.join(p.lost_to_cable)} unstable" if p.lost_to_cable else ""
            limits.append(f"{name}: a weak cable to the article, since umbilical_hz states none{falls}")
        names = [p.modes.modes.name[i] for i in p.modes.index]
        unseen = [mode for mode, seen in zip(names, p.modes.seen, strict=True) if seen < SEEN]
        if unseen:
            limits.append(
                f"{name}: modes that no survey measured, predicted by the model alone: {', '.join(unseen)}"
            )
    return limits


def _too_few(promise: Promise) -> str:
    """Effect of more modes, where it is significant."""
    found = promise.left_out
    if found is None or not found.shift_db:
        return ""
    shifts = (
        f"{name} by {few(db, 2)} dB" if np.isfinite(db) else f"{name} to instability"
        for name, db in found.shift_db.items()
    )
    return f"; {found.modes} modes shift {', '.join(shifts)}: state modes = {found.modes}"


def promised_there(name: str, promise: Promise, plan: Plan) -> dict[str, Any]:
    """The part of a document for one environment: modes and compensators."""
    return {
        "name": name,
        "modes": _modes(promise.modes, plan.loop.damping_std),
        "without_control_rms": [few(level(promise.rest_rms, share)) for share in (0.025, 0.5, 0.975)]
        if np.all(np.isfinite(promise.rest_rms))
        else None,
        "sweep": {
            "first_bending": promise.swept.modes.first_bending,
            "first_bending_percent": few(100.0 * plan.sweep.first_bending),
            "others": promise.swept.modes.others,
            "others_percent": few(100.0 * plan.sweep.others),
        },
        "compensators": [
            _loop_row(o, promise.bound[o.name], plan) | {"sweep": _swept(promise.sweeps[o.name])}
            for o in promise.outlooks
        ],
        "highest": promise.highest,
        **({} if promise.slip_time is None else {"friction": _friction(promise.slip_time, plan)}),
    }


def _friction(time: SlipTime, plan: Plan) -> dict[str, Any]:
    """The stated friction of the joints, and how it was simulated."""
    return {
        "joints": [
            {
                "name": j.name,
                "slip_torque_nm": j.slip_torque,
                "slip_angle_deg": few(j.slip_angle / _DEGREE),
                "viscous_nms_per_rad": j.viscous,
                "slip_torque_tolerance": j.slip_torque_tolerance,
                "slip_angle_tolerance": j.slip_angle_tolerance,
            }
            for j in plan.joints
        ],
        "record_s": few(time.record_s),
        "settle_s": few(time.settle_s),
        "band_hz": few(time.band_hz),
        "sample_hz": few(time.sample_hz),
    }


def _modes(modes: Prediction, unseen_damping: float) -> list[dict[str, Any]]:
    """``unseen_damping`` is the spread of the logarithms of ratios that no survey measured."""
    return [
        {
            "name": modes.modes.name[i],
            "kind": modes.modes.kind[i],
            "frequency_hz": few(hz),
            "interval_95_hz": [few(end) for end in ends],
            "damping": few(zeta),
            "damping_deviation": few(zeta * spread),
            "seen": round(min(float(seen), 1.0), SHARE_DIGITS),
            "ground_hz": few(ground),
        }
        for i, hz, ends, zeta, spread, seen, ground in zip(
            modes.index,
            modes.frequency_hz,
            modes.interval_hz,
            modes.damping,
            modes.damping_std(unseen_damping),
            modes.seen,
            modes.ground_hz,
            strict=True,
        )
    ]


def _loop_row(outlook: Outlook, bound: RobustBound, plan: Plan) -> dict[str, Any]:
    risk, correlation = outlook.risk
    effort = float(np.median(outlook.control_rms))
    return {
        "name": outlook.name,
        "given": outlook.name in plan.laws,
        "probability_stable": outlook.probability_stable,
        "interval_95": [few(end) for end in outlook.probability_interval],
        "at_least": few(outlook.promised_probability),
        "db": [few(outlook.level_db(share)) for share in LEVELS],
        "control_rms": few(effort),
        "bound": {
            "draws": bound.draws,
            "worst_db": few(bound.worst_db),
            "no_linear_law_below_db": few(bound.no_linear_law_below_db),
        },
        "unstable_mode": outlook.unstable_mode or None,
        "risk": {"of": risk or None, "rank_correlation": few(correlation)},
        **({} if outlook.friction is None else _with_friction(outlook.friction, plan)),
    }


def _swept(swept: Swept) -> dict[str, Any]:
    """Number of stable cases of the sweep, and the unstable ones."""
    return {"cases": len(swept.cases), "stable": int(np.count_nonzero(swept.stable)), "lost": swept.lost}


def _with_friction(friction: FrictionOutlook, plan: Plan) -> dict[str, Any]:
    """The cost of friction: the decibels without it, and whether joints stick or slip."""
    names = [joint.name for joint in plan.joints]
    return {
        "without_friction_db": [few(level(friction.without_db, share)) for share in LEVELS],
        "stable_while_sticking": float(np.mean(friction.sticks)),
        "travel_over_slip_angle": {
            name: few(travel, TRAVEL_DIGITS) for name, travel in zip(names, friction.travel, strict=True)
        },
        "simulation_error_db": few(friction.error_db),
    }


def few(value: float, digits: int = DIGITS) -> float | None:
    """``value`` rounded to the digits that are promised; None where it is not finite."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None
