"""The paper's claims, each a row: what is claimed, whether it holds here, and the number that says so.

The paper prints 36 dB in 0-g (40 dB was its target) and orderings; where a word such as "much higher" needs
a number to be judged by, the number stands in the claim. Every row is always there: where a loop is unstable
or nothing was found there is no number, and what would need it does not hold.
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from middeck.identification.measurement_model import path_delay
from middeck.study.gravity_responses import GravityResponses
from middeck.study.measured_control import MeasuredControl
from middeck.study.measured_sensors import MeasuredSensors
from middeck.study.zero_g_control import SubModelSweep, ZeroGControl

LEADS = 0.5  # share of all structural states from which on one mode leads an instability


class Claim(TypedDict):
    """One row."""

    claim: str
    holds: bool
    number: float | str | None


def figure_6_claims(responses: GravityResponses) -> list[Claim]:
    """Delay explains the phase; gravity and suspension bring the model to the data."""
    gap = responses.phase_gap_s
    largest = None if gap is None else float(np.max(np.abs(gap - responses.delay_s)))
    error = responses.magnitude_error
    names = [port.name for port in responses.rig.outputs]
    rows = [
        _row(
            "phase gap above 5 Hz equals the delay within 0.2 ms; largest gap [s]",
            largest is not None and largest < 2e-4,
            largest,
        )
    ]
    for k, name in enumerate(names):
        where = "where both are measured" if error is None else "in {:g}-{:g} Hz".format(*error.band_hz)
        ratio = None if error is None else float(error.lab_db[k] / error.orbit_db[k])
        text = f"{name}: the 1-g model's log-magnitude error {where} is below the 0-g one's; ratio"
        rows.append(_row(text, ratio is not None and ratio < 1.0, ratio))
    return rows


def figure_7_claims(control: ZeroGControl) -> list[Claim]:
    """Which of the paper's observations on 0-g controllers in 1-g come out."""
    sweeps = dict(control.sweeps)
    return [*_level_claims(sweeps["all"]), *_instability_claims(sweeps, control.log10_authority[0])]


def _level_claims(whole: SubModelSweep) -> list[Claim]:
    """What the decibels at the first and the last level say; an unstable loop has none."""
    sweep = whole.sweep
    orbit, lab = (sweep.plants.index(name) for name in ("orbit", "lab"))
    top = -float(sweep.db[orbit, -1]) if sweep.stable[orbit, -1] else None
    both = sweep.stable[orbit, 0] and sweep.stable[lab, 0]
    low = float(sweep.db[lab, 0] - sweep.db[orbit, 0]) if both else None
    return [
        _row(
            "0-g improves by 36 dB at the top level, within 3 dB (40 dB was the target) [dB]",
            top is not None and abs(top - 36.0) <= 3.0,
            top,
        ),
        _row("0-g reaches the 40 dB target at the top level [dB]", top is not None and top >= 40.0, top),
        _row(
            "the 0-g loop is stable at every level; levels",
            bool(np.all(sweep.stable[orbit])),
            float(np.count_nonzero(sweep.stable[orbit])),
        ),
        _row("1-g is better than 0-g at low authority [dB]", low is not None and low < 0.0, low),
    ]


