"""Newton's method on the potential of a hanging structure, by damped descent under a growing load."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import Assembly, assemble_carried, inner_forces
from middeck.structure.assembly.factorisation import factorise, positive_factor
from middeck.structure.assembly.freedom import Freedom
from middeck.structure.assembly.linked import closed, followed, static_freedom, torn
from middeck.structure.assembly.loads import Inner, Loads, scale_loads
from middeck.structure.assembly.mass import carried_mass
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.springs import own_law
from middeck.structure.assembly.strain import predict_forces
from middeck.structure.elements.frames import (
    Configuration,
    move_carried,
    placed,
)
from middeck.structure.elements.rotations import skew, turn_of
from middeck.structure.elements.since_drawn import SinceDrawn
from middeck.structure.rest.imbalance import article_size, imbalance, imbalance_scale
from middeck.structure.rest.whole_steps import deformation, move_whole, stride

# Largest imbalance that counts as rest, over `imbalance_scale`.
TOLERANCE = 1e-9
# And where Newton's undamped step moves nothing by more than `UNMOVED` of the article's size, or radians:
# rounding is what is left, in a support of 1e12 N/m 1e-7 of a weight.
ROUNDED = 1e-6
UNMOVED = 1e-12
# Residual accepted at intermediate load steps.
ROUGH = 1e-4
LOAD_FACTORS = (0.25, 0.5, 0.75)
MAX_ITERATIONS = 200
MAX_HALVINGS = 30
MIXED_ITERATIONS = 100
# Iterations after which a descent creeps.
SOON = 30
# Least part of the loads in one step of following them; iterations in one.
LEAST_PART, MAX_NEWTON = 1e-3, 20
# Of the step before, the longest that Newton's method takes on the branch that it follows (Deuflhard 2004,
# section 2.1); and of the longest, what shows that the next, its square, is rounding.
CONTRACTION, SQUARED = 0.5, 1e-7
# Of the longest step, the last one to a state on the way; of the longest step there may be, one aimed at.
NEARBY, FITTING = 0.15, 0.9
# Halvings of a step after which, twice, it does.
SHORT = 3
# Least damping [1/s^2]: a thousandth of a slow pendulum's omega^2 neither holds nor hurries anything.
LEAST_DAMPING = 1e-3
# And of the largest omega^2, whose rounding is 1e-16 of it.
NEUTRAL = 1e-12
DAMPING_STEP = 4.0
# Of the least damping that holds what grows: taken, and to what it is found.
AHEAD, NEAR = 1.5, 1.3
# Of the article's size: what is out of line by less, at a rest state that is not stable, is left there.
IN_LINE = 1e-9
# Beyond any omega^2 of a structure: what is still indefinite has no mass.
MOST_DAMPING = 1e20
# Turn [rad] of a node in the first step of prescribed displacements, and shift over the article's size.
PRESCRIBED_TURN = 0.1
# Largest `deformation` in one step: what the second-order chart follows well.
LONGEST_STEP = 0.5


class Settled(NamedTuple):
    """Where Newton ended, and (load factor, residual, damping) of every iteration on the way.

    The residual counts as rest below ``enough``. ``followed`` says that it is the branch of the drawn state.
    """

    config: Configuration
    assembly: Assembly
    residual: float
    enough: float
    history: tuple[tuple[float, float, float], ...]
    stable: bool
    followed: bool = False


def settle(model: Model, loads: Loads) -> Settled:
    """Equilibrium under gravity and preload: followed from the drawn state, or descended to.

    An article that the world holds, and any under applied loads, is followed from its drawn state as all that
    acts on it grows. One that hangs, and one whose branch ends or is not stable, descends at once or, should
    that fail, by steps of the load.

    The tangent is re-formed at every iteration. Damping (Levenberg 1944: a multiple of the mass) keeps each
    step downhill where the tangent is not positive definite; it is reduced after every success and the last
    step is a pure Newton step. Convergence is on the true residual alone; on the way a rough one will do.
    """
    mass = carried_mass(model, model.rest)
    moved = model.held is not None and bool(np.any(model.held.moved))
    pushed = bool(np.any(loads.push))
    held = model.held is not None or pushed or len(loads.ground.point) or not np.any(loads.gravity)
    followed = _follow(model, loads, mass) if held else None
    # A moment has no potential to descend, nor a node that is being displaced.
    if followed is not None and (followed.stable or moved or np.any(loads.push[:, 3:])):
        return followed
    if moved:
        steps = _prescribed_steps(model)
        return _by_steps(model, loads, mass, tuple((np.arange(1, steps) / steps).tolist()))
    fallen = _descend_by_turns(model, loads, mass)
    return fallen if followed is None or fallen.residual < fallen.enough else followed


def _descend_by_turns(model: Model, loads: Loads, mass: sp.csr_array) -> Settled:
    soon = _by_steps(model, loads, mass, (), SOON)
    if soon.residual < soon.enough:
        return soon
    mixed = _with_forces(model, loads, mass)
    if mixed is not None:
        return mixed
    at_once = _by_steps(model, loads, mass, ())
    return at_once if at_once.residual < at_once.enough else _by_steps(model, loads, mass, LOAD_FACTORS)


def _by_steps(
    model: Model, loads: Loads, mass: sp.csr_array, factors: tuple[float, ...], most: int | None = None
) -> Settled:
    scale = imbalance_scale(model, loads)
    config, before = model.rest, 0.0
    history: list[tuple[float, float, float]] = []
    for factor in factors:
        load = scale_loads(loads, factor)
        (config, _), before = displace(model, config, load, factor - before), factor
        config, _, steps, _ = _descend(model, config, load, mass, scale, ROUGH)
        history += [(factor, residual, damping) for residual, damping in steps]
    config, _ = displace(model, config, loads, 1.0 - before)
    config, at, steps, enough = _descend(model, config, loads, mass, scale, TOLERANCE, most)
    history += [(1.0, residual, damping) for residual, damping in steps]
    residual = history[-1][1]
    # Short of convergence stability is unknown: second-order strain of a step may act as tension.
    stable = residual < enough and _is_stable(model, config, at, mass)
    return Settled(config, at, residual, enough, tuple(history), stable)


def _holding(K: sp.csr_array, M: sp.csr_array) -> sp.csr_array:
    """K with so much more stiffness that rounding drives no motion that nothing holds.

    It is `LEAST_DAMPING` of the mass, or less in an article so large and soft that this would hold it.
    """
    k, m = np.abs(K.diagonal()), M.diagonal()
    fastest = float((k[m > 0.0] / m[m > 0.0]).max(initial=0.0))
    return sp.csr_array(K + min(LEAST_DAMPING, NEUTRAL * fastest or LEAST_DAMPING) * M)


def _is_stable(model: Model, config: Configuration, at: Assembly, mass: sp.csr_array) -> bool:
    free = static_freedom(model, config)
    return positive_factor(_holding(free.matrix(at.tangent), free.matrix(mass))) is not None


def _follow(model: Model, loads: Loads, mass: sp.csr_array) -> Settled | None:
    """Along the branch of the drawn state by Newton's method, stable or not, as all that acts grows together.

    None where the branch ends. A step is as long as the last one shows that Newton's method follows, or half
    of it where that leaves the branch.
    """
    config, inner, done, step = model.rest, None, 0.0, 1.0 / _prescribed_steps(model)
    history: list[tuple[float, float, float]] = []
    while done < 1.0 and step > LEAST_PART:
        part = min(1.0, done + step)
        found = _newton(model, _Way(config, inner), scale_loads(loads, part), part - done, mass, part < 1.0)
        step = (part - done) * min(2.0, max(found.fitting, 0.25) if found.to is None else found.fitting)
        if found.to is None:
            continue
        config, inner = found.to
        history += [(part, residual, 0.0) for residual in found.left]
        done = part
    if done < 1.0:
        return None
    at = assemble_carried(model, config, loads)
    enough = TOLERANCE if history[-1][1] < TOLERANCE else ROUNDED
    return Settled(
        config, at, history[-1][1], enough, tuple(history), _is_stable(model, config, at, mass), True
    )


class _Way(NamedTuple):
    """Where Newton's method is: the configuration, and the forces inside where they are unknowns."""

    config: Configuration
    inner: Inner | None


