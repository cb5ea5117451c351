"""Figures 9a and 9b: fit a measured response, design on the fit, predict the loop, measure it on the rig."""

from __future__ import annotations

import numpy as np

from middeck.control.closed_loop import close_loop, leave_open, predict_closed_loop_response
from middeck.control.compensator import Compensator, evaluate_compensator
from middeck.control.lqg import LQGWeights, design_filter, design_lqg
from middeck.control.performance import Performance, measure_rms
from middeck.files.study_form import RigForm, SisoForm
from middeck.identification.fit.fit_response import FitResult, fit_response
from middeck.identification.measurement_model import model_response, natural_hz
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.spectra import estimate_response
from middeck.realtime.rig import LinearRig, build_linear_rig, close_sampled_loop, run_closed_loop
from middeck.structure.modes import Modes
from middeck.study.rig_experiment import (
    EXCITATION_NM,
    RigExperiment,
    in_band,
    rig_plant,
    run_rig_experiment,
    shift_modes,
)
from middeck.systems.modal import ModalSystem, output_rows
from middeck.systems.plant import Plant
from middeck.systems.response import FrequencyResponse
from middeck.systems.sampling import tustin
from middeck.systems.stability import is_stable
from middeck.values import record

HELD = 0.02  # relative distance within which a fitted pole is a mode's


@record
class MeasuredLoop:
    """One authority: the compensator, its loop as predicted from the fit and as measured on the rig.

    ``predicted_db`` and ``measured_db`` are 20 log10 of the closed-loop rms angle in the band over the
    open-loop one, each from its own open loop; ``rms_error_db`` compares the two closed-loop rms angles. Each
    is None where one of its two has no finite rms: the rig's loop is unstable, or the fit or its loop has a
    mode without damping in the band, as a fit to little more than noise may.
    ``survives`` says for each shift of the pair whether the sampled loop stays stable.
    """

    name: str
    log10_authority: float
    compensator: Compensator
    predicted: FrequencyResponse
    measured: FrequencyResponse | None
    predicted_db: float | None
    measured_db: float | None
    rms_error_db: float | None
    stable: bool
    survives: tuple[tuple[float, bool], ...]


@record
class OutsideMode:
    """A mode of the article that the fit leaves out."""

    name: str
    kind: str
    frequency_hz: float


@record
class MeasuredControl:
    """The measured open loop, the fit to it in its band, the design plant, and a loop at each authority.

    ``below_fit`` is the mode that stands out most among those measured below the band of the fit; None where
    there is none or a fitted pole holds it.
    """

    fit_band_hz: tuple[float, float]
    open_loop: FrequencyResponse
    fit: FitResult
    fitted: FrequencyResponse
    plant: Plant
    pade_order: int
    pair_shift_hz: float
    below_fit: OutsideMode | None
    loops: tuple[MeasuredLoop, ...]


def study_measured_control(
    modes: Modes, rig_form: RigForm, siso: SisoForm, rng: np.random.Generator
) -> MeasuredControl:
    """Excite, fit, design at two authorities, predict, then measure each loop on the rig."""
    article = rig_plant(modes, siso.actuator, (siso.sensor,))
    test = run_rig_experiment(article, rig_form, siso, rng)
    measured = estimate_response(test.record, band_hz=siso.band_hz)
    fit = fit_response(in_band(measured, siso.fit_band_hz), states=siso.states, cost="logarithmic")
    ports = {"w": (siso.actuator,), "u": (siso.actuator,), "z": (siso.sensor,), "y": (siso.sensor,)}
    plant = measured_plant(fit.model, pade_order=siso.pade_order, **ports)
    fitted = FrequencyResponse(
        measured.frequency_hz,
        model_response(fit.model, measured.frequency_hz),
        measured.inputs,
        measured.outputs,
    )
    drifted = tuple(
        (percent, _build_rig(shift_modes(article, siso.pair_shift_hz, 1.0 + percent / 100.0), rig_form))
        for percent in (-siso.pair_shift_percent, siso.pair_shift_percent)
    )
    compensators = _design(plant, siso)
    loops = tuple(
        _run_loop(name, compensator, plant, fitted, measured, test, drifted, siso, rng)
        for name, compensator in compensators.items()
    )
    below = _below_fit(article, modes, siso, fit)
    return MeasuredControl(
        siso.fit_band_hz,
        measured,
        fit,
        fitted,
        plant,
        siso.pade_order,
        siso.pair_shift_hz,
        below,
        loops,
    )


