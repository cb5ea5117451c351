"""One loop of an experiment: designed on a fit, predicted from it, measured on the bench."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from middeck.control.law.compensator import Compensator, evaluate_compensator
from middeck.control.loop.closed_loop import close_loop, leave_open, predict_closed_loop_response
from middeck.control.loop.performance import Performance, loop_rms
from middeck.control.lqg.weights import LQGWeights
from middeck.files.studies.documents import Study
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    evaluate_model,
    natural_hz,
)
from middeck.laboratory.bench import build_bench, take_closed_loop
from middeck.laboratory.loop_stability import RigLoop, RigView, judge_loops, view_rig
from middeck.laboratory.rig_settings import LoopTest
from middeck.laboratory.tested_article import RigArticle
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

SEEN_DB = 40.0  # prediction and measurement are compared where the open loop is within this of its peak
STATIC_HZ = 0.2  # below the suspension's modes an angle follows its torque statically
HALF_WIDTHS = 3.0  # on either side of a mode, where its peak is looked for


@record(kw_only=True)
class DesignCase:
    """Data of a design: a fit, its plant, the fit on all lines, and the measured open loop.

    The first output of the responses is the performance; ``torque_nm`` is the rms of the excitation.
    """

    model: MeasurementModel
    plant: Plant
    fitted: FrequencyResponse
    measured: FrequencyResponse
    band_hz: tuple[float, float]
    torque_nm: float


def design_case(
    test: LoopTest, model: MeasurementModel, plant: Plant, measured: FrequencyResponse
) -> DesignCase:
    """The case of a fitted ``model`` and its design ``plant``, with the band and torque of ``test``."""
    return DesignCase(
        model=model,
        plant=plant,
        fitted=evaluate_model(model, measured.frequency_hz),
        measured=measured,
        band_hz=test.band_hz,
        torque_nm=test.open_nm,
    )


def design_weights(study: Study, output: Sequence[float], noise: ArrayLike) -> LQGWeights:
    """Weights of outputs, sensor ``noise`` [rad^2/Hz]; disturbance and control enter at the same motor."""
    siso = study.siso
    return LQGWeights(
        output=np.array(output),
        input=np.array([siso.input_weight]),
        disturbed=(siso.actuator,),
        process=np.array([[siso.disturbance_nm_per_rthz**2]]),
        sensor=np.asarray(noise),
    )


def view_shifted_rigs(
    study: Study, article: RigArticle, sensors: tuple[str, ...], percent: float, rng: np.random.Generator
) -> dict[float, RigView]:
    """The rig with the pair of modes unchanged, and shifted down and up, under one excitation."""
    bench_at = partial(build_bench, article, study.rig, study.loop_test, sensors)
    seed = int(rng.integers(2**63))
    shifts = (0.0, -percent, percent)
    return {p: view_rig(bench_at(np.random.default_rng(seed), shift_percent=p)) for p in shifts}


@record
class ModeReduction:
    """The measured peak of one fitted mode in the performance, closed over open loop."""

    frequency_hz: float
    db: float


@record(kw_only=True)
class MeasuredLoop:
    """One compensator: its loop as predicted from the fit and as measured on the rig.

    Attributes:
        predicted, measured: Closed-loop responses of all sensors; ``measured`` is None where the rig gave
            none, for ``cause``.
        predicted_db, measured_db: 20 log10 of the closed-loop rms of the performance in the band over the
            open-loop one, each from its own open loop. None where one of its two has no finite rms.
        rms_error_db: Compares the two closed-loop rms values.
        worst_error_db, worst_hz: Largest difference of the two where the open loop is within 40 dB of its
            peak.
        control_rms_nm: Torque of the compensator alone.
        static_db: The performance below 0.2 Hz, measured, over that of the open loop.
        modes: Each mode of the fit in the measured band, the lowest first; empty where nothing was measured.
        on_rig: The loop by the rig's own eigenvalues and return ratio: the pair unshifted, then each shift of
            it.
        warnings: Warnings of the closed loop's record.
    """

    name: str
    log10_authority: float
    compensator: Compensator
    predicted: FrequencyResponse
    measured: FrequencyResponse | None
    cause: str
    predicted_db: float | None
    measured_db: float | None
    rms_error_db: float | None
    worst_error_db: float | None
    worst_hz: float | None
    control_rms_nm: float | None
    static_db: float | None
    modes: tuple[ModeReduction, ...]
    on_rig: tuple[RigLoop, ...]
    warnings: tuple[str, ...]

    @property
    def stable(self) -> bool:
        """Whether the rig's loop gave a response."""
        return self.measured is not None

    @property
    def survives(self) -> tuple[tuple[float, bool], ...]:
        """Each shift of the pair [%], and whether the loop is stable there."""
        return tuple((loop.percent, loop.stable) for loop in self.on_rig if loop.percent)


