"""Forms of parts with own axes, clamps, bushings and load cases, and the values that they describe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from middeck.errors import ConfigError
from middeck.files.toml.form import Form, Inertia, Name, NotNegative, Vector, real_numbers, rule
from middeck.structure.model.article import AddedMass, Body, Bushing, LoadCase, PointLoad
from middeck.structure.model.clamps import LETTERS, Clamp
from middeck.structure.model.environment import GroundBushing

ORIGIN = (0.0, 0.0, 0.0)
# Sine between the two axes below which they are one: rounding decides where the third is.
APART = 1e-6


def stiffness_matrix(value: Any) -> tuple[tuple[float, ...], ...]:
    """A 6x6 stiffness from its diagonal or its rows; whether it is possible is checked with the article."""
    allowed = {"allowed": "six numbers, the diagonal, or six rows of six, symmetric: N/m, N, N m/rad"}
    matrix = real_numbers(value)
    matrix = np.diag(matrix) if matrix.shape == (6,) else matrix
    if matrix.shape != (6, 6) or not np.all(np.isfinite(matrix)):
        raise PydanticCustomError("stiffness", "not six numbers nor a 6x6 matrix of them", allowed)
    return tuple(map(tuple, matrix.tolist()))


Held = Annotated[
    str,
    rule(
        lambda held: list(held) == sorted(set(held) & set(LETTERS)),
        'must be x, y, z, in this order, as in "yz"; "" for none',
    ),
]
Stiffness = Annotated[Any, PlainValidator(stiffness_matrix)]


class AxesForm(Form):
    """Own axes in W; their lengths do not matter."""

    x_axis: Vector = (1.0, 0.0, 0.0)
    y_axis: Vector = (0.0, 1.0, 0.0)

    def axes(self, where: str) -> Float[np.ndarray, "3 3"]:
        """Unit vectors as columns, y in the plane of both; raises `ConfigError` where both are parallel."""
        x, y = np.array(self.x_axis), np.array(self.y_axis)
        across = np.cross(x, y)
        if not np.linalg.norm(across) > APART * np.linalg.norm(x) * np.linalg.norm(y):
            raise ConfigError(
                f"x_axis {x.tolist()} and y_axis {y.tolist()} make no plane",
                where=where,
                hint="two vectors in different directions; lengths do not matter",
            )
        x, z = x / np.linalg.norm(x), across / np.linalg.norm(across)
        return np.column_stack([x, np.cross(z, x), z])


class ClampForm(AxesForm):
    """Degrees of freedom of a node that the ground holds."""

    node: str
    along: Held = LETTERS
    about: Held = LETTERS


class PrescribedForm(ClampForm):
    """Held degrees of freedom moved from where the article was drawn, in the axes of the clamp."""

    shift_m: Vector = ORIGIN
    turn_deg: Vector = ORIGIN


class GroundBushingForm(AxesForm):
    """A 6x6 stiffness from an attach point to the ground."""

    name: Name | None = None
    attach: str
    stiffness: Stiffness


class BushingForm(AxesForm):
    """A 6x6 stiffness between two attach points, which follows the first."""

    name: Name | None = None
    from_: str = Field(alias="from")
    to: str
    stiffness: Stiffness


class LoadForm(Form):
    """A dead force, at ``offset_m`` from the origin of a frame, and a dead moment; both in W."""

    frame: str
    force_n: Vector = ORIGIN
    moment_nm: Vector = ORIGIN
    offset_m: Vector = ORIGIN


class MassForm(Form):
    """A body bolted to a frame; without ``inertia_kg_m2`` a point at ``cg_m``."""

    frame: str
    mass_kg: NotNegative
    cg_m: Vector = ORIGIN
    inertia_kg_m2: Inertia | None = None


class LoadCaseForm(Form):
    """Masses, loads and displacements of one test."""

    name: Name
    load: Annotated[tuple[LoadForm, ...], Field(strict=False)] = ()
    mass: Annotated[tuple[MassForm, ...], Field(strict=False)] = ()
    prescribed: Annotated[tuple[PrescribedForm, ...], Field(strict=False)] = ()


def build_clamp(form: ClampForm) -> Clamp:
    """The clamp that a valid form describes."""
    moved = form if isinstance(form, PrescribedForm) else PrescribedForm(node=form.node)
    return Clamp(
        node=form.node,
        along=form.along,
        about=form.about,
        axes=form.axes(f"clamp of node {form.node!r}"),
        shift=np.array(moved.shift_m),
        turn=np.deg2rad(moved.turn_deg),
    )


def build_ground(form: GroundBushingForm) -> GroundBushing:
    """The bushing to the ground that a valid form describes."""
    name = form.name or f"bushing_{form.attach}"
    axes = form.axes(f"bushing {name!r}")
    return GroundBushing(name=name, attach=form.attach, stiffness=np.array(form.stiffness), axes=axes)


def build_bushing(form: BushingForm) -> Bushing:
    """The bushing between two attach points that a valid form describes."""
    name = form.name or f"{form.from_}-{form.to}"
    axes = form.axes(f"bushing {name!r}")
    return Bushing(name=name, start=form.from_, end=form.to, stiffness=np.array(form.stiffness), axes=axes)


def build_load_cases(forms: Sequence[LoadCaseForm]) -> tuple[LoadCase, ...]:
    """The load cases that valid forms describe; loads and masses have the names of frames, numbered."""
    return tuple(
        LoadCase(
            name=form.name,
            loads=tuple(
                PointLoad(
                    name=f"{form.name}_{i}_{p.frame}",
                    frame=p.frame,
                    force=np.array(p.force_n),
                    moment=np.array(p.moment_nm),
                    offset=np.array(p.offset_m),
                )
                for i, p in enumerate(form.load)
            ),
            masses=tuple(
                AddedMass(f"{form.name}_{i}_{m.frame}", m.frame, _body(m)) for i, m in enumerate(form.mass)
            ),
            prescribed=tuple(build_clamp(p) for p in form.prescribed),
        )
        for form in forms
    )


def _body(form: MassForm) -> Body:
    inertia = np.zeros((3, 3)) if form.inertia_kg_m2 is None else np.array(form.inertia_kg_m2)
    return Body(form.mass_kg, np.array(form.cg_m), inertia)
