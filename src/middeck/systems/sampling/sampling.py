"""Sampling: exact zero-order hold with a true delay, and Tustin's rule."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.modal_system import ModalSystem, rate_scale
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, poles

WHOLE = 1e-9
"""Distance in samples within which a delay is rounded to a whole number: decimals like 0.009 s at 500 Hz are
not exact in binary."""
NEAR_EDGE = 1e-6
"""Relative distance within which a pole sits at the edge 2/T of Tustin's rule."""


def sample_dynamics(
    dynamics: StateSpace | ModalSystem, period_s: float, delay_s: float = 0.0
) -> SampledStateSpace:
    """The sampled system: inputs held over each period, then delayed, outputs sampled.

    Exact for any delay, fractions of a period included. y[k] is taken at the instant at which u[k] is issued.
    States: the system's, then the delayed inputs, the latest first. Raises `ConfigError` for a period that is
    not positive or a negative delay.

    The hold integrals come from one matrix exponential (Van Loan 1978, IEEE TAC 23), of 3x3 blocks for a
    modal system; the fractional delay splits them (Franklin, Powell and Workman 1998, section 4.3).

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    >>> held = sample_dynamics(lag, 0.5, 0.75)
    >>> bool(np.isclose(held.A[0, 0], np.exp(-0.5))), held.A.shape
    (True, (3, 3))
    """
    if not (period_s > 0.0 and delay_s >= 0.0):
        raise ConfigError(
            f"a period of {period_s} s and a delay of {delay_s} s", hint="a period > 0 s, a delay >= 0 s"
        )
    whole, part = split_delay(delay_s / period_s)
    rest, early = (1.0 - part) * period_s, part * period_s
    transition, _ = hold_inputs(dynamics, period_s)
    propagate, gain_new = hold_inputs(dynamics, rest)
    gain_old = propagate @ hold_inputs(dynamics, early)[1] if part else np.zeros_like(gain_new)
    system = dynamics.as_statespace()
    return _append_delay(transition, gain_new, gain_old, system, whole, part > 0.0, period_s)


def tustin(system: StateSpace, period_s: float) -> SampledStateSpace:
    """The trapezoidal rule s = (2/T) (z - 1)/(z + 1): stable stays stable, no aliasing, warped frequencies.

    Raises `ConfigError` where a pole sits at 2/T, `NumericalError` for states so mixed that rounding might
    put one there.
    """
    n = len(system.A)
    balanced, unit = balance(system.A)
    half = 0.5 * period_s * balanced
    left = np.eye(n) - half
    # Reciprocal of rounding with four digits to spare, whatever the units of the states.
    if n and np.linalg.cond(left) > 1e12:
        edge = 2.0 / period_s
        if np.abs(poles(system) - edge).min() > NEAR_EDGE * edge:
            raise NumericalError(
                "Tustin's rule: in states so mixed rounding leaves the sampled system unknown",
                hint="states of like sizes, as modal ones",
            )
        raise ConfigError(f"Tustin's rule: a pole at 2/T = {edge:.3g} rad/s", hint="sample faster")
    root = np.sqrt(period_s)
    A = unit[:, None] * np.linalg.solve(left, np.eye(n) + half) / unit
    B = unit[:, None] * np.linalg.solve(left, system.B / unit[:, None]) * root
    C = np.linalg.solve(left.T, (system.C * unit).T).T / unit * root
    return SampledStateSpace(A, B, C, system.D + 0.5 * C @ system.B * root, period_s=period_s)


def split_delay(samples: float) -> tuple[int, float]:
    """Whole samples of a delay, and the part of a sample beyond them if it is more than `WHOLE`."""
    nearest = round(samples)
    if abs(samples - nearest) < WHOLE:
        return nearest, 0.0
    whole = int(np.floor(samples))
    return whole, samples - whole


def hold_inputs(
    dynamics: StateSpace | ModalSystem, duration_s: float
) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, "state input"]]:
    """exp(A T) and its integral times B."""
    if isinstance(dynamics, ModalSystem):
        return _hold_modal(dynamics, duration_s)
    n, m = dynamics.B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = dynamics.A, dynamics.B
    exponential = np.asarray(sla.expm(block * duration_s))
    return exponential[:n, :n], exponential[:n, n:]


def _hold_modal(
    modal: ModalSystem, duration_s: float
) -> tuple[Float[np.ndarray, "state state"], Float[np.ndarray, "state input"]]:
    n = len(modal.omega)
    scale = rate_scale(modal)
    blocks = np.zeros((n, 3, 3))
    blocks[:, 0, 1] = scale
    blocks[:, 1, 0] = -(modal.omega**2) / scale
    blocks[:, 1, 1] = -2.0 * modal.zeta * modal.omega
    blocks[:, 1, 2] = 1.0 / scale
    exponential = np.asarray(sla.expm(blocks * duration_s))
    A = np.asarray(sla.block_diag(*exponential[:, :2, :2]))
    B = (exponential[:, :2, 2, None] * modal.psi[:, None, :]).reshape(2 * n, -1)
    return A, B


def _append_delay(
    A: np.ndarray,
    gain_new: np.ndarray,
    gain_old: np.ndarray,
    system: StateSpace,
    whole: int,
    split: bool,
    period_s: float,
) -> SampledStateSpace:
    """A chain of past inputs: the one ``whole`` samples old drives the state, and if split the next one."""
    n, m = system.B.shape
    depth = whole + split
    size = n + depth * m
    Ad, Bd = np.zeros((size, size)), np.zeros((size, m))
    Cd, Dd = np.zeros((len(system.C), size)), np.zeros_like(system.D)
    Ad[:n, :n], Cd[:, :n] = A, system.C

    def past(age: int) -> slice:
        return slice(n + (age - 1) * m, n + age * m)

    for age, gain in ((whole, gain_new), (whole + 1, gain_old))[: 1 + split]:
        if age:
            Ad[:n, past(age)] = gain
        else:
            Bd[:n] = gain
    if depth:
        Bd[past(1)] = np.eye(m)
        Cd[:, past(depth)] = system.D
    else:
        Dd = system.D
    for age in range(2, depth + 1):
        Ad[past(age), past(age - 1)] = np.eye(m)
    return SampledStateSpace(Ad, Bd, Cd, Dd, period_s=period_s)
