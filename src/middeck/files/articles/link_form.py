"""Forms of links, interpolations and linear equations, their values, and their faults."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from middeck.errors import ConfigError
from middeck.files.articles.boundary_form import ORIGIN, AxesForm, Held
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.form import Form, Name, Positive, Vector
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, tables
from middeck.structure.model.clamps import LETTERS
from middeck.structure.model.links import AnyLink, Equation, Interpolation, Link, Share, Term, link_faults


class LinkForm(AxesForm):
    """A rigid link or a joint between two frames, exact."""

    name: Name | None = None
    from_: str = Field(alias="from")
    to: str
    along: Held = LETTERS
    about: Held = LETTERS
    offset_m: Vector = ORIGIN


class ShareForm(AxesForm):
    """A frame that an interpolation follows."""

    frame: str
    weight: Positive = 1.0
    along: Held = LETTERS
    about: Held = ""


class InterpolationForm(AxesForm):
    """A frame that follows the mean motion of others (RBE3)."""

    name: Name | None = None
    frame: str
    along: Held = LETTERS
    about: Held = LETTERS
    follows: Annotated[tuple[ShareForm, ...], Field(strict=False, min_length=1)]


class TermForm(Form):
    """A coefficient times a motion."""

    frame: str
    direction: Literal["x", "y", "z", "rx", "ry", "rz", "angle"]
    coefficient: float


class EquationForm(Form):
    """A sum of motions that is zero (MPC)."""

    name: Name
    term: Annotated[tuple[TermForm, ...], Field(strict=False, min_length=1)]


FORMS: dict[str, type[LinkForm | InterpolationForm | EquationForm]] = {
    "link": LinkForm,
    "interpolation": InterpolationForm,
    "equation": EquationForm,
}


def build_link(form: LinkForm | InterpolationForm | EquationForm) -> AnyLink:
    """The value that a valid form describes; raises `ConfigError` for axes that make no plane."""
    if isinstance(form, EquationForm):
        return Equation(form.name, tuple(Term(t.frame, t.direction, t.coefficient) for t in form.term))
    if isinstance(form, LinkForm):
        name = form.name or f"{form.from_}-{form.to}"
        return Link(
            name=name,
            first=form.from_,
            second=form.to,
            along=form.along,
            about=form.about,
            offset=np.array(form.offset_m),
            axes=form.axes(f"link {name!r}"),
        )
    name = form.name or f"interpolation_{form.frame}"
    return Interpolation(
        name=name,
        frame=form.frame,
        along=form.along,
        about=form.about,
        axes=form.axes(f"link {name!r}"),
        shares=tuple(
            Share(frame=s.frame, weight=s.weight, along=s.along, about=s.about, axes=s.axes(f"link {name!r}"))
            for s in form.follows
        ),
    )


def link_findings(data: Table, joints: list[str]) -> Iterator[PathFault]:
    """Faults: links that tie nothing, axes that make no plane, impossible weights and coefficients."""
    for table, form in FORMS.items():
        for i, item in tables(data, table):
            try:
                link = build_link(form.model_validate(item))
            except ValidationError:  # reported by the form
                continue
            except ConfigError as error:
                yield finding((table, i), error.what, hint=error.hint)
                continue
            for fault in link_faults(link, set(joints)):
                yield finding((table, i), fault)


def linked_frames(data: Table) -> Iterator[list[tuple[Path, Any]]]:
    """The frames that every link ties, each with its path."""
    for i, t in tables(data, "link"):
        yield [(("link", i, key), t.get(key)) for key in ("from", "to")]
    for table, part in (("interpolation", "follows"), ("equation", "term")):
        for i, t in tables(data, table):
            parts = [((table, i, part, k), p) for k, p in tables(t, part)]
            parts = [((table, i), t), *parts] if table == "interpolation" else parts
            yield [((*path, "frame"), p.get("frame")) for path, p in parts]


def link_names(data: Table) -> list[tuple[Path, Any]]:
    """Names of all links, each with its path."""
    names: list[tuple[Path, Any]] = []
    for i, t in tables(data, "link"):
        key = "name" if "name" in t else "from"
        names.append((("link", i, key), t.get("name", f"{t.get('from')}-{t.get('to')}")))
    for i, t in tables(data, "interpolation"):
        key = "name" if "name" in t else "frame"
        names.append((("interpolation", i, key), t.get("name", f"interpolation_{t.get('frame')}")))
    return names + [(("equation", i, "name"), t.get("name")) for i, t in tables(data, "equation")]
