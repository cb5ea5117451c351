"""A continuous law made sampled: by a hold, by Tustin's rule, or pole by pole and zero by zero.

None of them knows the plant or the hold. They are what a direct design is compared with (Franklin, Powell and
Workman 1998, chapter 6).
"""

from __future__ import annotations

import dataclasses
from typing import Literal, get_args

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.sampled.matched import match_roots
from middeck.errors import ConfigError
from middeck.systems.sampling.sampling import hold_inputs, sample_dynamics, tustin
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

Rule = Literal["hold", "tustin", "matched"]


def emulate(
    compensator: Compensator, period_s: float, rule: Rule = "tustin", *, match_hz: float | None = None
) -> Compensator:
    """The continuous law converted to one sampled every ``period_s``.

    Args:
        compensator, period_s: The law, and the time from sample to sample [s].
        rule: ``"hold"``: exact where its input stands still over each period. ``"tustin"``: the trapezoidal
            rule. ``"matched"``: each pole and zero goes to exp(s T), zeros at infinity to z = -1; for one
            input and one output.
        match_hz: Where the response is to be met: Tustin's rule is prewarped there, a matched law has its
            gain there. None for zero frequency. The hold has no such choice.

    Raises `ConfigError` for a period that is not positive, a frequency beyond half the rate, an unknown rule,
    or a matched law of more than one input or output.

    >>> from middeck.signals.ports import Port
    >>> y, u = (Port("y", "m"),), (Port("u", "N"),)
    >>> lag = Compensator(StateSpace([[-2.0]], [[2.0]], [[1.0]], [[0.0]]), y, u)
    >>> [round(float(emulate(lag, 0.1, rule).sampled.A[0, 0]), 6) for rule in ("hold", "tustin", "matched")]
    [0.818731, 0.818182, 0.818731]
    """
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"sampling period of {period_s} s", hint="positive and finite")
    if match_hz is not None and not 0.0 <= match_hz < 0.5 / period_s:
        raise ConfigError(
            f"match_hz = {match_hz} for a compensator sampled at {1.0 / period_s:g} Hz",
            hint="a frequency below half the rate",
        )
    if rule not in get_args(Rule):
        raise ConfigError(f"no rule {rule!r}", hint=f"one of {', '.join(get_args(Rule))}")
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


def _hold_applied(
    system: StateSpace, applied: np.ndarray, period_s: float, omega: float, rule: Rule
) -> np.ndarray | None:
    """What a command missing over a whole period does to the states; None for a matched law, of other states.

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
