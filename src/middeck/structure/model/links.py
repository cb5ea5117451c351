"""Exact constraints between frames of an article: links, interpolation constraints, linear equations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import field

import numpy as np
from jaxtyping import Inexact

from middeck.errors import ConfigError
from middeck.structure.model.clamps import LETTERS, check_axes
from middeck.values import record

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz", "angle")
"""Motions of a term: shift along, or rotation vector about, the axes of W; angle or travel of a joint."""
# Resistance about an axis, over the largest moment of weights, below which an interpolation has no turn.
UNDETERMINED = 1e-10


@record(kw_only=True)
class Link:
    """A constraint on the motion of ``second``, as a frame fixed to ``first`` sees it.

    Attributes:
        first, second: Frames, nodes or joints.
        along: Letters of the axes along which the point of ``second`` keeps its place in ``first``.
        about: Letters of the axes about which the two do not turn against each other. All three: rigid. Two:
            a hinge about the third, for any angle. One: a universal joint, whose cross has one arm along the
            first of the two other axes, fixed in ``first``, and one along the last, fixed in ``second``.
            None: a ball.
        offset: Offset of the point from the origin of ``second``, in its axes [m].
        axes: Unit vectors of x, y and z of the link in W as drawn, as columns.

    So all six are a rigid link, "xyz" and "" a spherical joint, "xyz" and "xy" a hinge about z, "xy" and
    "xyz" a slide along z. As drawn every link fits. It is exact at any rotation.

    >>> Link(name="elbow", first="upper arm", second="forearm", about="xy").free_axis
    'z'
    """

    name: str
    first: str
    second: str
    along: str = LETTERS
    about: str = LETTERS
    offset: Inexact[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    axes: Inexact[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that it ties."""
        return (self.first, self.second)

    @property
    def free_axis(self) -> str:
        """Letters of the axes about which the frames may turn."""
        return "".join(letter for letter in LETTERS if letter not in self.about)


@record(kw_only=True)
class Share:
    """A frame that an `Interpolation` follows: weight, and which motions along and about ``axes`` count."""

    frame: str
    weight: float = 1.0
    along: str = LETTERS
    about: str = ""
    axes: Inexact[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))


