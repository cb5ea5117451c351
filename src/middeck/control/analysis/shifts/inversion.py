"""Plant inversion: zeros of the compensator beside poles of the plant, and their distances.

A compensator that cancels a lightly damped mode works for its design plant only: the phase changes by 180
degrees between pole and zero, so that a shift of the mode by more than their distance may destabilise it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, form_loop
from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.values import record

CANCELLED = 1e-8
"""Relative distance to a pole of the compensator below which a zero cancels it."""


@record(kw_only=True)
class Inversion:
    """A zero of the compensator beside a pole of the plant.

    Attributes:
        mode: The plant's mode.
        reads, drives: Measurement and input of the compensator's path that has the zero.
        pole, zero: Both [rad/s], imaginary parts positive; of sampled loops log(z)/T.
        distance: |zero - pole| / |pole|.
    """

    mode: str
    reads: str
    drives: str
    pole: complex
    zero: complex
    distance: float


def find_inversion(plant: Plant, law: Compensator, *, within: float = 0.1) -> tuple[Inversion, ...]:
    """Nearest zero of each path of the compensator to each oscillating pole of the plant, closest pairs
    first.

    Pairs further apart than ``within``, relative to the pole, are left out. A pole counts as inverted where
    the distance is of the order of its damping ratio or less: at the resonance the compensator is then as
    small as the plant is large.

    Raises `ConfigError` for halves that do not fit (`form_loop`).
    """
    loop = form_loop(plant, law)
    found: list[Inversion] = []
    for row, drives in enumerate(loop.inputs):
        for column, reads in enumerate(loop.outputs):
            zeros = _path_zeros(loop, row, column)
            found += [
                _pair(mode, reads, drives, pole, zeros) for mode, pole in _plant_poles(loop) if len(zeros)
            ]
    near = [pair for pair in found if pair.distance <= within]
    return tuple(sorted(near, key=lambda pair: pair.distance))


def _pair(mode: str, reads: str, drives: str, pole: complex, zeros: np.ndarray) -> Inversion:
    zero = complex(zeros[np.argmin(np.abs(zeros - pole))])
    distance = abs(zero - pole) / abs(pole)
    return Inversion(mode=mode, reads=reads, drives=drives, pole=pole, zero=zero, distance=distance)


def _path_zeros(loop: FeedbackLoop, row: int, column: int) -> Complex[np.ndarray, " zero"]:
    zeros = transmission_zeros(loop.law.select([column], [row]))
    poles = np.linalg.eigvals(loop.law.A)
    away = np.abs(zeros[:, None] - poles).min(axis=1, initial=np.inf)
    return _as_rates(loop, zeros[away > CANCELLED * np.abs(zeros)])


def _as_rates(loop: FeedbackLoop, values: np.ndarray) -> Complex[np.ndarray, " value"]:
    period = loop.period_s
    return values if period is None else np.log(values[np.abs(values) > 0.0]) / period


def _plant_poles(loop: FeedbackLoop) -> list[tuple[str, complex]]:
    """Oscillating poles with the mode that each belongs to."""
    plant, modal = loop.plant, loop.plant.modal
    if modal is None:
        A = remove_delays(plant).system.A if plant.period_s is None else plant.sampled.A
        return _named_poles(loop, A, name_states(loop.plant))
    light = (modal.omega > 0.0) & (np.abs(modal.zeta) < 1.0)
    return [
        (modal.names[k], complex(modal.omega[k] * (-modal.zeta[k] + 1j * np.sqrt(1.0 - modal.zeta[k] ** 2))))
        for k in np.flatnonzero(light)
    ]


def _named_poles(loop: FeedbackLoop, A: np.ndarray, names: tuple[str, ...]) -> list[tuple[str, complex]]:
    """Each pole with the name of the state of largest participation."""
    values, right = np.linalg.eig(A)
    # Rows of the pseudo-inverse are the left eigenvectors (approximately, for a defective pair).
    shares = np.abs(np.linalg.pinv(right).T * right)
    upper = np.flatnonzero(np.imag(values) > 0.0)
    rates = _as_rates(loop, values[upper].astype(complex))
    return [(names[int(np.argmax(shares[:, k]))], complex(r)) for k, r in zip(upper, rates, strict=True)]
