"""The form of ``environments/*.toml``, its own checks and the `Environment` it describes."""

from __future__ import annotations

from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field

from middeck.files.faults import Finding, nearest, show
from middeck.files.form import Form, Name, NotNegative, Positive, Vector
from middeck.structure.environment import AnchoredSpring, Environment, Suspension

Held = Annotated[str, Field(pattern=r"^x?y?z?$", min_length=1)]


class ConstantsForm(Form):
    """Gravity; the direction need not be a unit vector."""

    gravity_m_s2: NotNegative
    gravity_direction: Vector = (0.0, -1.0, 0.0)


class CablesForm(Form):
    """One cable and device per attach point in ``held``, all of one length and bounce frequency."""

    cable_length_m: Positive
    bounce_hz: Positive
    held: dict[str, Held]


class AnchoredSpringForm(Form):
    """A linear spring from an attach point to a point fixed in the world."""

    name: Name | None = None
    attach: str
    anchor_m: Vector
    stiffness_n_per_m: Positive
    free_length_m: NotNegative


class EnvironmentForm(Form):
    """Where an article is; without ``[constants]`` there is no gravity."""

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    constants: ConstantsForm | None = None
    suspension: CablesForm | None = None
    spring: Annotated[tuple[AnchoredSpringForm, ...], Field(strict=False)] = ()


def environment_findings(data: dict[str, Any]) -> list[Finding]:
    """What is wrong with an environment beyond the form of its keys; tolerates a broken form."""
    constants, suspension = _table(data, "constants"), _table(data, "suspension")
    found: list[Finding] = []
    gravity = constants.get("gravity_m_s2", 0.0)
    if isinstance(gravity, int | float) and gravity > 0.0 and not suspension and not data.get("spring"):
        advice = "add [suspension] or [[spring]], or leave [constants] out for orbit"
        path = ("constants", "gravity_m_s2")
        found.append(Finding(path, "a missing suspension in gravity", show(gravity), advice))
    if constants.get("gravity_direction") == [0.0, 0.0, 0.0]:
        found.append(Finding(("constants", "gravity_direction"), "must not be the zero vector"))
    if suspension and gravity == 0.0:
        advice = "give [constants] gravity_m_s2, or use [[spring]]"
        found.append(Finding(("suspension",), "cables carry nothing without gravity", hint=advice))
    if suspension.get("held") == {}:
        found.append(Finding(("suspension", "held"), "no attach point hangs on a cable", hint='n1 = "xyz"'))
    return found


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    value = data.get(key)
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def joint_findings(form: EnvironmentForm, attach_points: list[str], article: str) -> list[Finding]:
    """Names in the environment that the article does not have."""
    used = [
        (("suspension", "held", name), name) for name in (form.suspension.held if form.suspension else {})
    ]
    springs = [(("spring", i, "attach"), spring.attach) for i, spring in enumerate(form.spring)]
    return [
        Finding(path, f"article {article!r} has no attach point {name!r}", hint=nearest(name, attach_points))
        for path, name in (*used, *springs)
        if name not in attach_points
    ]


def build_environment(form: EnvironmentForm) -> Environment:
    """The value that a valid form describes."""
    gravity = np.zeros(3)
    if form.constants is not None:
        direction = np.array(form.constants.gravity_direction)
        gravity = form.constants.gravity_m_s2 * direction / np.linalg.norm(direction)
    springs = tuple(
        AnchoredSpring(
            s.name or f"spring_{s.attach}",
            s.attach,
            np.array(s.anchor_m),
            s.stiffness_n_per_m,
            s.free_length_m,
        )
        for s in form.spring
    )
    cables = form.suspension
    suspension = None
    if cables is not None:
        held = cables.held
        suspension = Suspension(tuple(held), tuple(held.values()), cables.cable_length_m, cables.bounce_hz)
    return Environment(form.name, gravity + 0.0, suspension, springs)  # + 0.0: no negative zeros
