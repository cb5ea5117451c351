"""Disk margins: gain and phase of one loop, or of all at once, changing together (Seiler et al. 2020).

A channel is multiplied by f = (1 + d/2) / (1 - d/2) with any stable complex d of size below alpha: real f
covers the gains from (2 - alpha)/(2 + alpha) to its inverse, f of size one all phases up to
2 atan(alpha/2) (Seiler, Packard and Gahinet 2020, IEEE Control Systems 40(5), "An introduction to disk
margins", balanced: sigma = 0). The loop bears all such f in all channels at once where
alpha < 1 / max mu(S - 1/2), S = (1 + L)^-1, mu for diagonal complex blocks (theorem 1 and "MIMO disk
margins" there).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import (
    At,
    Compensator,
    Plant,
    broken_at,
    evaluate_halves,
    form_loop,
    go_round,
    moved_part,
)
from middeck.control.analysis.loop.frequency_lines import add_ends, place_lines, refine_lines
from middeck.control.analysis.loop.returned_wave import ReturnedWave, repeating_loop
from middeck.control.analysis.margins.all_phases import all_phases, highest_of
from middeck.control.analysis.margins.crossings import find_peaks
from middeck.control.analysis.margins.return_ratio import broken_ratio
from middeck.control.analysis.margins.scaling import scaled_norms
from middeck.control.analysis.margins.shared_gain import TRUSTED, closed_round, is_short, spread_rounding
from middeck.control.analysis.stability.stability import decide_loop
from middeck.control.law.rounding_of_results import measure_known
from middeck.values import record


@record
class DiskMargin:
    """The largest disk of simultaneous changes that leaves a loop stable.

    Attributes:
        alpha: Its radius, from 0 to 2 and beyond; 0 for an unstable loop.
        frequency_hz: Frequency [Hz] at which a larger disk puts a pole on the axis.
        gain: Limits of the gain factor, 1/g and g; ``inf`` above for a radius of 2 or more.
        phase_rad: Limit of the phase change, lag or lead.
    """

    alpha: float
    frequency_hz: float
    gain: tuple[float, float]
    phase_rad: float


def disk_from_peak(peak: float, omega: float) -> DiskMargin:
    """Disk margin from the largest mu(S - 1/2), which is infinite for an unstable loop.

    >>> disk_from_peak(2.0, 0.0).gain                    # alpha = 1/2: from 3/5 to 5/3
    (0.6, 1.6666666666666667)
    """
    alpha = 1.0 / peak if peak > 0.0 else np.inf
    # A radius of two or more covers every positive gain, but no phase beyond its own.
    low = (2.0 - alpha) / (2.0 + alpha) if alpha < 2.0 else 0.0
    high = 1.0 / low if low > 0.0 else np.inf
    phase = 2.0 * np.arctan(0.5 * alpha)
    return DiskMargin(float(alpha), float(omega / (2.0 * np.pi)), (float(low), float(high)), float(phase))


@named_kinds
def measure_disk_margin(plant: Plant, law: Compensator, *, at: At = "both") -> DiskMargin:
    """The disk margin of all channels at once, delays exact.

    mu is bounded from above by scaling (`middeck.control.analysis.margins.scaling`), which is mu itself for
    up to three channels (Packard and Doyle 1993) and else makes the margin too small, never too large.

    Raises `ConfigError` for halves that do not fit (`form_loop`). Warns (`UserWarning`) where rounding of the
    matrices makes it uncertain (`measure_known`).
    """
    return measure_known(
        "disk margins", lambda *both: _measure(*both, at), lambda disk: np.log([disk.alpha]), plant, law
    )


def _measure(plant: Plant, law: Compensator, at: At) -> DiskMargin:
    loop = form_loop(plant, law)
    broken_at(loop, at)
    if not decide_loop(loop).stable:
        return disk_from_peak(np.inf, 0.0)
    loop = moved_part(loop)
    halves, closed = evaluate_halves(loop), closed_round(loop, at)
    ratio = broken_ratio(loop, at)
    half = 0.5 * np.eye(len(broken_at(loop, at)))
    even, wave = repeating_loop(loop)
    lines = place_lines(even, at, ratio if even is loop else broken_ratio(even, at), zeros=False)
    omega, _ = refine_lines(ratio, lines)

    def once(s: np.ndarray) -> Complex[np.ndarray, "line path"]:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # on a pole of a half
            return go_round(*halves(s), at).reshape(len(s), -1)

    # An end counts where both halves are finite, though one loop alone may close to a pole there.
    omega, _ = add_ends(loop, once, (omega, once(1j * omega)))

    def bound(w: np.ndarray) -> Float[np.ndarray, " line"]:
        P = go_round(*halves(1j * w), at)
        skewed = skewed_sensitivity(P)
        near = _hidden(P, skewed + half) & is_short(loop, 1j * w)
        if near.any():
            with np.errstate(divide="ignore", invalid="ignore"):  # on a pole of the loop
                skewed[near] = closed(1j * w[near]) + half
        return _bounds(skewed)

    at_peak, peak = find_peaks(bound, omega, bound(omega))
    beyond = 0.0
    if wave is not None and even is loop:
        beyond = _turn_peak(wave, at)
    elif wave is not None:
        beyond = highest_of(all_phases(loop, wave), lambda lag: _bound_at(wave, lag, at))
    return disk_from_peak(peak, at_peak) if peak >= beyond else disk_from_peak(beyond, np.inf)


def _turn_peak(wave: ReturnedWave, at: At) -> float:
    """The largest bound at infinite frequency, over one turn of the delays."""

    def bound(phase: np.ndarray) -> Float[np.ndarray, " phase"]:
        return _bound_at(wave, 1j * phase[:, None, None] * wave.multiples, at)

    return find_peaks(bound, wave.turn, bound(wave.turn))[1]


def _bound_at(wave: ReturnedWave, lag: np.ndarray, at: At) -> Float[np.ndarray, " phase"]:
    return _bounds(skewed_sensitivity(go_round(*wave.halves_at(lag), at)))


def _bounds(skewed: Complex[np.ndarray, "line channel channel"]) -> Float[np.ndarray, " line"]:
    lost = ~np.all(np.isfinite(skewed), axis=(1, 2))
    return np.where(lost, np.inf, scaled_norms(np.where(lost[:, None, None], 0.0, skewed)))


def _hidden(P: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Whether rounding hides the sensitivity of a channel, line by line."""
    own, error = (np.diagonal(part, axis1=1, axis2=2) for part in (S, spread_rounding(P, S)))
    return np.any(error > TRUSTED * (1.0 + np.abs(own)), axis=1)


def skewed_sensitivity(
    P: Complex[np.ndarray, "line channel channel"],
) -> Complex[np.ndarray, "line channel channel"]:
    """S - 1/2 = (1 - P)^-1 (1 + P)/2, P = -L; not a number on a pole of the loop."""
    identity = np.eye(P.shape[1])
    try:
        return 0.5 * np.linalg.solve(identity - P, identity + P)
    except np.linalg.LinAlgError:
        lost = np.linalg.det(identity - P) == 0.0
        skewed = 0.5 * np.linalg.solve(np.where(lost[:, None, None], identity, identity - P), identity + P)
        skewed[lost] = np.nan
        return skewed
