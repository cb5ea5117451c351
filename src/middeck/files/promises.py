"""Promises and what came of them: sealed documents."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from pydantic import Field

from middeck import __version__
from middeck.errors import DataError
from middeck.files.documents import check, read_source, sha256_of
from middeck.files.faults import raise_faults
from middeck.files.form import Finite, Form, Positive
from middeck.files.sealed import SEAL, read_sealed, seal
from middeck.updating.deflections import Deflection
from middeck.updating.draws import LoopSpread
from middeck.updating.findings import findings
from middeck.updating.orbit import Prediction
from middeck.updating.outlook import LEVELS, FrictionOutlook, Outlook, draws_needed, level
from middeck.updating.plan import Plan
from middeck.updating.promise import Promise
from middeck.updating.refine import Refined
from middeck.updating.score import Outcome, Statement, Verdict, judge, score
from middeck.updating.slip_time import SlipTime

PROMISE, COMPARISON = "middeck.promise/1", "middeck.comparison/1"
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
) -> dict[str, Any]:
    """The sealed document: what was promised when, on what, by which versions and seed."""
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
        "not_valid_for": limits_of(plan, promises),
        "environments": [promised_there(name, p, plan) for name, p in promises.items()],
    }
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
    place = {
        "name": environment,
        "modes": [] if modes is None else _modes(modes, LoopSpread().damping_std),
        "load_cases": [_case(case) for case in deflections],
    }
    said = {
        "not_valid_for": ["contact, yielding and creep: members are elastic at any strain"],
        "environments": [place],
    }
    return seal(_head(refined, files, date) | said)


def hash_files(files: Sequence[Path]) -> tuple[tuple[str, str], ...]:
    """Name and SHA-256 of each, to be taken before the work: what is saved later was not promised on."""
    return tuple((file.name, sha256_of(file)) for file in files)


def _head(refined: Refined, files: Sequence[tuple[str, str]], date: str) -> dict[str, Any]:
    return {
        "schema": PROMISE,
        "article": refined.structure.title,
        "date": date,
        "versions": _versions(),
        "files": [{"name": name, "sha256": digest} for name, digest in files],
        "refined": _refined(refined),
    }


def _case(case: Deflection) -> dict[str, Any]:
    """Readings in SI, angles in degrees for whoever compares them with a table."""
    return {
        "name": case.name,
        "strained_as_in_the_tests": _few(case.seen),
        "readings": [
            {
                "gauge": gauge.name,
                "at": gauge.at,
                "unit": "deg" if gauge.unit == "rad" else gauge.unit,
                "value": _few(case.value[k] / size),
                "std": _few(case.std[k] / size),
                "interval_95": [_few(end / size) for end in case.interval[k]],
                "of_the_refined_article": _few(case.of_the_article[k] / size),
            }
            for k, gauge in enumerate(case.gauges)
            for size in [_DEGREE if gauge.unit == "rad" else 1.0]
        ],
    }


def read_promise(path: str | Path) -> dict[str, Any]:
    """The promise in ``path``. Raises `DataError` for another document, or one that was changed."""
    return read_sealed(path, PROMISE)


class ModeOutcomeForm(Form):
    """A mode as it came."""

    environment: str
    number: Annotated[int, Field(ge=1)]
    frequency_hz: Positive


class LoopOutcomeForm(Form):
    """A compensator as it did."""

    environment: str
    name: str
    stable: bool
    rms_db: Finite | None = None


class ReadingOutcomeForm(Form):
    """A gauge as it read, in the unit of the promise: degrees of angles, else SI."""

    environment: str
    load_case: str
    gauge: str
    value: Finite


class OutcomeForm(Form):
    """What came of a promise."""

    schema_: Literal["middeck.outcome/1"] = Field(alias="schema")
    mode: Annotated[tuple[ModeOutcomeForm, ...], Field(strict=False)] = ()
    compensator: Annotated[tuple[LoopOutcomeForm, ...], Field(strict=False)] = ()
    reading: Annotated[tuple[ReadingOutcomeForm, ...], Field(strict=False)] = ()


def load_outcomes(path: str | Path) -> tuple[Outcome, ...]:
    """Outcomes in file ``path``.

    Raises `ConfigError` with all faults of the document, `DataError` for a stable loop without decibels.
    """
    source = read_source(path)
    checked = check(source, source.data, {}, OutcomeForm, lambda _: [])
    raise_faults(list(checked.faults))
    form = checked.form
    assert form is not None  # no faults
    for loop in form.compensator:
        if loop.stable == (loop.rms_db is None):
            what = "stable, without its rms_db" if loop.stable else "unstable, with rms_db"
            raise DataError(f"{loop.name} is {what}", where=str(path), hint="rms_db of stable loops alone")
    return (
        *(Outcome(name=name_of_mode(m.environment, m.number), value=m.frequency_hz) for m in form.mode),
        *(Outcome(name=_reading(r.environment, r.load_case, r.gauge), value=r.value) for r in form.reading),
        *(
            Outcome(name=name_of_loop(c.environment, c.name), value=c.rms_db, stable=c.stable)
            for c in form.compensator
        ),
    )


def comparison_document(
    promise: Mapping[str, Any], outcomes: Sequence[Outcome], *, outcome_file: Path, date: str
) -> dict[str, Any]:
    """What came beside ``promise``, which it names by its seal and does not change.

    Raises `DataError` for an outcome of which nothing was promised.
    """
    statements = statements_of(promise)
    verdicts = judge(statements, outcomes)
    said, came = {s.name: s for s in statements}, {o.name: o for o in outcomes}
    return seal(
        {
            "schema": COMPARISON,
            "promise": promise[SEAL],
            "promised_on": promise["date"],
            "date": date,
            "versions": _versions(),
            "outcome": {"name": outcome_file.name, "sha256": sha256_of(outcome_file)},
            "verdicts": [_row(v, said[v.name], came[v.name]) for v in verdicts],
            "score": score(verdicts),
        }
    )


def statements_of(promise: Mapping[str, Any]) -> tuple[Statement, ...]:
    """What a promise says, quantity by quantity."""
    at = {share: k for k, share in enumerate(promise.get("shares", ()))}

    def reached(value: float | None) -> float:
        return np.inf if value is None else float(value)

    found: list[Statement] = []
    for place in promise["environments"]:
        for number, mode in enumerate(place["modes"], start=1):
            ends = mode["interval_95_hz"]
            found.append(Statement(name=name_of_mode(place["name"], number), low=ends[0], high=ends[1]))
        for case in place.get("load_cases", ()):
            for reading in case["readings"]:
                ends = reading["interval_95"]
                name = _reading(place["name"], case["name"], reading["gauge"])
                found.append(Statement(name=name, low=ends[0], high=ends[1]))
        for loop in place.get("compensators", ()):
            db = loop["db"]
            found.append(
                Statement(
                    name=name_of_loop(place["name"], loop["name"]),
                    low=reached(db[at[0.025]]),
                    high=reached(db[at[0.975]]),
                    probability=loop["probability_stable"],
                    cautious=reached(db[at[0.99]]),
                )
            )
    return tuple(found)


def name_of_mode(environment: str, number: int) -> str:
    """As outcomes name it; numbered from 1."""
    return f"{environment}: mode {number}"


def _reading(environment: str, case: str, gauge: str) -> str:
    return f"{environment}: {case}: {gauge}"


def name_of_loop(environment: str, name: str) -> str:
    """As outcomes name it."""
    return f"{environment}: {name}"


def _row(verdict: Verdict, said: Statement, came: Outcome) -> dict[str, Any]:
    return {
        "name": verdict.name,
        "promised": [_few(said.low), _few(said.high)],
        "probability_stable": said.probability,
        "value": came.value,
        "stable": came.stable,
        "inside": verdict.inside,
        "brier": verdict.brier,
        "pessimism_db": None if verdict.pessimism is None else _few(verdict.pessimism),
    }


def _versions() -> dict[str, str]:
    return {
        "middeck": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


def _refined(refined: Refined) -> dict[str, Any]:
    rows = zip(refined.unknowns, refined.x, refined.estimate.x_std, strict=True)
    return {
        "unknowns": [{"name": u.name, "x": _few(x), "std": _few(std)} for u, x, std in rows],
        "model_error": {s: _few(tau) for s, tau in zip(refined.sorts, refined.estimate.tau, strict=True)},
        "warnings": findings(refined),
    }


def limits_of(plan: Plan, promises: Mapping[str, Promise]) -> list[str]:
    """What the plants of the promise do not have."""
    said = ["friction, play and saturation: every plant is linear"]
    if plan.joints:
        said = [
            "play, saturation, and friction but at the joints stated",
            "disturbances of another intensity: with friction the decibels go with it",
        ]
        said += [
            f"{name}: slow motions, whose decay asks for more than the {p.slip_time.record_s:.0f} s simulated"
            for name, p in promises.items()
            if p.slip_time is not None and p.slip_time.short
        ]
    if plan.draws + 1 < 1.0 / (1.0 - LEVELS[-1]):
        held = 100.0 * plan.draws / (plan.draws + 1)
        said.append(f"levels beyond {held:.3g} %: the worst of {plan.draws} draws stands for them")
    said += [
        f"{name}: what lies above {p.modes.frequency_hz[-1]:.4g} Hz, the last of {plan.modes} modes"
        for name, p in promises.items()
    ]
    for name, p in promises.items():
        names = [p.modes.modes.name[i] for i in p.modes.index]
        unseen = [mode for mode, seen in zip(names, p.modes.seen, strict=True) if seen < SEEN]
        if unseen:
            said.append(f"{name}: modes that no survey saw, by the model alone: {', '.join(unseen)}")
    return said


def promised_there(name: str, promise: Promise, plan: Plan) -> dict[str, Any]:
    """What a document says of one environment: modes and compensators."""
    return {
        "name": name,
        "modes": _modes(promise.modes, plan.loop.damping_std),
        "without_control_rms": [_few(float(np.quantile(promise.rest_rms, q))) for q in (0.025, 0.5, 0.975)]
        if np.all(np.isfinite(promise.rest_rms))
        else None,
        "compensators": [_loop_row(o, promise.bound[o.name], plan) for o in promise.outlooks],
        "highest": promise.highest,
        **({} if promise.slip_time is None else {"friction": _friction(promise.slip_time, plan)}),
    }


def _friction(time: SlipTime, plan: Plan) -> dict[str, Any]:
    """What was stated of the joints, and how it was simulated."""
    return {
        "joints": [
            {
                "name": j.name,
                "slip_torque_nm": j.slip_torque,
                "slip_angle_deg": _few(j.slip_angle / _DEGREE),
                "viscous_nms_per_rad": j.viscous,
                "slip_torque_tolerance": j.slip_torque_tolerance,
                "slip_angle_tolerance": j.slip_angle_tolerance,
            }
            for j in plan.joints
        ],
        "record_s": _few(time.record_s),
        "settle_s": _few(time.settle_s),
        "band_hz": _few(time.band_hz),
        "sample_hz": _few(time.sample_hz),
    }


def _modes(modes: Prediction, unseen_damping: float) -> list[dict[str, Any]]:
    """``unseen_damping`` is the spread of the logarithms of ratios that no survey measured."""
    return [
        {
            "name": modes.modes.name[i],
            "frequency_hz": _few(hz),
            "interval_95_hz": [_few(end) for end in ends],
            "damping": _few(zeta),
            "damping_deviation": _few(zeta * spread),
            "seen": round(min(float(seen), 1.0), SHARE_DIGITS),
            "ground_hz": _few(ground),
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


def _loop_row(outlook: Outlook, bound: tuple[float, float], plan: Plan) -> dict[str, Any]:
    risk, correlation = outlook.risk
    effort = float(np.median(outlook.control_rms))
    return {
        "name": outlook.name,
        "given": outlook.name in plan.laws,
        "probability_stable": outlook.probability_stable,
        "interval_95": [_few(end) for end in outlook.probability_interval],
        "at_least": _few(outlook.promised_probability),
        "db": [_few(outlook.level_db(share)) for share in LEVELS],
        "control_rms": _few(effort),
        "bound": {"own_db": _few(bound[0]), "no_linear_law_below_db": _few(bound[1])},
        "unstable_mode": outlook.unstable_mode or None,
        "risk": {"of": risk or None, "rank_correlation": _few(correlation)},
        **({} if outlook.friction is None else _with_friction(outlook.friction, plan)),
    }


def _with_friction(friction: FrictionOutlook, plan: Plan) -> dict[str, Any]:
    """What friction costs: the same levels without it; and whether joints stick or slip."""
    names = [joint.name for joint in plan.joints]
    return {
        "without_friction_db": [_few(level(friction.without_db, share)) for share in LEVELS],
        "stable_while_sticking": float(np.mean(friction.sticks)),
        "travel_over_slip_angle": {
            name: float(f"{travel:.{TRAVEL_DIGITS}g}")
            for name, travel in zip(names, friction.travel, strict=True)
        },
        "simulation_error_db": _few(friction.error_db),
    }


def _few(value: float) -> float | None:
    """To the digits that are promised; None for what is not finite."""
    return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
