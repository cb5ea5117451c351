"""Articles of a survey with friction: each measured mode's, with the stiffness of its own amplitude.

Joints that stick make other modes of the free ones, so that a measured mode is compared with the modes of its
own article. Those are all there are: of two measured modes neither can be what the other is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from middeck.errors import ConfigError
from middeck.structure.eigenproblem.eigen import ROUNDING
from middeck.structure.modes.solve import Modes
from middeck.updating.residuals.surveyed_friction import Added
from middeck.values import record

# Modes above the highest that is asked for, which losses may mix into it; and by how much, relative, one with
# friction may move without the last of these: a joint that sticks bends the article where it holds, as a sum
# of free modes does slowly.
SPARE, MISSED = 6, 1e-3
# Modes up to which more are taken where they are too few: as many cost seconds an iteration.
MOST = 200


class TooFewModesError(ConfigError):
    """Joints with friction that are too stiff for the modes that were taken."""


@record
class OwnArticles:
    """The articles side by side, all with the same number of modes.

    Attributes:
        modes: Modes of the articles, one article after the other, each in the order of the free modes that
            they resemble most.
        count: Modes of each article.
        turn: Parts of the free modes in them, by columns; None without friction, where one article serves
            all.
    """

    modes: Modes
    count: int
    turn: Float[np.ndarray, "article mode mode"] | None

    def columns(self, measured: np.ndarray) -> np.ndarray:
        """Indices in ``modes`` of the modes, in rows, that each of the ``measured`` may be."""
        return np.arange(self.count)[:, None] + self.count * (0 * measured if self.turn is None else measured)

    def in_free(self, shapes: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Shapes in the modes of the articles of ``measured``, in the free modes."""
        return shapes if self.turn is None else np.einsum("kim,mk->ik", self.turn[measured], shapes)


def own_articles(modes: Modes, count: int, added: Sequence[Added]) -> OwnArticles:
    """Articles of the lowest ``count`` modes with the friction ``added`` for each measured mode."""
    if not added:
        return OwnArticles(modes, len(modes.omega), None)
    free, rows = modes.omega[:count], np.array([a.row for a in added])
    stiffness = np.real([a.stiffness for a in added]).T
    # Between the softest and the stiffest: the least that any of them must be turned.
    _, amid = _stiffened(free, rows, np.median(stiffness, axis=0), np.eye(count))
    found = [_stiffened(free, rows, k, amid) for k in stiffness]
    omega, turn = (np.array(part) for part in zip(*found, strict=True))
    times = len(turn)
    return OwnArticles(
        dataclasses.replace(
            modes,
            omega=omega.ravel(),
            shapes=np.hstack([modes.shapes[:, :count] @ one for one in turn]),
            kind=modes.kind[:count] * times,
            stated_name=modes.name[:count] * times,
            **{
                name: np.tile(getattr(modes, name)[:count], times)
                for name in ("rigid_share", "strain_share", "residual")
            },
        ),
        count,
        turn,
    )


def check_spare(free: np.ndarray, own: OwnArticles, pairs: np.ndarray, added: Sequence[Added]) -> None:
    """Raise `TooFewModesError` where the modes are too few for the stiffness of the joints."""
    if own.turn is None:
        return
    count = own.count
    kept = max(count - SPARE, int((pairs[:, 0] % count).max(initial=0)) + 1)
    rows = np.array([a.row for a in added])
    for place, k in pairs:
        here = np.real([a.stiffness[k] for a in added])
        near = own.turn[k][:kept, place % count, None]
        hz = own.modes.frequency_hz[place]
        moved = _stiffened(free[:kept], rows[:, :kept], here, near)[0][0] / own.modes.omega[place] - 1.0
        if moved > MISSED:
            raise TooFewModesError(
                f"joints with friction are too stiff for {count} modes: the mode at {hz:.4g} Hz moves by "
                f"{100.0 * moved:.2g} % without the last {count - kept}",
                where="surveyed friction",
                hint="a test in which the joints slip, or an article with an elastic joint that sticks",
            )


def _stiffened(
    omega: np.ndarray, rows: np.ndarray, stiffness: np.ndarray, like: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [rad/s] and modes with springs, one for each column of ``like``, which it has most of."""
    lam, turn = np.linalg.eigh(np.diag(omega**2) + (rows.T * stiffness) @ rows)
    parts = like.T @ turn
    order = linear_sum_assignment(np.abs(parts), maximize=True)[1]
    sign = np.where(np.take_along_axis(parts, order[:, None], axis=1)[:, 0] < 0.0, -1.0, 1.0)
    lam = np.where(lam > ROUNDING * lam[-1], lam, 0.0)
    return np.sqrt(lam[order]), turn[:, order] * sign
