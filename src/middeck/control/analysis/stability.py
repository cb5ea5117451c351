"""Stability of a loop with exact delays: roots found from an approximation, and counted, lest one is missed.

With f = det(1 - K G) and f_n the same with delays approximated, f / f_n has no open-loop poles: it has the
roots of the delayed loop as zeros and those of the approximation, which are eigenvalues, as poles. Its change
of phase along the axis is therefore the difference of the two numbers of unstable roots, whatever integrators
and rigid modes the plant has.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.lines import HALF_WIDTHS, MOST_DELAY_LINES, PER_DECADE
from middeck.control.analysis.loop import (
    AnyLaw,
    AnyPlant,
    FeedbackLoop,
    Halves,
    approximate_halves,
    close_channels,
    evaluate_halves,
    form_loop,
    is_late,
    period_of,
    resolve,
)
from middeck.control.delay_order import pade_order
from middeck.errors import NumericalError
from middeck.systems.delayed_plant import DelayedPlant, approximate_delays
from middeck.systems.resolvent import Resolvent
from middeck.systems.stability import GROWTH_LIMIT, growth_rates, none_grows
from middeck.systems.statespace import SampledStateSpace, gain_system
from middeck.values import record

MOST_ORDER = 64
LIGHT = 0.1
"""Damping ratio below which a pole needs a good approximation at its own frequency."""
NEWTON_STEPS = 12
UNMOVED = 1e-9
"""A mode that the loop moves by less, relative to itself, stands as it is: evaluation cannot tell."""
ON_ROOT = 1e-2
"""|f| at a root beside |f| a thousandth of the way to the next pole: within 1e-5 of that way."""
ONE_ROOT, TWO_STARTS = 1e-8, 1e-6
REACH = 0.1
"""How far left of the axis roots are counted, times the longest delay: a wave changes by a tenth there."""
NEAREST_AXIS = 12
"""Roots followed to the exact delay beside those that are counted."""
STEP = 0.7
"""Largest change of phase [rad] that is believed from line to line."""
ROUNDS, DOUBLINGS = 60, 40


@record
class LoopStability:
    """Whether a loop is stable, and by how much.

    Parameters
    ----------
    stable:
        No root grows by more than 1e-8 rad/s.
    pole:
        The root of largest real part [rad/s], imaginary part not negative; of a sampled loop log(z)/T.
    frequency_hz:
        Its imaginary part.
    margin:
        Minus its real part [rad/s]: the least decay, negative for growth.
    damping:
        Its damping ratio.
    growing:
        How many roots grow, conjugates counted.
    """

    stable: bool
    pole: complex
    frequency_hz: float
    margin: float
    damping: float
    growing: int


def decide_stability(plant: AnyPlant, law: AnyLaw) -> LoopStability:
    """Stability with exact delays, modes included that the law does not move; unstable is an outcome.

    Without delays, and for sampled loops, by eigenvalues. With delays the poles of an approximation, good at
    the frequencies of all light modes, are carried to roots of det(1 - K G) by Newton's method; those right
    of a line on the left of the axis are counted by the argument principle. Only roots at which the
    determinant vanishes count as found; where found and counted disagree the order is raised.

    Raises
    ------
    ConfigError
        For halves that do not fit (`form_loop`).
    NumericalError
        Where roots and count disagree at the highest order.

    Examples
    --------
    >>> from middeck.control.compensator import Compensator
    >>> from middeck.systems.delayed_plant import delay_inputs
    >>> from middeck.systems.plant import Plant
    >>> from middeck.systems.ports import Port
    >>> from middeck.systems.statespace import StateSpace, gain_system
    >>> force, way = Port("force", "N"), Port("way", "m")
    >>> integrator = Plant(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), (force,), (way,))
    >>> P = Compensator(gain_system(np.array([[-1.0]])), (way,), (force,))
    >>> [decide_stability(delay_inputs(integrator, tau), P).stable for tau in (1.57, 1.58)]     # pi / 2
    [True, False]
    """
    return decide_loop(form_loop(plant, law))


def decide_loop(loop: FeedbackLoop) -> LoopStability:
    """The same of a loop that is formed."""
    if not is_late(loop):
        return _outcome(_eigenvalues(loop))
    if _direct_gain(loop) >= 1.0:
        # A neutral equation: a chain of roots on or right of the axis (Hale and Verduyn Lunel 1993).
        return LoopStability(False, complex(np.inf, np.inf), np.inf, -np.inf, 0.0, -1)
    halves, open_poles, reach = evaluate_halves(loop), _open_poles(loop), _reach(loop)
    found, counted = 0, None
    for order in _orders(loop, open_poles):
        near = _eigenvalues(loop, order)
        roots, others = _follow(halves, near, open_poles, reach)
        wall = _clear_wall(np.real(np.concatenate([near, roots, open_poles])), reach)
        more = _turns(loop, halves, order, np.concatenate([near, roots]), wall)
        found = int(np.sum(np.real(roots) > wall))
        counted = None if more is None else int(np.sum(np.real(near) > wall)) + more
        if found == counted:
            return _outcome(np.concatenate([roots, others[np.real(others) < wall]]))
    raise NumericalError(
        f"stability with delays cannot be decided: {found} roots found near and right of the axis, "
        f"{'an unclear number' if counted is None else counted} counted",
        hint="a shorter delay or less gain at high frequency; or a root lies on the axis",
    )


def _orders(loop: FeedbackLoop, open_poles: np.ndarray) -> list[int]:
    """Orders to try: first one that is right at the fastest light mode, then twice and four times that.

    Modes too fast for `MOST_ORDER` are found from their own poles.
    """
    assert isinstance(loop.plant, DelayedPlant)
    fastest = np.abs(open_poles[_is_light(open_poles)]).max(initial=0.0)
    first = min(pade_order(fastest * loop.plant.delay_s.max()), MOST_ORDER)
    return [first, 2 * first, 4 * first]


def _is_light(poles: np.ndarray) -> np.ndarray:
    return (np.imag(poles) > 0.0) & (np.abs(np.real(poles)) < LIGHT * np.abs(poles))


def _reach(loop: FeedbackLoop) -> float:
    """How far left of the axis [rad/s] to count: not into the chain of roots that a direct term has."""
    assert isinstance(loop.plant, DelayedPlant)
    direct = _direct_gain(loop)
    chain = -0.25 * np.log(direct) if direct > 0.0 else np.inf
    return float(min(REACH, chain) / loop.plant.delay_s.max())


def _eigenvalues(loop: FeedbackLoop, order: int | None = None) -> Complex[np.ndarray, " root"]:
    """Poles of the closed loop [rad/s] with approximated delays, or of the sampled loop."""
    closed, period = close_channels(approximate_halves(loop, order)), period_of(loop)
    if period is None:
        return growth_rates(closed)
    return growth_rates(SampledStateSpace(closed.A, closed.B, closed.C, closed.D, period))


def _outcome(roots: Complex[np.ndarray, " root"]) -> LoopStability:
    if not len(roots):
        return LoopStability(True, complex(-np.inf, 0.0), 0.0, np.inf, 1.0, 0)
    lead = complex(roots[np.argmax(np.real(roots))])
    pole = complex(lead.real, abs(lead.imag))
    damping = -pole.real / abs(pole) if 0.0 < abs(pole) < np.inf else float(pole.real < 0.0)
    growing = int(np.sum(np.real(roots) > GROWTH_LIMIT))
    return LoopStability(
        none_grows(roots), pole, pole.imag / (2.0 * np.pi), -pole.real, float(damping), growing
    )


def _direct_gain(loop: FeedbackLoop) -> float:
    """How much a wave without end keeps of itself each time round; one or more is unstable.

    Exact where all paths with a direct term are late alike; otherwise from absolute values, an upper bound.
    """
    if not isinstance(loop.plant, DelayedPlant):
        return 0.0
    through, law = loop.plant.plant.system.D, loop.law.D
    late = loop.plant.delay_s[through != 0.0]
    if not late.size or not np.any(late):
        return 0.0
    alike = bool(np.all(late == late[0]))
    if not alike:
        through, law = np.abs(through), np.abs(law)
    gain = float(np.abs(np.linalg.eigvals(law @ through)).max(initial=0.0))
    if not alike and gain >= 1.0:
        raise NumericalError(
            f"a direct term of loop gain {gain:.3g} comes back by paths that are late by different times",
            hint="a law or a plant that rolls off",
        )
    return gain


def _follow(
    halves: Halves, near: np.ndarray, open_poles: np.ndarray, reach: float
) -> tuple[Complex[np.ndarray, " root"], Complex[np.ndarray, " root"]]:
    """Roots of the loop from the poles ``near`` them and from the open loop's light ones; and what is none.

    The latter are poles of the approximation that lead to no root, or that are too far left to be followed.
    """
    upper = near[np.imag(near) >= 0.0]
    upper = upper[np.argsort(-np.real(upper), kind="stable")]
    count = int(np.sum(np.real(upper) > -reach)) + NEAREST_AXIS
    light = open_poles[_is_light(open_poles) & (np.abs(open_poles) > 1e-3 * reach)]
    # Not on the pole itself, where nothing is finite.
    start = np.concatenate([upper[:count], light + 1e-6 * np.abs(light)])
    roots, is_root = _newton(halves, start, open_poles, reach)
    own = np.arange(len(start)) < len(upper[:count])
    roots = _once(roots[is_root], start[is_root], own[is_root])
    return _with_conjugates(roots), _with_conjugates(np.append(start[own & ~is_root], upper[count:]))


def _with_conjugates(upper: np.ndarray) -> Complex[np.ndarray, " root"]:
    return np.concatenate([upper, np.conj(upper[np.imag(upper) > 0.0])])


def _once(roots: np.ndarray, start: np.ndarray, own: np.ndarray) -> Complex[np.ndarray, " root"]:
    """Each root once; twice where two poles of the approximation coincide there."""
    kept: list[int] = []
    for i in range(len(roots)):
        size = np.abs(roots[i])
        same = [k for k in kept if np.abs(roots[k] - roots[i]) <= ONE_ROOT * size]
        apart = [np.abs(start[k] - start[i]) > TWO_STARTS * size for k in same]
        if not same or (own[i] and not any(apart)):
            kept.append(i)
    return roots[kept]


def _open_poles(loop: FeedbackLoop) -> Complex[np.ndarray, " pole"]:
    plant = loop.plant.plant.system if isinstance(loop.plant, DelayedPlant) else loop.plant
    return np.concatenate([np.linalg.eigvals(plant.A), np.linalg.eigvals(loop.law.A)]).astype(complex)


def _newton(
    halves: Halves, start: np.ndarray, open_poles: np.ndarray, reach: float
) -> tuple[Complex[np.ndarray, " root"], np.ndarray]:
    """Newton's method on f(s) times all (s - p), which has no poles; and where it ended at a root.

    A mode that the loop does not move is a root of this product, though not of f: it stays as it is.
    """
    size = np.maximum(np.abs(start), 1e-3 * reach)
    unmoved = np.abs(start[:, None] - open_poles).min(axis=1, initial=np.inf) <= UNMOVED * size
    s, real = start.copy(), np.imag(start) == 0.0
    on_root = np.zeros(len(s), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            # Differences over a thousandth of the way to the next pole err by 1e-6 of the slope.
            away = s[:, None] - open_poles
            way = np.abs(away).min(axis=1, initial=np.inf)
            h = 1e-3 * np.where(np.isfinite(way), way, size)
            middle, left, right = (_determinant(halves, x) for x in (s, s - h, s + h))
            beside = np.maximum(np.abs(left), np.abs(right))
            on_root = np.isfinite(beside) & (np.abs(middle) <= ON_ROOT * beside)
            step = middle / ((right - left) / (2.0 * h) + middle * np.sum(1.0 / away, axis=1))
            s = np.where(np.isfinite(step) & ~unmoved, s - step, s)
            s = np.where(real, np.real(s) + 0.0j, s)
    ended = np.where(np.imag(s) < 0.0, np.conj(s), s)
    return ended, unmoved | on_root


def _determinant(halves: Halves, s: np.ndarray) -> Complex[np.ndarray, " point"]:
    G, K = halves(s)
    loop = np.eye(K.shape[1]) - K @ G
    finite = np.isfinite(loop).all(axis=(1, 2))
    value = np.full(len(s), np.nan + 0.0j)
    value[finite] = np.linalg.det(loop[finite])
    return value


def _clear_wall(real: np.ndarray, reach: float) -> float:
    """A line Re s left of the axis with nothing beside it: the middle of the widest gap within ``reach``.

    Whatever grows, and what is nearer to the axis than the line, is to its right: found and counted.
    """
    inside = np.sort(real[(real > -reach) & (real < 0.0)])
    edges = np.concatenate([[-reach], inside, [0.0]])
    k = int(np.argmax(np.diff(edges)))
    return float(0.5 * (edges[k] + edges[k + 1]))


def _turns(loop: FeedbackLoop, halves: Halves, order: int, roots: np.ndarray, wall: float) -> int | None:
    """How many roots right of ``wall`` the delayed loop has more than its approximation; None if unclear."""
    phase = _phase(loop, halves, order)
    omega = _wall_lines(loop, halves, roots, wall)
    ratio, away = phase(wall + 1j * omega)
    for _ in range(ROUNDS):
        step = np.angle(ratio[1:] * np.conj(ratio[:-1]))
        coarse = (np.abs(step) > STEP) & (np.diff(omega) > 1e-14 * omega[1:])
        if not coarse.any():
            break
        middle = 0.5 * (omega[:-1] + omega[1:])[coarse]
        between, _ = phase(wall + 1j * middle)
        place = np.flatnonzero(coarse) + 1
        omega, ratio = np.insert(omega, place, middle), np.insert(ratio, place, between)
    step = np.angle(ratio[1:] * np.conj(ratio[:-1]))
    # From the last line along Re s to infinity both loops are small: their phase is that of 1 - K G itself.
    half_turns = (away[-1] - step.sum()) / np.pi
    near = round(float(half_turns)) if np.isfinite(half_turns) else 0
    clear = np.all(np.abs(step) <= STEP) and abs(half_turns - near) < 0.1
    return near if clear else None


def _phase(
    loop: FeedbackLoop, halves: Halves, order: int
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """f / f_n of size one, and its phase where both loops are small."""
    assert isinstance(loop.plant, DelayedPlant)
    late, smoothed = loop.plant.delay_s, _smoothed_delays(loop.plant, order)

    def evaluate(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        G, K = halves(s)
        identity = np.eye(K.shape[1])
        exact = identity - K @ G
        near = identity - K @ (G * np.exp(s[:, None, None] * late) * smoothed(s))
        ratio = np.linalg.slogdet(exact)[0] * np.conj(np.linalg.slogdet(near)[0])
        away = [np.angle(np.linalg.eigvals(M[-1])).sum() for M in (exact, near)]
        return ratio, np.full(len(s), away[0] - away[1])

    return evaluate


def _smoothed_delays(plant: DelayedPlant, order: int) -> Resolvent:
    """What stands for exp(-s tau) of each path in `approximate_delays`: that of a plant of ones."""
    ones = dataclasses.replace(
        plant.plant, dynamics=gain_system(np.ones(plant.delay_s.shape)), state_names=()
    )
    return resolve(approximate_delays(DelayedPlant(ones, plant.delay_s), order).system)


def _wall_lines(
    loop: FeedbackLoop, halves: Halves, roots: np.ndarray, wall: float
) -> Float[np.ndarray, " line"]:
    """Frequencies from zero to where the loop is small, dense beside the roots and for the delay."""
    assert isinstance(loop.plant, DelayedPlant)
    size = np.abs(np.concatenate([roots, _open_poles(loop)]))
    moving = size[size > 1e-9 * size.max(initial=0.0)]
    low, high = (0.01 * moving.min(), 2.0 * moving.max()) if len(moving) else (0.01, 100.0)
    top = _where_small(halves, wall, high, _direct_gain(loop))
    centre, width = np.abs(np.imag(roots)), np.abs(np.real(roots) - wall)
    beside = centre[:, None] + width[:, None] * np.concatenate([-HALF_WIDTHS, HALF_WIDTHS])
    late = float(loop.plant.delay_s.max())
    waves = np.arange(1, min(int(2.0 * top * late) + 1, MOST_DELAY_LINES)) * 0.5 / late
    lines = np.geomspace(low, top, int(PER_DECADE * np.log10(top / low)) + 2)
    omega = np.unique(np.concatenate([[0.0], lines, beside.ravel(), waves]))
    return omega[(omega >= 0.0) & (omega <= top)]


def _where_small(halves: Halves, wall: float, omega: float, direct: float) -> float:
    """From where on a wave is less than half of itself each time round, or half-way to what stays of it."""
    for _ in range(DOUBLINGS):
        G, K = halves(wall + 1j * omega * np.array([1.0, 1.3, 1.7, 2.3]))
        if np.abs(np.linalg.eigvals(K @ G)).max(initial=0.0) < 0.5 * (1.0 + direct):
            return omega
        omega *= 2.0
    raise NumericalError("stability with delays: the loop gain does not fall with frequency")
