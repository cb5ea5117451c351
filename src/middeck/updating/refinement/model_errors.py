"""The model's own errors in modes: their shapes, and the share of each in each mode.

An error belongs to the shape of a mode that a survey saw: every paired mode of the first survey, and one of a
later survey that has less than half of its shape in those before. Shapes are orthonormal in mass, so that
what a mode has of them adds up to no more than the whole of it. All are turned with the article to how it was
drawn, however it hung.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from middeck.structure.gravity.turned_modes import modes_as_drawn
from middeck.structure.modes.solve import Modes
from middeck.updating.residuals.surveys import Compared
from middeck.values import record

HALF = 0.5


@record(kw_only=True)
class OwnErrors:
    """Shapes with errors of their own, the mass in which they are orthonormal, and whose they are.

    That is the mass of the first survey's set-up; ``survey`` and ``pair`` in it say where each was seen.
    ``drawn`` are the shapes of each survey's modes, as drawn.
    """

    shapes: Float[np.ndarray, "coordinate error"]
    mass: sp.csr_array
    survey: Int[np.ndarray, " error"]
    pair: Int[np.ndarray, " error"]
    drawn: tuple[Float[np.ndarray, "coordinate mode"], ...]

    @staticmethod
    def of(compared: Sequence[Compared]) -> OwnErrors:
        """Errors of all surveys, in their order; of a later one the part of a shape not in those before."""
        first = compared[0]
        drawn = [modes_as_drawn(one.modes) for one in compared]
        mass, shapes = drawn[0].mass, drawn[0].shapes[:, first.pairs[:, 0]]
        place = [(0, k) for k in range(len(first.pairs))]
        for number, later in enumerate(compared[1:], start=1):
            seen = drawn[number].shapes[:, later.pairs[:, 0]]
            for k, shape in enumerate(seen.T):
                part = shapes.T @ (mass @ shape)
                if part @ part < HALF * (shape @ (mass @ shape)):
                    left = shape - shapes @ part
                    shapes = np.column_stack([shapes, left / np.sqrt(left @ (mass @ left))])
                    place.append((number, k))
        survey, pair = np.array(place, dtype=int).reshape(-1, 2).T
        return OwnErrors(
            shapes=shapes, mass=mass, survey=survey, pair=pair, drawn=tuple(one.shapes for one in drawn)
        )

    def shared_with(self, others: Modes) -> Float[np.ndarray, "mode error"]:
        """Share of the kinetic energy of each mode in each of the shapes: cross-orthogonality squared.

        For a small error of the model d ln f of a mode is the sum of those of the modes that it is made of,
        each by its share, and of unknown cross terms.
        """
        return self._shares(modes_as_drawn(others).shapes)

    def of_survey(self, number: int) -> Float[np.ndarray, "mode error"]:
        """`shared_with` the modes of one of the surveys."""
        return self._shares(self.drawn[number])

    def _shares(self, shapes: np.ndarray) -> Float[np.ndarray, "mode error"]:
        weighted = self.mass @ shapes
        size = np.einsum("im,im->m", shapes, weighted)
        return ((self.shapes.T @ weighted) ** 2 / size).T

    def sorts(self, compared: Sequence[Compared]) -> Int[np.ndarray, " error"]:
        """The place in `MODES` of each error."""
        return np.array(
            [
                sorts_of(compared[s].modes, compared[s].pairs[p : p + 1, 0])[0]
                for s, p in zip(self.survey, self.pair, strict=True)
            ],
            dtype=int,
        )

    def ground_hz(self, compared: Sequence[Compared]) -> Float[np.ndarray, " error"]:
        """The model's frequencies [Hz] of the modes that define the shapes."""
        return np.array(
            [
                compared[s].modes.frequency_hz[compared[s].pairs[p, 0]]
                for s, p in zip(self.survey, self.pair, strict=True)
            ]
        )


def sorts_of(modes: Modes, index: Int[np.ndarray, " mode"]) -> Int[np.ndarray, " mode"]:
    """The place in `MODES` of each mode."""
    return np.array([modes.kind[i] == "flexible" for i in index], dtype=int)