class _Newton(NamedTuple):
    """Where Newton's method ended, None where it left the branch, and the residuals of its iterations.

    ``fitting`` times the step of the loads would have made its first step as long as it may be.
    """

    fitting: float
    to: _Way | None = None
    left: tuple[float, ...] = ()


def _newton(model: Model, way: _Way, loads: Loads, part: float, mass: sp.csr_array, rough: bool) -> _Newton:
    """Newton's method from nearby, after a further ``part`` of what is prescribed.

    Forces inside are unknowns (see `_with_forces`). It ends where the next step would be rounding, whatever
    the loads are beside the weight; on the way a ``rough`` state will do, to which it contracts.
    """
    scale = imbalance_scale(model, loads)
    config, moved = displace(model, way.config, loads, part)
    inner = way.inner if moved is None else moved
    left, longest, before, fitting = [], 0.0, LONGEST_STEP, 0.5
    for _ in range(MAX_NEWTON):
        free = static_freedom(model, config)
        at = assemble_carried(model, config, loads, None, inner)
        left.append(imbalance(at, free, scale))
        settled = left[-1] < TOLERANCE and _is_settled(left, before, longest)
        if settled or (rough and before < NEARBY * longest):
            break
        held = _holding(free.matrix(at.tangent), free.matrix(mass))
        q = _solve_spun(held, _spin(model, at, loads, free), free.part(at.gradient))
        if q is None:
            return _Newton(0.5)
        q = free.spread(q)
        step = stride(model, q)
        if longest == 0.0:
            fitting = FITTING * LONGEST_STEP / max(step, UNMOVED)
        if left[-1] < ROUNDED and step < UNMOVED:
            break
        if not step < (CONTRACTION * before if longest > 0.0 else LONGEST_STEP):
            return _Newton(min(fitting, 0.5) if longest > 0.0 else fitting)
        longest, before = max(longest, step), step
        inner = predict_forces(model, config, loads, q)
        moved = closed(model, move_carried(model.tree, config, q))
        if moved is None:
            return _Newton(0.5)
        config = moved
        inner = _with_linear_springs(model, config, loads, inner)
    else:
        return _Newton(0.5)
    return _Newton(fitting, _Way(config, inner), tuple(left))


