"""Inputs that are commands, though the record does not say that they were held; the model behind the hold."""

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.identification.faults.spikes import is_impact
from middeck.identification.fit.fit_result import FitResult
from middeck.identification.fit.undeclared_hold import MOVED, TO_THE_END
from middeck.identification.model.fit_options import is_acceleration, is_velocity
from middeck.identification.model.measurement_model import MeasurementModel, damping_ratio, natural_hz
from middeck.identification.record_fit.behind_hold import LIGHT
from middeck.identification.uncertainty.parameter_deviations import distinct_poles, modal_constant
from middeck.signals.excitation.driven_band import driven_band
from middeck.signals.record import Record

# Share of samples off rest that equal the one before exactly, and jumps, from which an input is in steps.
# It rests within this share of its span, as a converter's last digit moves.
STILL, FEWEST_JUMPS, AT_REST = 0.4, 10, 0.05
# Score of a hold from which it is tried. Share of half the rate from which inputs drive all frequencies.
TRIED, NYQUIST = 2.0, 0.95
IN_STEPS = "inputs are taken as held, as they are given in steps"
# Phase [rad] by which the terms that a model lacks may turn a residue; from `UNTOLD` on it tells no delay.
BENT, UNTOLD = 3e-3, 0.1


def given_as_commands(record: Record) -> str:
    """Why the inputs are commands, which are held, by themselves; empty where they may have been measured.

    What is measured behind a filter is weak near half the rate. Blows are short, and may not be.
    """
    if are_steps(record):
        return IN_STEPS
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    to_the_end = driven_band(inputs, record.sample_hz)[1] >= NYQUIST * 0.5 * record.sample_hz
    struck = any(is_impact(x) for u in inputs for x in u.T)
    return TO_THE_END if to_the_end and not struck and not _falls_off(inputs) else ""


def _falls_off(inputs: Float[np.ndarray, "experiment sample input"]) -> bool:
    """Whether an input is weaker in the last tenth of its lines, by more than three deviations of noise."""
    power = np.abs(np.fft.rfft(inputs, axis=1)[:, 1:]) ** 2
    last = power.shape[1] // 10
    tail, rest = power[:, -last:].mean(axis=(0, 1)), power[:, last:-last].mean(axis=(0, 1))
    return bool(np.any(tail < (1.0 - 3.0 / np.sqrt(len(inputs) * last)) * rest)) if last else True


def are_steps(record: Record) -> bool:
    """Whether all inputs stay at a level for some samples and jump to the next: commands, which are held.

    What is band-limited between samples, or measured, has hardly two equal samples in a row. Rest, as between
    the blows of a hammer or after a burst, is at or near the value that is there most often, and is no step.
    """
    inputs = record.u.reshape(len(record.u), -1, record.u.shape[3])
    return all(_in_steps(inputs[:, :, i]) for i in range(inputs.shape[2]))


def _in_steps(u: Float[np.ndarray, "experiment sample"]) -> bool:
    still = np.diff(u, axis=1) == 0.0
    rest = np.array(
        [[level[np.argmax(times)]] for level, times in (np.unique(x, return_counts=True) for x in u)]
    )
    off = np.abs(u - rest) > AT_REST * np.ptp(u)
    after = off[:, 1:]
    stays = np.count_nonzero(still & after) > STILL * max(np.count_nonzero(after), 1)
    jumps = ~still & (after | off[:, :-1])  # those to rest are jumps, too: a pulse has two
    return bool(stays and np.count_nonzero(jumps) >= FEWEST_JUMPS)


def without_hold(model: MeasurementModel, sample_hz: float) -> MeasurementModel:
    """The model behind the hold, from one whose modes and delay contain the hold."""
    weaker = np.sinc(np.minimum(natural_hz(model) / sample_hz, 0.5))
    late = np.maximum(model.delay_s - 0.5 / sample_hz, 0.0)
    return dataclasses.replace(model, shapes=model.shapes / weaker, delay_s=late)


def turned_by_half(fit: FitResult, sample_hz: float) -> bool:
    """Whether half a sample turns the residues of all rates, as a hold does: complex ones take that up.

    Of a proportionally damped article (Caughey and O'Kelly 1965) residues are real but for the power of s of
    their output. Nothing but a delay turns each by its frequency, and no other is likely to be just half a
    sample. Where the residues leave nothing, neither do deviations tell that delay from none.
    """
    omega, phase, deviation = _phases_of_rates(fit)
    if not len(omega):
        return False
    none, half = (np.abs(_turned_less(phase, omega * late / sample_hz)) / deviation for late in (0.0, 0.5))
    return bool(np.all(half < MOVED) and np.sum(none**2) - np.sum(half**2) > MOVED**2)


def _phases_of_rates(fit: FitResult) -> Float[np.ndarray, "3 residue"]:
    """Rows: frequency [rad/s], phase and its deviation of each rate's residue, by the mode's strongest input.

    Phases are those of real modal constants, up to half a turn, as far as delays of the fit leave them. Modes
    are the light ones in the band.
    """
    covariance, model = fit.covariance, fit.covariance.model
    if covariance.structure.real_constants or model.sample_hz is not None:
        return np.zeros((3, 0))
    light = model.is_pair & (damping_ratio(model) < LIGHT) & (np.array(fit.standing) != "outside")
    power = [2 if is_acceleration(port) else 1 if is_velocity(port) else 0 for port in model.outputs]
    omega, phase, slopes = [], [], []
    for m in np.intersect1d(distinct_poles(model), np.flatnonzero(light)):
        i = int(np.argmax(np.abs(model.participation[m])))
        for o in np.flatnonzero(power):
            value, by = modal_constant(covariance, covariance.at, int(m), int(o), i)
            if value == 0.0:
                continue
            omega.append(model.poles[m].imag)
            phase.append(np.angle(value / model.poles[m] ** power[o]))
            slopes.append(np.imag(by / value))
    if not omega:
        return np.zeros((3, 0))
    deviation = np.hypot(covariance.deviation(np.array(slopes)), BENT)
    return np.array([omega, phase, deviation])[:, deviation < UNTOLD]


def _turned_less(phase: np.ndarray, lag: np.ndarray) -> np.ndarray:
    """The phase without a lag, within a quarter of a turn: constants may have either sign."""
    return (phase + lag + 0.5 * np.pi) % np.pi - 0.5 * np.pi
