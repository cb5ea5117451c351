"""Friction of joints in refinements: its prior values, and the amplitudes of joints in a survey."""

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from middeck.errors import ConfigError
from middeck.files.articles.name_checks import given_again
from middeck.files.toml.faults import PathFault, finding, nearest
from middeck.files.toml.form import Form, Positive, Positives
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, tables
from middeck.structure.model.article import Structure
from middeck.updating.residuals.surveyed_friction import SurveyedFriction


class FrictionForm(Form):
    """A spring and a slider in series at a joint that turns."""

    joint: str
    slip_torque_nm: Positive
    slip_angle_deg: Positive


class AmplitudeForm(Form):
    """Amplitude of a joint with friction: one for all modes, or one a mode."""

    joint: str
    angle_deg: Positives
    random: bool = False


def build_frictions(
    amplitudes: Sequence[AmplitudeForm], frictions: Sequence[FrictionForm], modes: int
) -> tuple[SurveyedFriction, ...]:
    """Frictions of a survey of ``modes`` modes; every joint of ``amplitudes`` is one of ``frictions``."""
    named = {f.joint: f for f in frictions}
    return tuple(
        SurveyedFriction(
            joint=a.joint,
            slip_torque=named[a.joint].slip_torque_nm,
            slip_angle=float(np.radians(named[a.joint].slip_angle_deg)),
            amplitude=np.radians(a.angle_deg * (modes if len(a.angle_deg) == 1 else 1)),
            random=a.random,
        )
        for a in amplitudes
    )


def friction_findings(data: Any) -> Iterator[PathFault]:
    """Faults beyond the forms of friction: joints given twice, and amplitudes of joints without friction."""
    known: list[Any] = [f.get("joint") for _, f in tables(data, "friction")]
    yield from _twice((), "friction", data)
    for k, survey in tables(data, "survey"):
        yield from _twice(("survey", k), "amplitude", survey)
        for i, amplitude in tables(survey, "amplitude"):
            joint = amplitude.get("joint")
            if isinstance(joint, str) and joint not in known:
                hint = (
                    nearest(joint, [str(name) for name in known]) if known else "a [[friction]] of the joint"
                )
                path = ("survey", k, "amplitude", i, "joint")
                yield finding(path, "no [[friction]] of this joint", joint, hint=hint)


def refuse_slides(structure: Structure, joints: Collection[str], where: str) -> None:
    """Raise `ConfigError` for friction in N m and degrees of one of ``joints`` that slides."""
    for joint in structure.joints:
        if joint.slides and joint.name in joints:
            raise ConfigError(
                f"joint {joint.name!r} slides: N m and degrees say nothing of its friction",
                where=where,
                hint="joints that turn; of slides SurveyedFriction and JointSlip take N and m in Python",
            )


def _twice(path: Path, key: str, table: Table) -> Iterator[PathFault]:
    joints = [((*path, key, i, "joint"), item.get("joint")) for i, item in tables(table, key)]
    return given_again(joints, "given twice", "one of a joint")
