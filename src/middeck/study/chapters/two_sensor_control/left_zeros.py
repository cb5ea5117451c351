"""Fit of a path with all its zeros in the left half-plane, to show whether its phase needs others."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float

STEPS = 200  # most steps of the refit, which takes some tens
FIRST_STEPS = 20  # steps with either sign of the gain; the better goes on
LEAST_DAMPING = 1e-6  # with which a zero on the axis starts


def refit_left(
    frequency_hz: Float[np.ndarray, " line"],
    fitted: Complex[np.ndarray, " line"],
    data: Complex[np.ndarray, " line"],
    zeros: Complex[np.ndarray, " zero"],
) -> float:
    """Relative error of the best path found whose zeros all lie in the left half-plane.

    The zeros [rad/s] of ``fitted`` (one of each pair) are mirrored, then they and the gain, of either sign,
    are fitted anew to ``data`` by least squares; poles and delay stay. A pair s^2 + a s + b has free
    logarithms of a and b, so that it may also become two real zeros. Zeros at the origin stay.

    >>> f = np.linspace(0.1, 10.0, 50)
    >>> s = 2j * np.pi * f
    >>> H = (s + 3.0) / (s + 1.0) ** 2
    >>> bool(refit_left(f, H * (s - 9.0) / (s + 3.0), H, np.array([9.0 + 0.0j])) < 1e-8)
    True
    """
    s = 2j * np.pi * frequency_hz
    real = np.real(zeros[(np.imag(zeros) == 0.0) & (zeros != 0.0)])[:, None]
    pairs = zeros[np.imag(zeros) != 0.0]
    first, second = (x[:, None] for x in (-2.0 * np.real(pairs), np.abs(pairs) ** 2))
    rest = fitted / np.prod(1.0 - s / real, axis=0) / np.prod(1.0 + (first * s + s**2) / second, axis=0)
    damped = np.maximum(np.abs(first), LEAST_DAMPING * np.sqrt(second))
    start = np.log(np.concatenate([np.abs(real), damped, second])[:, 0])
    size = float(np.linalg.norm(data))

    squared = s**2

    def factors(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The path, s over its real zeros, and its pairs."""
        z, a, b = np.split(np.exp(theta[1:, None]), np.cumsum([len(real), len(pairs)]))
        over, quadratic = s / z, 1.0 + (a * s + squared) / b
        H = np.exp(theta[0]) * rest * np.prod(1.0 + over, axis=0) * np.prod(quadratic, axis=0)
        return H, over, quadratic

    def derivative(theta: np.ndarray) -> np.ndarray:
        """Derivatives by the logarithms of the gain, real zeros, a and b."""
        H, over, quadratic = factors(theta)
        _, a, b = np.split(np.exp(theta[1:, None]), np.cumsum([len(real), len(pairs)]))
        by = [np.ones((1, len(s))), -over / (1.0 + over), a * s / b / quadratic, 1.0 / quadratic - 1.0]
        return H * np.concatenate(by)

    def refined(sign: float, theta: np.ndarray, steps: int) -> Any:
        def residual(theta: np.ndarray) -> np.ndarray:
            return ((sign * factors(theta)[0] - data) / size).view(float)

        def slope(theta: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(sign * derivative(theta) / size).view(float).T

        least_squares: Any = scipy.optimize.least_squares
        return least_squares(residual, theta, jac=slope, max_nfev=steps)

    first_of = {sign: refined(sign, np.concatenate([[0.0], start]), FIRST_STEPS) for sign in (1.0, -1.0)}
    sign = min(first_of, key=lambda sign: first_of[sign].cost)
    found = first_of[sign]
    if not found.success:
        found = refined(sign, found.x, STEPS)
    return float(np.sqrt(2.0 * found.cost))