@record(kw_only=True)
class Interpolation:
    """A frame that follows the motion of others, stiffening none of them (RBE3 of Nastran).

    Its motion is that of the body that fits the motions of the ``shares`` best, by weighted least squares;
    turns that count are weighted with the square of the mean distance too. Loads on it so spread to them
    as forces in proportion to weight, and their moments. In large motion displacements are those that the
    frame itself sees, so that the relation is exact in rotation where it follows in all three turns.

    Attributes:
        frame: The frame that follows.
        along, about: Motions of it that follow, along and about ``axes``.
    """

    name: str
    frame: str
    shares: tuple[Share, ...]
    along: str = LETTERS
    about: str = LETTERS
    axes: Inexact[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that it ties."""
        return (self.frame, *(share.frame for share in self.shares))


@record
class Term:
    """A coefficient times a motion since drawn: ``direction`` of `DIRECTIONS` of a frame in W."""

    frame: str
    direction: str
    coefficient: float


@record
class Equation:
    """A linear equation (MPC), the sum of its terms is zero: for small motions, and for angles of joints."""

    name: str
    terms: tuple[Term, ...]

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that it ties."""
        return tuple(dict.fromkeys(term.frame for term in self.terms))


AnyLink = Link | Interpolation | Equation
"""What ties frames exactly."""


def link_faults(link: AnyLink, joints: set[str]) -> Iterator[str]:
    """Faults of a link between existing frames; ``joints`` are those that are joints."""
    what = f"link {link.name!r}"
    if isinstance(link, Equation):
        yield from (f"{what}: {fault}" for fault in _equation_faults(link, joints))
        return
    for part in (link, *(link.shares if isinstance(link, Interpolation) else ())):
        for letters in (part.along, part.about):
            if set(letters) - set(LETTERS) or len(set(letters)) < len(letters):
                yield f"{what}: {letters!r} is none of x, y and z, each once"
        if not part.along and not part.about:
            yield f"{what} ties nothing: along and about are both empty"
        try:
            check_axes(np.real(part.axes), what)
        except ConfigError as error:
            yield f"{what}: {error.what}"
    if (twice := _twice(link)) is not None:
        yield f"{what} names a frame twice, among {', '.join(map(repr, link.frames))}{twice}"
    if isinstance(link, Interpolation):
        weights = np.real([share.weight for share in link.shares])
        if not len(weights) or not np.all(np.isfinite(weights)) or np.any(weights <= 0.0):
            yield f"{what} needs frames that it follows, each of positive weight"
    elif not np.all(np.isfinite(link.offset)):
        yield f"{what} has an offset that is no place"


def _twice(link: Link | Interpolation) -> str | None:
    """None where no frame is named twice, or an average follows each in several ways, all equally often.

    Otherwise the mean distance, by which turns that count are weighted, would not be one.
    """
    count = Counter(link.frames)
    if max(count.values()) == 1:
        return None
    if not isinstance(link, Interpolation) or count.pop(link.frame) > 1:
        return ""
    unlike = len(set(count.values())) > 1 and any(share.about for share in link.shares)
    return ", and not each equally often, while turns count" if unlike else None


def _equation_faults(link: Equation, joints: set[str]) -> Iterator[str]:
    coefficients = np.real([term.coefficient for term in link.terms])
    if not np.all(np.isfinite(coefficients)) or not np.any(coefficients):
        yield "its coefficients must be numbers, and not all zero"
    for term in link.terms:
        if term.direction not in DIRECTIONS:
            yield f"direction {term.direction!r} is none of {', '.join(DIRECTIONS)}"
        elif term.direction == "angle" and term.frame not in joints:
            yield f"{term.frame!r} has no angle, it is no joint"
    if len({(t.frame, t.direction) for t in link.terms}) < len(link.terms):
        yield "it names one motion twice"


def fitted_body(
    link: Interpolation, arms: Inexact[np.ndarray, "share 3"]
) -> Inexact[np.ndarray, "share row 6"]:
    """Factors with which shift and turn in W of each share enter the motion of ``link``.

    ``arms`` are the places of the shares less that of the frame. One row for each letter that follows, along
    and then about. (MSC Nastran, Linear Static Analysis User's Guide, RBE3.)

    Raises `ConfigError` where the shares leave a motion that follows undetermined.
    """
    mean = np.mean(np.sqrt(np.sum(arms * arms, axis=1))) or 1.0
    weighted = []
    D = np.zeros((len(arms), 6, 6), arms.dtype)
    D[:, :3, :3] = D[:, 3:, 3:] = np.eye(3)
    for d, arm in zip(D, arms, strict=True):
        x, y, z = arm
        d[:3, 3:] = np.array([[0.0 * x, z, -y], [-z, 0.0 * x, x], [y, -x, 0.0 * x]])
    for share in link.shares:
        W = np.zeros((6, 6), np.result_type(arms, share.axes, np.asarray(share.weight)))
        for start, letters, size in ((0, share.along, 1.0), (3, share.about, mean**2)):
            n = share.axes[:, [LETTERS.index(letter) for letter in letters]]
            W[start : start + 3, start : start + 3] = share.weight * size * n @ n.T
        weighted.append(W)
    moved = np.swapaxes(D, 1, 2) @ np.array(weighted)
    fit = np.sum(moved @ D, axis=0)
    unit = np.array([1.0] * 3 + [1.0 / mean] * 3)
    size, turn = np.linalg.eigh(np.real(unit[:, None] * fit * unit))
    rows = np.zeros((6, 0))
    for start, letters in ((0, link.along), (3, link.about)):
        n = np.zeros((6, len(letters)), link.axes.dtype)
        n[start : start + 3] = link.axes[:, [LETTERS.index(letter) for letter in letters]]
        rows = np.hstack([rows, n])
    loose = size <= UNDETERMINED * size[-1]
    if np.any(np.abs(turn[:, loose].T @ (np.real(rows) / unit[:, None])) > np.sqrt(UNDETERMINED)):
        way = turn[:, loose][:, 0] * unit
        kind, axis = ("turn", way[3:]) if np.linalg.norm(turn[3:, loose][:, 0]) > 0.5 else ("shift", way[:3])
        axis = np.round(axis / np.linalg.norm(axis), 3) + 0.0
        raise ConfigError(
            f"the frames that it follows determine no {kind} along {axis.tolist()}",
            where=f"link {link.name!r}",
            hint="add frames off their line, or motions about axes; or let it follow in fewer motions",
        )
    own = unit[:, None] * turn[:, ~loose]  # the motions that the shares determine
    inverse = own @ np.linalg.inv(own.T @ fit @ own) @ own.T
    return np.swapaxes(rows, 0, 1) @ inverse @ moved


def square_axes(link: Link) -> list[tuple[Inexact[np.ndarray, "3"], Inexact[np.ndarray, "3"]]]:
    """Pairs of directions in W as drawn, the first fixed in the first frame, that a link keeps square."""
    own = dict(zip(LETTERS, link.axes.T, strict=True))
    free = link.free_axis
    if len(free) == 0:
        return [(own["y"], own["z"]), (own["z"], own["x"]), (own["x"], own["y"])]
    if len(free) == 1:
        return [(own[letter], own[free]) for letter in sorted(link.about)]
    return [(own[free[0]], own[free[1]])] if len(free) == 2 else []
