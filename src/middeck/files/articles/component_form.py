"""The form of a reduced component in an article's file."""

from typing import Annotated

from pydantic import Field

from middeck.files.articles.axes_form import AxesForm
from middeck.files.toml.form import Name, Vector, whole


class ComponentForm(AxesForm):
    """Matrices in a file beside the article, and the frame that each of its boundary grids is fixed to.

    ``cards`` (the punch file) are of OUTPUT4 and punched matrices; NPZ and MAT without ``units`` are in SI.
    """

    name: Name
    file: str
    nodes: dict[str, str]
    offsets_m: dict[str, Vector] = Field(default_factory=dict)
    cards: Annotated[tuple[str, ...], Field(strict=False)] = ()
    units: str | None = None
    superelement: Annotated[int, whole(1, 10**8)] | None = None
