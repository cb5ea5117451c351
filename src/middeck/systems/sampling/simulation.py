"""Simulation of sampled systems, and the periodic steady state under a periodic input.

Long inputs are processed in blocks of L samples: with powers of A formed once, the outputs of all blocks are
matrix products, and only every L-th state is stepped. L is small enough that no power of A grows. The power
used for stepping is held in two parts, because its rounding would accumulate as a phase error of lightly
damped modes. The result equals stepping to rounding.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.systems.state_space.balancing import balance
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

GROWTH = 1e3
"""Largest norm that a power A^2, A^4, A^8 ... of a balanced A may have within a block."""
STEP_COST = 60_000
"""Overhead of one step, in multiplications of a large product."""
LONGEST = 256
REPEATS = 1e-9
"""Change of a free motion over a period, relative to the largest, below which it repeats itself."""
STEADY = 1e-6
"""Change of an output from one period to the next, relative to its largest, below which it is steady."""
CHUNK = 1 << 16  # samples at a time: what a block needs beside its input and output stays below this


@record(kw_only=True)
class _Blocks:
    """Matrices of a system over L samples, its states scaled.

    ``after`` + ``rest`` (its rounding) maps a state to that L samples later, ``collect`` the inputs of a
    block to the same; ``observe`` and ``through`` map the state before a block and its inputs to its outputs.
    """

    after: Float[np.ndarray, "state state"]
    rest: Float[np.ndarray, "state state"]
    collect: Float[np.ndarray, "state block_input"]
    observe: Float[np.ndarray, "block_output state"]
    through: Float[np.ndarray, "block_output block_input"]
    scale: Float[np.ndarray, " state"]


def simulate(
    system: SampledStateSpace,
    u: Float[np.ndarray, "sample input"],
    start: Float[np.ndarray, " state"] | None = None,
) -> tuple[Float[np.ndarray, "sample output"], Float[np.ndarray, " state"]]:
    """Outputs y[k] = C x[k] + D u[k] and the state after the last sample, from ``start`` (zero if None).

    Raises `ConfigError` for an input of other channels or a start of another size.

    >>> import numpy as np
    >>> y, x = simulate(SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]], period_s=1.0), np.ones((3, 1)))
    >>> y.ravel(), x
    (array([0. , 1. , 1.5]), array([1.75]))
    """
    u, x = _as_input(system, u), _as_start(system, start)
    blocks = _write_out(system, len(u))
    if blocks is None:
        return _step(system, u, x)
    y = np.empty((len(u), len(system.C)))
    for first in range(0, len(u), CHUNK):
        x = _advance(system, blocks, u[first : first + CHUNK], x, y[first : first + CHUNK])
    return y, x


def stream(
    system: SampledStateSpace, blocks: Iterable[Float[np.ndarray, "sample input"]]
) -> Iterator[Float[np.ndarray, "sample output"]]:
    """`simulate` from rest for an input in pieces, which may exceed memory; yields the outputs of each piece.

    >>> import numpy as np
    >>> sums = SampledStateSpace([[1.0]], [[1.0]], [[1.0]], [[0.0]], period_s=1.0)
    >>> [y.ravel().tolist() for y in stream(sums, (np.ones((2, 1)) for _ in range(2)))]
    [[0.0, 1.0], [2.0, 3.0]]
    """
    x = _as_start(system, None)
    written = _write_out(system, CHUNK)
    for piece in blocks:
        u = _as_input(system, piece)
        if written is None:
            y, x = _step(system, u, x)
        else:
            y = np.empty((len(u), len(system.C)))
            x = _advance(system, written, u, x, y)
        yield y


def find_periodic_state(
    system: SampledStateSpace, u: Float[np.ndarray, "sample input"]
) -> Float[np.ndarray, " state"]:
    """The state x0 at the start of a steady period of ``u``: x0 = A^N x0 + (one period from rest).

    Each state is counted in what it reaches from rest, so that units of states and inputs have no say. A pole
    that repeats itself after N samples (a rigid-body mode, an undamped one on a line) has no steady state
    where ``u`` drives it: `NumericalError`, if an output shows it. Where nothing does, it may have any: the
    smallest is taken.
    """
    reach = _reach(system, u)
    moved = np.flatnonzero(reach)
    size, end = reach[moved], simulate(system, u)[1][moved]
    A = system.A[np.ix_(moved, moved)] * size / size[:, None]
    left = np.eye(len(moved)) - np.linalg.matrix_power(A, len(u))
    start = np.zeros(len(reach))
    start[moved] = size * np.linalg.lstsq(left, end / size, rcond=REPEATS)[0]
    first, after = simulate(system, u, start)
    change = np.abs(simulate(system, u, after)[0] - first).max(axis=0)
    if np.any(change > STEADY * np.abs(first).max(axis=0)):
        raise NumericalError(
            "no periodic steady state: a pole repeats itself from period to period",
            hint="hold the rigid-body modes, or start from rest",
        )
    return start


def _reach(system: SampledStateSpace, u: np.ndarray) -> Float[np.ndarray, " state"]:
    """Largest magnitude of each state from rest, in a period and at least as many samples as states."""
    n = len(system.A)
    states = dataclasses.replace(system, C=np.eye(n), D=np.zeros((n, system.B.shape[1])))
    samples = np.arange(max(len(u), n) + 1) % len(u)
    pieces = (u[samples[k : k + CHUNK]] for k in range(0, len(samples), CHUNK))
    return np.max([np.abs(x).max(axis=0) for x in stream(states, pieces)], axis=0)


def _as_input(system: SampledStateSpace, u: np.ndarray) -> Float[np.ndarray, "sample input"]:
    u = np.asarray(u, dtype=float)
    if u.ndim != 2 or u.shape[1] != system.B.shape[1]:
        raise ConfigError(
            f"an input of shape {u.shape} for a system of {system.B.shape[1]} inputs",
            hint="samples in rows, one column for each input",
        )
    return u


def _as_start(system: SampledStateSpace, start: np.ndarray | None) -> Float[np.ndarray, " state"]:
    x = np.zeros(len(system.A)) if start is None else np.array(start, dtype=float)
    if x.shape != (len(system.A),):
        raise ConfigError(f"a start of shape {x.shape} for {len(system.A)} states", hint="one each, or None")
    return x


def _step(
    system: SampledStateSpace, u: np.ndarray, start: np.ndarray
) -> tuple[Float[np.ndarray, "sample output"], Float[np.ndarray, " state"]]:
    """Outputs and final state, stepped sample by sample."""
    A = np.ascontiguousarray(system.A)
    drive = u @ system.B.T
    states = np.empty((len(u) + 1, len(A)))
    states[0] = start
    for k in range(len(u)):
        np.dot(A, states[k], out=states[k + 1])
        states[k + 1] += drive[k]
    return states[:-1] @ system.C.T + u @ system.D.T, states[-1].copy()


def _advance(
    system: SampledStateSpace, blocks: _Blocks, u: np.ndarray, x: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """Outputs to ``u`` from ``x``, written into ``y``, and the state after them."""
    m, p = system.B.shape[1], len(system.C)
    length = blocks.through.shape[0] // p
    whole = len(u) // length * length
    inputs = u[:whole].reshape(-1, length * m)
    collected = inputs @ blocks.collect.T
    states = np.empty((len(inputs) + 1, len(x)))
    states[0] = x / blocks.scale
    for k, own in enumerate(collected):
        np.dot(blocks.after, states[k], out=states[k + 1])
        states[k + 1] += own + np.dot(blocks.rest, states[k])
    outputs = inputs @ blocks.through.T
    outputs += states[:-1] @ blocks.observe.T
    y[:whole] = outputs.reshape(whole, p)
    y[whole:], end = _step(system, u[whole:], states[-1] * blocks.scale)
    return end


def _write_out(system: SampledStateSpace, samples: int) -> _Blocks | None:
    """The system over the cheapest number of samples; None where stepping is as cheap or powers of A grow."""
    n, m, p = len(system.A), system.B.shape[1], len(system.C)
    if n == 0 or m == 0 or p == 0 or not np.isfinite(system.A).all():
        return None
    # A block of L costs its step and L^2 m p in all: least per sample at this L.
    best = min(LONGEST, np.sqrt((STEP_COST + n * n) / (m * p)), samples / 8)
    balanced, scale = balance(system.A)
    A, B, C = balanced, system.B / scale[:, None], system.C * scale
    length, after, rest = 1, A, np.zeros_like(A)
    while 2 * length <= best:
        twice, left_over = _square(after, rest)
        if np.abs(twice).sum(axis=1).max() > GROWTH:
            break
        length, after, rest = 2 * length, twice, left_over
    if length == 1:
        return None
    drive, seen = [B], [C]
    for _ in range(length - 1):
        drive.append(A @ drive[-1])
        seen.append(seen[-1] @ A)
    markov = [system.D, *(C @ gain for gain in drive[:-1])]
    through = np.zeros((length, p, length, m))
    for delay, gain in enumerate(markov):
        for k in range(delay, length):
            through[k, :, k - delay] = gain
    return _Blocks(
        after=after,
        rest=rest,
        collect=np.hstack(drive[::-1]),
        observe=np.vstack(seen),
        through=through.reshape(length * p, length * m),
        scale=scale,
    )


def _square(
    high: Float[np.ndarray, "state state"], low: Float[np.ndarray, "state state"]
) -> tuple[np.ndarray, np.ndarray]:
    """The square of ``high`` + ``low`` in two parts, accurate to some 70 bits.

    The leading bits of either factor multiply without rounding (Ozaki, Ogita, Oishi and Rump 2012).
    """
    left, right = _leading(high, axis=1), _leading(high, axis=0)
    exact = left @ right
    small = left @ (high - right) + (high - left) @ high + high @ low + low @ high
    nearest = exact + small
    return nearest, (exact - nearest) + small


def _leading(matrix: Float[np.ndarray, "state state"], axis: int) -> Float[np.ndarray, "state state"]:
    """Leading bits of each row (axis 1) or column (axis 0), few enough that sums of products are exact."""
    bits = (53 - int(np.ceil(np.log2(len(matrix) + 1)))) // 2
    peak = np.abs(matrix).max(axis=axis, keepdims=True)
    exponent = np.ceil(np.log2(np.where(peak > 0.0, peak, 1.0)))
    large = 2.0 ** (exponent + 53 - bits)
    return (matrix + large) - large
