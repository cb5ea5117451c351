"""Channels of a survey that read other than the model moves where the rest of the survey agrees with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from middeck.updating.residuals.pairing import at_channels
from middeck.updating.residuals.surveys import Compared, neighbours, real_shapes, shape_deviations

# Of what a channel reads in all modes: what is left of one that is wrong, of the others in the mean (rms).
WRONG, RIGHT = 0.5, 0.15
# Of the channels: more that are wrong are another article.
FEW = 0.25
# Readings and motions that are alike but for a factor; deviations by which what is left is no noise.
ALIKE, NOISE = 0.8, 5.0
TINY = np.finfo(float).tiny


def wrong_channels(compared: Compared) -> tuple[str, ...]:
    """A sentence for each; none where channels are too few to tell, or most of them disagree."""
    measured = compared.survey.measured
    if not measured.node:
        return ()
    ours = compared.pairs[:, 1]
    shapes = _Shapes(
        real_shapes(measured)[:, ours], shape_deviations(compared.modes, measured)[:, ours],
        at_channels(compared.modes, measured), compared.paired.column,
        neighbours(compared.modes, compared.paired.column) | np.eye(len(ours), dtype=bool),
    )  # fmt: skip
    kept = np.ones(len(shapes.read), dtype=bool)
    while True:
        moved = shapes.moved(kept)
        if moved is None:
            return ()
        wrong = shapes.left(moved) > np.maximum(WRONG, shapes.noise)
        if not np.any(kept & wrong):
            break
        # One that dominates the fit makes others look wrong: the one without which they agree best.
        kept[min(np.flatnonzero(kept), key=lambda r: shapes.left_without(kept, r))] = False
        if np.count_nonzero(~kept) > FEW * len(kept):
            return ()
    if float(np.sqrt(np.mean(shapes.left(moved)[kept] ** 2))) > RIGHT:
        return ()
    return tuple(_said(compared, r, shapes.read[r], moved[r]) for r in np.flatnonzero(~kept & wrong))


class _Shapes(NamedTuple):
    """Measured shapes, their deviations, motion of the model, its paired modes, and which are close."""

    read: np.ndarray
    std: np.ndarray
    motion: np.ndarray
    column: np.ndarray
    near: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """What each channel reads in all modes."""
        return np.maximum(np.linalg.norm(self.read, axis=1), TINY)

    @property
    def noise(self) -> np.ndarray:
        """Of that, what may be noise."""
        return NOISE * np.linalg.norm(self.std, axis=1) / self.size

    def left(self, moved: np.ndarray) -> np.ndarray:
        """Of that, what does not agree."""
        return np.linalg.norm(self.read - moved, axis=1) / self.size

    def left_without(self, kept: np.ndarray, row: int) -> float:
        """In squares, of the other kept channels where one is left out."""
        others = kept & (np.arange(len(kept)) != row)
        moved = self.moved(others)
        return np.inf if moved is None else float(np.sum(self.left(moved)[others] ** 2))

    def moved(self, kept: np.ndarray) -> np.ndarray | None:
        """At all channels, of the modes that fit the kept ones best, each with its neighbours."""
        out = np.empty_like(self.read)
        for k, own in enumerate(self.near):
            basis = self.motion[:, self.column[k, own]]
            if np.count_nonzero(kept) < 2 * basis.shape[1] + 1:
                return None
            weight = 1.0 / self.std[kept, k]
            parts = np.linalg.lstsq(weight[:, None] * basis[kept], weight * self.read[kept, k], rcond=None)[0]
            out[:, k] = basis @ parts
        return out


def how_it_reads(read: np.ndarray, moved: np.ndarray) -> str:
    """The matter with an instrument that reads ``read`` where the model moves by ``moved``."""
    by = float(read @ moved / max(moved @ moved, TINY))
    alike = abs(float(read @ moved)) / max(float(np.linalg.norm(read) * np.linalg.norm(moved)), TINY)
    if alike < ALIKE:
        return "does not read what the model moves there: another axis or place? The"
    if abs(by + 1.0) < WRONG:
        return "reads with the other sign. The"
    return f"reads {by:.2g} times what the model moves there: its calibration or unit? The"


def _said(compared: Compared, row: int, read: np.ndarray, moved: np.ndarray) -> str:
    measured = compared.survey.measured
    channel = f"channel {measured.node[row]} {measured.direction[row]}"
    return (
        f"{compared.survey.name}: {channel} {how_it_reads(read, moved)} other channels agree with the model; "
        "correct it or leave it out, for it shifts and widens all that is stated"
    )