def _instability_claims(sweeps: dict[str, SubModelSweep], lowest: float) -> list[Claim]:
    """What goes unstable first in 1-g, and whether the sub-models repeat it.

    A loop that is unstable at the ``lowest`` level already has its onset somewhere below: two such are not
    compared.
    """
    whole = sweeps["all"]
    first = whole.first_instability
    repeats, parts = (sweeps[which].first_instability for which in ("rigid", "flexible"))
    decades = apart = None
    if first is not None:
        if repeats is not None and lowest not in (first.log10_authority, repeats.log10_authority):
            decades = abs(repeats.log10_authority - first.log10_authority)
        apart = None if parts is None else parts.log10_authority - first.log10_authority
    real = f" (here {whole.unstable_real} real, a divergence)" if whole.unstable_real else ""
    leader = "" if first is None else f" ({first.mode_name})"
    same = first is not None and repeats is not None and repeats.mode_name == first.mode_name
    return [
        _row(
            "1-g goes unstable as authority rises; log10 authority",
            first is not None,
            None if first is None else first.log10_authority,
        ),
        _row(
            f"one complex pair goes unstable first in 1-g{real}; pairs",
            whole.unstable_pairs == 1 and whole.unstable_real == 0,
            None if first is None else whole.unstable_pairs,
        ),
        _row(
            f"a suspension mode leads it with over half of all structural states' shares{leader}; share",
            first is not None and whole.mode_kind == "suspension" and first.participation > LEADS,
            None if first is None else first.participation,
        ),
        _row(
            "the rigid sub-model repeats it with the same mode within 0.25 decade; decades apart",
            same and decades is not None and decades <= 0.25,
            decades,
        ),
        _row(
            "the flexible pair goes unstable only at over ten times the authority, or never; decades above",
            first is not None and (parts is None or (apart is not None and apart > 1.0)),
            apart,
        ),
    ]


def figure_9_claims(control: MeasuredControl) -> list[Claim]:
    """Design on a measured model: reduction, prediction, and what a drift of the pair does."""
    low, high = control.loops
    errors = [loop.rms_error_db for loop in control.loops]
    error = max((abs(e) for e in errors if e is not None), default=None) if None not in errors else None
    broken = [percent for percent, ok in high.survives if not ok]
    states, model = len(control.plant.system.A), control.fit.model
    pair = f"a shift of the pair near {control.pair_shift_hz:g} Hz"
    return [
        _row(
            "ten structural states and a third-order Pade give 13",
            (model.states, control.pade_order, states) == (10, 3, 13),
            float(states),
        ),
        _row(
            "high authority reduces the payload's rms angle by over 20 dB, measured [dB]",
            high.measured_db is not None and high.measured_db < -20.0,
            high.measured_db,
        ),
        _row(
            "prediction and measurement agree within 1 dB at both authorities [dB]",
            error is not None and error <= 1.0,
            error,
        ),
        _row(
            f"{pair} breaks the high authority; shifts that do [%]",
            bool(broken),
            ", ".join(f"{p:+g}" for p in broken),
        ),
        _row(
            f"{pair} leaves the low authority stable; shifts survived",
            all(ok for _, ok in low.survives),
            float(sum(ok for _, ok in low.survives)),
        ),
    ]


def figure_10_claims(sensors: MeasuredSensors) -> list[Claim]:
    """The bus needs zeros in the right half-plane where payload and encoder need none."""
    low, high = sensors.fit_band_hz
    words = [port.name for port in sensors.measured.outputs]
    wrong = [
        float(np.count_nonzero(z.is_nonminimum_phase & (z.frequency_hz >= low) & (z.frequency_hz <= high)))
        for z in (sensor.zeros for sensor in sensors.sensors)
    ]
    bus = sensors.sensors[2]
    ratio = None if bus.mirrored_error is None else bus.mirrored_error / float(sensors.fit.error[2])
    late = float(np.max(np.abs(path_delay(sensors.fit.model) - sensors.delay_s)))
    where = f"from {low:g} to {high:g} Hz"
    return [
        _row(f"{words[2]}: non-minimum-phase zeros {where}; zeros or pairs", wrong[2] > 0.0, wrong[2]),
        *(_row(f"{words[k]}: none {where}; zeros or pairs", wrong[k] == 0.0, wrong[k]) for k in (0, 1)),
        _row(
            f"{words[2]}: with those zeros in the left half-plane the fit errs over ten times as much; ratio",
            ratio is not None and ratio > 10.0,
            ratio,
        ),
        _row("the fitted delays are the rig's within 0.2 ms; largest difference [s]", late < 2e-4, late),
    ]


def _row(claim: str, holds: bool, number: float | str | None) -> Claim:
    return {"claim": claim, "holds": bool(holds), "number": number}
