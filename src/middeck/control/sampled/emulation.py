"""A continuous compensator made sampled: by a hold, by Tustin's rule, or pole by pole and zero by zero.

None of them knows the plant or the hold. They are what a direct design is compared with (Franklin, Powell and
Workman 1998, chapter 6).
"""

import dataclasses
import warnings
from typing import Literal, get_args

import numpy as np

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.sampling.sampling import hold_inputs, sample_dynamics, tustin
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles, series
from middeck.values import require_kind

Rule = Literal["hold", "tustin", "matched"]
RINGING, COUNTS = 0.2, 0.1
"""Damping below which a pole rings; its gain, over the largest at any pole, from which that counts.

Chosen: at 500 Hz laws of the study do well with poles of 0.25 to 0.3 beyond 250 Hz, at a tenth of their gain.
"""
LOW = 0.1
"""The least frequency, over half the rate, at which gains are compared: an integrator's grows without end."""
BESIDE = 1.0 + 1e-6
"""Where a gain is asked for, over the frequency of a pole: at an undamped one itself there is none."""
Roots = tuple[complex, ...]
"""One real root, two real ones, or a complex one with its conjugate."""


@named_kinds
def emulate(
    compensator: Compensator, period_s: float, rule: Rule = "tustin", *, match_hz: float | None = None
) -> Compensator:
    """The continuous compensator converted to one sampled every ``period_s``.

    Args:
        compensator, period_s: The compensator, and the time from sample to sample [s].
        rule: ``"hold"``: exact where its input stands still over each period. ``"tustin"``: the trapezoidal
            rule. ``"matched"``: each pole and zero goes to exp(s T), zeros at infinity to z = -1; for one
            input and one output.
        match_hz: Frequency [Hz] of equal response: Tustin's rule is prewarped there, a matched compensator
            has its gain there. None for zero frequency. The hold has no such choice.

    Raises `ConfigError` for a period that is not positive, a frequency beyond half the rate, an unknown rule,
    or a matched compensator of more than one input or output. Warns of a compensator that rings faster than
    half the rate, at a gain that counts (`RINGING`, `COUNTS`): no rule keeps that.

    >>> from middeck.signals.ports import Port
    >>> y, u = (Port("y", "m"),), (Port("u", "N"),)
    >>> lag = Compensator(StateSpace([[-2.0]], [[2.0]], [[1.0]], [[0.0]]), y, u)
    >>> [round(float(emulate(lag, 0.1, rule).sampled.A[0, 0]), 6) for rule in ("hold", "tustin", "matched")]
    [0.818731, 0.818182, 0.818731]
    """
    require_kind(compensator, Compensator, "compensator", "a law: Compensator(system, inputs, outputs)")
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"sampling period of {period_s} s", hint="positive and finite")
    if match_hz is not None and not 0.0 <= match_hz < 0.5 / period_s:
        raise ConfigError(
            f"match_hz = {match_hz} for a compensator sampled at {1.0 / period_s:g} Hz",
            hint="a frequency below half the rate",
        )
    if rule not in get_args(Rule):
        raise ConfigError(f"no rule {rule!r}", hint=f"one of {', '.join(get_args(Rule))}")
    _warn_of_fast_poles(compensator, period_s)
    at = 2.0 * np.pi * (match_hz or 0.0)
    if rule == "hold":
        system = sample_dynamics(compensator.system, period_s)
    elif rule == "tustin":
        system = _prewarped(compensator.system, period_s, at)
    else:
        system = match_roots(compensator.system, period_s, at)
    applied = (
        None
        if compensator.applied is None
        else _hold_applied(compensator.system, compensator.applied, period_s, at, rule)
    )
    return Compensator(system, compensator.inputs, compensator.outputs, method=rule, applied=applied)


def _warn_of_fast_poles(compensator: Compensator, period_s: float) -> None:
    found, half = poles(compensator.system), 0.5 / period_s
    hz = np.abs(found.imag) / (2.0 * np.pi)
    fast = (found.real > -RINGING * np.abs(found)) & (hz > half)
    if not fast.any():
        return
    beside = 2.0 * np.pi * BESIDE * np.maximum(hz, LOW * half)
    gain = np.abs(statespace_response(compensator.system, beside))
    rings = hz[fast & (gain >= COUNTS * gain.max(axis=0)).any(axis=(1, 2))]
    if len(rings):
        warnings.warn(
            f"the compensator rings at {rings.max():.4g} Hz, half the rate is {half:.4g} Hz: sampled, it is "
            f"another law; sample it faster than {2.0 * rings.max():.4g} Hz",
            UserWarning, stacklevel=4,
        )  # fmt: skip


