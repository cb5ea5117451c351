"""Figures 9a and 9b in numbers.json, with the claims."""

from collections.abc import Callable, Iterable

from middeck.files.json.results import fitted_numbers, response_numbers
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.laboratory.loop_stability import RigLoop
from middeck.study.chapters.measured_control.computation import MeasuredControl
from middeck.study.measured_loop.computation import STATIC_HZ, MeasuredLoop, ModeReduction
from middeck.study.measured_loop.numbers_and_claims import fit_numbers, loop_numbers, prediction_claims
from middeck.study.words import Claim, Numbers, at_most, below, largest, row


def figure_9a(control: MeasuredControl) -> Numbers:
    """The measured response of the rig and the fit to it."""
    return {
        **fitted_numbers(control.open_loop, control.fitted),
        **fit_numbers(control.fit, control.plant, control.fit_band_hz),
        "mode_below_fit": control.below_fit,
        "warnings": control.fit.warnings,
    }


def figure_9b(control: MeasuredControl) -> Numbers:
    """Loops at two authorities and one for two records, predicted and measured."""
    drifted = control.drifted_fit
    return {
        "open_loop": response_numbers(control.open_loop),
        "pair_shift_hz": control.pair_shift_hz,
        "drifted": {
            "shift_percent": control.drifted_percent,
            "natural_hz": natural_hz(drifted.model),
            "damping": damping_ratio(drifted.model),
            "relative_error": drifted.error[0],
            "warnings": drifted.warnings,
        },
        **{loop.name: loop_numbers(loop) for loop in control.loops},
        "one_model": control.one_model,
        "claims": figure_9_claims(control),
    }


SUPPRESSED_DB = 3.0  # a mode that is lower by this is suppressed, one that is within it is left alone
LOW_HZ = 5.0  # pendulum and first bending are below, the modes near 7 and 9 Hz above
SEVEN_HZ = (6.0, 8.0)
GAIN_DB, PHASE_DEG = 4.0, 30.0  # margins that CL3 must have on both records
LEAST = "change of the least reduced"


def figure_9_claims(control: MeasuredControl) -> list[Claim]:
    """Reduction mode by mode, prediction, drift, and the design for both records."""
    low, high, robust = control.loops
    return [
        *_low_claims(low),
        *_high_claims(high),
        *prediction_claims(control.loops, "CL1, CL2, CL3"),
        *_drift_claims(control, low, high),
        *_robust_claims(control, robust),
    ]


def _low_claims(low: MeasuredLoop) -> list[Claim]:
    below = [mode for mode in low.modes if mode.frequency_hz < LOW_HZ]
    above = [mode for mode in low.modes if mode.frequency_hz >= LOW_HZ]
    by = f"by at least {SUPPRESSED_DB:g} dB"
    static = f"CL1 (low authority) lowers the static response, below {STATIC_HZ:g} Hz, {by}; change [dB]"
    bending = f"CL1 lowers pendulum and first bending{_listed(below)} {by}; {LEAST} [dB]"
    kept = f"CL1 changes the modes above{_listed(above)} by at most {SUPPRESSED_DB:g} dB; largest change [dB]"
    return [
        at_most(static, low.static_db, -SUPPRESSED_DB),
        at_most(bending, largest(mode.db for mode in below), -SUPPRESSED_DB),
        at_most(kept, largest(abs(mode.db) for mode in above), SUPPRESSED_DB),
    ]


def _high_claims(high: MeasuredLoop) -> list[Claim]:
    seven = [m for m in high.modes if SEVEN_HZ[0] <= m.frequency_hz <= SEVEN_HZ[1]]
    least = max(high.modes, key=lambda mode: mode.db, default=None)
    near_seven = (
        f"CL2 (high authority) also lowers the mode near 7 Hz, by at least {SUPPRESSED_DB:g} dB; change [dB]"
    )
    every = f"CL2 lowers every mode of the fit; {LEAST}{_listed([] if least is None else [least])} [dB]"
    return [
        at_most(near_seven, largest(mode.db for mode in seven), -SUPPRESSED_DB),
        below(every, None if least is None else least.db, 0.0),
        at_most(
            "CL2 reduces the payload's measured rms angle by over 20 dB; change [dB]", high.measured_db, -20.0
        ),
    ]


def _drift_claims(control: MeasuredControl, low: MeasuredLoop, high: MeasuredLoop) -> list[Claim]:
    broken = [percent for percent, ok in high.survives if not ok]
    shifts = f"if the pair of modes near {control.pair_shift_hz:g} Hz shifts"
    breaks, tried = high.stable and len(broken) == len(high.survives), _of_shifts(p for p, _ in high.survives)
    holds, asked = low.stable and all(ok for _, ok in low.survives), f"= {len(low.survives)}"
    survived = float(sum(ok for _, ok in low.survives))
    return [
        row(f"CL2 is unstable {shifts}; unstable shifts [%]", breaks, _of_shifts(broken), tried, "%"),
        row(f"CL1 stays stable {shifts}; stable at", holds, survived, asked, "shifts"),
    ]


def _robust_claims(control: MeasuredControl, robust: MeasuredLoop) -> list[Claim]:
    both = [loop for loop in robust.on_rig if loop.percent in (0.0, control.drifted_percent)]
    alone = [loop for loop in control.one_model if loop.percent in (0.0, control.drifted_percent)]
    where = f"with the pair unshifted and shifted by {control.drifted_percent:+g} %"
    broken = [loop.percent for loop in alone if not loop.stable]
    gain = f"CL3 is stable {where}, with a gain margin of at least {GAIN_DB:g} dB; least margin [dB]"
    phase = f"CL3 has a phase margin of at least {PHASE_DEG:g} degrees {where}; least margin [deg]"
    first = (
        "LQG for the first record alone, at CL3's authority, is not stable on both records;"
        " unstable shifts [%]"
    )
    return [
        at_most(
            "CL3, designed for two records, reduces the payload's rms angle by over 20 dB; change [dB]",
            robust.measured_db,
            -20.0,
        ),
        _margin(gain, both, lambda loop: loop.gain_margin_db, GAIN_DB, "dB"),
        _margin(phase, both, lambda loop: loop.phase_margin_deg, PHASE_DEG, "deg"),
        row(first, bool(broken), _of_shifts(broken), "any", "%"),
    ]


def _margin(
    claim: str, loops: list[RigLoop], margin: Callable[[RigLoop], float | None], least: float, unit: str
) -> Claim:
    """A margin of stable loops; one without a limit satisfies any."""
    stable, asked = all(loop.stable for loop in loops), f"\u2265 {least:g}"
    if not stable:
        return row(claim, False, None, asked, unit)
    smallest = min((m for m in map(margin, loops) if m is not None), default=None)
    return row(
        claim, smallest is None or smallest >= least, "any" if smallest is None else smallest, asked, unit
    )


def _of_shifts(percents: Iterable[float]) -> str:
    return ", ".join(f"{p:+g}" for p in percents)


def _listed(modes: list[ModeReduction]) -> str:
    return f" ({', '.join(f'{mode.frequency_hz:.2f}' for mode in modes)} Hz)" if modes else ""
