"""The form of ``articles/*.toml``: every key that a test article may have."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from middeck.files.articles.boundary_form import AxesForm, BushingForm, LoadCaseForm
from middeck.files.articles.link_form import EquationForm, InterpolationForm, LinkForm
from middeck.files.toml.form import (
    Direction,
    Finite,
    Form,
    Inertia,
    Interval,
    Name,
    NotNegative,
    Positive,
    Positives,
    Vector,
    ascends,
    real_numbers,
    rule,
    whole,
    within,
)

State = Literal["free", "sprung", "locked", "driven", "hinged"]
Ratio = Annotated[float, within(least=0.0, below=1.0)]
ORIGIN = (0.0, 0.0, 0.0)
Plane = Annotated[tuple[Finite, Finite], Field(strict=False)]


def section_stiffness(value: Any) -> tuple[tuple[float, ...], ...]:
    """Rows of a 4x4 or 6x6; whether it can be a stiffness is checked with the article."""
    matrix = real_numbers(value)
    if matrix.shape not in ((4, 4), (6, 6)) or not np.all(np.isfinite(matrix)):
        allowed = {"allowed": "4x4: extension, twist, curvatures about y and z; 6x6: with shears y, z second"}
        raise PydanticCustomError("stiffness", "not a 4x4 nor a 6x6 matrix of numbers", allowed)
    return tuple(map(tuple, matrix.tolist()))


SectionStiffness = Annotated[Any, PlainValidator(section_stiffness)]


class MeshForm(Form):
    """Division of members into elements."""

    elements_per_strut: Annotated[int, whole(1, 200)] = 8


class MaterialForm(Form):
    """Isotropic: Young's modulus, Poisson's ratio (G = E / (2 (1 + nu))) and density."""

    E_pa: Positive
    nu: Annotated[float, within(above=-1.0, most=0.5)]
    rho_kg_m3: Positive


class SectionForm(Form):
    """A round tube (material, diameters, shear coefficient), or a section by its stiffnesses or their matrix.

    ``mass`` is the formulation of an element's mass, see `MemberMass`; for ``stiffness`` `coupled_section`.
    ``density_kg_m3`` is that of the material of a section without one; doubts about units look at it alone.
    """

    material: str | None = None
    outer_diameter_m: Positive | None = None
    inner_diameter_m: NotNegative | None = None
    shear: Annotated[float, within(above=0.0, most=1.0)] | None = None
    EA_n: Positive | None = None
    GJ_nm2: NotNegative | None = None
    EI_y_nm2: NotNegative | None = None
    EI_z_nm2: NotNegative | None = None
    GA_y_n: Positive | None = None
    GA_z_n: Positive | None = None
    rho_A_kg_per_m: NotNegative | None = None
    rho_I_y_kg_m: NotNegative | None = None
    rho_I_z_kg_m: NotNegative | None = None
    density_kg_m3: NotNegative | None = None
    stiffness: SectionStiffness | None = None
    centroid_m: Plane = (0.0, 0.0)
    shear_centre_m: Plane = (0.0, 0.0)
    mass_centre_m: Plane = (0.0, 0.0)
    mass: Literal["consistent", "coupled", "rod", "coupled rod"] = "consistent"


class NodeForm(Form):
    """A rigid node; without ``inertia_kg_m2`` its mass is a point at ``cg_m``."""

    name: Name
    x_m: Finite
    y_m: Finite = 0.0
    z_m: Finite = 0.0
    size_m: NotNegative = 0.0
    mass_kg: NotNegative = 0.0
    cg_m: Vector = ORIGIN
    inertia_kg_m2: Inertia | None = None
    rotors_excluded: bool = False


class StationForm(Form):
    """A section of a tapered member, at a fraction of its length."""

    at: Annotated[float, within(above=0.0, most=1.0)]
    section: str


class StrutForm(Form):
    """A member; ``up`` fixes its own y axis (default: world y, or world x for an upright member).

    It begins at ``from_offset_m`` from its first node, rigidly joined to it, and ends likewise; from its
    ``section`` it tapers through ``stations``.
    """

    name: Name | None = None
    section: str
    from_: str = Field(alias="from")
    to: str
    up: Vector | None = None
    from_offset_m: Vector = ORIGIN
    to_offset_m: Vector = ORIGIN
    tension_n: Finite = 0.0
    stations: Annotated[tuple[StationForm, ...], Field(strict=False)] = ()
    elements: Annotated[int, whole(1, 200)] | None = None


class GimbalForm(Form):
    """Two axes that cross: ``<name>_x`` carries the stage and ``<name>_z``, on it, the payload."""

    name: Name
    node: str
    offset_m: Vector = ORIGIN
    angle_x_deg: Annotated[float, within(least=-180.0, most=180.0)] = 0.0
    angle_z_deg: Annotated[float, within(least=-180.0, most=180.0)] = 0.0
    stage_mass_kg: NotNegative = 0.0
    stage_cg_m: Vector = ORIGIN
    stage_inertia_kg_m2: Inertia | None = None
    payload_mass_kg: Positive
    payload_cg_m: Vector = ORIGIN
    payload_inertia_kg_m2: Inertia
    state_x: State = "free"
    state_z: State = "free"
    stiffness_x_nm_per_rad: Positive | None = None
    stiffness_z_nm_per_rad: Positive | None = None
    rest_x_deg: Finite | None = None
    rest_z_deg: Finite | None = None
    command_x_deg: Finite | None = None
    command_z_deg: Finite | None = None
    travel_x_deg: Interval | None = None
    travel_z_deg: Interval | None = None
    torque_limit_nm: Positive | None = None
    rotors_excluded: bool = False


class RevoluteForm(Form):
    """One axis that carries a body; ``parent`` is a node or another joint."""

    name: Name
    parent: str
    offset_m: Vector = ORIGIN
    axis: Direction
    angle_deg: Annotated[float, within(least=-180.0, most=180.0)] = 0.0
    mass_kg: NotNegative
    cg_m: Vector = ORIGIN
    inertia_kg_m2: Inertia | None = None
    state: State = "free"
    stiffness_nm_per_rad: Positive | None = None
    rest_deg: Finite | None = None
    command_deg: Finite | None = None
    travel_deg: Interval | None = None
    torque_limit_nm: Positive | None = None
    rotors_excluded: bool = False


class ProofMassForm(Form):
    """A mass that slides along an axis of its carrier against a spring, driven by a force between the two."""

    name: Name
    node: str
    offset_m: Vector = ORIGIN
    axis: Direction
    mass_kg: Positive
    stiffness_n_per_m: Positive | None = None
    natural_hz: Positive | None = None
    damping: Ratio = 0.0
    rest_m: Finite = 0.0
    travel_m: Interval | None = None


class WheelForm(Form):
    """A rotor on a frame: its inertia about its spin axis. The environment states its speed."""

    name: Name
    frame: str
    axis: Direction
    rotor_inertia_kg_m2: Positive


class AttachForm(Form):
    """A named point of a frame."""

    name: Name
    frame: str
    offset_m: Vector = ORIGIN


class SpringForm(Form):
    """A linear spring between two attach points."""

    name: Name | None = None
    from_: str = Field(alias="from")
    to: str
    stiffness_n_per_m: Positive
    free_length_m: NotNegative


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


class SuspensionForm(Form):
    """Attach points with the names of their nodes."""

    nodes: Annotated[tuple[str, ...], Field(strict=False)]
    offsets_m: Annotated[tuple[Vector, ...], Field(strict=False)]


class ActuatorForm(Form):
    """A torque on a frame about its ``axis``, or a force; without an axis, the torque of a joint."""

    name: Name
    frame: str
    axis: Direction | None = None
    kind: Literal["torque", "force"] = "torque"
    offset_m: Vector = ORIGIN


class SensorForm(Form):
    """An inertial rotation of a frame about an axis of ``axis_frame``; without an axis, a joint's angle.

    Or an accelerometer at a point of the frame, along an axis of it; or the displacement of such a point
    along an axis of the world.
    """

    name: Name
    frame: str
    axis: Direction | None = None
    axis_frame: str | None = None
    kind: Literal["angle", "accelerometer", "displacement"] = "angle"
    offset_m: Vector = ORIGIN


class DamperForm(Form):
    """A viscous damper at one of ``joint``, ``spring`` and ``attach`` (a device of the environment there)."""

    joint: str | None = None
    spring: str | None = None
    attach: str | None = None
    c_ns_per_m: NotNegative | None = None
    c_joint_nms_per_rad: NotNegative | None = None


class DampingTableForm(Form):
    """Ratios measured at frequencies that ascend."""

    frequency_hz: Annotated[Positives, rule(ascends, "must ascend, in Hz")]
    ratio: Annotated[tuple[Ratio, ...], Field(strict=False)]
    outside: Literal["refuse", "hold"] = "refuse"


class DampingForm(Form):
    """Modal damping ratios: a base, plus what materials and devices add; a mode may have its own.

    ``rule`` says which modes have ``suspension``: "shares" weighs both ratios with where each mode keeps its
    energy, "rank" gives it to the n lowest modes, n the number of rigid-body modes in orbit.
    Where a table is given, ``flexible`` and ``suspension`` are not; where loss factors are, ``flexible`` is
    zero unless it is written.
    """

    flexible: Ratio = 0.01
    suspension: Ratio = 0.03
    rule: Literal["shares", "rank"] = "shares"
    rigid: Ratio = 0.0
    table: DampingTableForm | None = None
    material: dict[str, NotNegative] = Field(default_factory=dict)
    section: dict[str, NotNegative] = Field(default_factory=dict)
    device: Annotated[tuple[DamperForm, ...], Field(strict=False)] = ()
    mode: dict[str, Ratio] = Field(default_factory=dict)


class ArticleForm(Form):
    """A test article."""

    schema_: Literal[1] = Field(alias="schema")
    name: Name
    title: str = ""
    wheel_node: str | None = None
    up: Direction | None = None
    mesh: MeshForm = MeshForm()
    material: dict[str, MaterialForm] = Field(default_factory=dict)
    section: dict[str, SectionForm] = Field(default_factory=dict)
    node: Annotated[tuple[NodeForm, ...], Field(strict=False, min_length=1)]
    strut: Annotated[tuple[StrutForm, ...], Field(strict=False)] = ()
    gimbal: Annotated[tuple[GimbalForm, ...], Field(strict=False)] = ()
    revolute: Annotated[tuple[RevoluteForm, ...], Field(strict=False)] = ()
    proof_mass: Annotated[tuple[ProofMassForm, ...], Field(strict=False)] = ()
    wheel: Annotated[tuple[WheelForm, ...], Field(strict=False)] = ()
    attach: Annotated[tuple[AttachForm, ...], Field(strict=False)] = ()
    spring: Annotated[tuple[SpringForm, ...], Field(strict=False)] = ()
    bushing: Annotated[tuple[BushingForm, ...], Field(strict=False)] = ()
    link: Annotated[tuple[LinkForm, ...], Field(strict=False)] = ()
    interpolation: Annotated[tuple[InterpolationForm, ...], Field(strict=False)] = ()
    equation: Annotated[tuple[EquationForm, ...], Field(strict=False)] = ()
    component: Annotated[tuple[ComponentForm, ...], Field(strict=False)] = ()
    load_case: Annotated[tuple[LoadCaseForm, ...], Field(strict=False)] = ()
    suspension: SuspensionForm | None = None
    actuator: Annotated[tuple[ActuatorForm, ...], Field(strict=False)] = ()
    sensor: Annotated[tuple[SensorForm, ...], Field(strict=False)] = ()
    damping: DampingForm = DampingForm()
    factors: dict[str, Positive] = Field(default_factory=dict)