def _below_fit(article: Plant, modes: Modes, siso: SisoForm, fit: FitResult) -> OutsideMode | None:
    """By the height of the resonances, |phi psi| / (2 zeta omega^2); held is what a fitted pole meets.

    A pole meets a mode within 2 %, the shift of frequency that the study takes to break a loop.
    """
    modal = article.dynamics
    assert isinstance(modal, ModalSystem)
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
    return OutsideMode(modal.names[mode], modes.kind[mode], float(f[mode]))


def _build_rig(plant: Plant, rig: RigForm) -> LinearRig:
    silent = np.zeros(len(plant.outputs))
    return build_linear_rig(plant, sample_hz=rig.sample_hz, delay_s=rig.delay_s, noise_rms=silent)


def _design(plant: Plant, siso: SisoForm) -> dict[str, Compensator]:
    """LQG at both authorities; disturbance and control enter at the same motor."""
    weights = LQGWeights(
        np.array([siso.angle_weight]),
        np.array([siso.input_weight]),
        (siso.actuator,),
        np.array([[siso.disturbance_nm_per_rthz**2]]),
        np.array([siso.angle_noise_rad_per_rthz**2]),
    )
    kalman = design_filter(plant, weights)
    levels = {"low": siso.low.log10_authority, "high": siso.high.log10_authority}
    return {name: design_lqg(plant, weights, 10.0**level, kalman=kalman) for name, level in levels.items()}


def _run_loop(
    name: str,
    compensator: Compensator,
    plant: Plant,
    fitted: FrequencyResponse,
    measured: FrequencyResponse,
    test: RigExperiment,
    drifted: tuple[tuple[float, LinearRig], ...],
    siso: SisoForm,
    rng: np.random.Generator,
) -> MeasuredLoop:
    law = tustin(compensator.system, 1.0 / test.rig.sample_hz)
    run = run_closed_loop(test.rig, law, test.excitation[:, None], periods=siso.periods, rng=rng)
    closed = None if run.record is None else estimate_response(run.record, band_hz=siso.band_hz)
    survives = tuple((percent, is_stable(close_sampled_loop(rig.sampled, law))) for percent, rig in drifted)
    predicted_rms = _predicted_rms(plant, compensator, siso)
    predicted_open = _predicted_rms(plant, None, siso)
    measured_rms = np.inf if closed is None else _measured_rms(closed)
    return MeasuredLoop(
        name=name,
        log10_authority={"low": siso.low, "high": siso.high}[name].log10_authority,
        compensator=compensator,
        predicted=predict_closed_loop_response(
            fitted, evaluate_compensator(compensator, fitted.frequency_hz)
        ),
        measured=closed,
        predicted_db=_db(predicted_rms, predicted_open),
        measured_db=_db(measured_rms, _measured_rms(measured)),
        rms_error_db=_db(predicted_rms, measured_rms),
        stable=closed is not None,
        survives=survives,
    )


def _predicted_rms(plant: Plant, compensator: Compensator | None, siso: SisoForm) -> float:
    """Rms angle of the design model in the band, for the excitation's intensity."""
    loop = leave_open(plant) if compensator is None else close_loop(plant, compensator)
    low, high = siso.band_hz
    intensity = np.array([[EXCITATION_NM**2 / (2.0 * (high - low))]])
    return float(measure_rms(loop, Performance(np.ones(1), intensity, siso.band_hz))[0])


def _measured_rms(response: FrequencyResponse) -> float:
    """Rms angle in the band under equal amplitudes on all lines of the excitation."""
    return float(EXCITATION_NM * np.sqrt(np.mean(np.abs(response.H) ** 2)))


def _db(rms: float, reference: float) -> float | None:
    """None unless both are finite."""
    return float(20.0 * np.log10(rms / reference)) if np.isfinite([rms, reference]).all() else None
