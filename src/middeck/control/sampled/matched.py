"""Matched poles and zeros: the roots of a law mapped one by one, as sections in series.

Each pole and zero s goes to exp(s T), each zero at infinity to z = -1, and the gain is met at one frequency
(Franklin, Powell and Workman 1998, section 6.2). Sections are written in the differences of their roots, so
that slow roots beside z = 1 lose no digits.
"""

from __future__ import annotations

import numpy as np

from middeck.errors import ConfigError
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles, series

Roots = tuple[complex, ...]
"""One real root, two real ones, or a complex one with its conjugate."""


def match_roots(system: StateSpace, period_s: float, omega: float) -> SampledStateSpace:
    """The law of one input and one output with its roots mapped, its gain met at ``omega`` [rad/s].

    Raises `ConfigError` for more inputs or outputs, and for a law that is zero.
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
