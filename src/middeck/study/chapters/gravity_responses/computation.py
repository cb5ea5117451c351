"""Figure 6: one torque to payload and bus rates, as modelled in 0-g and 1-g and as measured on the rig."""

import numpy as np

from middeck.files.studies.documents import Study
from middeck.identification.spectra.estimate import estimate_response
from middeck.laboratory.linear_rig_record import rig_plant, run_rig_experiment
from middeck.structure.plants.modal_plant import build_plant
from middeck.study.shared import find_modes
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import FrequencyResponse, evaluate_plant
from middeck.values import record

LINES = 600  # logarithmic, for the models' curves
DELAY_FROM_HZ = 5.0  # the phase gap is read above this frequency
LONGEST_S = 0.5  # delays that are tried
AS_GOOD = 0.95  # of the most power in phase: coarse lines, or one mode, have as much with a turn more
ERROR_BAND_HZ = (0.3, 30.0)


@record
class MagnitudeError:
    """Rms of 20 log10 of the magnitude ratio model over rig, one for each output, in a band."""

    band_hz: tuple[float, float]
    orbit_db: np.ndarray
    lab_db: np.ndarray


@record(kw_only=True)
class GravityResponses:
    """Responses of two models and of the rig.

    ``phase_gap_s`` is the delay that explains the phase between rig and 1-g model above 5 Hz, one for each
    output; None where nothing is measured there. ``magnitude_error`` holds in what is measured of 0.3-30 Hz,
    and is None where that is nothing.
    """

    orbit: FrequencyResponse
    lab: FrequencyResponse
    rig: FrequencyResponse
    delay_s: float
    phase_gap_s: np.ndarray | None
    magnitude_error: MagnitudeError | None


def compute(study: Study, rng: np.random.Generator) -> GravityResponses:
    """Model both environments without PD, measure the rig in the laboratory, compare."""
    figure, test = study.figure_6, study.loop_test
    orbit, lab = (find_modes(*study.case(figure.article, environment)) for environment in ("orbit", "lab"))
    frequency_hz = np.geomspace(*figure.band_hz, LINES)
    plants = {
        environment: build_plant(
            modes, inputs=(figure.input,), outputs=figure.outputs, count=figure.modes_kept
        )
        for environment, modes in (("orbit", orbit), ("lab", lab))
    }
    taken = run_rig_experiment(rig_plant(lab, figure.input, figure.outputs), study.rig, test, rng)
    measured = estimate_response(taken, band_hz=figure.band_hz)
    return GravityResponses(
        orbit=evaluate_plant(plants["orbit"], frequency_hz),
        lab=evaluate_plant(plants["lab"], frequency_hz),
        rig=measured,
        delay_s=study.rig.delay_s,
        phase_gap_s=phase_gap(plants["lab"], measured),
        magnitude_error=_magnitude_error(
            plants["orbit"], plants["lab"], measured, (figure.band_hz, test.band_hz)
        ),
    )


def phase_gap(model: Plant, measured: FrequencyResponse) -> np.ndarray | None:
    """Weighted least squares of the phase lag on omega, through the origin; lines count by their power.

    About the shortest delay with which most of the power is in phase: in a deep zero the phase cannot be
    unwrapped.
    """
    lines = measured.frequency_hz > DELAY_FROM_HZ
    if not lines.any():
        return None
    omega = 2.0 * np.pi * measured.frequency_hz[lines]
    H, G = measured.H[lines, :, 0], evaluate_plant(model, measured.frequency_hz[lines]).H[:, :, 0]
    turn, weight = np.exp(1j * np.angle(H * G.conj())), np.abs(H) ** 2
    tried = np.arange(-LONGEST_S, LONGEST_S, 0.5 / omega[-1])
    in_phase = np.array([np.real(np.exp(1j * omega * t) @ (weight * turn)) for t in tried])
    beside = np.pad(in_phase, ((1, 1), (0, 0)), constant_values=-np.inf)
    tops = in_phase >= np.maximum(AS_GOOD * in_phase.max(axis=0), np.maximum(beside[:-2], beside[2:]))
    near = tried[np.argmin(np.where(tops, np.abs(tried)[:, None], np.inf), axis=0)]
    left = np.angle(turn * np.exp(1j * np.outer(omega, near)))
    return near - (weight * left * omega[:, None]).sum(axis=0) / (weight * omega[:, None] ** 2).sum(axis=0)


def _magnitude_error(
    orbit: Plant, lab: Plant, measured: FrequencyResponse, bands_hz: tuple[tuple[float, float], ...]
) -> MagnitudeError | None:
    """The error in the part of `ERROR_BAND_HZ` that all ``bands_hz`` cover, as shown and as excited."""
    low, high = max(b[0] for b in (ERROR_BAND_HZ, *bands_hz)), min(b[1] for b in (ERROR_BAND_HZ, *bands_hz))
    lines = (measured.frequency_hz >= low) & (measured.frequency_hz <= high)
    if not lines.any():
        return None
    H = np.abs(measured.H[lines, :, 0])
    orbit_db, lab_db = (
        20.0 * np.log10(np.abs(evaluate_plant(p, measured.frequency_hz[lines]).H[:, :, 0]) / H)
        for p in (orbit, lab)
    )
    return MagnitudeError(
        (low, high), np.sqrt(np.mean(orbit_db**2, axis=0)), np.sqrt(np.mean(lab_db**2, axis=0))
    )
