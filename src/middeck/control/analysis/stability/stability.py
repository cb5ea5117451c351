"""Stability of a loop with exact delays: roots are found from an approximation and verified by counting."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import (
    FeedbackLoop,
    approximate_halves,
    close_channels,
    evaluate_halves,
    form_loop,
    split_unmoved,
)
from middeck.control.analysis.stability.delayed_roots import (
    NEAR,
    find_open_poles,
    follow_roots,
    is_light,
    keep_certain,
)
from middeck.control.analysis.stability.root_count import clear_walls, count_more, direct_gain
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import pade_order
from middeck.control.law.rounding_of_results import measure_known
from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.rounding import LIGHTEST, ROUNDINGS, is_vague, poles_with_rounding
from middeck.systems.poles.stability import all_decay, growth_limits, growth_rates, none_grows
from middeck.systems.poles.verdict import CURE, OPEN, is_reached, may_cross
from middeck.systems.state_space.statespace import LinearSystem
from middeck.values import record

MOST_ORDER = 64
KEPT = 16
"""Loops of which `decide_loop` keeps what it found: stability is asked for, then margins."""
REACH = 0.1
"""Distance left of the axis up to which roots are counted, times the longest delay."""


@record(kw_only=True)
class LoopStability:
    """Whether a loop is stable, and by how much.

    Attributes:
        stable: No root grows by more than 1e-8 rad/s, or more than rounding at high frequencies and rates.
        pole: The root of largest real part [rad/s], imaginary part not negative; of a sampled loop log(z)/T.
        frequency_hz: Its imaginary part.
        margin: Minus its real part [rad/s]: the least decay, negative for growth.
        damping: Its damping ratio.
        growing: Number of roots that grow, conjugates counted; -1 where more may grow than were found, and
            faster than ``pole``.
        decays: All roots decay by more than rounding: none stays on the axis.
    """

    stable: bool
    pole: complex
    frequency_hz: float
    margin: float
    damping: float
    growing: int
    decays: bool


@named_kinds
def decide_stability(plant: Plant, law: Compensator) -> LoopStability:
    """Stability with exact delays, including modes that the compensator does not move.

    Loops without delays and sampled loops are decided by eigenvalues. With delays, the poles of an
    approximation valid for all light modes start Newton's method on det(1 - K G); roots right of a line left
    of the axis are also counted by the argument principle. Only roots at which the determinant vanishes count
    as found; where found and counted disagree the order is raised. Where they still do, one root that a
    circle right of the axis holds proves the loop unstable.

    Raises `ConfigError` for halves that do not fit (`form_loop`); `NumericalError` where roots and count
    disagree at the highest order, right of every line that was tried, and none is sure to grow, or where
    rounding of the matrices alone may take a root across the axis. Warns (`UserWarning`) where it makes
    margin or damping uncertain (`measure_known`).

    >>> import middeck as md
    >>> integrator = md.make_plant([[0.0]], [[1.0]], [[1.0]])
    >>> none, gain = np.zeros((0, 1)), -np.eye(1)
    >>> law = md.systems.StateSpace(none @ none.T, none, none.T, gain)
    >>> P = md.Compensator(law, integrator.outputs, integrator.inputs)
    >>> [decide_stability(md.delay_plant(integrator, tau), P).stable for tau in (1.57, 1.58)]     # pi / 2
    [True, False]
    """
    return measure_known(
        "margin and damping", lambda *both: decide_loop(form_loop(*both)), _numbers, plant, law
    )


def _numbers(found: LoopStability) -> Float[np.ndarray, " number"]:
    return np.log(np.maximum(np.abs([found.margin, found.damping]), LIGHTEST))


@functools.lru_cache(maxsize=KEPT)
def decide_loop(loop: FeedbackLoop) -> LoopStability:
    """`decide_stability` for a loop already formed; margin and damping may be uncertain."""
    roots, counted = _search_roots(loop, known=False)
    found = judge_roots(roots, loop.period_s)
    return found if counted else dataclasses.replace(found, growing=-1)


def find_roots(loop: FeedbackLoop, *, known: bool = False) -> Complex[np.ndarray, " root"]:
    """Roots of a loop [rad/s]: all that matter for stability, exact, and those left of them as approximated.

    An infinite one stands for a chain of roots on or right of the axis. Of an unstable loop some may be
    missing. Raises as `decide_stability`, but not for rounding of the matrices where these are given as
    ``known``.
    """
    return _search_roots(loop, known=known)[0]


def _search_roots(loop: FeedbackLoop, *, known: bool) -> tuple[Complex[np.ndarray, " root"], bool]:
    """`find_roots`, and whether the count says that none right of the axis is missing."""
    if not loop.plant.delayed:
        moved, unmoved = split_unmoved(loop)
        if not known:
            require_known(loop, moved)
        return np.concatenate([loop_poles(moved), unmoved]), True
    if direct_gain(loop) >= 1.0:  # a neutral equation (Hale and Verduyn Lunel 1993)
        return np.array([complex(np.inf, np.inf)]), True
    whole = loop
    loop, unmoved = split_unmoved(whole)
    if not known:
        require_known(whole, loop)
    halves, reach = evaluate_halves(loop), _reach(loop)
    open_poles, rounding = find_open_poles(loop)
    vague = any(map(is_vague, _parts(loop)))
    vague |= bool(np.any(is_light(open_poles) & (rounding > NEAR * np.abs(open_poles))))
    found, counted, roots = 0, None, np.zeros(0, dtype=complex)
    orders = _orders(loop, open_poles)
    for order, apart in itertools.product(orders, (True,) if vague else (False, True)):
        near, crosses = _near(loop, order, apart)
        roots, others = follow_roots(halves, near, open_poles, rounding, reach)
        walls = clear_walls(np.real(np.concatenate([near, roots, open_poles])), reach)
        for wall in walls if order == orders[-1] else walls[:1]:
            more = None
            if not crosses(wall):
                more = count_more(loop, halves, order, np.concatenate([near, roots]), wall)
            found = int(np.sum(np.real(roots) > wall))
            counted = None if more is None else int(np.sum(np.real(near) > wall)) + more
            if found == counted:
                return np.concatenate([roots, others[np.real(others) < wall], unmoved]), True
    roots = keep_certain(halves, roots, open_poles)
    if not none_grows(roots):
        return np.concatenate([roots, unmoved]), False
    raise NumericalError(
        f"stability with delays cannot be decided: {found} roots found near and right of the axis, "
        f"{'an unclear number' if counted is None else counted} counted",
        hint="change the gain by a thousandth if a root lies on the axis; give one delay for each input and "
        "output instead of one for each path; take states of like sizes, as modal ones; or sample the loop: "
        "its stability follows from eigenvalues",
    )


def require_known(loop: FeedbackLoop, moved: FeedbackLoop | None = None) -> None:
    """Raise `NumericalError` where rounding of vague halves leaves the loop's stability open.

    Also where stability goes by which integrators count as unmoved, ``moved`` being the loop without these.
    """
    if not any(map(is_vague, _parts(loop))):
        return
    closed = close_channels(approximate_halves(loop))
    # With delays roots are counted, too.
    roundings = 1.0 if loop.plant.delayed else ROUNDINGS
    grow = [] if moved is None else [growth_rates(closed), loop_poles(moved)]
    if may_cross(closed, roundings) or len({none_grows(rates, loop.period_s) for rates in grow}) > 1:
        raise NumericalError(f"stability cannot be decided: {OPEN}", hint=CURE)


def _parts(loop: FeedbackLoop) -> tuple[LinearSystem, LinearSystem]:
    plant = remove_delays(loop.plant).system if loop.period_s is None else loop.plant.sampled
    return plant, loop.law


def _near(
    loop: FeedbackLoop, order: int, apart: bool
) -> tuple[Complex[np.ndarray, " root"], Callable[[float], bool]]:
    """Poles of the loop with approximated delays, those near zero replaced by their mean or ``apart``.

    Where they stay apart, also whether rounding may move one across a vertical line or the axis. Modes that
    are slow beside the entries of A need that: `growth_rates` takes them for integrators that rounding has
    split, and no root is near their mean.
    """
    if not apart:
        return loop_poles(loop, order), lambda wall: False
    A = close_channels(approximate_halves(loop, order)).A
    near, blur = poles_with_rounding(A)

    def crosses(wall: float) -> bool:
        """To first order, and by the resolvent where that says so: poles that nearly coincide move less."""
        upper = np.imag(near) >= 0.0
        return any(
            is_reached(A, complex(line, s.imag), 1.0)
            for line in (0.0, wall)
            for s in near[upper & (np.abs(np.real(near) - line) <= blur)]
        )

    return near, crosses


def _orders(loop: FeedbackLoop, open_poles: np.ndarray) -> list[int]:
    """Orders to try: one accurate at the fastest light mode, then twice and four times that.

    Modes too fast for `MOST_ORDER` are found from their open poles.
    """
    fastest = np.abs(open_poles[is_light(open_poles)]).max(initial=0.0)
    first = min(pade_order(fastest * loop.plant.delay_s.max()), MOST_ORDER)
    return [first, 2 * first, 4 * first]


def _reach(loop: FeedbackLoop) -> float:
    """Distance left of the axis [rad/s] for counting, short of the chain of roots of a direct term."""
    direct = direct_gain(loop)
    chain = -0.25 * np.log(direct) if direct > 0.0 else np.inf
    return float(min(REACH, chain) / loop.plant.delay_s.max())


def loop_poles(loop: FeedbackLoop, order: int | None = None) -> Complex[np.ndarray, " root"]:
    """Poles of the closed loop [rad/s] with approximated delays, or of the sampled loop, for ranking."""
    return growth_rates(close_channels(approximate_halves(loop, order)))


def judge_roots(roots: Complex[np.ndarray, " root"], period_s: float | None = None) -> LoopStability:
    """The verdict on the roots of `find_roots`."""
    lead = complex(roots[np.argmax(np.real(roots))]) if len(roots) else complex(-np.inf)
    pole = complex(lead.real, abs(lead.imag))
    damping = -pole.real / abs(pole) if 0.0 < abs(pole) < np.inf else float(pole.real < 0.0)
    chain = pole.real == np.inf
    return LoopStability(
        stable=not chain and none_grows(roots, period_s),
        pole=pole,
        frequency_hz=pole.imag / (2.0 * np.pi),
        margin=-pole.real,
        damping=float(damping),
        growing=-1 if chain else int(np.sum(np.real(roots) > growth_limits(roots, period_s))),
        decays=not chain and all_decay(roots, period_s),
    )