def _is_settled(left: list[float], step: float, longest: float) -> bool:
    """Whether Newton's next step is rounding: none is left, the last was short, or it did no good."""
    fell = len(left) < 2 or left[-1] < 0.5 * left[-2]
    return left[-1] == 0.0 or step < SQUARED * longest or not fell


def rest_beside(
    model: Model, config: Configuration, loads: Loads, mass: sp.csr_array
) -> Configuration | None:
    """The rest state on the branch of ``config``, the forces inside as unknowns; None where it is left."""
    found = _newton(model, _Way(config, None), loads, 0.0, mass, rough=False)
    return None if found.to is None else found.to.config


def _spin(model: Model, at: Assembly, loads: Loads, free: Freedom) -> sp.csr_array | None:
    """What the tangent lacks for moments of fixed direction: -[M]/2 on the turn of each, antisymmetric.

    The rest of the tangent is that of potentials in the chart exp(theta) R, where a gradient M has it.
    """
    moved = np.flatnonzero(np.any(loads.push[:, 3:] != 0.0, axis=1))
    if not len(moved):
        return None
    rows = (6 * model.load_point[moved][:, None] + np.arange(3, 6)).ravel()
    turns = free.columns(at.jacobian[rows])
    return sp.csr_array(turns.T @ sp.block_diag(list(-0.5 * skew(loads.push[moved, 3:]))) @ turns)


def _solve_spun(K: sp.csr_array, spin: sp.csr_array | None, gradient: np.ndarray) -> np.ndarray | None:
    """Newton's step; None where there is none."""
    if spin is None:
        factor = factorise(K)
        return None if factor is None else -factor.solve(gradient)
    try:
        q = -spla.splu(sp.csc_array(K + spin)).solve(gradient)
    except RuntimeError:  # SuperLU: "Factor is exactly singular"
        return None
    return q if np.all(np.isfinite(q)) else None


def _prescribed_steps(model: Model) -> int:
    """Steps of prescribed displacements that the tangent predicts well."""
    moved = np.zeros((1, 6)) if model.held is None else model.held.moved
    turn = np.linalg.norm(moved[:, 3:], axis=1).max() / PRESCRIBED_TURN
    shift = np.linalg.norm(moved[:, :3], axis=1).max() / (PRESCRIBED_TURN * article_size(model))
    return 1 + int(max(turn, shift))


