"""Attach points that make an article hang level: Newton's method on its tilts over their offsets."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, EquilibriumError
from middeck.structure.elements.frames import move
from middeck.structure.hanging.attitude import Attitude, estimate_attitude
from middeck.structure.hanging.support_warnings import SAG_HINT, sag
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.sensitivity.parameters import AXES, list_parameters
from middeck.structure.sensitivity.rest import differentiate_rest
from middeck.values import record

LEVEL = 1e-7
"""Tilt [rad] that counts as none: a millimetre in ten kilometres, and above what the residual of statics does
to a roll, 1e-9 of the weight over a centre of mass some centimetres below its attach points."""
TURN = 1e-5
"""Largest motion [m or rad] of the differences that take a moving rest state to its tilt: errors of its
square, and of rounding over it, 1e-10."""
MAX_ITERATIONS = 20
MAX_HALVINGS = 6
NO_ROOM = 1e-6
"""Part of a step within the limit below which the step leads out of it."""
STUCK = 1e-2
"""Singular value of the tilts' derivative [rad/m], half a degree a metre, below which nothing is levelled;
of offsets that do level an article it is some 10 rad/m."""


@record(kw_only=True)
class Levelling:
    """An article before and after its attach points were moved.

    Attributes:
        structure, equilibrium: With the attach points that level it.
        before, after: Attitude before and after.
        moved, change: (attach point, axis of its frame) and by how much it moved [m].
        history: Largest of the tilts sought [rad] at every iteration.
    """

    structure: Structure
    equilibrium: Equilibrium
    before: Attitude
    after: Attitude
    moved: tuple[tuple[str, str], ...]
    change: Float[np.ndarray, " moved"]
    history: tuple[float, ...]


@record(kw_only=True)
class _Task:
    structure: Structure
    environment: Environment
    free: tuple[tuple[str, str], ...]
    about: str
    node: str | None


@named_kinds
def level(
    structure: Structure,
    environment: Environment,
    *,
    free: Sequence[tuple[str, str]],
    about: str | None = None,
    node: str | None = None,
    limit: float = 0.1,
) -> Levelling:
    """Move attach points until the tilts about the axes ``about`` are zero.

    Newton's method with the exact derivative of the rest state (`differentiate_rest`), tuned reactions,
    stiffnesses and anchors included. For more offsets than tilts the least change (in the root of the sum of
    squares) is taken. The result is solved for anew: its tilt is that of its own rest state.

    Args:
        free: (attach point, "x", "y" or "z" of its frame): the offsets that may change.
        about: Axes of the drawn article; by default all but the one nearest to the vertical.
        node: Level this node instead of the rigid body that fits the article best.
        limit: Largest change of an offset [m].

    Raises `ConfigError` for names that the article lacks, a limit that is not positive, or fewer offsets
    than tilts; `EquilibriumError` where the offsets do not move the tilts, a change beyond ``limit`` would be
    needed (both with the ``change_m`` reached), or the article does not hang at all.
    """
    if not 0.0 < limit < np.inf:
        raise ConfigError(f"a limit of {limit} m", where="level", hint="positive and finite")
    task = _task(structure, environment, free, about, node)
    at = _hang(task, np.zeros(len(task.free)))
    before, history = at.attitude, [at.size]
    while at.size > LEVEL and len(history) <= MAX_ITERATIONS:
        rates = _rates(task, at)
        step = _within(rates, at, limit)
        if step is None:  # further than the limit by this step; the way there may bend back
            whole = -np.linalg.pinv(rates) @ at.tilt
            room = _room(at.change, whole, limit)
            if room < NO_ROOM:
                needed = float(np.abs(at.change + whole).max())
                what = f"would need more than the limit of {limit:g} m, about {needed:.3g} m"
                raise _unreached(task, at, what, history)
            step = whole * room
        at = _better(task, at, step, history)
        history.append(at.size)
    if at.size > LEVEL:
        raise _unreached(task, at, f"still tilts by {np.degrees(at.size):.3g} deg", history)
    moved = _moved(task, at.change)
    return Levelling(
        structure=moved,
        equilibrium=at.rest,
        before=before,
        after=at.attitude,
        moved=task.free,
        change=at.change,
        history=tuple(history),
    )


class _Hung(NamedTuple):
    """Rest state, attitude and the tilts sought [rad] with offsets changed by ``change``."""

    change: np.ndarray
    rest: Equilibrium
    attitude: Attitude
    tilt: np.ndarray

    @property
    def size(self) -> float:
        return float(np.abs(self.tilt).max())


def _better(task: _Task, at: _Hung, step: np.ndarray, history: Sequence[float]) -> _Hung:
    """The first of step, step/2, step/4 ... that hangs nearer to level."""
    for _ in range(MAX_HALVINGS):
        try:
            trial = _hang(task, at.change + step)
        except EquilibriumError:  # so far it does not hang at all
            trial = None
        if trial is not None and trial.size < at.size:
            return trial
        step = 0.5 * step
    raise _unreached(task, at, f"stays tilted by {np.degrees(at.size):.3g} deg", history)


def _room(change: np.ndarray, step: np.ndarray, limit: float) -> float:
    """Part of ``step``, at most one, that keeps within the limit."""
    left = limit - np.sign(step) * change
    return float(np.min(left / np.maximum(np.abs(step), left)))


def _task(
    structure: Structure,
    environment: Environment,
    free: Sequence[tuple[str, str]],
    about: str | None,
    node: str | None,
) -> _Task:
    level_axes = AXES.replace(AXES[int(np.argmax(np.abs(environment.gravity)))], "")
    axes = level_axes if about is None else about
    chosen = tuple(dict.fromkeys((name, axis) for name, axis in free))
    task = _Task(structure=structure, environment=environment, free=chosen, about=axes, node=node)
    for what, hint in _faults(task, level_axes):
        raise ConfigError(what, where="level", hint=hint)
    return task


def _faults(task: _Task, level_axes: str) -> Iterator[tuple[str, str]]:
    structure, environment, free, axes = task.structure, task.environment, task.free, task.about
    if not np.any(environment.gravity):
        yield "level is undefined without gravity", "take another environment"
    if not (environment.hung or environment.springs):
        what = f"nothing hangs in {environment.title!r}: attach points are moved below the devices"
        yield f"{what} that hold them", "take an environment with a [suspension], devices or springs"
    points, nodes = [a.name for a in structure.attach_points], [n.name for n in structure.nodes]
    for name, axis in free:
        if name not in points or len(axis) != 1 or axis not in AXES:
            hint = f"x, y or z of {', '.join(points) or 'no attach point at all'}"
            yield f"no offset {axis!r} of an attach point {name!r}", hint
    if task.node is not None and task.node not in nodes:
        yield f"no node {task.node!r}", f"one of {', '.join(nodes)}"
    if not axes or len(set(axes)) < len(axes) or not set(axes) <= set(level_axes):
        yield f"no tilts about {axes!r}", f"any of the axes {level_axes}"
    if len(free) < len(axes):
        what = f"{len(free)} offsets cannot remove {len(axes)} tilts, about {' and '.join(axes)}"
        yield what, "free as many offsets as tilts, or name fewer tilts"


def _moved(task: _Task, change: np.ndarray) -> Structure:
    points = {a.name: a for a in task.structure.attach_points}
    for (name, axis), by in zip(task.free, change, strict=True):
        shift = by * np.eye(3)[AXES.index(axis)]
        points[name] = dataclasses.replace(points[name], offset=points[name].offset + shift)
    return dataclasses.replace(task.structure, attach_points=tuple(points.values()))


def _hang(task: _Task, change: np.ndarray) -> _Hung:
    rest = solve_equilibrium(_moved(task, change), task.environment)
    if not rest.converged:
        raise EquilibriumError(
            f"no rest state on the way to a level one (residual {rest.residual:.1e})",
            where="level",
            hint="start from offsets that hang nearer to level",
            history=rest.history,
        )
    attitude = estimate_attitude(rest)
    return _Hung(change, rest, attitude, _tilt(task, attitude))


def _tilt(task: _Task, attitude: Attitude) -> np.ndarray:
    tilt = attitude.tilt if task.node is None else attitude.node_tilt[attitude.node.index(task.node)]
    return tilt[[AXES.index(axis) for axis in task.about]]


def _rates(task: _Task, at: _Hung) -> np.ndarray:
    """Tilts [rad] per offset [m]."""
    known = {p.name: p for p in list_parameters(at.rest.model.structure, task.environment)}
    offsets = [known[f"attach.{name}.offset.{axis}"] for name, axis in task.free]
    motion = differentiate_rest(at.rest, offsets).motion
    rates = np.array([_rate(task, at, q) for q in motion.T]).T
    U, size, _ = np.linalg.svd(rates, full_matrices=False)
    if size[-1] <= STUCK:
        axes = [axis for axis, part in zip(task.about, np.abs(U[:, -1]), strict=True) if part > 0.1]
        raise _unreached(task, at, f"cannot be tilted about {' and '.join(axes)}", [at.size])
    return rates


def _within(rates: np.ndarray, at: _Hung, limit: float) -> np.ndarray | None:
    """Newton's step, the shortest there is, with offsets that it would take beyond the limit left at it.

    None where too few offsets remain.
    """
    step, free = np.zeros(len(at.change)), np.ones(len(at.change), dtype=bool)
    while True:
        left = at.tilt + rates[:, ~free] @ step[~free]
        if np.linalg.matrix_rank(rates[:, free], tol=STUCK) < len(left):
            return None
        step[free] = -np.linalg.pinv(rates[:, free]) @ left
        beyond = free & (np.abs(at.change + step) > limit)
        if not np.any(beyond):
            return step
        step[beyond] = np.sign(at.change + step)[beyond] * limit - at.change[beyond]
        free &= ~beyond


def _rate(task: _Task, at: _Hung, motion: np.ndarray) -> np.ndarray:
    """Rate of the tilts as the rest state moves: geometry alone, by central differences."""
    tree, config = at.rest.model.tree, at.rest.config
    step = TURN / max(float(np.abs(motion).max()), 1.0)
    there, back = (
        _tilt(task, estimate_attitude(dataclasses.replace(at.rest, config=move(tree, config, by * motion))))
        for by in (step, -step)
    )
    return (there - back) / (2.0 * step)


def _unreached(task: _Task, at: _Hung, what: str, history: Sequence[float]) -> EquilibriumError:
    found = {f"{name} {axis}": float(by) for (name, axis), by in zip(task.free, at.change, strict=True)}
    hint = "free other offsets, across the line of the attach points, or hang it by points out of line"
    tilt = sag(at.attitude)
    return EquilibriumError(
        f"with the offsets {', '.join(found)} the article {what}" + (f"; {tilt}" if tilt else ""),
        where="level",
        hint=SAG_HINT if tilt else hint,
        change_m=found,
        history=tuple(history),
    )