def measure_loop(
    name: str,
    log10_authority: float,
    compensator: Compensator,
    case: DesignCase,
    views: Mapping[float, RigView],
    rng: np.random.Generator,
) -> MeasuredLoop:
    """Predict the loop, run it on the unchanged rig, and find the margins of each view."""
    taken = take_closed_loop(views[0.0].bench, compensator, rng)
    closed = taken.response
    predicted = predict_closed_loop_response(
        case.fitted, evaluate_compensator(compensator, case.fitted.frequency_hz)
    )
    predicted_rms, predicted_open = (_predicted_rms(case, law) for law in (compensator, None))
    measured_rms = np.inf if closed is None else measured_rms_of(closed, case.torque_nm)
    worst = (None, None) if closed is None else _worst_error(case.measured, predicted, closed)
    return MeasuredLoop(
        name=name,
        log10_authority=log10_authority,
        compensator=compensator,
        predicted=predicted,
        measured=closed,
        cause=taken.cause,
        predicted_db=decibel(predicted_rms, predicted_open),
        measured_db=decibel(measured_rms, measured_rms_of(case.measured, case.torque_nm)),
        rms_error_db=decibel(predicted_rms, measured_rms),
        worst_error_db=worst[0],
        worst_hz=worst[1],
        control_rms_nm=taken.control_rms,
        static_db=None if closed is None else _static_db(case.measured, closed),
        modes=() if closed is None else _mode_reductions(case, closed),
        on_rig=judge_loops(views, compensator),
        warnings=tuple(f"{name}: {warning}" for warning in taken.warnings),
    )


def measured_rms_of(
    response: FrequencyResponse,
    torque_nm: float,
    *,
    output: int = 0,
    band_hz: tuple[float, float] = (0.0, np.inf),
) -> float:
    """Rms of an output in a band under equal amplitudes on all lines of the excitation."""
    f = response.frequency_hz
    inside = (f >= band_hz[0]) & (f <= band_hz[1])
    return float(torque_nm * np.sqrt(np.sum(np.abs(response.H[inside, output]) ** 2) / len(f)))


def decibel(rms: float, reference: float) -> float | None:
    """20 log10 of ``rms`` over ``reference``; None unless both are finite and positive."""
    good = np.isfinite([rms, reference]).all() and rms > 0.0 and reference > 0.0
    return float(20.0 * np.log10(rms / reference)) if good else None


def predicted_db(case: DesignCase, compensator: Compensator) -> float | None:
    """Improvement of the performance on the design plant alone; None where that loop is unstable."""
    return decibel(_predicted_rms(case, compensator), _predicted_rms(case, None))


def _predicted_rms(case: DesignCase, compensator: Compensator | None) -> float:
    """Rms of the performance on the design plant, for the excitation's intensity in the band."""
    loop = leave_open(case.plant) if compensator is None else close_loop(case.plant, compensator)
    low, high = case.band_hz
    intensity = np.array([[case.torque_nm**2 / (2.0 * (high - low))]])
    weights = np.zeros(len(loop.outputs))
    weights[0] = 1.0
    return float(loop_rms(loop, Performance(weights, intensity, case.band_hz))[0])


def _worst_error(
    open_loop: FrequencyResponse, predicted: FrequencyResponse, measured: FrequencyResponse
) -> tuple[float, float]:
    size = np.abs(open_loop.H[:, 0, 0])
    seen = np.flatnonzero(size > size.max() * 10.0 ** (-SEEN_DB / 20.0))
    error = np.abs(20.0 * np.log10(np.abs(predicted.H[seen, 0, 0] / measured.H[seen, 0, 0])))
    at = int(np.argmax(error))
    return float(error[at]), float(measured.frequency_hz[seen][at])


def _static_db(open_loop: FrequencyResponse, closed: FrequencyResponse) -> float | None:
    rms = (measured_rms_of(r, 1.0, band_hz=(0.0, STATIC_HZ)) for r in (closed, open_loop))
    return decibel(*rms)


def _mode_reductions(case: DesignCase, closed: FrequencyResponse) -> tuple[ModeReduction, ...]:
    """The highest line near each fitted mode that has a peak (damping below 0.71) and lines of its own."""
    f = closed.frequency_hz
    found: list[ModeReduction] = []
    for mode, zeta in sorted(zip(natural_hz(case.model), damping_ratio(case.model), strict=True)):
        near = np.abs(f / mode - 1.0) <= HALF_WIDTHS * abs(zeta)
        if near.any() and f[0] <= mode <= f[-1] and zeta < np.sqrt(0.5):
            peaks = [float(np.max(np.abs(r.H[near, 0, 0]))) for r in (closed, case.measured)]
            found.append(ModeReduction(float(mode), float(20.0 * np.log10(peaks[0] / peaks[1]))))
    return tuple(found)
