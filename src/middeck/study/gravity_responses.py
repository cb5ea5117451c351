"""Figure 6: one torque to payload and bus rates, as modelled in 0-g and 1-g and as measured on the rig."""

from __future__ import annotations

import numpy as np

from middeck.files.study_form import Figure6Form, RigForm, SisoForm
from middeck.identification.spectra import estimate_response
from middeck.structure.modal_plant import build_plant
from middeck.structure.modes import Modes
from middeck.study.rig_experiment import rig_plant, run_rig_experiment
from middeck.systems.plant import Plant
from middeck.systems.response import FrequencyResponse, evaluate_plant
from middeck.values import record

LINES = 600  # logarithmic, for the models' curves
DELAY_FROM_HZ = 5.0  # the phase gap is read above this frequency
ERROR_BAND_HZ = (0.3, 30.0)


@record
class GravityResponses:
    """Responses of two models and of the rig.

    ``phase_gap_s`` is the delay that explains the phase between rig and 1-g model above 5 Hz, one for each
    output; ``error_db`` the rms of 20 log10 of the magnitude ratio model over rig in 0.3-30 Hz.
    """

    orbit: FrequencyResponse
    lab: FrequencyResponse
    rig: FrequencyResponse
    delay_s: float
    phase_gap_s: np.ndarray
    error_db_orbit: np.ndarray
    error_db_lab: np.ndarray


def study_gravity_responses(
    orbit: Modes,
    lab: Modes,
    figure: Figure6Form,
    rig: RigForm,
    siso: SisoForm,
    rng: np.random.Generator,
) -> GravityResponses:
    """Model both environments without PD, measure the rig in the laboratory, compare."""
    frequency_hz = np.geomspace(*figure.band_hz, LINES)
    plants = {
        environment: build_plant(
            modes, inputs=(figure.input,), outputs=figure.outputs, count=figure.modes_kept
        )
        for environment, modes in (("orbit", orbit), ("lab", lab))
    }
    test = run_rig_experiment(rig_plant(lab, figure.input, figure.outputs), rig, siso, rng)
    measured = estimate_response(test.record, band_hz=figure.band_hz)
    return GravityResponses(
        evaluate_plant(plants["orbit"], frequency_hz),
        evaluate_plant(plants["lab"], frequency_hz),
        measured,
        rig.delay_s,
        _phase_gap(plants["lab"], measured),
        _magnitude_error(plants["orbit"], measured),
        _magnitude_error(plants["lab"], measured),
    )


def _phase_gap(model: Plant, measured: FrequencyResponse) -> np.ndarray:
    """Weighted least squares of the phase lag on omega, through the origin; lines count by their power."""
    lines = measured.frequency_hz > DELAY_FROM_HZ
    omega = 2.0 * np.pi * measured.frequency_hz[lines]
    H, G = measured.H[lines, :, 0], evaluate_plant(model, measured.frequency_hz[lines]).H[:, :, 0]
    gap = np.unwrap(np.angle(H * G.conj()), axis=0)
    weight = np.abs(H) ** 2
    return -(weight * gap * omega[:, None]).sum(axis=0) / (weight * omega[:, None] ** 2).sum(axis=0)


def _magnitude_error(model: Plant, measured: FrequencyResponse) -> np.ndarray:
    low, high = ERROR_BAND_HZ
    lines = (measured.frequency_hz >= low) & (measured.frequency_hz <= high)
    G = evaluate_plant(model, measured.frequency_hz[lines]).H[:, :, 0]
    ratio = 20.0 * np.log10(np.abs(G) / np.abs(measured.H[lines, :, 0]))
    return np.sqrt(np.mean(ratio**2, axis=0))
