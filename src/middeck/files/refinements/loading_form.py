"""Loads on an article in a test, in documents."""

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from middeck.files.articles.boundary_form import (
    LoadCaseForm,
    LoadForm,
    MassForm,
    PrescribedForm,
    build_load_cases,
)
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.form import Form
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import tables
from middeck.structure.model.article import LoadCase


class LoadingForm(Form):
    """A test under one of the article's load cases by name, under loads of its own, or under none."""

    name: str
    load_case: str | None = None
    load: Annotated[tuple[LoadForm, ...], Field(strict=False)] = ()
    mass: Annotated[tuple[MassForm, ...], Field(strict=False)] = ()
    prescribed: Annotated[tuple[PrescribedForm, ...], Field(strict=False)] = ()


def case_of(form: LoadingForm) -> LoadCase | str | None:
    """The load case of a test: one of the article's by name, one of its own, or none."""
    if not (form.load or form.mass or form.prescribed):
        return form.load_case
    own = LoadCaseForm.model_construct(
        name=form.name, load=form.load, mass=form.mass, prescribed=form.prescribed
    )
    return build_load_cases([own])[0]


def survey_load_findings(data: Any) -> list[PathFault]:
    """Faults of surveys that name a load case beside loads of their own."""
    return [f for i, test in tables(data, "survey") for f in loaded_twice(("survey", i), test)]


def own_loads(test: dict[str, Any]) -> list[str]:
    """Kinds of loads that a test states itself."""
    return [key for key in ("load", "mass", "prescribed") if key in test]


def loaded_twice(path: Path, test: dict[str, Any]) -> Iterator[PathFault]:
    """The fault of a test that names a load case beside loads of its own."""
    own = own_loads(test)
    if own and "load_case" in test:
        yield finding((*path, "load_case"), f"beside {own[0]} of its own", hint="one or the other")
