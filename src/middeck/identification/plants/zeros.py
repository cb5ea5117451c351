"""Zeros of a measurement model: of one path or of a matrix, named, with their derivatives; poles and zeros.

The zeros of the modal form come from a pencil (`transmission_zeros`) and are refined by Newton's method on
the partial fractions themselves, whose poles and residues carry no rounding of a conversion. A delay has no
zero; delays of paths of their own make those of a matrix infinitely many, and none are given.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, NumericalError
from middeck.identification.model.channel_selection import select_channels
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    double_pole,
    is_single,
    path_delay,
    rational_response,
    rational_slope,
    single_pole,
)
from middeck.identification.plants.measured_plant import rational_statespace
from middeck.systems.delay.delay_approximation import SAME_DELAY_S
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.sampling.delayed_sampling import is_sum
from middeck.values import record

NEWTON_STEPS = 8
# A refined zero stays within this share of its size from the pencil's.
NEAR = 1e-3
# Real parts below this share of a zero's size say nothing about its side: rounding.
ON_THE_AXIS = 1e-9
# A matrix whose singular values differ by more, at a point without meaning, has no full rank.
SINGULAR = 1e-12
# Sampled zeros closer to q = 0 are whole samples of delay.
AT_ORIGIN = 1e-9
# Continuous ones closer to s = 0, as a share of the slowest pole, are there: of a rate or an acceleration.
STANDING = 1e-6


@record(kw_only=True)
class Zeros:
    """Zeros between some inputs and outputs.

    Attributes:
        value: One of each conjugate pair (positive imaginary part), or a real zero [rad/s], ascending in
            size; those of a sampled model are log(q) / T, for negative real q with the imaginary part pi / T.
        residual: Relative error of each: |H / (s dH/ds)| there, what is left to Newton's
            method.
        by_response: G with dz = sum over outputs and inputs of G_oi dH_oi(z), for any change dH of the
            response without its delays; None for a matrix that is not square or singular everywhere: any
            change removes its zeros.
        inputs, outputs: Names of the channels.
    """

    value: Complex[np.ndarray, " zero"]
    residual: Float[np.ndarray, " zero"]
    by_response: Complex[np.ndarray, "zero output input"] | None
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_hz: float | None = None

    @property
    def is_pair(self) -> np.ndarray:
        """True for each that stands for a conjugate pair."""
        return ~is_single(self.value, self.sample_hz)

    @property
    def frequency_hz(self) -> Float[np.ndarray, " zero"]:
        """|z| / 2 pi [Hz]."""
        return np.abs(self.value) / (2.0 * np.pi)

    @property
    def damping(self) -> Float[np.ndarray, " zero"]:
        """-Re z / |z|, negative in the right half-plane; zero for a zero at the origin."""
        size = np.abs(self.value)
        return np.divide(-np.real(self.value), size, out=np.zeros(len(size)), where=size > 0.0)

    @property
    def is_nonminimum_phase(self) -> np.ndarray:
        """True in the right half-plane: phase lag beyond that of the magnitude, and a bound on feedback."""
        return np.real(self.value) > ON_THE_AXIS * np.abs(self.value)


def path_zeros(model: MeasurementModel, output: str, input: str) -> Zeros:
    """Zeros of the path from ``input`` to ``output``.

    A mode that the path does not hold has neither pole nor zero in it. The term L / s^2 counts as part of
    the response: the zeros are where the model's response has its antiresonances.

    Raises `ConfigError` for an unknown name.
    """
    return matrix_zeros(model, outputs=(output,), inputs=(input,))


def matrix_zeros(
    model: MeasurementModel, *, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None
) -> Zeros:
    """Transmission zeros between some inputs and outputs: where their matrix loses rank; None for all.

    Raises `ConfigError` for an unknown name, or delays that are no sum of one for the input and one for the
    output: they take part in the determinant, whose zeros are then infinitely many; `NumericalError` if a
    zero cannot be distinguished from its surroundings.
    """
    chosen = select_channels(model, inputs=inputs, outputs=outputs).model
    if not is_sum(path_delay(chosen), SAME_DELAY_S):
        raise ConfigError(
            "the delays of the paths differ: their matrix has infinitely many zeros",
            hint="ask for the zeros of one path, or of channels whose delays are their own",
        )
    found, regular = _from_pencil(chosen), _is_regular(chosen)
    refined = [_refine(chosen, z, regular=regular) for z in found]
    value = np.array([r[0] for r in refined], dtype=complex)
    residual = np.array([r[1] for r in refined], dtype=float)
    if np.any(residual > NEAR):
        raise NumericalError(
            f"{np.sum(residual > NEAR)} of {len(found)} zeros are lost in rounding",
            hint="leave out a channel that duplicates another, or modes too weak to matter",
        )
    order = np.argsort(np.abs(value), kind="stable")
    outputs_, inputs_ = (tuple(p.name for p in side) for side in (chosen.outputs, chosen.inputs))
    by = np.array([r[2] for r in refined], dtype=complex).reshape(-1, len(outputs_), len(inputs_))
    return Zeros(
        value=value[order],
        residual=residual[order],
        by_response=by[order] if regular else None,
        inputs=inputs_,
        outputs=outputs_,
        sample_hz=model.sample_hz,
    )


def name_zeros(zeros: Zeros) -> tuple[str, ...]:
    """Each zero in words: its channels, frequency, damping, and whether it is non-minimum-phase."""
    where = f"{', '.join(zeros.inputs)} to {', '.join(zeros.outputs)}"
    words: list[str] = []
    for hz, ratio, pair, wrong in zip(
        zeros.frequency_hz, zeros.damping, zeros.is_pair, zeros.is_nonminimum_phase, strict=True
    ):
        kind = f"pair of zeros at {hz:.4g} Hz, damping {ratio:.2%}" if pair else f"real zero at {hz:.4g} Hz"
        words.append(f"{where}: {kind}" + (", non-minimum phase" if wrong else ""))
    return tuple(words)


def _from_pencil(model: MeasurementModel) -> np.ndarray:
    """One of each pair, unrefined, in rad/s."""
    found = transmission_zeros(rational_statespace(model))
    if model.sample_hz is None:
        slowest = float(np.min(np.abs(model.poles), initial=np.inf))
        standing = np.abs(found) < STANDING * slowest
        count = int(np.sum(np.where(is_single(found[standing], None), 1, 2)))
        return np.concatenate([np.zeros(count, dtype=complex), found[~standing]])
    found = found[np.abs(found) > AT_ORIGIN]
    return np.log(found) * model.sample_hz


def _is_regular(model: MeasurementModel) -> bool:
    """Whether the matrix is square and of full rank at an arbitrary point, hence everywhere but at zeros."""
    if len(model.outputs) != len(model.inputs):
        return False
    H, slope = _at(model, complex(np.pi, 1.0) * float(np.median(np.abs(model.poles))))
    _, size, _ = _scaled_svd(H, slope)[0]
    return bool(size[-1] > SINGULAR * size[0])


def _refine(model: MeasurementModel, z: complex, *, regular: bool) -> tuple[complex, float, np.ndarray]:
    """The zero, how far off it is as a share of its size, and its derivative by the response."""
    if z == 0.0 and model.sample_hz is None:
        return _standing(model)
    start, unit = z, max(abs(z), float(np.finfo(float).tiny))
    step, by = _newton(model, z)
    if not regular:
        return z, abs(step) / unit, by
    for _ in range(NEWTON_STEPS):
        trial = z + (step.real if is_single(np.array([z]), model.sample_hz)[0] else step)
        ahead, by_ahead = _newton(model, trial)
        # A step that gains nothing has met rounding.
        if not abs(ahead) < 0.5 * abs(step) or abs(trial - start) > NEAR * unit:
            break
        z, step, by = trial, ahead, by_ahead
    return z, abs(step) / unit, by


def _standing(model: MeasurementModel) -> tuple[complex, float, np.ndarray]:
    """A zero at the origin, its least singular value over that at the slowest pole's frequency, its slope.

    The slope is the derivative of the zero by the response.

    Several zeros there leave the response without a slope, so that no Newton step measures their distance.
    If poles are at the origin too, in other directions, the values are taken beside it.
    """
    slowest = 1j * float(np.min(np.abs(model.poles), initial=np.inf))
    beside = STANDING * slowest if np.any(double_pole(model)) or np.any(single_pole(model)) else 0.0
    (_, usual, _), rows, columns = _scaled_svd(*_at(model, slowest))
    here = np.linalg.svd(_at(model, beside)[0] * rows[:, None] * columns, compute_uv=False)
    return 0.0, float(here[-1] / usual[-1]), _newton(model, beside)[1]


def _newton(model: MeasurementModel, s: complex) -> tuple[complex, np.ndarray]:
    """Newton's step to where the smallest singular value vanishes, and the derivative by the response.

    With y H x the smallest singular value and its vectors, H + dH is singular at s - (y H x + y dH x) /
    (y H' x) to first order; at a zero x and y are its directions.
    """
    H, slope = _at(model, s)
    if not (np.isfinite(H).all() and np.isfinite(slope).all()):
        return 0.0, np.zeros(H.shape, dtype=complex)
    (U, size, Vh), rows, columns = _scaled_svd(H, slope)
    k = len(size) - 1
    y, x = U[:, k].conj() * rows, Vh[k].conj() * columns
    along = complex(y @ slope @ x)
    if along == 0.0:
        return 0.0, np.zeros(H.shape, dtype=complex)
    return -complex(y @ H @ x) / along, -np.outer(y, x) / along


def _scaled_svd(
    H: np.ndarray, slope: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray, np.ndarray]:
    """Singular values of H with rows and columns, which have units of their own, scaled to like size."""
    tiny = float(np.finfo(float).tiny)
    rows = 1.0 / np.maximum(np.linalg.norm(slope, axis=1), tiny)
    columns = 1.0 / np.maximum(np.linalg.norm(slope * rows[:, None], axis=0), tiny)
    U, size, Vh = np.linalg.svd(H * rows[:, None] * columns)
    return (U, size, Vh), rows, columns


def _at(
    model: MeasurementModel, s: complex
) -> tuple[Complex[np.ndarray, "output input"], Complex[np.ndarray, "output input"]]:
    at = np.array([s])
    return rational_response(model, at)[0], rational_slope(model, at)[0]
