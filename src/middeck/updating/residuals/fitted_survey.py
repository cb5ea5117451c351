"""A fitted record as a modal survey: frequencies, dampings and shapes with their deviations.

A residue of rank one is c b: the readings of the mode by the sensors, and its excitation by the motors. By
reciprocity b is the shape too, at the motors. So a fit has as many channels as it has outputs and inputs, all
of them ports of the article, and those at one place and axis on both sides fix the scale between the two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, DataError
from middeck.identification.fit.fit_response import FitResult
from middeck.identification.fit.mode_trust import Standing
from middeck.identification.fit.unneeded_modes import DOUBTFUL, mode_significance
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.parameter_deviations import distinct_poles, uncertainty_of
from middeck.structure.correlation.measured_modes import ACTUATOR, SENSOR, MeasuredModes
from middeck.structure.model.article import Actuator, ActuatorKind, Sensor, SensorKind, Structure
from middeck.structure.plants.sensors_and_actuators import RATE

# Relative standard deviation of a frequency beyond which a mode says nothing of an article; damping ratio
# beyond which a pole is a delay's or a filter's; and least relative deviation, the most that pairs of tests
# allow beside what a fit states.
MOST, DAMPED, LEAST = 0.01, 0.3, 3e-6
# Standard deviation over a shape's largest channel: cross-talk and misaligned axes.
CROSS = 1e-3
# Relative, of sensors and motors: what a calibration leaves.
GAIN_STD = 0.01


def survey_from_fit(
    structure: Structure,
    fitted: FitResult | ModelCovariance,
    *,
    standing: Sequence[Standing] = (),
    gain_std: float = GAIN_STD,
) -> MeasuredModes:
    """The modes of a fit whose ports are sensors and actuators of ``structure``, as a survey of them.

    Modes that the fit doubts or does not determine, real poles and poles damped by more than 0.3 are left
    out, each named in ``warnings``.

    Args:
        fitted: From torques or forces to angles or travels, or to their rates; a fit, or the covariance of
            its model.
        standing: Standing of each mode if no fit gives it; without it the covariance decides.
        gain_std: Standard deviation of each port's gain, relative: an error that no fit can see.

    Raises `ConfigError` for a port that the article does not have, an accelerometer or a gain deviation that
    is not from 0 to 1; `DataError` for a sampled model and where no mode is left.
    """
    if isinstance(fitted, FitResult):
        covariance, standing = fitted.covariance, fitted.standing
    else:
        covariance = fitted
    model = covariance.model
    if not 0.0 <= gain_std < 1.0:
        raise ConfigError(f"gains known to {gain_std}", where="gain_std", hint="relative, such as 0.01")
    if model.sample_hz is not None:
        raise DataError(
            "a sampled model has no shapes of an article",
            where="fitted modes",
            hint="fit a continuous one, of lines below an eighth of the rate",
        )
    sensors = [_find_sensor(structure, p.name) for p in model.outputs]
    actuators = [_find_actuator(structure, p.name) for p in model.inputs]
    std = uncertainty_of(covariance)
    kept, left_out = _kept(covariance, standing, std.natural_hz)
    if not kept:
        raise DataError(
            f"the fit has no mode to be sure of: {'; '.join(left_out) or 'it has no pair of poles'}",
            where="fitted modes",
            hint="take friction out of the record, more states, or a longer record",
        )
    shapes = [_shape(covariance, m, sensors, actuators, gain_std) for m in kept]
    hz, index = natural_hz(model)[kept], np.array(kept, dtype=int)
    rows = _first_of_each(sensors)
    channel = [*rows, *range(len(sensors), len(sensors) + len(actuators))]
    return MeasuredModes(
        frequency_hz=hz,
        damping=damping_ratio(model)[index],
        node=(*(sensors[o][0].name for o in rows), *(a.name for a in actuators)),
        direction=(*(SENSOR for _ in rows), *(ACTUATOR for _ in actuators)),
        shape=np.stack([value for value, _ in shapes], axis=1)[channel],
        frequency_std_hz=np.hypot(std.natural_hz[index], LEAST * hz),
        damping_std=_finite(std.damping[index]),
        shape_std=np.stack([deviation for _, deviation in shapes], axis=1)[channel],
        warnings=tuple(left_out),
    )


def _kept(
    covariance: ModelCovariance, standing: Sequence[Standing], std_hz: np.ndarray
) -> tuple[list[int], list[str]]:
    """Modes in rising frequency, and why others are left out."""
    model = covariance.model
    hz, zeta, clear = natural_hz(model), damping_ratio(model), mode_significance(covariance) >= DOUBTFUL
    kept: list[int] = []
    left_out: list[str] = []
    for m in sorted(distinct_poles(model), key=lambda m: hz[m]):
        why = (
            "is a real pole"
            if not model.is_pair[m]
            else f"has a damping of {zeta[m]:.2g}"
            if zeta[m] > DAMPED
            else f"is {standing[m]}"
            if standing and standing[m] != "sound"
            else "is not determined"
            if not std_hz[m] <= MOST * hz[m]
            else "may be noise"
            if not clear[m]
            else ""
        )
        if why:
            left_out.append(f"the pole at {hz[m]:.4g} Hz {why}: left out")
        else:
            kept.append(m)
    return kept, left_out


def _shape(
    covariance: ModelCovariance,
    m: int,
    sensors: list[tuple[Sensor, bool]],
    actuators: list[Actuator],
    gain_std: float,
) -> tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]]:
    """The shape at sensors, then at actuators, its largest entry one, and deviations of its two parts."""
    model, at = covariance.model, covariance.at
    pole = model.poles[m]
    read = np.array([1.0 / pole if is_rate else 1.0 for _, is_rate in sensors])
    deviation = covariance.deviation()
    unit = 0.5 / abs(pole.imag) if covariance.structure.real_constants else 1.0
    c, b = model.shapes[:, m] * read, model.participation[m]
    c_std = _part_std(deviation, at.c[:, m]) * np.abs(read) * unit
    b_std = _part_std(deviation, at.b[m])
    scale = _scale(c, b, sensors, actuators)
    shape, std = np.concatenate([c, scale * b]), np.concatenate([c_std, np.abs(scale) * b_std])
    largest = np.max(np.abs(shape))
    turn = np.exp(-0.5j * np.angle(np.sum(shape**2)))
    std = np.sqrt(std**2 + (gain_std * np.abs(shape)) ** 2 + (CROSS * largest) ** 2)
    return shape * turn / largest, std / largest


def _part_std(deviation: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Standard deviations of complex numbers from those of their parts; none for a part that was held."""
    return np.linalg.norm(np.where(places >= 0, deviation[places], 0.0), axis=-1)


