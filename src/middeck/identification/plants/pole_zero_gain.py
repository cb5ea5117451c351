"""One path in the paper's form: poles, zeros, a gain and a time delay.

The products are taken factor by factor, zeros and poles of like size together, so that nothing overflows and
no polynomial is ever multiplied out.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.errors import ConfigError
from middeck.identification.model.channel_selection import select_channels
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    double_pole,
    is_single,
    path_delay,
    rank_of,
    rational_response,
    rational_slope,
)
from middeck.identification.plants.zeros import path_zeros
from middeck.signals.ports import Port
from middeck.values import record

# Where the gain is read: at these multiples of the geometric mean of the poles, wherever |H| is largest.
GAIN_AT = (1.0, 0.5, 2.0, 0.25, 4.0)
# The part of 1/s beside 1/s^2 that is rounding.


@record(kw_only=True)
class PoleZeroGain:
    """H = gain prod (q - zeros) / prod (q - poles) exp(-s delay), q = s, or exp(s T) of a sampled model.

    Attributes:
        poles, zeros: One of each conjugate pair (positive imaginary part) or a real one [rad/s]; those of a
            sampled model are log(q) / T. Two poles at zero stand for 1/s^2, one for 1/s.
        gain: Ratio of the leading coefficients.
        static_gain: H at zero frequency; None with a pole there.
        delay_s: Delay [s].
    """

    poles: Complex[np.ndarray, " pole"]
    zeros: Complex[np.ndarray, " zero"]
    gain: float
    static_gain: float | None
    delay_s: float
    input: Port
    output: Port
    sample_hz: float | None = None


def pole_zero_gain(model: MeasurementModel, output: str, input: str) -> PoleZeroGain:
    """The path from ``input`` to ``output`` as poles, zeros, gain and delay.

    Modes that the path does not hold are left out.

    Raises `ConfigError` for an unknown name, or a path that is zero.
    """
    path = select_channels(model, outputs=(output,), inputs=(input,)).model
    still = 2 if double_pole(path).any() else rank_of(path.integral)
    if not (len(path.poles) or path.direct.any() or still):
        raise ConfigError(f"the path from {input} to {output} is zero", hint="take another path")
    zeros = path_zeros(path, output, input).value
    poles = np.concatenate([path.poles, np.zeros(still)])
    return PoleZeroGain(
        poles=poles,
        zeros=zeros,
        gain=_gain(path, poles, zeros),
        static_gain=None if still else float(np.real(rational_response(path, np.zeros(1))[0, 0, 0])),
        delay_s=float(path_delay(path)[0, 0]),
        input=path.inputs[0],
        output=path.outputs[0],
        sample_hz=model.sample_hz,
    )


def _gain(path: MeasurementModel, poles: np.ndarray, zeros: np.ndarray) -> float:
    """H over the quotient of the products, at the real point of `GAIN_AT` that is farthest from a zero."""
    size = np.abs(path.poles)
    amid = float(np.exp(np.mean(np.log(size)))) if len(size) else 1.0
    points = amid * np.array(GAIN_AT)
    H, slope = (part(path, points.astype(complex))[:, 0, 0] for part in (rational_response, rational_slope))
    best = int(np.argmax(np.abs(H) / (points * np.abs(slope) + np.abs(H))))
    q = _in_q(points, path.sample_hz)[best]
    quotient = _quotient(q, _both(zeros, path.sample_hz), _both(poles, path.sample_hz))
    return float(np.real(H[best] / quotient))


def _in_q(value: np.ndarray, sample_hz: float | None) -> np.ndarray:
    return value if sample_hz is None else np.exp(value / sample_hz)


def _both(value: np.ndarray, sample_hz: float | None) -> Complex[np.ndarray, " value"]:
    """Both of each pair, in q."""
    q = _in_q(value, sample_hz).astype(complex)
    return np.concatenate([q, q[~is_single(value, sample_hz)].conj()])


def _quotient(q: complex, zeros: np.ndarray, poles: np.ndarray) -> complex:
    """prod (q - zeros) / prod (q - poles), large factors with large ones; the poles may be more."""
    above, below = (np.sort_complex(q - part) for part in (zeros, poles))
    above, below = above[np.argsort(np.abs(above))], below[np.argsort(np.abs(below))]
    spare = len(below) - len(above)
    return complex(np.prod(above / below[spare:]) / np.prod(below[:spare]))
