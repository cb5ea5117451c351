"""The filters between what a sensor reads and what is sampled."""

from __future__ import annotations

import math

import numpy as np

from middeck.laboratory.rig.parts.sensors import BUTTERWORTH_DELAY, Gyro, Sampler, Sensor
from middeck.systems.state_space.statespace import StateSpace, gain_system, series


def sensor_filter(sensor: Sensor) -> StateSpace:
    """From what is read (for a gyro the rate) to what is sampled; states of the lag, then of the filter."""
    gain = gain_system(np.array([[1.0 if isinstance(sensor, Sampler) else sensor.gain]]))
    if not isinstance(sensor, Gyro):
        return gain
    return series(gain, series(_lag(sensor.bandwidth_hz), anti_alias(sensor.anti_alias_hz)))


def _lag(bandwidth_hz: float) -> StateSpace:
    if math.isinf(bandwidth_hz):
        return gain_system(np.ones((1, 1)))
    w = 2.0 * np.pi * bandwidth_hz
    return StateSpace(np.array([[-w]]), np.array([[w]]), np.ones((1, 1)), np.zeros((1, 1)))


def anti_alias(frequency_hz: float) -> StateSpace:
    """Butterworth's filter of second order, or nothing for an infinite frequency."""
    if math.isinf(frequency_hz):
        return gain_system(np.ones((1, 1)))
    w = 2.0 * np.pi * frequency_hz
    A = np.array([[0.0, w], [-w, -BUTTERWORTH_DELAY * w]])
    return StateSpace(A, np.array([[0.0], [w]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