def _hold_applied(
    system: StateSpace, applied: np.ndarray, period_s: float, omega: float, rule: Rule
) -> np.ndarray | None:
    """Effect on the states of a missing command over a period; None for a matched compensator.

    Of Tustin's rule the states are (I - A T/2) x / sqrt(T), less what the input holds of them.
    """
    if rule == "hold":
        return hold_inputs(
            dataclasses.replace(system, B=applied, D=np.zeros((len(system.C), applied.shape[1]))), period_s
        )[1]
    return np.sqrt(_warped_period(period_s, omega)) * applied if rule == "tustin" else None


def _prewarped(system: StateSpace, period_s: float, omega: float) -> SampledStateSpace:
    """s = w / tan(w T / 2) (z - 1)/(z + 1): a period of 2 tan(w T / 2) / w in Tustin's rule."""
    return dataclasses.replace(tustin(system, _warped_period(period_s, omega)), period_s=period_s)


def _warped_period(period_s: float, omega: float) -> float:
    return 2.0 * np.tan(0.5 * omega * period_s) / omega if omega > 0.0 else period_s


def match_roots(system: StateSpace, period_s: float, omega: float) -> SampledStateSpace:
    """The compensator of one path with its roots mapped, its gain equal at ``omega`` [rad/s].

    Sections in series, in the differences of their roots, so that slow roots beside z = 1 lose no digits
    (Franklin, Powell and Workman 1998, section 6.2).

    Raises `ConfigError` for more inputs or outputs, and for a compensator that is zero.
    """
    if system.D.shape != (1, 1):
        raise ConfigError(
            f"pole-zero matching of {system.D.shape} outputs and inputs", hint="one of each, or Tustin's rule"
        )
    found, zeros = poles(system), transmission_zeros(system)
    chain = _in_series(_group(found, period_s), _group(zeros, period_s), period_s)
    roots = np.concatenate([found, zeros])
    # Each factor (s - r) / (z - exp(r T)) is positive at zero frequency; a mode beyond half the rate may turn
    # it.
    at = [_beside(roots, w, 1.0 / period_s) for w in (0.0, omega)]
    wanted, have = (statespace_response(s, np.array(at))[:, 0, 0] for s in (system, chain))
    if not np.all(wanted):
        raise ConfigError("the compensator is zero: there is no gain to match", hint="leave it out")
    ratio = wanted / have
    gain = float(np.copysign(abs(ratio[1]), ratio[0].real))
    return SampledStateSpace(chain.A, chain.B, gain * chain.C, gain * chain.D, period_s=period_s)


def _beside(roots: np.ndarray, omega: float, rate: float) -> float:
    """``omega``, moved by a thousandth of the way to the next root where it meets a root."""
    away = np.abs(roots - 1j * omega)
    there = away <= 1e-9 * np.abs(roots).max(initial=0.0)
    return omega + 1e-3 * float(away[~there].min(initial=rate)) if there.any() else omega


def _group(roots: np.ndarray, period_s: float) -> list[Roots]:
    """exp(s T), complex ones with their conjugates and real ones two by two."""
    upper = roots[np.imag(roots) >= 0.0]
    z = np.exp(upper[np.imag(upper) > 0.0] * period_s)
    real = np.sort(np.exp(np.real(upper[np.imag(upper) == 0.0]) * period_s))
    groups: list[Roots] = [(complex(r), complex(r.conjugate())) for r in z]
    groups += [(complex(a), complex(b)) for a, b in zip(real[::2], real[1::2], strict=False)]
    return groups + ([(complex(real[-1]),)] if len(real) % 2 else [])


def _in_series(below: list[Roots], above: list[Roots], period_s: float) -> SampledStateSpace:
    """Each group of poles with the nearest group of at most as many zeros, pairs first."""
    left = list(above)
    system = SampledStateSpace(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), period_s=period_s
    )
    for group in sorted(below, key=len, reverse=True):
        fits = [k for k, other in enumerate(left) if len(other) <= len(group)]
        near = min(fits, key=lambda k: (-len(left[k]), abs(left[k][0] - group[0])), default=None)
        zeros = () if near is None else left.pop(near)
        system = series(system, _section(group, (*zeros, *(-1.0 + 0.0j,) * (len(group) - len(zeros)))))
    return system


def _section(p: Roots, r: Roots) -> SampledStateSpace:
    """The product of (z - r) / (z - p), one or two of each."""
    if len(p) == 1:
        step, read = [[p[0].real]], [(p[0] - r[0]).real]
    elif p[0].imag != 0.0:
        a, b = p[0].real, abs(p[0].imag)
        middle, apart = (r[0] + r[1]) / 2.0, (r[0] - r[1]) / 2.0
        step, read = [[a, b], [-b, a]], [((middle - a) ** 2 - apart**2).real / b - b, 2.0 * (a - middle.real)]
    else:
        step = [[p[0].real, 1.0], [0.0, p[1].real]]
        read = [((p[0] - r[0]) * (p[0] - r[1])).real, (p[0] + p[1] - r[0] - r[1]).real]
    drive = np.eye(len(p))[:, -1:]
    return SampledStateSpace(np.array(step), drive, np.array([read]), np.ones((1, 1)), period_s=1.0)
