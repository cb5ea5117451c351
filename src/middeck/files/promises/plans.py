"""Plans of promises: documents that state the promised quantities of a refined article."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from middeck.control.law.pd_loops import PDLoops
from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import PLAN
from middeck.files.laws.compensators import load_compensator
from middeck.files.refinements.documents import Refinement, load_refinement
from middeck.files.refinements.friction_form import refuse_slides
from middeck.files.setups import article_files, find_stated, load_setup, load_structure
from middeck.files.toml.form import (
    Form,
    Log10Authority,
    Names,
    NotNegative,
    NotNegatives,
    Positive,
    whole,
)
from middeck.files.toml.source import read_form
from middeck.structure.model.article import Structure
from middeck.systems.plants.dispersed_frequencies import Dispersion
from middeck.updating.promise.draws import LoopSpread
from middeck.updating.promise.plan import Ladder, Plan
from middeck.updating.promise.slip import JointSlip
from middeck.values import record

# Unit of a port -> key of the noise of its readings.
NOISE = {
    "rad": "angle_rad_per_rthz",
    "rad/s": "rate_rad_per_s_per_rthz",
    "m": "way_m_per_rthz",
    "m/s": "speed_m_per_s_per_rthz",
    "m/s^2": "acceleration_m_per_s2_per_rthz",
}


class PerformanceForm(Form):
    """The promised performance: the weighted rms of sensors under white noise at actuators."""

    outputs: Names
    weights: NotNegatives
    disturbances: Names
    intensity_per_rthz: NotNegatives
    band_hz: Annotated[tuple[NotNegative, Positive], Field(strict=False)] | None = None


class NoiseForm(Form):
    """Two-sided noise of readings, by their unit."""

    angle_rad_per_rthz: Positive | None = None
    rate_rad_per_s_per_rthz: Positive | None = None
    way_m_per_rthz: Positive | None = None
    speed_m_per_s_per_rthz: Positive | None = None
    acceleration_m_per_s2_per_rthz: Positive | None = None


class LoopForm(Form):
    """Uncertainty of the loop beside that of the article."""

    delay_s: NotNegative = 0.0
    delay_tolerance_s: NotNegative = 0.0
    gain_tolerance: NotNegative = 0.0
    damping_std: NotNegative = 0.3
    umbilical_hz: NotNegative = 0.0


class InnerForm(Form):
    """Proportional-derivative loops without delay."""

    loops: Names
    kp_nm_per_rad: NotNegatives
    kd_nms_per_rad: NotNegatives


class LadderForm(Form):
    """LQG of rising authority on the refined article."""

    drives: Names
    reads: Names
    log10_authority: Annotated[tuple[Log10Authority, ...], Field(strict=False, min_length=1)]


class LawFile(Form):
    """A compensator in a file beside the plan."""

    name: str
    file: str


class JointForm(Form):
    """Dry friction of a joint."""

    name: str
    slip_torque_nm: NotNegative
    slip_angle_deg: Positive
    viscous_nms_per_rad: NotNegative = 0.0
    slip_torque_tolerance: NotNegative = 0.0
    slip_angle_tolerance: NotNegative = 0.0


class SweepForm(Form):
    """Shifts of the refined article's flexible modes."""

    first_bending_percent: Annotated[float, Field(ge=0.0, lt=100.0)] = 10.0
    others_percent: Annotated[float, Field(ge=0.0, lt=100.0)] = 20.0


class PlanForm(Form):
    """A plan."""

    schema_: Literal["middeck.promise-plan/1"] = Field(alias="schema")
    refinement: str
    environments: Names = ("orbit",)
    modes: Annotated[int, whole(1, 10000)] = 26
    draws: Annotated[int, whole(1, 1000000)] = 300
    bounded: Annotated[int, whole(0, 10000)] = 10
    seed: Annotated[int, whole(0, 2**63 - 1)] = 0
    probability: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.99
    performance: PerformanceForm
    noise: NoiseForm
    loop: LoopForm = LoopForm()
    inner: InnerForm | None = None
    ladder: LadderForm | None = None
    law: Annotated[tuple[LawFile, ...], Field(strict=False)] = ()
    joint: Annotated[tuple[JointForm, ...], Field(strict=False)] = ()
    sweep: SweepForm = SweepForm()


@record(kw_only=True)
class LoadedPlan:
    """An article, a plan for it, the refinement that this stands on, and every file that was read."""

    structure: Structure
    plan: Plan
    refinement: Refinement
    files: tuple[Path, ...]


def load_plan(path: str | Path, article: str | Path) -> LoadedPlan:
    """The plan in file ``path`` for the article in file ``article``.

    The refinement and compensators are sought beside it, environments as everywhere. Raises `ConfigError`
    with all faults of the document, and `DataError` for files that cannot be read.
    """
    form = read_form(path, PLAN, PlanForm)
    for what, names in (
        ("law", [law.name for law in form.law]),
        ("joint", [joint.name for joint in form.joint]),
        ("environment", list(form.environments)),
    ):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ConfigError(
                f"the name {twice[0]!r} is given twice", where=f"{path}, {what}", hint="a name for each"
            )
    beside = Path(path).parent
    found = {name: find_stated(name, path) for name in form.environments}
    laws = {law.name: beside / law.file for law in form.law}
    refinement = load_refinement(beside / form.refinement, article)
    noise = {unit: getattr(form.noise, key) for unit, key in NOISE.items()}
    p, inner, ladder = form.performance, form.inner, form.ladder
    plan = Plan(
        environments={name: load_setup(article, file)[1] for name, file in found.items()},
        performance=p.outputs,
        weights=np.array(p.weights),
        disturbances=p.disturbances,
        intensity=np.array(p.intensity_per_rthz),
        band_hz=p.band_hz,
        noise={unit: value for unit, value in noise.items() if value is not None},
        inner=None
        if inner is None
        else PDLoops(inner.loops, np.array(inner.kp_nm_per_rad), np.array(inner.kd_nms_per_rad)),
        loop=LoopSpread(**form.loop.model_dump()),
        modes=form.modes,
        draws=form.draws,
        seed=form.seed,
        probability=form.probability,
        bounded=form.bounded,
        laws={name: load_compensator(file) for name, file in laws.items()},
        ladder=None
        if ladder is None
        else Ladder(
            drives=ladder.drives, reads=ladder.reads, authority=10.0 ** np.array(ladder.log10_authority)
        ),
        joints=tuple(_joint(joint) for joint in form.joint),
        sweep=Dispersion(
            first_bending=0.01 * form.sweep.first_bending_percent, others=0.01 * form.sweep.others_percent
        ),
    )
    structure = load_structure(article)
    own = {joint.name for joint in form.joint}
    moved = [a.frame for a in structure.actuators if a.axis is None and a.name in own]
    refuse_slides(structure, moved, f"{path}, joint")
    files = (Path(path), *article_files(article), *refinement.files, *found.values(), *laws.values())
    return LoadedPlan(
        structure=structure, plan=plan, refinement=refinement, files=tuple(dict.fromkeys(files))
    )


def _joint(form: JointForm) -> JointSlip:
    return JointSlip(
        name=form.name,
        slip_torque=form.slip_torque_nm,
        slip_angle=float(np.radians(form.slip_angle_deg)),
        viscous=form.viscous_nms_per_rad,
        slip_torque_tolerance=form.slip_torque_tolerance,
        slip_angle_tolerance=form.slip_angle_tolerance,
    )
