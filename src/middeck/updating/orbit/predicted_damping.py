"""Damping ratios in another environment, from those that surveys measured on the ground.

A measured ratio is of a whole mode: of what the article loses, and of what the suspension does. The refined
model parts the two on the ground, mode by mode; where the article goes, each part is what the model has of it
there, times what the test says of that part. Nothing is asked of modes that are not of one shape: losses of a
cycle add up over the shapes that a mode is made of, each with its own part of the energy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.structure.model.article import DamperPlace
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.updating.refinement.model_errors import OwnErrors
from middeck.updating.residuals.surveys import Compared

# Relative standard deviation of a measured damping ratio for which the test states none.
DAMPING_STD = 0.1
# Ratio of an article to which its model gives no damping: about the least that any solid has (fused quartz).
LEAST = 1e-6


class DampingParts(NamedTuple):
    """Parts of the ratios of modes: of the article and of its suspension, in stiffness and in dampers."""

    omega: Float[np.ndarray, " mode"]
    parts: Float[np.ndarray, "part way mode"]

    @staticmethod
    def of(modes: Modes, index: Int[np.ndarray, " mode"]) -> DampingParts:
        """Losses of some modes: the suspension's are what its ratio and its dampers add.

        That is never negative: weight that softens a mode takes no loss from its supports.
        """
        damping = modes.equilibrium.model.structure.damping
        own = tuple(d for d in damping.dampers if d.place is not DamperPlace.DEVICE)
        alone = dataclasses.replace(damping, suspension=0.0, dampers=own)
        found = (ratios_by_cause(modes, d, count=int(index.max(initial=-1)) + 1) for d in (damping, alone))
        whole, article = (np.array([f.base + f.material, f.device])[:, index] for f in found)
        rest = whole - article
        article[0] = np.maximum(article[0], LEAST)
        return DampingParts(modes.omega[index], np.array([article, rest]))

    @property
    def of_parts(self) -> Float[np.ndarray, "part mode"]:
        """The article's and the suspension's part of each ratio."""
        return self.parts.sum(axis=1)


class Carried(NamedTuple):
    """Ratios in another environment, and deviations of their logarithms.

    Attributes:
        zeta: The ratios.
        open_part: Deviations by what no test separates from the rest, as those of a mode not seen.
        noise: Deviations by the noise of the tests.
    """

    zeta: Float[np.ndarray, " mode"]
    open_part: Float[np.ndarray, " mode"]
    noise: Float[np.ndarray, " mode"]


def measured_damping(
    errors: OwnErrors, compared: Sequence[Compared]
) -> tuple[DampingParts, Float[np.ndarray, " error"], Float[np.ndarray, " error"]]:
    """The model's losses in modes with errors of their own, measured ratios, relative deviations of these.

    A ratio of zero is none: files of modes have no other way to say so.
    """
    omega, parts, zeta, relative = [], [], [], []
    for number, one in enumerate(compared):
        mode, at = one.pairs[errors.pair[errors.survey == number]].T
        losses, measured = DampingParts.of(one.modes, mode), one.survey.measured
        stated = None if measured.damping_std is None else measured.damping_std[at]
        omega.append(losses.omega)
        parts.append(losses.parts)
        zeta.append(measured.damping[at])
        relative.append(_relative(measured.damping[at], stated))
    ground = DampingParts(np.concatenate(omega), np.concatenate(parts, axis=2))
    return ground, np.concatenate(zeta), np.concatenate(relative)


def _relative(zeta: np.ndarray, std: np.ndarray | None) -> np.ndarray:
    usual = np.full(len(zeta), DAMPING_STD)
    return usual if std is None else np.divide(std, zeta, out=usual, where=(zeta > 0.0) & np.isfinite(std))


def carry_damping(
    share: Float[np.ndarray, "mode error"],
    there: DampingParts,
    ground: DampingParts,
    zeta: Float[np.ndarray, " error"],
    relative: Float[np.ndarray, " error"],
) -> Carried:
    """The ratios of modes that have ``share`` of each shape in which ``zeta`` was measured.

    Each part of the model's loss there is scaled by what tests say of the shapes that lose it, each in the
    measure of its loss on the ground; of shapes that no test saw the model's stays as it is.
    """
    own, whole = there.of_parts[:, :, None], ground.of_parts.sum(axis=0)
    kept = ground.of_parts[0] / whole
    measured = np.where(zeta > 0.0, zeta / whole, 1.0)
    part, spread, slope = split_measured(kept, measured)
    factor = np.array([part / kept, _over(measured - part, 1.0 - kept)])
    known, slower = share * (zeta > 0.0), ground.omega / there.omega[:, None]
    lost = sum(known * slower ** (2 - way) * ground.parts[:, way, None] for way in (0, 1))
    unseen = np.maximum(1.0 - known.sum(axis=1), 0.0)[:, None]
    tested = own * _over(lost, np.sum(lost, axis=2, keepdims=True) + unseen * own)
    scaled = tested * factor[:, None]
    found = np.sum(own[:, :, 0] + np.sum(scaled - tested, axis=2), axis=0)
    # The two parts of a measured ratio add up to it: what the one has more the other has less.
    both = _over(scaled[1], measured - part) * measured / found[:, None]
    alone = scaled[0] / found[:, None] - both * part / measured
    noise = np.linalg.norm((alone * slope + both) * relative, axis=1)
    return Carried(found, np.abs(alone) @ spread, noise)


def split_measured(
    kept: Float[np.ndarray, " error"], measured: Float[np.ndarray, " error"]
) -> tuple[Float[np.ndarray, " error"], Float[np.ndarray, " error"], Float[np.ndarray, " error"]]:
    """The article's part of losses that are ``measured`` times those of the model, suspension included.

    ``kept`` is the article's share in the model, in whose losses the part is. Both shares differ from the
    model by unknown factors, as likely before, and only their sum was measured: for small factors ln factor
    of the share w is w / (w^2 + (1 - w)^2) of the sum's. The article never loses more than was measured.
    Second, how much of the spread of ln factor stays open; third, its derivative by the logarithm of the sum.
    """
    size = np.hypot(kept, 1.0 - kept)
    slope = kept / size**2
    part = kept * measured**slope
    return np.minimum(part, measured), (1.0 - kept) / size, np.where(part < measured, slope, 1.0)


def _over(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    out = np.zeros(np.broadcast_shapes(part.shape, whole.shape))
    return np.divide(part, whole, out=out, where=whole > 0.0)
