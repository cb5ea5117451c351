"""Classical sections: leads and notches of second order, leads of first order, roll-off.

All have unit gain at zero frequency. Second-order sections are in modal form, (q, q'/omega) of their poles,
so that a section of 1 % damping stays exact beside a plant of hundreds of states.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace, gain_system, series


def second_order_section(
    zero_hz: float, zero_damping: float, pole_hz: float, pole_damping: float
) -> StateSpace:
    """(w_p/w_z)^2 (s^2 + 2 zeta_z w_z s + w_z^2) / (s^2 + 2 zeta_p w_p s + w_p^2).

    A notch where both frequencies are one and the zeros less damped than the poles; a lead in phase between
    the frequencies where the zeros come first (the paper's, lightly damped, about the modes near 9 Hz), a lag
    where the poles do. Raises `ConfigError` for a frequency or a damping of the poles that is not positive.

    >>> from middeck.systems.plants.response import statespace_response
    >>> lead = second_order_section(8.0, 0.02, 10.0, 0.02)
    >>> at_9_hz = statespace_response(lead, np.array([2.0 * np.pi * 9.0]))[0, 0, 0]
    >>> 150.0 < float(np.degrees(np.angle(at_9_hz))) < 180.0
    True
    """
    if not (zero_hz > 0.0 and pole_hz > 0.0 and pole_damping > 0.0):
        raise ConfigError(
            f"zeros at {zero_hz:g} Hz and poles at {pole_hz:g} Hz of damping ratio {pole_damping:g}",
            hint="positive frequencies, and poles that decay",
        )
    wz, wp = 2.0 * np.pi * zero_hz, 2.0 * np.pi * pole_hz
    gain = (wp / wz) ** 2
    # What the numerator has beyond the denominator, on the states w_p^2/den and s w_p/den.
    rest = np.array([[(wz / wp) ** 2 - 1.0, 2.0 * (zero_damping * wz - pole_damping * wp) / wp]])
    A = np.array([[0.0, wp], [-wp, -2.0 * pole_damping * wp]])
    return StateSpace(A, np.array([[0.0], [wp]]), gain * rest, np.array([[gain]]))


def notch(frequency_hz: float, depth: float, width: float) -> StateSpace:
    """A dip to ``depth`` (0 to 1) at ``frequency_hz``, if deep 3 dB down over ``width`` of that frequency.

    >>> from middeck.systems.plants.response import statespace_response
    >>> dip = statespace_response(notch(9.0, 0.1, 0.2), np.array([2.0 * np.pi * 9.0]))[0, 0, 0]
    >>> round(float(abs(dip)), 12)
    0.1
    >>> edges = 2.0 * np.pi * 9.0 * (1.0 + np.array([-0.005, 0.005]))       # all gone, 1 % wide
    >>> abs(statespace_response(notch(9.0, 0.0, 0.01), edges)[:, 0, 0]).round(2)
    array([0.71, 0.71])
    """
    if not 0.0 <= depth <= 1.0:
        raise ConfigError(f"notch depth {depth:g}", hint="0 (zero gain) to 1 (no notch)")
    return second_order_section(frequency_hz, depth * width / 2.0, frequency_hz, width / 2.0)


def first_order_section(zero_hz: float, pole_hz: float) -> StateSpace:
    """(1 + s/w_z) / (1 + s/w_p): a lead where the zero comes first, a lag where the pole does.

    Raises `ConfigError` for a frequency that is not positive.
    """
    if not (zero_hz > 0.0 and pole_hz > 0.0):
        raise ConfigError(f"a section with a zero at {zero_hz:g} Hz and a pole at {pole_hz:g} Hz",
                          hint="positive frequencies")  # fmt: skip
    wp, ratio = 2.0 * np.pi * pole_hz, pole_hz / zero_hz
    return StateSpace(np.array([[-wp]]), np.array([[wp]]), np.array([[1.0 - ratio]]), np.array([[ratio]]))


def roll_off(frequency_hz: float, order: int = 2) -> StateSpace:
    """Butterworth's low pass of ``order`` at ``frequency_hz``: -3 dB there, flat below (Butterworth 1930).

    >>> from middeck.systems.plants.response import statespace_response
    >>> G = statespace_response(roll_off(20.0, 3), 2.0 * np.pi * np.array([20.0]))[0, 0, 0]
    >>> round(float(abs(G)) ** 2, 12)
    0.5
    """
    if not frequency_hz > 0.0 or order < 1:
        raise ConfigError(
            f"roll-off of order {order} at {frequency_hz:g} Hz", hint="order and frequency positive"
        )
    w = 2.0 * np.pi * frequency_hz
    law = gain_system(np.eye(1))
    for k in range(order // 2):
        zeta = np.sin(np.pi * (2 * k + 1) / (2 * order))
        A = np.array([[0.0, w], [-w, -2.0 * zeta * w]])
        law = series(law, StateSpace(A, np.array([[0.0], [w]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))))
    if order % 2:
        lag = StateSpace(np.array([[-w]]), np.array([[w]]), np.ones((1, 1)), np.zeros((1, 1)))
        law = series(law, lag)
    return law


def design_pd(
    plant: Plant, pd: PDLoops, corner_hz: float | Sequence[float], *, order: int = 2
) -> Compensator:
    """u = -(kp + kd s) y through Butterworth's roll-off, one loop for each name: reads angles only.

    The loops of `close_inner_loop` as a compensator that can be built: no rate is measured, and beyond
    ``corner_hz`` (one for all loops, or one each) nothing is amplified. At an ``order`` of one a direct term
    is left. Raises `ConfigError` for ports that the plant lacks and a corner or order that is not positive.
    """
    corners = np.broadcast_to(np.asarray(corner_hz, dtype=float), (len(pd.names),))
    each = [
        _pd_loop(float(kp), float(kd), float(corner), order)
        for kp, kd, corner in zip(pd.kp, pd.kd, corners, strict=True)
    ]
    beside = StateSpace(*(np.asarray(sla.block_diag(*(getattr(s, m) for s in each))) for m in "ABCD"))
    return Compensator(
        beside,
        tuple(plant.outputs[i] for i in plant.output_indices(pd.names)),
        tuple(plant.inputs[i] for i in plant.input_indices(pd.names)),
    )


def _pd_loop(kp: float, kd: float, corner_hz: float, order: int) -> StateSpace:
    """-(kp + kd s) F: with x' = A x + B y and f = C x, s F y is C A x + C B y."""
    F = roll_off(corner_hz, order)
    return StateSpace(F.A, F.B, -(kp * F.C + kd * F.C @ F.A), -kd * F.C @ F.B)


def shape_compensator(compensator: Compensator, section: StateSpace) -> Compensator:
    """The compensator with ``section`` (one input, one output) behind each of its outputs.

    Raises `ConfigError` for a section with more than one input or output.
    """
    if section.D.shape != (1, 1):
        raise ConfigError(f"the section has {section.D.shape} outputs and inputs", hint="one of each")
    one = np.eye(len(compensator.outputs))
    each = StateSpace(*(np.kron(one, m) for m in (section.A, section.B, section.C, section.D)))
    return Compensator(series(compensator.system, each), compensator.inputs, compensator.outputs)
