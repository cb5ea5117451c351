"""Return ratios: loops broken at one channel, all others closed, on lines that resolve every resonance.

The return ratio is L = -K G, so that 1 + L = 0 is the stability limit and the critical point is -1, as in the
field's plots, although u = K y is added at the plant's input.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import (
    At,
    FeedbackLoop,
    broken_at,
    evaluate_halves,
    form_loop,
    go_round,
)
from middeck.control.analysis.loop.frequency_lines import place_lines, refine_lines
from middeck.control.analysis.loop.returned_wave import ReturnedWave
from middeck.control.analysis.margins.shared_gain import TRUSTED, closed_ratio, is_short, spread_rounding
from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant import Plant
from middeck.values import record

Ratio = Callable[[np.ndarray], np.ndarray]
"""L [line, channel] at complex frequencies s [rad/s]."""

SMOOTH = 6.0
"""Refinement of lines for plots against those that find crossings: steps of three degrees."""


@record
class ReturnRatio:
    """The loop broken at each channel in turn, the others closed.

    Attributes:
        frequency_hz: Lines.
        L: Response from the signal injected behind the break to minus the signal arriving before it: critical
            point -1.
        channels: Inputs or measurements at which the loop is broken.
    """

    frequency_hz: Float[np.ndarray, " line"]
    L: Complex[np.ndarray, "line channel"]
    channels: tuple[str, ...]


def trace_return_ratio(
    plant: Plant,
    law: Compensator,
    *,
    at: At = "inputs",
    frequency_hz: Float[np.ndarray, " line"] | None = None,
) -> ReturnRatio:
    """The return ratio at each channel, delays exact; by default on lines dense enough for a smooth curve.

    Raises `ConfigError` for halves that do not fit (`form_loop`), or lines at which the response is infinite.

    >>> import middeck as md
    >>> lag = md.make_plant([[-1.0]], [[1.0]], [[1.0]])
    >>> law = md.Compensator(lag.system, lag.outputs, lag.inputs)
    >>> trace_return_ratio(lag, law, frequency_hz=np.array([0.0])).L.real
    array([[-1.]])
    """
    loop = form_loop(plant, law)
    ratio = broken_ratio(loop, at)
    if frequency_hz is None:
        omega, L = refine_lines(ratio, place_lines(loop, at, ratio), SMOOTH)
        return ReturnRatio(omega / (2.0 * np.pi), L, broken_at(loop, at))
    frequency_hz = np.asarray(frequency_hz, dtype=float)
    return ReturnRatio(frequency_hz, ratio(2j * np.pi * frequency_hz), broken_at(loop, at))


def broken_ratio(loop: FeedbackLoop, at: At) -> Ratio:
    """L at each channel as a function of s, all from one inverse of 1 - P.

    With P = K G, S = (1 - P)^-1 and r the other channels, L_i = -(P_ii + P_ir (1 - P_rr)^-1 P_ri) is
    -(S P)_ii / S_ii term by term: no cancellation where the loop is weak, as 1 / S_ii - 1 would have.
    """
    halves, closed = evaluate_halves(loop), closed_ratio(loop, at)

    def ratio(s: np.ndarray) -> np.ndarray:
        # On a pole the ratio is infinite; the caller interprets it.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            G, K = halves(s := np.asarray(s, dtype=complex))
            L, error = _at_each(G, K, at)
            near = np.any(error > TRUSTED, axis=1) & is_short(loop, s)
            if near.any():
                L[near] = closed(s[near])
        return L

    return ratio


def wave_ratio(wave: ReturnedWave, at: At) -> Ratio:
    """L at each channel at infinite frequency, a function of the phase 1j phi [rad] of the delay."""
    return lambda s: _at_each(*wave.halves(s), at)[0]


def ratio_at(wave: ReturnedWave, lag: np.ndarray, at: At) -> Complex[np.ndarray, "point channel"]:
    """L at each channel at infinite frequency, where each path of the plant has an imaginary lag [rad]."""
    return _at_each(*wave.halves_at(lag), at)[0]


def _at_each(
    G: np.ndarray, K: np.ndarray, at: At
) -> tuple[Complex[np.ndarray, "line channel"], Float[np.ndarray, "line channel"]]:
    """The ratio at each channel, and its error from rounding.

    A channel's loop is the same whichever others are named: each end has an inverse of its own size.
    """
    ends: tuple[At, ...] = ("inputs", "outputs") if at == "both" else (at,)
    both = [_one_by_one(go_round(G, K, end)) for end in ends]
    L, error = (np.concatenate(parts, axis=1) for parts in zip(*both, strict=True))
    return L, error


def _one_by_one(
    P: Complex[np.ndarray, "line channel channel"],
) -> tuple[Complex[np.ndarray, "line channel"], Float[np.ndarray, "line channel"]]:
    """The ratio of each channel, and its error from rounding."""
    error = np.zeros(P.shape[:2])
    if P.shape[1] == 1:
        return -P[:, :, 0], error
    difference = np.eye(P.shape[1]) - P
    bounded = np.isfinite(P).all(axis=(1, 2))
    on_root = np.zeros(len(P), dtype=bool)
    inverse = _inverse(difference[bounded])
    if inverse is None:
        on_root = bounded & (np.linalg.det(difference) == 0.0)
        inverse = np.linalg.inv(difference[bounded & ~on_root])
    regular, S = bounded & ~on_root, inverse
    through, own = np.sum(S * P[regular].transpose(0, 2, 1), axis=2), np.diagonal(S, axis1=1, axis2=2)
    # The ratio is unbounded where the other loops alone have a pole on the line.
    L = np.full(P.shape[:2], np.inf + 0.0j)
    L[regular] = np.where(own == 0.0, np.inf, -through / own)
    error[regular] = _rounding(P[regular], S, own, L[regular])
    for k in np.flatnonzero(on_root):
        L[k, [bool(_minor(difference[k], i)) for i in range(P.shape[1])]] = -1.0
        error[k] = np.finfo(float).eps * np.abs(P[k]).max()
    return L, error


def _rounding(P: np.ndarray, S: np.ndarray, own: np.ndarray, L: np.ndarray) -> np.ndarray:
    """The error of L = -(S P)_ii / S_ii relative to 1 + |L|."""
    error, size = spread_rounding(P, S), np.abs(L)
    through, here = np.einsum("kij,kji->ki", error, np.abs(P)), np.diagonal(error, axis1=1, axis2=2)
    return np.where(np.isfinite(size), (through + size * here) / np.abs(own) / (1.0 + size), 0.0)


def _inverse(matrices: np.ndarray) -> np.ndarray | None:
    """The inverses; None where one of the matrices is singular."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        return None


def _minor(matrix: np.ndarray, i: int) -> complex:
    """The determinant of the other channels."""
    return complex(np.linalg.det(np.delete(np.delete(matrix, i, 0), i, 1)))
