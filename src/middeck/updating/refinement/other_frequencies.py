"""Surveys that state another frequency of their modes than the size |s| of a root.

A program may write the frequency of the decay, Im s = |s| sqrt(1 - zeta^2), or that of a real mode, as if
nothing were lost. The difference grows with the square of the damping, and looks like an error of the model.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.damping_rows import shifted_by_losses

# Logarithm of the odds of another frequency above which it is named: a thousand to one.
NAMED = np.log(1000.0)


def other_frequencies(refined: Refined) -> Iterator[str]:
    """A sentence for each survey whose frequencies fit better as other ones."""
    lossy = {d.survey.name for d in refined.damped}
    for c in refined.compared:
        theirs = c.pairs[:, 1]
        std, off = c.survey.std[theirs], c.residual[: len(theirs)]
        zeta = np.nan_to_num(c.survey.measured.damping[theirs])
        zeta = np.where(
            np.abs(zeta) < 1.0, zeta, 0.0
        )  # others, as those in per cent, decay without a frequency
        others = {"of decays, |s| sqrt(1 - zeta^2)": (0.5 * np.log1p(-(zeta**2)), "divide them by that root")}
        if c.survey.name in lossy:
            cure = "leave damping out of the unknowns, which compares undamped modes"
            others["of undamped modes"] = (-shifted_by_losses(c), cure)
        odds = {name: _cost(off / std) - _cost((off - e) / std) for name, (e, _) in others.items()}
        best = max(odds, key=lambda name: odds[name])
        if odds[best] > NAMED:
            shift, cure = others[best]
            yield (
                f"{c.survey.name}: the frequencies fit better as those {best}, than as natural ones, |s| of "
                f"roots, as which they are compared (off by up to {100.0 * np.abs(shift).max():.2g} %, odds "
                f"e^{odds[best]:.0f} to 1): are they? Then {cure}"
            )


def _cost(miss: Float[np.ndarray, " pair"]) -> float:
    """Negative log likelihood of misses in stated deviations, which are taken as wider where all miss."""
    n, total = len(miss), float(miss @ miss)
    return 0.5 * total if total < n else 0.5 * n * (1.0 + np.log(total / n))
