"""Faults of clamps and bushings beyond the form of their keys: impossible values."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from pydantic import ValidationError

from middeck.errors import ConfigError
from middeck.files.articles.boundary_form import ClampForm, build_clamp
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.form import Form
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table
from middeck.structure.model.article import Bushing
from middeck.structure.model.clamps import Clamp, held_directions
from middeck.structure.model.environment import GroundBushing
from middeck.structure.model.section_and_bushing_checks import bushing_faults

F = TypeVar("F", bound=Form)


def clamp_findings(
    path: Path, items: Iterable[tuple[int, Table]], form: type[ClampForm]
) -> Iterator[PathFault]:
    """Faults of clamps: nothing held, an impossible direction, or a degree of freedom held twice."""
    held: list[Clamp] = []
    for i, table in items:
        try:
            held.append(build_clamp(form.model_validate(table)))
            held_directions(held, held[-1].node)
        except ValidationError:  # reported by the form
            continue
        except ConfigError as error:
            yield finding((*path, i), error.what, hint=error.hint)


def bushing_findings(
    path: Path,
    items: Iterable[tuple[int, Table]],
    form: type[F],
    build: Callable[[F], Bushing | GroundBushing],
) -> Iterator[PathFault]:
    """Faults of bushings: axes that make no plane, stiffnesses not symmetric or indefinite."""
    for i, table in items:
        try:
            bushing = build(form.model_validate(table))
        except ValidationError:
            continue
        except ConfigError as error:
            yield finding((*path, i), error.what, hint=error.hint)
            continue
        for fault in bushing_faults(bushing.name, bushing.stiffness, bushing.axes):  # axes are built right
            yield finding((*path, i, "stiffness"), fault)
        if isinstance(bushing, Bushing) and bushing.start == bushing.end:
            yield finding((*path, i, "to"), "joins an attach point to itself", bushing.end)
