"""One path in the paper's form: poles, zeros, a gain and a time delay; and back to residues.

The products are taken factor by factor, zeros and poles of like size together, so that nothing overflows and
no polynomial is ever multiplied out.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    double_pole,
    is_single,
    path_delay,
    rank_of,
    rational_response,
    rational_slope,
)
from middeck.identification.model.selection import select_channels
from middeck.identification.plants.zeros import path_zeros
from middeck.signals.ports import Port
from middeck.values import record

# Where the gain is read: at these multiples of the geometric mean of the poles, wherever |H| is largest.
GAIN_AT = (1.0, 0.5, 2.0, 0.25, 4.0)
# The part of 1/s beside 1/s^2 that is rounding.
ROUNDING = 1e-9


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


def from_pole_zero_gain(form: PoleZeroGain) -> MeasurementModel:
    """The model of one input and one output with these poles, zeros, gain and delay.

    Raises `ConfigError` for more zeros than poles, for poles that coincide (two at zero apart, whose part in
    1/s must vanish), or for a pole in the right half-plane.
    """
    p, z = _both(form.poles, form.sample_hz), _both(form.zeros, form.sample_hz)
    if len(z) > len(p):
        raise ConfigError(f"{len(z)} zeros for {len(p)} poles: no system does that", hint="give it poles")
    if np.any(np.real(form.poles) > 0.0):
        raise ConfigError("a pole lies in the right half-plane", hint="a measurement model is stable")
    at_zero = form.poles == 0.0
    count = int(np.sum(at_zero))
    lasting = np.array([[_lasting(form, p, z, count)]]) if count else None
    modes = form.poles[~at_zero]
    q = _in_q(modes, form.sample_hz)
    residues = np.array([form.gain * _quotient(pole, z, _without(p, pole)) for pole in q], dtype=complex)
    if not np.isfinite(residues).all():
        raise ConfigError("two poles coincide", hint="move them apart by more than rounding")
    residues = np.where(is_single(modes, form.sample_hz), np.real(residues), residues)
    direct = form.gain if len(z) == len(p) else 0.0
    return MeasurementModel(
        poles=modes,
        shapes=residues[None],
        participation=np.ones((len(modes), 1)),
        direct=np.array([[direct]]),
        lower=np.zeros((1, 1)),
        delay_s=np.array([form.delay_s]),
        inputs=(form.input,),
        outputs=(form.output,),
        sample_hz=form.sample_hz,
        rigid=lasting if count > 1 else None,
        integral=lasting if count == 1 else None,
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
    with np.errstate(divide="ignore", invalid="ignore"):
        return complex(np.prod(above / below[spare:]) / np.prod(below[:spare]))


def _without(poles: np.ndarray, pole: complex) -> np.ndarray:
    return np.delete(poles, int(np.argmin(np.abs(poles - pole))))


def _lasting(form: PoleZeroGain, p: np.ndarray, z: np.ndarray, count: int) -> float:
    """R of R / s^2, from H = F(s) / s^2 with R = F(0); F'(0), the part in 1/s, must vanish. Or Q of Q / s."""
    others = p[p != 0.0]
    slope = np.sum(1.0 / -z) - np.sum(1.0 / -others) if z.all() else np.inf
    unit = np.sum(1.0 / np.abs(np.concatenate([z, others]))) if z.all() else 0.0
    single = count == 1 and z.all()
    double = count == 2 and abs(slope) <= ROUNDING * unit
    if form.sample_hz is not None or not (single or double):
        raise ConfigError(
            f"{count} poles at zero are no rigid-body mode R / s^2 and no integrator Q / s",
            hint="one, or two whose numerator has no slope at s = 0, and no zero there",
        )
    return float(np.real(form.gain * _quotient(0.0, z, others)))
