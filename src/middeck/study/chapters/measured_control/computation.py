"""Figures 9a and 9b: fit a measured response, design on the fit, predict the loop, measure it on the rig.

CL1 and CL2 are LQG at two authorities. When the pair of modes near 9 Hz has moved, the article is measured
again, and CL3 is designed for both fits at once (MacMartin, Hall and Bernstein 1991).
"""

from functools import partial

import numpy as np

from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.plants.measured_plant import measured_plant
from middeck.laboratory.bench import Bench, take_open_loop
from middeck.laboratory.loop_stability import RigLoop, judge_loops
from middeck.laboratory.tested_article import RigArticle, rig_article_plant
from middeck.study.measured_loop.computation import (
    DesignCase,
    MeasuredLoop,
    design_case,
    design_weights,
    measure_loop,
    view_shifted_rigs,
)
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, require_modal
from middeck.systems.plants.response import FrequencyResponse, in_band
from middeck.systems.state_space.modal_system import output_rows
from middeck.values import record

HELD = 0.02  # relative distance within which a fitted pole is a mode's


@record
class OutsideMode:
    """A mode of the article that the fit leaves out."""

    name: str
    kind: str
    frequency_hz: float


@record(kw_only=True)
class MeasuredControl:
    """The measured open loop, the fit to it in its band, the design plant, and a loop at each authority.

    ``loops`` are "low", "high" (CL1, CL2) and "robust" (CL3, for the fit ``drifted_fit`` of the article with
    its pair moved by ``drifted_percent`` too). ``one_model`` is LQG on the first fit alone at CL3's
    authority, on the rig as it was and shifted. ``below_fit`` is the mode that stands out most among those
    measured below the band of the fit; None where there is none or a fitted pole holds it.
    """

    fit_band_hz: tuple[float, float]
    open_loop: FrequencyResponse
    fit: FitResult
    drifted_fit: FitResult
    fitted: FrequencyResponse
    plant: Plant
    pair_shift_hz: float
    drifted_percent: float
    below_fit: OutsideMode | None
    loops: tuple[MeasuredLoop, ...]
    one_model: tuple[RigLoop, ...]


def compute(study: Study, rng: np.random.Generator, article: RigArticle) -> MeasuredControl:
    """Excite, fit, design at two authorities and for two records, predict, then measure each loop."""
    siso, shift = study.siso, study.siso.pair_shift_percent
    views = view_shifted_rigs(study, article, (siso.sensor,), shift, rng)
    measured, fit = _identify(views[0.0].bench, study, rng)
    later = shift if siso.drifted == "up" else -shift
    _, drifted_fit = _identify(views[later].bench, study, rng)
    case = _design_case(fit, measured, study)
    weights = design_weights(study, [siso.angle_weight], [siso.angle_noise_rad_per_rthz**2])
    kalman = design_filter(case.plant, weights)
    design = partial(design_lqg, case.plant, weights, kalman=kalman)
    low, high, robust = (level.log10_authority for level in (siso.low, siso.high, siso.robust))
    also = _design_case(drifted_fit, measured, study).plant
    laws = (
        ("low", low, design(10.0**low)),
        ("high", high, design(10.0**high)),
        ("robust", robust, design_multimodel(case.plant, weights, 10.0**robust, uncertainty=(also,))),
    )
    loops = tuple(measure_loop(name, level, law, case, views, rng) for name, level, law in laws)
    return MeasuredControl(
        fit_band_hz=siso.fit_band_hz,
        open_loop=measured,
        fit=fit,
        drifted_fit=drifted_fit,
        fitted=case.fitted,
        plant=case.plant,
        pair_shift_hz=siso.pair_shift_hz,
        drifted_percent=later,
        below_fit=_below_fit(article, study, fit),
        loops=loops,
        one_model=judge_loops(views, design(10.0**robust)),
    )


def _identify(bench: Bench, study: Study, rng: np.random.Generator) -> tuple[FrequencyResponse, FitResult]:
    measured, siso = take_open_loop(bench, rng), study.siso
    return measured, fit_response(in_band(measured, siso.fit_band_hz), states=siso.states, cost="logarithmic")


def _design_case(fit: FitResult, measured: FrequencyResponse, study: Study) -> DesignCase:
    siso = study.siso
    ports = {"w": (siso.actuator,), "u": (siso.actuator,), "z": (siso.sensor,), "y": (siso.sensor,)}
    plant = approximate_delays(measured_plant(fit.model, **ports), siso.pade_order)
    return design_case(study.loop_test, fit.model, plant, measured)


def _below_fit(article: RigArticle, study: Study, fit: FitResult) -> OutsideMode | None:
    """The highest resonance below the fit, by |phi psi| / (2 zeta omega^2), that no fitted pole meets.

    A pole meets a mode within 2 %, the shift of frequency that the study takes to break a loop.
    """
    siso = study.siso
    plant = rig_article_plant(article, inputs=(siso.actuator,), outputs=(siso.sensor,))
    modal = require_modal(plant)
    f = modal.omega / (2.0 * np.pi)
    below = (f >= siso.band_hz[0]) & (f < siso.fit_band_hz[0]) & (modal.zeta > 0.0)
    if not below.any():
        return None
    at = np.flatnonzero(below)
    residue = output_rows(modal).position[0, at] * modal.psi[at, 0]
    height = np.abs(residue) / (2.0 * modal.zeta[at] * modal.omega[at] ** 2)
    mode = int(at[np.argmax(height)])
    if not height.any() or np.any(np.abs(natural_hz(fit.model) / f[mode] - 1.0) < HELD):
        return None
    return OutsideMode(modal.names[mode], article.modes.kind[mode], float(f[mode]))
