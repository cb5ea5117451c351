"""Held degrees of freedom of a node: a test set-up's clamps, rollers and hinges."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.values import record

LETTERS = "xyz"
# An axis is a unit vector, and two are square to each other, to rounding.
SQUARE = 1e-9


@record(kw_only=True)
class Clamp:
    """Degrees of freedom of a node that stay where the article was drawn; by default all six.

    Attributes:
        node: Name of the node.
        along, about: Letters of the axes along which it does not shift and about which it does not turn:
            "xyz" and "" are a ball joint, "xyz" and "xy" a hinge about z, "y" and "" a roller. A single
            held turn has zero rate: the attitude reached depends on the order of the two others. A rest
            state warns where it exceeds a thousandth of a radian.
        axes: Unit vectors of x, y and z of the clamp in W, as columns.
        shift, turn: How far [m] and by what rotation vector [rad], in its axes, the held directions are moved
            from there: the prescribed displacements of a load case.

    Raises `ConfigError` for letters, axes or displacements that cannot be.
    """

    node: str
    along: str = LETTERS
    about: str = LETTERS
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    shift: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    turn: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        where = f"clamp of node {self.node!r}"
        for what, hint in self._faults():
            raise ConfigError(what, where=where, hint=hint)
        check_axes(self.axes, where)

    def _faults(self) -> Iterator[tuple[str, str]]:
        for what, held in (("along", self.along), ("about", self.about)):
            if set(held) - set(LETTERS) or len(set(held)) < len(held):
                yield f"{what} {held!r}", "some of x, y and z, each once, such as 'xz'"
        if not self.along and not self.about:
            yield "holds nothing", "give along or about, or leave it out"
        if not np.all(np.isfinite([*self.shift, *self.turn])):
            yield "a prescribed displacement is no number", "finite numbers; metres and radians"
        idle = [a for a, s in zip(LETTERS, self.shift, strict=True) if s != 0.0 and a not in self.along]
        if idle:
            yield f"shifts along {idle[0]!r}, which it does not hold", "add it to along"
        if np.any(self.turn) and set(self.about) != set(LETTERS):
            what = "turns the node by a rotation vector and leaves a turn free"
            yield what, 'hold all three, about = "xyz"'


def check_axes(axes: Float[np.ndarray, "3 3"], where: str) -> None:
    """Raise `ConfigError` unless the columns of ``axes`` are a right-handed set of unit vectors."""
    right = np.all(np.isfinite(axes)) and np.abs(axes.T @ axes - np.eye(3)).max() < SQUARE
    if not right or np.linalg.det(axes) < 0.0:
        raise ConfigError(
            f"its axes {axes.T.tolist()} are no right-handed set of unit vectors at right angles",
            where=where,
            hint="x, y and z of its frame in W, each of length one, z = x cross y",
        )


def held_directions(clamps: Iterable[Clamp], node: str) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Unit vectors in W along which a node is held, and about which.

    Raises `ConfigError` where two are not square to each other: a degree of freedom is then held twice.
    """
    held: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for clamp in (c for c in clamps if c.node == node):
        for found, letters, what in zip(held, (clamp.along, clamp.about), ("along", "about"), strict=True):
            for letter in letters:
                axis = clamp.axes[:, LETTERS.index(letter)]
                if any(abs(axis @ other) > SQUARE for other in found):
                    raise ConfigError(
                        f"a degree of freedom is fixed or prescribed twice: {what} {letter!r} of its axes",
                        where=f"clamp of node {node!r}",
                        hint="one clamp a direction, an environment's and a load case's together; "
                        "two on one node need axes at right angles",
                    )
                found.append(axis)
    return held


def free_translations(clamps: Iterable[Clamp]) -> Float[np.ndarray, "3 motion"]:
    """Orthonormal directions in which all held nodes may shift together."""
    rows = [c.axes[:, LETTERS.index(a)] for c in clamps for a in c.along]
    _, size, turn = np.linalg.svd(np.array([*rows, np.zeros(3), np.zeros(3), np.zeros(3)]))
    return turn[size < SQUARE].T
