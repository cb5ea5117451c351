r"""Largest gain over frequency, by a Hamiltonian search instead of sampling.

The gain exceeds g somewhere if and only if a Hamiltonian matrix has imaginary eigenvalues, and these are the
frequencies at which it passes g (Boyd, Balakrishnan and Kabamba 1989, Math. Control Signals Systems 2;
iteration of Bruinsma and Steinbuch 1990, Systems and Control Letters 14). Rounding makes it uncertain which
eigenvalues are imaginary, so the gain is evaluated at the imaginary parts of all and midway between
neighbours: a peak above g has at least one of these points under it.
"""

from __future__ import annotations

import warnings
from typing import cast

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import NumericalError
from middeck.systems.poles.resolvent import entry_sensitivity, evaluate_transfer
from middeck.systems.poles.rounding import EPS, LIGHTEST, is_vague
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.verdict import CURE
from middeck.systems.state_space.statespace import StateSpace, poles
from middeck.values import record

PRECISION = 1e-9
"""Relative rise of the peak below which the search ends; rounding of a response is 1e-12."""
ROUNDS = 40
"""Most rounds; convergence is quadratic, three to six are typical."""
UNCERTAIN = 1e-4
"""Relative change of the peak by rounding of A (first order, worst case of all entries) that gives a
warning."""
ON_AXIS = 1e-13
"""Real part, relative to A, below which a pole counts as on the axis, with infinite gain."""


@record
class PeakGain:
    """The largest singular value of a response, and where [rad/s]; ``inf`` at a pole on the axis."""

    gain: float
    omega: float


def peak_gain(
    system: StateSpace, band: tuple[float, float] = (0.0, np.inf), *, beside: float = 0.0
) -> PeakGain:
    """The largest singular value of C (jw I - A)^-1 B + D within ``band`` [rad/s].

    The H-infinity norm where the system is stable; of an unstable one the peak over frequency all the same.
    Warns (`UserWarning`) where rounding of A moves the peak, of a remainder ``beside`` the gain of the whole.
    Raises `NumericalError` where the search does not end.

    >>> mode = StateSpace([[0.0, 1.0], [-1.0, -0.02]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    >>> zeta = 0.01
    >>> bool(np.isclose(peak_gain(mode).gain, 1.0 / (2.0 * zeta * np.sqrt(1.0 - zeta**2)), rtol=1e-8))
    True
    """
    direct = float(np.linalg.norm(system.D, 2)) if system.D.size else 0.0
    if not system.D.size or not len(system.A):
        return PeakGain(direct, band[0])
    balanced = balance_states(system)
    values = poles(balanced)
    size = float(np.linalg.norm(balanced.A, 2))
    stuck = _on_axis(values, size, band)
    if stuck is not None:
        if ON_AXIS * size > LIGHTEST and is_vague(system):
            _warn("whether a pole lies on the axis is undecided")
        return PeakGain(float(np.inf), stuck)
    best = _search(balanced, values, band, direct)
    moved = entry_sensitivity(balanced, np.array([best.omega])) if np.isfinite(best.omega) else np.zeros(1)
    if best.gain > 0.0 and (moved := EPS * float(np.linalg.norm(moved))) > UNCERTAIN * max(best.gain, beside):
        _warn(f"rounding of the matrix A alone moves it by a relative {moved / best.gain:.0e} or more")
    return best


def _warn(why: str) -> None:
    warnings.warn(f"peak of a gain: {why}; {CURE}, would decide", UserWarning, stacklevel=3)


def _search(balanced: StateSpace, values: np.ndarray, band: tuple[float, float], direct: float) -> PeakGain:
    best = _largest(balanced, _first_lines(values, band))
    if band[1] == np.inf and direct > best.gain:
        best = PeakGain(direct, float(np.inf))
    for _ in range(ROUNDS):
        if best.gain == 0.0:
            return best
        found = _largest(balanced, _lines_above(balanced, best.gain * (1.0 + PRECISION), band))
        if found.gain <= best.gain * (1.0 + PRECISION):
            return max(best, found, key=lambda peak: peak.gain)
        best = found
    raise NumericalError(
        f"no peak of the gain was settled on in {ROUNDS} rounds",
        gain=best.gain,
        hint="a narrower band, or a balanced realisation of the system",
    )


def _on_axis(values: Complex[np.ndarray, " state"], size: float, band: tuple[float, float]) -> float | None:
    omega = np.abs(np.imag(values))
    there = (np.abs(np.real(values)) <= ON_AXIS * size) & (omega >= band[0]) & (omega <= band[1])
    return float(omega[there][0]) if there.any() else None


def _first_lines(values: np.ndarray, band: tuple[float, float]) -> Float[np.ndarray, " line"]:
    """Each resonance, its corner frequency, and the ends of the band."""
    rate, turn = np.real(values), np.abs(np.imag(values))
    at = np.concatenate([np.sqrt(np.maximum(turn**2 - rate**2, 0.0)), np.abs(values)])
    ends = [band[0], band[1] if np.isfinite(band[1]) else 10.0 * np.abs(values).max()]
    return np.unique(np.concatenate([np.clip(at, *band), ends]))


def _lines_above(system: StateSpace, level: float, band: tuple[float, float]) -> Float[np.ndarray, " line"]:
    """Frequencies where a singular value may pass ``level``, and those between."""
    B, C, D = system.B / level, system.C, system.D / level
    R = np.eye(D.shape[1]) - D.T @ D
    through = np.linalg.solve(R, np.hstack([D.T @ C, B.T]))
    feed, drive = through[:, : len(system.A)], through[:, len(system.A) :]
    A = system.A + B @ feed
    H = np.block([[A, B @ drive], [-C.T @ (C + D @ feed), -A.T]])
    at = np.unique(np.clip(np.abs(np.imag(np.linalg.eigvals(H))), *band))
    ends = np.array([end for end in band if np.isfinite(end)])
    at = np.unique(np.concatenate([at, ends]))
    return np.concatenate([at, (at[1:] + at[:-1]) / 2.0])


def _largest(system: StateSpace, omega: Float[np.ndarray, " line"]) -> PeakGain:
    H = evaluate_transfer(system, 1j * omega)
    gain = cast("np.ndarray", np.linalg.norm(H, 2, axis=(1, 2)))
    top = int(np.argmax(gain))
    return PeakGain(float(gain[top]), float(omega[top]))
