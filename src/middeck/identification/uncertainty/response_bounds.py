"""Bounds on the response of a fitted model: ellipses in the complex plane, bands of magnitude and phase.

The complex response is nearly linear in the unknowns within their deviations (the delta method), so that
its error is a normal pair with the covariance S = J C J^T, and the truth lies in an ellipse. Magnitude and
phase are not linear near a zero of the response: there the bands are taken from a circle around the ellipse.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.identification.uncertainty.covariance import ModelCovariance, draw_errors
from middeck.identification.uncertainty.parameter_deviations import check_level, joint_factor, quantile
from middeck.identification.uncertainty.response_derivatives import EntrySlopes, entry_slopes
from middeck.values import record

# Deviations from zero beyond which magnitude and phase are as good as linear in the response: their curvature
# then shifts a band by a tenth of a deviation.
FAR_FROM_ZERO = 5.0
# Draws of the largest deviation: its 95 % quantile is then exceeded with a probability of 5 +- 0.5 %.
DRAWS = 2000
# An error in one direction only (of a response without damping, say) is given this share in the other.
FLAT = 1e-6


@record(kw_only=True)
class ResponseBounds:
    """Region of the true response with probability ``level``, on each line alone or on all together.

    Attributes:
        H: Response of the fitted model.
        axes: The two semi-axes of the ellipse around H, as complex numbers: H + axes[0] cos t + axes[1] sin
            t.
        magnitude_low, magnitude_high: Band of |H|; at a zero of the response it begins at zero.
        phase_error: Half width of the band of phase [rad]; pi where the phase is not known at all.
        level: Probability. The bands hold it far from zeros, and more than it near them.
    """

    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]
    axes: Complex[np.ndarray, "line output input 2"]
    magnitude_low: Float[np.ndarray, "line output input"]
    magnitude_high: Float[np.ndarray, "line output input"]
    phase_error: Float[np.ndarray, "line output input"]
    level: float


def response_bounds(
    covariance: ModelCovariance, frequency_hz: Float[np.ndarray, " line"], *, level: float = 0.95
) -> ResponseBounds:
    """Bounds that hold on each line by itself (pointwise).

    Ellipses by Hotelling's T^2 with the degrees of freedom of the variance, bands by Student's t.

    Raises `ConfigError` for a level that is no probability or a frequency that is not positive.
    """
    check_level(level)
    ellipse = joint_factor(level, 2, covariance.degrees)
    return _bounds(covariance, frequency_hz, ellipse, quantile(level, covariance.degrees), level)


def simultaneous_bounds(
    covariance: ModelCovariance,
    frequency_hz: Float[np.ndarray, " line"],
    rng: np.random.Generator,
    *,
    level: float = 0.95,
) -> ResponseBounds:
    """Bounds that hold on all lines and entries at once.

    Their factor is the quantile of the largest deviation over all lines, from draws of the unknowns in the
    linearised response (Montiel Olea and Plagborg-Moller 2019): narrower than Scheffe's, which would hold
    for any combination of the unknowns.

    Raises `ConfigError` as `response_bounds`.
    """
    check_level(level)
    draws = draw_errors(covariance, DRAWS, rng)
    worst = np.zeros(DRAWS)
    for _, _, entry in _entries(covariance, frequency_hz):
        S = _spread(entry, covariance.root)
        e = np.stack(
            [np.real(entry.by).T @ draws[entry.place], np.imag(entry.by).T @ draws[entry.place]], axis=1
        )
        worst = np.maximum(worst, np.max(np.sum(e * np.linalg.solve(S, e), axis=1), axis=0))
    factor = float(np.sqrt(np.quantile(worst, level)))
    return _bounds(covariance, frequency_hz, factor, factor, level)


def _bounds(
    covariance: ModelCovariance,
    frequency_hz: np.ndarray,
    ellipse: float,
    band: float,
    level: float,
) -> ResponseBounds:
    shape = (len(frequency_hz), *covariance.model.direct.shape)
    H, axes = np.zeros(shape, dtype=complex), np.zeros((*shape, 2), dtype=complex)
    low, high, phase = np.zeros((3, *shape))
    for o, i, entry in _entries(covariance, frequency_hz):
        S = _spread(entry, covariance.root)
        size, direction = np.linalg.eigh(S)
        deviation = np.sqrt(np.maximum(size, 0.0))
        H[:, o, i] = entry.H
        axes[:, o, i] = ellipse * deviation[:, ::-1] * (direction[:, 0] + 1j * direction[:, 1])[:, ::-1]
        along, across, around = _bands(entry.H, S, ellipse * deviation[:, 1], band)
        low[:, o, i] = np.maximum(np.abs(entry.H) - along, 0.0)
        high[:, o, i] = np.abs(entry.H) + along
        phase[:, o, i] = np.where(around, np.pi, across)
    return ResponseBounds(
        frequency_hz=np.asarray(frequency_hz),
        H=H,
        axes=axes,
        magnitude_low=low,
        magnitude_high=high,
        phase_error=phase,
        level=level,
    )


def _bands(
    H: np.ndarray, S: np.ndarray, longest: np.ndarray, band: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half width of the magnitude and of the phase, and whether the ellipse's circle holds zero."""
    size = np.maximum(np.abs(H), np.finfo(float).tiny)
    n = np.stack([np.real(H), np.imag(H)], axis=1) / size[:, None]
    t = np.stack([-n[:, 1], n[:, 0]], axis=1)
    along, across = (band * np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", v, S, v), 0.0)) for v in (n, t))
    far = size > FAR_FROM_ZERO * np.sqrt(np.trace(S, axis1=1, axis2=2))
    around = longest >= size
    near = np.arcsin(np.minimum(longest / size, 1.0))
    return np.where(far, along, longest), np.where(far, across / size, near), around & ~far


def _entries(covariance: ModelCovariance, frequency_hz: np.ndarray) -> Iterator[tuple[int, int, EntrySlopes]]:
    f = np.asarray(frequency_hz, dtype=float)
    if f.ndim != 1 or not np.isfinite(f).all() or (f <= 0.0).any():
        raise ConfigError(
            "frequencies of bounds must be a list of positive numbers of Hz",
            hint="a one-dimensional array, finite and > 0 Hz",
        )
    outputs, inputs = covariance.model.direct.shape
    for o in range(outputs):
        for i in range(inputs):
            yield o, i, entry_slopes(covariance.model, covariance.structure, 2j * np.pi * f, o, i)


def _spread(entry: EntrySlopes, root: np.ndarray) -> Float[np.ndarray, "line 2 2"]:
    """Covariance of the real and the imaginary part on each line."""
    of = root[entry.place].T
    J = np.stack([of @ np.real(entry.by), of @ np.imag(entry.by)])
    S = np.einsum("adl,bdl->lab", J, J)
    floor = FLAT**2 * np.trace(S, axis1=1, axis2=2) + np.finfo(float).tiny
    return S + floor[:, None, None] * np.eye(2)
