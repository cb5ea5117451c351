"""Figure 7 in numbers.json."""

from __future__ import annotations

import numpy as np

from middeck.study.chapters.zero_g_control.claims import figure_7_claims
from middeck.study.chapters.zero_g_control.computation import SubModelSweep, ZeroGControl
from middeck.study.words import Numbers


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
        "mode_name": first.mode_name,
        "participation": first.participation,
        "compensator_share": first.compensator_share,
        "unstable_pairs": sub.unstable_pairs,
        "unstable_real_poles": sub.unstable_real,
    }
    return {
        **sides,
        "reference_db_lab_pd": sub.reference_db_lab_pd,
        "quadrature_error": sub.quadrature_error,
        "first_instability": instability,
    }
