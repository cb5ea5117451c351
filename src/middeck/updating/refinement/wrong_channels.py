"""Channels of a survey that read other than the model moves where the rest of the survey agrees with it."""

from __future__ import annotations

import numpy as np

from middeck.updating.residuals.pairing import at_channels
from middeck.updating.residuals.surveys import Compared, neighbours, real_shapes, shape_deviations

# Of what a channel reads in all modes: what is left of one that is wrong, of the middle one of the others.
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
    read, std = real_shapes(measured)[:, ours], shape_deviations(compared.modes, measured)[:, ours]
    size = np.maximum(np.linalg.norm(read, axis=1), TINY)
    noise = NOISE * np.linalg.norm(std, axis=1) / size
    kept, found = np.ones(len(read), dtype=bool), []
    while True:
        moved = _as_the_model_moves(compared, read, std, kept)
        if moved is None:
            return ()
        left = np.where(kept, np.linalg.norm(read - moved, axis=1) / size, 0.0)
        worst = int(np.argmax(np.where(left > noise, left, 0.0)))
        if not left[worst] > max(WRONG, noise[worst]):
            break
        kept[worst] = False
        found.append(worst)
    if len(found) > FEW * len(read) or float(np.median(left[kept])) > RIGHT:
        return ()
    return tuple(_said(compared, r, read[r], moved[r]) for r in found)


def _as_the_model_moves(
    compared: Compared, read: np.ndarray, std: np.ndarray, kept: np.ndarray
) -> np.ndarray | None:
    """At all channels, of the modes that fit the kept ones best, each with its neighbours."""
    motion, column = at_channels(compared.modes, compared.survey.measured), compared.paired.column
    near = neighbours(compared.modes, column) | np.eye(len(column), dtype=bool)
    out = np.empty_like(read)
    for k, own in enumerate(near):
        basis = motion[:, column[k, own]]
        if np.count_nonzero(kept) < 2 * basis.shape[1] + 1:
            return None
        parts = np.linalg.lstsq(basis[kept] / std[kept, k, None], read[kept, k] / std[kept, k], rcond=None)[0]
        out[:, k] = basis @ parts
    return out


def _said(compared: Compared, row: int, read: np.ndarray, moved: np.ndarray) -> str:
    measured = compared.survey.measured
    channel = f"channel {measured.node[row]} {measured.direction[row]}"
    by = float(read @ moved / max(moved @ moved, TINY))
    alike = abs(float(read @ moved)) / max(float(np.linalg.norm(read) * np.linalg.norm(moved)), TINY)
    if alike < ALIKE:
        what = "does not read what the model moves there: another axis or place? The"
    elif abs(by + 1.0) < WRONG:
        what = "reads with the other sign. The"
    else:
        what = f"reads {by:.3g} times what the model moves there: its calibration or unit? The"
    return (
        f"{compared.survey.name}: {channel} {what} other channels agree with the model; correct it or "
        "leave it out, for it shifts and widens all that is stated"
    )
