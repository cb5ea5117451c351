"""Frequencies in another environment, above all in orbit, from what was refined on the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import estimate_damping
from middeck.updating.posterior import NORMAL_95
from middeck.updating.refine import Refined, shared_with, sorts_of
from middeck.updating.surveys import set_up
from middeck.updating.unknowns import product_slopes
from middeck.values import record

# Of ln f: what a model's own error in a mode changes when gravity goes, over and above what shapes say.
CARRIED = 1e-4


@record(kw_only=True)
class Prediction:
    """Modes as predicted, rigid ones left out.

    Attributes:
        modes, index: Of the refined model, and which of its modes these are.
        log_shift: What the model's own errors, seen on the ground, add to the logarithms of its frequencies.
        log_std: Standard deviation of the logarithms, all told.
        damping: What the first survey measured, by what each mode has of the shapes that it saw; of the rest,
            and where the survey states none, the article's.
        seen: Part of each shape that the surveys saw.
    """

    modes: Modes
    index: Int[np.ndarray, " mode"]
    log_shift: Float[np.ndarray, " mode"]
    log_std: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    seen: Float[np.ndarray, " mode"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " mode"]:
        """The most probable frequencies [Hz]."""
        return self.modes.frequency_hz[self.index] * np.exp(self.log_shift)

    @property
    def interval_hz(self) -> Float[np.ndarray, "mode 2"]:
        """95 % intervals [Hz]."""
        half = NORMAL_95 * self.log_std[:, None] * np.array([-1.0, 1.0])
        return self.frequency_hz[:, None] * np.exp(half)


def predict_modes(
    refined: Refined,
    environment: Environment,
    settings: Sequence[tuple[str, float]] = (),
    count: int = 10,
) -> Prediction:
    """The lowest ``count`` modes that are not rigid, in ``environment``."""
    there = set_up(refined.structure, environment, settings, refined.unknowns)
    found = refined.estimate
    modes = there.solve(refined.x)
    index = np.array([i for i, kind in enumerate(modes.kind) if kind != "rigid"][:count], dtype=int)
    first = refined.compared[0] if refined.compared else None
    share = np.zeros((len(index), 0)) if first is None else shared_with(first, modes)[index]
    lam = modes.omega[index] ** 2
    slope = product_slopes(modes, there.bound, index, index, lam) / (2.0 * lam[:, None])
    spread = np.hstack([slope, share]) @ found.root[: slope.shape[1] + share.shape[1]]
    rest = np.maximum(1.0 - np.sum(share**2, axis=1), 0.0) * refined.unseen[sorts_of(modes, index)] ** 2
    measured = np.zeros(0) if first is None else first.survey.measured.damping[first.pairs[:, 1]]
    return Prediction(
        modes=modes,
        index=index,
        log_shift=share @ found.d[: share.shape[1]],
        log_std=np.sqrt(np.einsum("ij,ij->i", spread, spread) + rest + CARRIED**2),
        damping=_damping(modes, index, share, measured),
        seen=share.sum(axis=1),
    )


def _damping(modes: Modes, index: np.ndarray, share: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """By shape, not by rank: what is lost in a cycle adds up over the shapes that a mode is made of."""
    own = estimate_damping(modes, count=int(index[-1]) + 1).zeta[index]
    known = share * np.isfinite(measured)
    part = np.minimum(known.sum(axis=1), 1.0)
    return known @ np.nan_to_num(measured) + (1.0 - part) * own