def displace(
    model: Model, config: Configuration, loads: Loads, part: float
) -> tuple[Configuration, Inner | None]:
    """``config`` after a further ``part`` of what is prescribed; the rest follows by the tangent.

    With the forces inside to first order, None where nothing followed.
    """
    since = config.since_drawn
    if model.held is None or since is None or not np.any(model.held.moved):
        return config, None
    moved = part * model.held.moved
    free, pushed = static_freedom(model, config), np.zeros(model.tree.size)
    pushed[: moved.size] = moved.ravel()
    drawn_along = followed(model, config, pushed)
    pushed = pushed + drawn_along
    K = assemble_carried(model, config, loads).tangent
    factor = positive_factor(free.matrix(K))
    turn = turn_of(moved[:, 3:])
    shifted = since.shift + moved[:, :3]
    displaced = placed(
        SinceDrawn(since.drawn, since.carrier, shifted, since.turn + turn + turn @ since.turn), config.angle
    )
    q = None if factor is None else free.spread(-factor.solve(free.part(K @ pushed)))
    there = move_carried(model.tree, displaced, drawn_along if q is None else drawn_along + q)
    there = closed(model, there)
    if there is None:
        raise torn(model, config, pushed)
    return there, None if q is None else predict_forces(model, config, loads, pushed + q)


def _with_forces(model: Model, loads: Loads, mass: sp.csr_array) -> Settled | None:
    """Newton's method with the internal forces as unknowns of their own; None where it does not converge.

    Stiff members resist the second-order terms of a step: a strut of 1e12 N/m that a turn of 0.1 strains by
    1e-3 m pulls with 1e9 N, so that a descent must take tiny steps. As an unknown, the force follows the
    step's first order, and only that enters the geometric stiffness (Magisano, Leonetti and Garcea 2017,
    Comput. Methods Appl. Mech. Eng. 313). Where a motion grows the step is damped, so that it leaves an
    unstable rest state; an article upright to rounding ends in that state, which is marked as unstable.
    """
    scale = imbalance_scale(model, loads)
    config, inner, damping, size_of = model.rest, None, 0.0, article_size(model)
    history: list[tuple[float, float, float]] = []
    for _ in range(MIXED_ITERATIONS):
        free = static_freedom(model, config)
        least = LEAST_DAMPING * free.matrix(mass)
        at = assemble_carried(model, config, loads, None, inner)
        residual = imbalance(at, free, scale)
        history.append((1.0, residual, damping))
        if not np.isfinite(residual):
            return None
        step = _unfolding_step(free.matrix(at.tangent), least, free.part(at.gradient), damping, size_of)
        if step is None:
            return None
        q, damping, upright = step
        q = free.spread(q)
        size = stride(model, q)
        enough = ROUNDED if size < UNMOVED and (upright or damping == 0.0) else TOLERANCE
        if residual < enough and (upright or damping == 0.0):
            at = assemble_carried(model, config, loads)
            stable = positive_factor(sp.csr_array(free.matrix(at.tangent) + least)) is not None
            return Settled(config, at, residual, enough, tuple(history), stable)
        q = q * min(1.0, LONGEST_STEP / max(size, LONGEST_STEP))
        inner = predict_forces(model, config, loads, q)
        moved = closed(model, move_carried(model.tree, config, q))
        if moved is None:
            return None
        config = moved
        inner = _with_linear_springs(model, config, loads, inner)
    return None


class _Step(NamedTuple):
    """A step, its damping, and whether it leads to a rest state that is not stable."""

    q: np.ndarray
    damping: float
    upright: bool = False


def _unfolding_step(
    K: sp.csr_array, least: sp.csr_array, gradient: np.ndarray, damping: float, size: float
) -> _Step | None:
    """Newton's step or, where something grows, one with little more damping than makes K positive definite.

    Damping of `AHEAD` times the rate squared at which something grows lets it grow by 1 + 1/(`AHEAD` - 1)
    in a step: a column a millionth out of line is well bent after ten. What is in line to rounding stays.
    """
    factor = positive_factor(K) or positive_factor(sp.csr_array(K + least))
    if factor is not None:
        return _Step(-factor.solve(gradient), 0.0)
    newton = factorise(K)
    if newton is not None:
        q = -newton.solve(gradient)
        if np.abs(q).max() < IN_LINE * size:
            return _Step(q, damping, upright=True)
    low, high = LEAST_DAMPING, max(damping / AHEAD, 2.0 * LEAST_DAMPING)
    while positive_factor(_damped(K, least, high)) is None:
        low, high = high, DAMPING_STEP * high
        if high > MOST_DAMPING:
            return None
    while high > NEAR * low:
        middle = np.sqrt(low * high)
        if positive_factor(_damped(K, least, middle)) is None:
            low = middle
        else:
            high = middle
    factor = positive_factor(_damped(K, least, AHEAD * high))
    return factor and _Step(-factor.solve(gradient), AHEAD * high)


