"""Figures 11 and 12: the payload held by encoder and bus alone, then payload and bus together.

The loop is designed on the common fit of Figures 10a and 10b. Without shaping it is stopped by the pair of
modes near 9 Hz, which the filter inverts; a lead about the pair gives it the phase to go on.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.shaping.leads_and_notches import second_order_section, shape_compensator
from middeck.files.studies.documents import Study
from middeck.identification.fit.fit_response import FitResult
from middeck.laboratory.article_rig import rig_delay
from middeck.laboratory.bench import take_closed_loop, take_open_loop
from middeck.laboratory.loop_stability import RigView
from middeck.laboratory.tested_article import RigArticle
from middeck.study.chapters.two_sensor_control.measured_sensors import (
    MeasuredSensors,
    fit_sensors,
    sensor_case,
    study_measured_sensors,
)
from middeck.study.chapters.two_sensor_control.reach import Design, LoopReach, find_level, find_reach
from middeck.study.measured_loop.computation import (
    DesignCase,
    MeasuredLoop,
    decibel,
    design_weights,
    measure_loop,
    measured_rms_of,
    view_shifted_rigs,
)
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

FLEXIBLE_HZ = (7.0, 9.0)  # the modes that the bus penalty is for
ABOVE_HZ = (10.0, np.inf)
HALF_POWER = 0.01  # the flexible modes' damping: so far to either side a peak is down by 3 dB


@record(kw_only=True)
class TwoSensorControl:
    """The three paths and their fit, how far each design reaches, and the loops of Figures 11 and 12.

    Attributes:
        sensors: Figures 10a and 10b.
        smaller: Reach of designs on fits of fewer states.
        without_lead, with_lead: Reach of the payload's design on the fit.
        payload, both: The loops of Figure 11 (payload penalty, with the lead) and Figure 12 (payload and
            bus); warnings of the run without the penalty on the bus are among those of the latter.
        bus_db: Measured bus angle of both loops in 7-9 Hz over that of the open loop.
        above_db: The payload above 10 Hz, likewise.
        above_without_bus_db: The same of the loop that differs from Figure 12's only in the penalty on the
            bus.
        deeper_db: The payload in 7-9 Hz under both penalties over that under the payload's alone.
        mode_hz, deeper_at_mode_db: Where the bus is highest there in open loop, and the same between that
            mode's half-power points.
    """

    sensors: MeasuredSensors
    smaller: tuple[LoopReach, ...]
    without_lead: LoopReach
    with_lead: LoopReach
    payload: MeasuredLoop
    both: MeasuredLoop
    bus_db: tuple[float | None, ...]
    above_db: tuple[float | None, ...]
    above_without_bus_db: float | None
    deeper_db: float | None
    mode_hz: float
    deeper_at_mode_db: float | None


def compute(study: Study, rng: np.random.Generator, article: RigArticle) -> TwoSensorControl:
    """Excite once, fit the three paths together, search each design's reach, then measure the two loops."""
    sito = study.sito
    views = view_shifted_rigs(
        study, article, (study.siso.sensor, *sito.sensors), sito.pair_shift_percent, rng
    )
    measured = take_open_loop(views[0.0].bench, rng)
    sensors = study_measured_sensors(study, measured, rig_delay(article, study.rig))
    smaller = tuple(
        _reach(study, fit_sensors(measured, states, band), measured, views, lead=False)
        for states, band in zip(sito.smaller_states, sito.smaller_bands_hz, strict=True)
    )
    payload, both = (sensor_case(study, sensors.fit, measured, bus=bus) for bus in (False, True))
    design = _designs(study, payload, lead=True)
    level = find_level(design, payload, sito.payload.predicted_db)
    first = measure_loop("payload", level, design(10.0**level), payload, views, rng)
    design = _designs(study, both, lead=False)
    level = find_level(design, both, sito.both.predicted_db)
    second = measure_loop("both", level, design(10.0**level), both, views, rng)
    without_bus = take_closed_loop(views[0.0].bench, _designs(study, payload, lead=False)(10.0**level), rng)
    said = tuple(f"both, without the penalty on the bus: {said}" for said in without_bus.warnings)
    second = dataclasses.replace(second, warnings=(*second.warnings, *said))
    mode_hz = _highest_hz(measured, 2, FLEXIBLE_HZ)
    at_mode = mode_hz * (1.0 - HALF_POWER), mode_hz * (1.0 + HALF_POWER)
    return TwoSensorControl(
        sensors=sensors,
        smaller=smaller,
        without_lead=_reach(study, sensors.fit, measured, views, lead=False),
        with_lead=_reach(study, sensors.fit, measured, views, lead=True),
        payload=first,
        both=second,
        bus_db=tuple(_over(loop.measured, measured, 2, FLEXIBLE_HZ) for loop in (first, second)),
        above_db=tuple(_over(loop.measured, measured, 0, ABOVE_HZ) for loop in (first, second)),
        above_without_bus_db=_over(without_bus.response, measured, 0, ABOVE_HZ),
        deeper_db=_over(second.measured, first.measured, 0, FLEXIBLE_HZ),
        mode_hz=mode_hz,
        deeper_at_mode_db=_over(second.measured, first.measured, 0, at_mode),
    )


def _designs(study: Study, case: DesignCase, *, lead: bool) -> Design:
    """LQG by authority, with or without the lead about the pair."""
    siso, sito = study.siso, study.sito
    both = [siso.angle_weight, sito.bus_weight]
    noise = np.array(sito.angle_noise_rad_per_rthz) ** 2
    weights = design_weights(study, both[: len(case.plant.z)], noise)
    kalman = design_filter(case.plant, weights)
    section = second_order_section(
        sito.lead_zeros_hz, sito.lead_damping, sito.lead_poles_hz, sito.lead_damping
    )

    def design(authority: float) -> Compensator:
        law = design_lqg(case.plant, weights, authority, kalman=kalman)
        return shape_compensator(law, section) if lead else law

    return design


def _reach(
    study: Study, fit: FitResult, measured: FrequencyResponse, views: Mapping[float, RigView], *, lead: bool
) -> LoopReach:
    case = sensor_case(study, fit, measured)
    what = f"{fit.model.states} states" + (" and the lead" if lead else "")
    return find_reach(what, _designs(study, case, lead=lead), case, views)


def _highest_hz(response: FrequencyResponse, output: int, band_hz: tuple[float, float]) -> float:
    f = response.frequency_hz
    inside = np.flatnonzero((f >= band_hz[0]) & (f <= band_hz[1]))
    return float(f[inside[np.argmax(np.abs(response.H[inside, output, 0]))]])


def _over(
    response: FrequencyResponse | None,
    reference: FrequencyResponse | None,
    output: int,
    band_hz: tuple[float, float],
) -> float | None:
    """An output's rms in a band over the reference's [dB]; None where one was not measured."""
    if response is None or reference is None:
        return None
    rms = (measured_rms_of(r, 1.0, output=output, band_hz=band_hz) for r in (response, reference))
    return decibel(*rms)
