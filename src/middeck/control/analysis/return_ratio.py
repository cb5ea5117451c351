"""Loops broken at one channel, all others closed, on lines that miss no resonance.

The return ratio is L = -K G, so that 1 + L = 0 is the stability limit and the critical point is -1, as in the
field's plots, although u = K y is added at the plant's input.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.lines import place_lines, refine_lines
from middeck.control.analysis.loop import (
    AnyLaw,
    AnyPlant,
    At,
    FeedbackLoop,
    broken_at,
    evaluate_halves,
    form_loop,
    go_round,
)
from middeck.values import record

Ratio = Callable[[np.ndarray], np.ndarray]
"""L [line, channel] at complex frequencies s [rad/s]."""

SMOOTH = 6.0
"""Steps of a curve that is looked at are a sixth of those that find crossings: three degrees."""


@record
class ReturnRatio:
    """The loop broken at each channel in turn, the others closed.

    Parameters
    ----------
    frequency_hz:
        Lines.
    L:
        Response from what is put in behind the break to minus what arrives before it: critical point -1.
    channels:
        Inputs or measurements at which the loop is broken.
    """

    frequency_hz: Float[np.ndarray, " line"]
    L: Complex[np.ndarray, "line channel"]
    channels: tuple[str, ...]


def trace_return_ratio(
    plant: AnyPlant,
    law: AnyLaw,
    *,
    at: At = "inputs",
    frequency_hz: Float[np.ndarray, " line"] | None = None,
) -> ReturnRatio:
    """The return ratio at each channel, delays exact; by default on lines dense enough for a smooth curve.

    Raises
    ------
    ConfigError
        For halves that do not fit (`form_loop`), or lines at which the response is infinite.

    Examples
    --------
    >>> from middeck.control.compensator import Compensator
    >>> from middeck.systems.plant import Plant
    >>> from middeck.systems.ports import Port
    >>> from middeck.systems.statespace import StateSpace, gain_system
    >>> force, way = Port("force", "N"), Port("way", "m")
    >>> lag = Plant(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), (force,), (way,))
    >>> P = Compensator(gain_system(np.array([[-2.0]])), (way,), (force,))
    >>> trace_return_ratio(lag, P, frequency_hz=np.array([0.0])).L.real
    array([[2.]])
    """
    loop = form_loop(plant, law)
    ratio = broken_ratio(loop, at)
    if frequency_hz is None:
        omega = refine_lines(ratio, place_lines(loop, at, ratio), SMOOTH)
        return ReturnRatio(omega / (2.0 * np.pi), ratio(1j * omega), broken_at(loop, at))
    frequency_hz = np.asarray(frequency_hz, dtype=float)
    return ReturnRatio(frequency_hz, ratio(2j * np.pi * frequency_hz), broken_at(loop, at))


def broken_ratio(loop: FeedbackLoop, at: At, only: int | None = None) -> Ratio:
    """L at each channel, or at one ``only``, as a function of s, by the Schur complement of what goes round.

    With P = K G and r the other channels, L_i = -(P_ii + P_ir (1 - P_rr)^-1 P_ri): no cancellation where the
    loop is strong, as 1 / S_ii - 1 would have.
    """
    halves = evaluate_halves(loop)

    def ratio(s: np.ndarray) -> np.ndarray:
        # On a pole the ratio is infinite; who asks there decides what that means.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return _one_by_one(go_round(*halves(np.asarray(s, dtype=complex)), at), only)

    return ratio


def _one_by_one(P: np.ndarray, only: int | None) -> np.ndarray:
    if P.shape[1] == 1:
        return -P[:, :, 0]
    which = range(P.shape[1]) if only is None else [only]
    return np.stack([_complement(P, i) for i in which], axis=1)


def _complement(P: np.ndarray, i: int) -> Complex[np.ndarray, " line"]:
    r = np.delete(np.arange(P.shape[1]), i)
    others = np.eye(len(r)) - P[:, r][:, :, r]
    # Where the other loops alone have a pole on the line, this one is without bound.
    bounded = np.isfinite(P).all(axis=(1, 2)) & (np.linalg.det(others) != 0.0)
    through = np.linalg.solve(others[bounded], P[bounded][:, r, i][:, :, None])
    L = np.full(len(P), np.inf + 0.0j)
    L[bounded] = -(P[bounded, i, i] + (P[bounded][:, i, r][:, None, :] @ through)[:, 0, 0])
    return L
