"""The form of a reduced component in an article's file."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from middeck.files.articles.boundary_form import X, Y, build_plane
from middeck.files.toml.form import Form, Name, Vector, whole


class ComponentForm(Form):
    """Matrices in a file beside the article, and the frame that each of its boundary grids is fixed to.

    ``cards`` (the punch file) and ``units`` belong to OUTPUT4 and punched matrices.
    """

    name: Name
    file: str
    nodes: dict[str, str]
    offsets_m: dict[str, Vector] = Field(default_factory=dict)
    x_axis: Vector = X
    y_axis: Vector = Y
    cards: Annotated[tuple[str, ...], Field(strict=False)] = ()
    units: str | None = None
    superelement: Annotated[int, whole(1, 10**8)] | None = None

    def axes(self, where: str) -> Float[np.ndarray, "3 3"]:
        """Unit vectors of the component's own axes in W, as columns."""
        return build_plane(self.x_axis, self.y_axis, where)
