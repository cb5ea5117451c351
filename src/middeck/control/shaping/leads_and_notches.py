"""Classical sections: leads and notches of second order, roll-off.

All have unit gain at zero frequency. Second-order sections are in modal form, (q, q'/omega) of their poles,
so that a section of 1 % damping stays exact beside a plant of hundreds of states.
"""

import numpy as np

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
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


@named_kinds
def shape_compensator(compensator: Compensator, section: StateSpace) -> Compensator:
    """The compensator with ``section`` (one input, one output) behind each of its outputs.

    Raises `ConfigError` for a section with more than one input or output.
    """
    if section.D.shape != (1, 1):
        raise ConfigError(f"the section has {section.D.shape} outputs and inputs", hint="one of each")
    one = np.eye(len(compensator.outputs))
    each = StateSpace(*(np.kron(one, m) for m in (section.A, section.B, section.C, section.D)))
    return Compensator(series(compensator.system, each), compensator.inputs, compensator.outputs)