def _scale(
    c: np.ndarray, b: np.ndarray, sensors: list[tuple[Sensor, bool]], actuators: list[Actuator]
) -> complex:
    """Factor that makes b the shape c, by the places that both have; zero where they share none."""
    both = [(o, i) for o, (s, _) in enumerate(sensors) for i, a in enumerate(actuators) if _together(s, a)]
    if not both:
        return 0.0
    o, i = (list(side) for side in zip(*both, strict=True))
    return complex(np.vdot(b[i], c[o]) / np.vdot(b[i], b[i]).real)


def _together(sensor: Sensor, actuator: Actuator) -> bool:
    """Whether the force works on the motion that the sensor reads."""
    turning = sensor.kind is SensorKind.ANGLE and actuator.kind is ActuatorKind.TORQUE
    if sensor.frame != actuator.frame or not turning:
        return False
    if sensor.axis is None or actuator.axis is None:
        return sensor.axis is actuator.axis
    return sensor.axis_frame in ("", sensor.frame) and bool(np.allclose(sensor.axis, actuator.axis))


def _find_sensor(structure: Structure, output: str) -> tuple[Sensor, bool]:
    """The sensor of an output, and whether it is its rate."""
    known = {s.name: s for s in structure.sensors}
    is_rate = output not in known and output.endswith(RATE)
    sensor = known.get(output.removesuffix(RATE) if is_rate else output)
    if sensor is None:
        raise ConfigError(
            f"the article has no sensor {output!r}", where="fitted modes", hint=f"one of {', '.join(known)}"
        )
    if sensor.kind is SensorKind.ACCELEROMETER:
        raise ConfigError(
            f"sensor {output!r} is an accelerometer, which reads gravity beside motion",
            where="fitted modes",
            hint="leave it out of the fit: angles, travels and their rates make a survey",
        )
    return sensor, is_rate


def _find_actuator(structure: Structure, name: str) -> Actuator:
    known = {a.name: a for a in structure.actuators}
    if name not in known:
        raise ConfigError(
            f"the article has no actuator {name!r}", where="fitted modes", hint=f"one of {', '.join(known)}"
        )
    return known[name]


def _first_of_each(sensors: list[tuple[Sensor, bool]]) -> list[int]:
    """Outputs, of a sensor that has several the first."""
    names = [s.name for s, _ in sensors]
    return [o for o, name in enumerate(names) if names.index(name) == o]


def _finite(std: np.ndarray) -> np.ndarray | None:
    return std if np.isfinite(std).all() else None
