"""The return ratio of one channel of a sampled loop, its own paths delayed by part of a period more.

With all other loops closed, L = -R G: R is the transfer from the channel's paths back to it, and does not
depend on their delay; G are the paths. The state of a path at the samples does not depend on its delay
either, so that a delay only reads it at another instant between them: y(kT + f T) = C exp(A f T) x[k] +
(C int_0^fT exp(A t) dt B + D) u[k].

Beside a free body that other loops hold too, R vanishes as G grows, and rounding hides their product. What a
delay does to a gain as large as that is a turn.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import (
    At,
    FeedbackLoop,
    approximate_halves,
    close_channels,
    moved_part,
    resolve,
)
from middeck.control.analysis.margins.shared_gain import TRUSTED, closed_ratio
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.resolvent import Resolvent
from middeck.systems.sampling.delayed_sampling import tidy_samples
from middeck.systems.sampling.sampling import hold_inputs
from middeck.systems.state_space.statespace import LinearSystem, SampledStateSpace, StateSpace, dual

DelayedChannel = Callable[[float], Callable[[np.ndarray], np.ndarray]]
"""L [line, 1] as a function of s, of a channel delayed by a part of a period more."""


def delayed_channels(
    loop: FeedbackLoop, path: Plant, at: At, lines: Float[np.ndarray, " line"]
) -> list[DelayedChannel]:
    """The channels of the sampled ``loop`` at which it is broken, the others closed.

    ``path`` is its continuous plant. What does not depend on the delay is remembered at ``lines`` [rad/s].
    """
    path, period = moved_part(FeedbackLoop(path, loop.law)).plant, float(loop.period_s or 0.0)
    halves, system, now = approximate_halves(loop), remove_delays(path).system, closed_ratio(loop, at)
    delay, z, (ny, nu) = path.delay_s / period, np.exp(1j * lines * period), system.D.shape
    found: list[DelayedChannel] = []

    def add(paths: StateSpace, delay: np.ndarray, closed: LinearSystem) -> None:
        k = len(found)
        found.append(
            _channel(paths, delay, _remembered(resolve(closed), z), lambda s: now(s)[:, k], z, period)
        )

    for i in range(nu) if at != "outputs" else ():
        closed = close_channels(halves, [i]).select(range(nu, nu + ny), [i])
        add(system.select([i], range(ny)), delay[:, i], closed)
    for o in range(ny) if at != "inputs" else ():
        closed = close_channels(halves, [nu + o]).select([nu + o], range(nu))
        add(dual(system.select(range(nu), [o])), delay[o], closed)
    return found


def _channel(
    paths: StateSpace,
    delay: Float[np.ndarray, " path"],
    back: Resolvent,
    now: Resolvent,
    z: Complex[np.ndarray, " line"],
    period: float,
) -> DelayedChannel:
    """One input through ``paths``, ``delay`` in samples, and ``back``; ``now`` is L without a delay more.

    Of a measurement the paths are transposed.
    """
    hold, drive = hold_inputs(paths, period)
    held = SampledStateSpace(hold, drive, np.eye(len(hold)), np.zeros_like(drive), period_s=period)
    states = _remembered(resolve(held), z)

    def delayed(part: float) -> Callable[[np.ndarray], np.ndarray]:
        samples = tidy_samples(delay + part)
        whole = np.ceil(samples)
        C, D = paths.C.copy(), paths.D[:, 0].copy()
        for o in np.flatnonzero(whole > samples):
            after, driven = hold_inputs(paths, float(whole[o] - samples[o]) * period)
            C[o], D[o] = paths.C[o] @ after, D[o] + paths.C[o] @ driven[:, 0]

        def ratio(s: np.ndarray) -> Complex[np.ndarray, "line 1"]:
            z = np.exp(s * period)
            G, R = (states(z)[:, :, 0] @ C.T + D) * z[:, None] ** -whole, back(z).reshape(len(z), -1)
            L, error = -np.sum(R * G, axis=1), np.finfo(float).eps * np.sum(np.abs(R) * np.abs(G), axis=1)
            hidden = error > TRUSTED * (1.0 + np.abs(L))
            if hidden.any():
                L[hidden] = now(s[hidden]) * z[hidden] ** -part
            return L[:, None]

        return ratio

    return delayed


def _remembered(response: Resolvent, z: np.ndarray) -> Resolvent:
    known = functools.cache(lambda: response(z))
    return lambda points: known() if np.array_equal(points, z) else response(points)
