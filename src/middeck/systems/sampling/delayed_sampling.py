"""Exact sampled equivalents, with few states, of systems with a separate delay for each path.

Input i is held over each period and delayed by a_i, output o by b_o. The state is the plant's at the sampling
instants under inputs delayed by alpha_i = a_i + beta. An output delayed by less than beta is predicted (all
inputs until then are known); one delayed by more waits in a chain of states. With beta the largest output
delay, a single input needs no more states than its most delayed path; with beta zero each output has a chain.
The beta of fewest states is chosen.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.systems.sampling.sampling import WHOLE, hold_inputs
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from middeck.values import record

LONGEST = 2000
"""Most periods of a delay."""


@record
class DelaySplit:
    """Delays of the paths as delay of the input plus delay of the output plus a rest, all [s]."""

    input_s: Float[np.ndarray, " input"]
    output_s: Float[np.ndarray, " output"]
    rest_s: Float[np.ndarray, "output input"]


def split_delays(delay_s: Float[np.ndarray, "output input"]) -> DelaySplit:
    """Split path delays into the largest parts common to an input or to an output; the outputs take their
    common.

    >>> split = split_delays(np.array([[1.0, 3.0], [2.0, 4.0]]))
    >>> split.input_s.tolist(), split.output_s.tolist(), split.rest_s.any()
    ([0.0, 2.0], [1.0, 2.0], np.False_)
    """
    of_input = delay_s.min(axis=0)
    of_input = of_input - of_input.min()
    of_output = (delay_s - of_input).min(axis=1)
    return DelaySplit(of_input, of_output, delay_s - of_input - of_output[:, None])


def is_sum(delay_s: Float[np.ndarray, "output input"], tolerance: float = WHOLE) -> bool:
    """Whether each path is delayed by its input's delay plus its output's, all within ``tolerance``.

    >>> is_sum(np.array([[1.0, 3.0], [2.0, 4.0]])), is_sum(np.array([[1.0, 3.0], [2.0, 2.0]]))
    (True, False)
    """
    return bool(np.all(split_delays(delay_s).rest_s <= tolerance))


def sample_delayed(
    system: StateSpace, period_s: float, delay_s: Float[np.ndarray, "output input"]
) -> SampledStateSpace:
    """The sampled system: inputs held, each path delayed by its own delay, outputs sampled.

    Exact for any delays, fractions of a period included; y[k] is taken at the instant at which u[k] is
    issued. States: the system's, then past inputs (input by input, the latest first), then waiting outputs.
    Where the delays are not sums (`is_sum`), each input has a copy of the system, whose states come first.

    Raises `ConfigError` for a period that is not positive, a negative delay, or delays of another shape than
    D.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0], [2.0]], [[0.0], [0.0]])
    >>> len(sample_delayed(lag, 0.1, np.array([[0.2], [0.45]])).A)     # one state, five past inputs
    6
    """
    delay_s = np.asarray(delay_s, dtype=float)
    if not (np.isfinite(period_s) and period_s > 0.0):
        raise ConfigError(f"sampling period of {period_s} s", hint="positive and finite")
    if delay_s.shape != system.D.shape or not (np.isfinite(delay_s).all() and (delay_s >= 0.0).all()):
        raise ConfigError(
            f"delays of shape {delay_s.shape} for {system.D.shape} outputs and inputs, or one is negative",
            hint="one delay of zero or more for each path",
        )
    samples = tidy_samples(delay_s / period_s)
    if not samples.max(initial=0.0) <= LONGEST:
        raise ConfigError(
            f"a delay of {samples.max():.3g} periods of {period_s:g} s",
            hint=f"{LONGEST} at most: each is a state; a longer period or a shorter delay",
        )
    split = split_delays(samples)
    if is_sum(samples):
        return _sample(system, period_s, tidy_samples(split.input_s), tidy_samples(split.output_s))
    alone = [
        _sample(StateSpace(system.A, system.B[:, [i]], system.C, system.D[:, [i]]), period_s,
                np.zeros(1), samples[:, i])
        for i in range(samples.shape[1])
    ]  # fmt: skip
    return _side_by_side(alone, len(system.A))


def _side_by_side(alone: list[SampledStateSpace], states: int) -> SampledStateSpace:
    """Systems of one input each, outputs added; the first ``states`` of each come first."""
    A, B = (np.asarray(scipy.linalg.block_diag(*(getattr(s, name) for s in alone))) for name in "AB")
    C, D = (np.hstack([getattr(s, name) for s in alone]) for name in "CD")
    first = np.concatenate([np.arange(len(s.A)) < states for s in alone])
    order = np.concatenate([np.flatnonzero(first), np.flatnonzero(~first)])
    return SampledStateSpace(A[np.ix_(order, order)], B[order], C[:, order], D, period_s=alone[0].period_s)


def tidy_samples(samples: np.ndarray) -> np.ndarray:
    """Round numbers of samples that differ from whole ones by binary rounding of decimals only."""
    nearest = np.round(samples)
    return np.where(np.abs(samples - nearest) < WHOLE, nearest, samples)


def _sample(system: StateSpace, period_s: float, a: np.ndarray, b: np.ndarray) -> SampledStateSpace:
    """``a`` and ``b`` in samples."""
    choices = np.unique(np.concatenate([[0.0], b]))
    beta = min(choices, key=lambda level: _count(a, b, level))
    ahead = tidy_samples(beta - b)
    waiting = np.ceil(np.maximum(-ahead, 0.0)).astype(int)
    alpha = tidy_samples(a + beta)
    rows = [_look_ahead(system, period_s, alpha, eta) for eta in tidy_samples(ahead + waiting)]
    step = _look_ahead(system, period_s, alpha, 1.0)
    return _assemble(system, period_s, step, rows, alpha, tidy_samples(ahead + waiting), waiting)


def _count(a: np.ndarray, b: np.ndarray, beta: float) -> float:
    return float(
        np.sum(np.ceil(tidy_samples(a + beta))) + np.sum(np.ceil(np.maximum(tidy_samples(b - beta), 0.0)))
    )


@record
class _Ahead:
    """x(kT + eta) = transition x[k] + sum over age j and input i of gain[j, :, i] u_i[k - j]."""

    transition: Float[np.ndarray, "state state"]
    gain: Float[np.ndarray, "age state input"]


def _look_ahead(system: StateSpace, period_s: float, alpha: np.ndarray, eta: float) -> _Ahead:
    n, m = system.B.shape
    oldest = int(np.ceil(alpha.max(initial=0.0)))
    gain = np.zeros((oldest + 1, n, m))
    for i, delay in enumerate(alpha):
        for age in range(int(np.ceil(delay)) + 1):
            start, end = max(0.0, delay - age), min(eta, delay - age + 1.0)
            if end > start:
                held = hold_inputs(system.select([i], []), (end - start) * period_s)[1]
                after = np.asarray(scipy.linalg.expm(system.A * ((eta - end) * period_s)))
                gain[age, :, [i]] = (after @ held).T
    return _Ahead(np.asarray(scipy.linalg.expm(system.A * (eta * period_s))), gain)


def _assemble(
    system: StateSpace,
    period_s: float,
    step: _Ahead,
    rows: list[_Ahead],
    alpha: np.ndarray,
    eta: np.ndarray,
    waiting: np.ndarray,
) -> SampledStateSpace:
    n, m = system.B.shape
    depth = np.ceil(alpha).astype(int)
    first = n + np.concatenate([[0], np.cumsum(depth)])
    chain = first[-1] + np.concatenate([[0], np.cumsum(waiting)])
    size = int(chain[-1])

    def weights(ahead: _Ahead, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of ``rows`` of x(kT + eta) on all states and on u[k]."""
        on_state, on_input = np.zeros((len(rows), size)), rows @ ahead.gain[0]
        on_state[:, :n] = rows @ ahead.transition
        for i in range(m):
            for age in range(1, depth[i] + 1):
                on_state[:, first[i] + age - 1] = rows @ ahead.gain[age, :, i]
        return on_state, on_input

    A, B = np.zeros((size, size)), np.zeros((size, m))
    A[:n], B[:n] = weights(step, np.eye(n))
    for i in range(m):
        if depth[i]:
            B[first[i], i] = 1.0
        for age in range(1, depth[i]):
            A[first[i] + age, first[i] + age - 1] = 1.0
    C, D = np.zeros((len(system.C), size)), np.zeros(system.D.shape)
    for o, ahead in enumerate(rows):
        on_state, on_input = weights(ahead, system.C[[o]])
        for i in range(m):  # the direct term reads the input that is held at kT + eta
            age = int(np.ceil(tidy_samples(alpha[i] - eta[o])))
            if age > 0:
                on_state[0, first[i] + age - 1] += system.D[o, i]
            else:
                on_input[0, i] += system.D[o, i]
        if not waiting[o]:
            C[o], D[o] = on_state[0], on_input[0]
            continue
        A[chain[o]], B[chain[o]] = on_state[0], on_input[0]
        for k in range(1, waiting[o]):
            A[chain[o] + k, chain[o] + k - 1] = 1.0
        C[o, chain[o] + waiting[o] - 1] = 1.0
    return SampledStateSpace(A, B, C, D, period_s=period_s)