def _damped(K: sp.csr_array, least: sp.csr_array, damping: float) -> sp.csr_array:
    return sp.csr_array(K + damping / LEAST_DAMPING * least)


def _with_linear_springs(model: Model, config: Configuration, loads: Loads, inner: Inner) -> Inner:
    """Springs without free length keep their own forces, as stiff across as along wherever they point."""
    if not len(inner.spring) and not len(inner.device):
        return inner
    own = inner_forces(model, config, loads)
    linear = [law.preload == law.stiffness * law.length for law in (own_law(model), loads.law)]
    return inner._replace(
        spring=np.where(linear[0], own.spring, inner.spring),
        device=np.where(linear[1], own.device, inner.device),
    )


def _descend(
    model: Model,
    config: Configuration,
    loads: Loads,
    mass: sp.csr_array,
    scale: np.ndarray,
    enough: float,
    most: int | None = None,
) -> tuple[Configuration, Assembly, list[tuple[float, float]], float]:
    """Where the descent ends, (residual, damping) of every iteration, and the residual that counts as rest.

    ``mass`` need not be exact. A descent of at ``most`` so many iterations ends where it begins to creep.
    """
    at = assemble_carried(model, config, loads)
    damping, crept = 0.0, 0
    history: list[tuple[float, float]] = []
    for _ in range(MAX_ITERATIONS if most is None else min(most, MAX_ITERATIONS)):
        residual = imbalance(at, static_freedom(model, config), scale)
        history.append((residual, damping))
        if residual < enough:
            break
        q, damping = _damped_step(model, config, at, mass, damping)
        better = _shorten(_Descent(model, loads, mass, scale), config, at, q)
        if better is None:
            step = np.abs(q * scale).max() / scale.min()
            if damping == 0.0 and step < UNMOVED * article_size(model):
                enough = max(enough, ROUNDED)
            break
        config, at, halvings = better
        crept += halvings >= SHORT
        if most is not None and crept > 1:
            break
    return config, at, history, enough


class _Descent(NamedTuple):
    """Constants of one descent."""

    model: Model
    loads: Loads
    mass: sp.csr_array
    scale: np.ndarray

    def at(self, config: Configuration) -> Assembly:
        return assemble_carried(self.model, config, self.loads)

    def imbalance(self, config: Configuration, at: Assembly) -> float:
        return imbalance(at, static_freedom(self.model, config), self.scale)


def _shorten(
    way: _Descent, config: Configuration, at: Assembly, q: np.ndarray
) -> tuple[Configuration, Assembly, int] | None:
    """The first of q, q/2, q/4 ... that lowers the energy or the residual, and the halvings.

    None at rounding level.
    """
    for halvings in range(MAX_HALVINGS):
        trial = closed(way.model, move_whole(way.model, config, q, way.mass))
        if trial is not None:
            new = way.at(trial)
            if new.energy < at.energy or way.imbalance(trial, new) < way.imbalance(config, at):
                return trial, new, halvings
        q = 0.5 * q
    return None


def _damped_step(
    model: Model, config: Configuration, at: Assembly, mass: sp.csr_array, damping: float
) -> tuple[np.ndarray, float]:
    """Solve (K + damping M) q = -gradient with the least damping that makes the matrix positive definite."""
    free = static_freedom(model, config)
    stiffness, inertia = free.matrix(at.tangent), free.matrix(mass)
    damping = 0.0 if damping < LEAST_DAMPING else damping / DAMPING_STEP
    while damping < MOST_DAMPING:
        factor = positive_factor(sp.csr_array(stiffness + damping * inertia))
        if factor is not None:
            q = free.spread(-factor.solve(free.part(at.gradient)))
            if deformation(model, config, q, mass) < LONGEST_STEP:
                return q, damping
        damping = max(DAMPING_STEP * damping, LEAST_DAMPING)
    raise NumericalError(
        "no step towards equilibrium: the tangent stays indefinite at any damping",
        where=f"structure {model.structure.title!r}",
        hint="a load beyond buckling? apply less of it; a motion without mass that something pushes over? "
        "give its frame a mass and an inertia",
    )
