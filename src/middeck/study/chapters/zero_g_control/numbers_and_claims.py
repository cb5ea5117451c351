"""Figure 7 in numbers.json, with the claims."""

import numpy as np

from middeck.study.chapters.zero_g_control.computation import SubModelSweep, ZeroGControl
from middeck.study.words import Claim, Numbers, at_most, below, fields, row


def figure_7(control: ZeroGControl) -> Numbers:
    """Performance against authority for the model and its two sub-models."""
    sweeps = dict(control.sweeps)
    return {
        "log10_authority": control.log10_authority,
        "disturbance_psd_two_sided": control.disturbance_psd,
        "metric_3sigma_deg_pd": {env: np.degrees(3.0 * value) for env, value in control.metric_pd},
        **{which: _sub_model(sweep) for which, sweep in sweeps.items()},
        "claims": figure_7_claims(control),
    }


def _sub_model(sub: SubModelSweep) -> Numbers:
    sweep, first = sub.sweep, sub.first_instability
    sides = {
        plant: {
            "db": [float(v) if ok else None for v, ok in zip(db, stable, strict=True)],
            "stable": stable,
            "compensator_stable": sweep.compensator_stable,
        }
        for plant, db, stable in zip(sweep.plants, sweep.db, sweep.stable, strict=True)
    }
    instability = first and {
        "log10_authority": first.log10_authority,
        "frequency_hz": first.frequency_hz,
        "growth_rad_s": first.pole.real,
        "mode_frequency_hz": sub.mode_frequency_hz,
        **fields(first, "mode_name", "participation", "compensator_share"),
        "unstable_pairs": sub.unstable_pairs,
        "unstable_real_poles": sub.unstable_real,
    }
    return {
        **sides,
        "reference_db_lab_pd": sub.reference_db_lab_pd,
        "quadrature_error": sub.quadrature_error,
        "first_instability": instability,
    }


LEADS = 0.5  # share of all structural states from which on one mode leads an instability


def figure_7_claims(control: ZeroGControl) -> list[Claim]:
    """Claims: the paper's observations on 0-g controllers in 1-g."""
    sweeps = dict(control.sweeps)
    return [*_level_claims(sweeps["all"]), *_instability_claims(sweeps, control.log10_authority[0])]


def _level_claims(whole: SubModelSweep) -> list[Claim]:
    """Decibels at the first and the last level; an unstable loop has none."""
    sweep = whole.sweep
    orbit, lab = (sweep.plants.index(name) for name in ("orbit", "lab"))
    top = float(sweep.db[orbit, -1]) if sweep.stable[orbit, -1] else None
    both = sweep.stable[orbit, 0] and sweep.stable[lab, 0]
    low = float(sweep.db[lab, 0] - sweep.db[orbit, 0]) if both else None
    stable, count = float(np.count_nonzero(sweep.stable[orbit])), sweep.stable[orbit].size
    reduces = "the highest authority reduces the error in 0-g by"
    improves = f"{reduces} 36 dB, within 3 dB (40 dB was the target); change [dB]"
    return [
        row(improves, top is not None and abs(top + 36.0) <= 3.0, top, "-39 to -33", "dB"),
        at_most(f"{reduces} the target of 40 dB; change [dB]", top, -40.0),
        row("the 0-g loop is stable at every level; levels", stable == count, stable, f"= {count}", "levels"),
        below("at the lowest authority the error is smaller in 1-g than in 0-g; difference [dB]", low, 0.0),
    ]


def _instability_claims(sweeps: dict[str, SubModelSweep], lowest: float) -> list[Claim]:
    """Claims: the first instability in 1-g, and whether the sub-models repeat it.

    A loop already unstable at the ``lowest`` level has its onset somewhere below: two such are not compared.
    """
    whole = sweeps["all"]
    first = whole.first_instability
    repeats = sweeps["rigid"].first_instability if "rigid" in sweeps else None
    parts = sweeps["flexible"].first_instability
    decades = apart = None
    if first is not None:
        if repeats is not None and lowest not in (first.log10_authority, repeats.log10_authority):
            decades = abs(repeats.log10_authority - first.log10_authority)
        apart = None if parts is None else parts.log10_authority - first.log10_authority
    real = f" (here {whole.unstable_real} real, a divergence)" if whole.unstable_real else ""
    leader = "" if first is None else f" ({first.mode_name})"
    same = first is not None and repeats is not None and repeats.mode_name == first.mode_name
    level, pairs, share = None, None, None
    if first is not None:
        level, pairs, share = first.log10_authority, whole.unstable_pairs, first.participation
    single = f"one complex pair of poles becomes unstable first in 1-g{real}; pairs"
    led = f"a suspension mode{leader} has over half of the structural participation in that pair; share"
    rigid = "in the rigid sub-model the same mode becomes unstable first, within 0.25 decade; decades apart"
    flexible = (
        "in the flexible sub-model the first instability is at over ten times that authority, or never;"
        " decades above"
    )
    leads = share is not None and whole.mode_kind == "suspension" and share > LEADS
    later = first is not None and (parts is None or (apart is not None and apart > 1.0))
    near = same and decades is not None and decades <= 0.25
    return [
        row(
            "the 1-g loop becomes unstable as authority rises; log10 authority",
            first is not None,
            level,
            "any",
        ),
        row(single, whole.unstable_pairs == 1 and whole.unstable_real == 0, pairs, "= 1"),
        row(led, leads, share, f"> {LEADS:g}"),
        row(rigid, near, decades, "\u2264 0.25", "decades"),
        row(flexible, later, apart, "> 1, or never", "decades"),
    ]
