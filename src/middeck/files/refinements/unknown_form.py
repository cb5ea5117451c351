"""The form of an unknown, in refinements and in studies."""

from typing import Annotated

from pydantic import Field

from middeck.files.toml.form import Finite, Form, Positive


class UnknownForm(Form):
    """Parameters that move together, with the mean and standard deviation of their prior."""

    name: str
    parameters: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    spread: Positive
    mean: Finite = 0.0
    added: bool = False
