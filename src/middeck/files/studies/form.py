"""The form of ``studies/*.toml``: the values of a closed-loop study and of its rig."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, cast

from pydantic import Field

from middeck.files.studies.promise_table import PromiseForm, States
from middeck.files.toml.faults import PathFault, finding, nearest
from middeck.files.toml.form import (
    Band,
    Finite,
    Form,
    Log10Authority,
    Name,
    Names,
    NotNegative,
    NotNegatives,
    Positive,
    Positives,
    rule,
    whole,
    within,
)
from middeck.files.toml.tables import Table, table_of

# Figures 6a and 6b show one rate each, of payload and bus in the paper.
Rates = Annotated[
    Names,
    rule(
        lambda names: len(names) == 2 and all(name.endswith("_rate") for name in names),
        "must be two rates: a payload's (Figure 6a), then the bus's (Figure 6b)",
        "names of sensors that end in _rate",
    ),
]


class ControlForm(Form):
    """Inner loops, LQG and the sweep of authority (Figure 7)."""

    article: str
    modes_kept: Annotated[int, whole(7, 10000)]
    inputs: Names
    disturbances: Names
    angles: Names
    pd_loops: Names
    pd_kp_nm_per_rad: NotNegatives
    pd_kd_nms_per_rad: NotNegatives
    metric: Names
    metric_weights: Annotated[NotNegatives, rule(any, "every weight is zero; at least one must be > 0")]
    input_weight: Positives
    angle_noise_rad_per_rthz: Positive
    rate_noise_rad_per_s_per_rthz: Positive
    actuator_noise_ratio: NotNegative
    three_sigma_deg: Positive
    band_hz: Band
    log10_authority_first: Log10Authority
    log10_authority_last: Log10Authority
    levels: Annotated[int, whole(2, 10000)]


class RigForm(Form):
    """Simulated hardware."""

    sample_hz: Positive
    delay_s: NotNegative
    wheel_torque_nm: Positive
    wheel_rotor_inertia_kg_m2: Positive
    wheel_speed_rad_s: Positive
    gimbal_torque_nm: Positive
    gimbal_friction_nm: NotNegative
    gimbal_viscous_nms_per_rad: NotNegative
    gimbal_presliding_deg: Positive | None = None
    gimbal_deadband_deg: Positive | None = None
    gimbal_flank_nm_per_rad: Positive | None = None
    encoder_counts: Annotated[int, whole(4, 2**32)]
    gyro_noise_rad_per_s_per_rthz: NotNegative
    gyro_bias_rad_s: Finite
    gyro_bias_walk_rad_per_s_per_rts: NotNegative
    gyro_bandwidth_hz: Positive
    converter_bits: Annotated[int, whole(1, 32)]
    anti_alias_hz: Positive
    umbilical_hz: NotNegative
    identification_noise: NotNegative
    gimbal_slew_nm_per_s: Positive | None = None
    wheel_slew_nm_per_s: Positive | None = None
    gyro_range_rad_s: Positive = 5.0
    rest_s: NotNegative = 30.0
    modes_hz: Positive = 200.0
    mesh_factor: Annotated[int, whole(1, 100)] = 3
    shear_coefficient: Annotated[float, within(above=0.0, most=1.0)] | None = 0.62
    hidden_seed: Annotated[int, whole(0, 2**63 - 1)] | None = None


class Figure6Form(Form):
    """One input to several outputs, in orbit, in the laboratory and on the rig."""

    article: str
    input: str
    outputs: Rates
    band_hz: Band
    modes_kept: Annotated[int, whole(1, 10000)]


class AuthorityForm(Form):
    """One level of authority and why it was chosen."""

    log10_authority: Log10Authority
    reason: Annotated[str, Field(min_length=1)]


class ImprovementForm(Form):
    """The improvement to be predicted, by the lowest authority that reaches it, and the reason for it."""

    predicted_db: Positive
    reason: Annotated[str, Field(min_length=1)]


class SisoForm(Form):
    """Identify, design and verify one loop on the rig (Figures 9a and 9b)."""

    article: str
    environment: str
    actuator: str
    sensor: str
    period_s: Positive
    periods: Annotated[int, whole(2, 1000)]  # the fit weighs by their scatter
    excitation_nm: Positive
    closed_excitation_nm: Positive
    band_hz: Band
    fit_band_hz: Band
    states: States
    pade_order: Annotated[int, whole(1, 12)]
    angle_weight: Positive
    input_weight: Positive
    disturbance_nm_per_rthz: Positive
    angle_noise_rad_per_rthz: Positive
    pair_shift_percent: Positive
    pair_shift_hz: Positive
    drifted: Literal["up", "down"]
    low: AuthorityForm
    high: AuthorityForm
    robust: AuthorityForm


class SitoForm(Form):
    """One input to two sensors and the performance: fitted together (Figures 10a, 10b), controlled (11, 12).

    Article, environment, actuator, excitation and rig are those of `SisoForm`, its sensor the performance.
    """

    sensors: Names
    fit_band_hz: Band
    states: States | None = None
    smaller_states: Annotated[tuple[States, ...], Field(strict=False)] = ()
    smaller_bands_hz: Annotated[tuple[Band, ...], Field(strict=False)] = ()
    pade_order: Annotated[int, whole(1, 12)]
    angle_noise_rad_per_rthz: Annotated[tuple[Positive, ...], Field(strict=False)]
    lead_zeros_hz: Positive
    lead_poles_hz: Positive
    lead_damping: Positive
    pair_shift_percent: Positive
    bus_weight: Positive
    payload: ImprovementForm
    both: ImprovementForm


class MirrorForm(Form):
    """A measured record to fit and one to judge the fit by."""

    train: str
    test: str
    states: Annotated[int, whole(2, 1000)]


class StudyForm(Form):
    """A study: documents it stands on, and settings; a chapter without settings is not run.

    Attributes:
        account: Source of the report's claims; without one there are none.
    """

    schema_: Literal[1] = Field(alias="schema")
    title: str
    seed: Annotated[int, whole(0, 2**63 - 1)]
    account: Literal["mace-1993"] | None = None
    article: dict[Name, str]
    environment: dict[Name, str]
    control: ControlForm | None = None
    rig: RigForm | None = None
    figure_6: Figure6Form | None = None
    siso: SisoForm | None = None
    sito: SitoForm | None = None
    promise: PromiseForm | None = None
    mirror: MirrorForm | None = None

    def __hash__(self) -> int:
        """Hash of the fields that are no dictionaries."""
        return hash((self.title, self.seed))


NEEDS = {"figure_6": ("rig", "siso"), "siso": ("rig",), "sito": ("siso",), "promise": ("rig",)}
"""Tables that the settings of a chapter stand on."""
CHAPTERS = ("control", "figure_6", "siso", "sito", "promise", "mirror")


def study_findings(data: Table) -> list[PathFault]:
    """Faults of a study beyond the form of its keys; tolerates a broken form."""
    control = table_of(data, "control")
    return [
        *_one_each(control, "pd_loops", ["pd_kp_nm_per_rad", "pd_kd_nms_per_rad"]),
        *_one_each(control, "metric", ["metric_weights"]),
        *_one_each(control, "inputs", ["input_weight"]),
        *_one_each(table_of(data, "sito"), "sensors", ["angle_noise_rad_per_rthz"], "sito"),
        *_one_each(table_of(data, "sito"), "smaller_states", ["smaller_bands_hz"], "sito"),
        *_one_each(table_of(data, "promise"), "inputs", ["torque_nm"], "promise"),
        *_one_each(
            table_of(data, "promise"), "pd_loops", ["pd_kp_nm_per_rad", "pd_kd_nms_per_rad"], "promise"
        ),
        *_tables(data),
        *_levels(control),
        *_documents(data),
        *_rubs(data),
        *_gap(data),
        *_two_sensors(data),
    ]


def _one_each(settings: Table, names: str, keys: list[str], where: str = "control") -> Iterator[PathFault]:
    wanted = settings.get(names)
    for key in keys:
        given = settings.get(key)
        if isinstance(wanted, list) and isinstance(given, list):
            count, needed = len(cast("list[Any]", given)), len(cast("list[Any]", wanted))
            if count != needed:
                message = f"{count} values for the {needed} {names}; must be one each"
                yield finding((where, key), message, given)


def _tables(data: Table) -> Iterator[PathFault]:
    """Faults of a study without a chapter, or with one that lacks a table it needs."""
    if not any(key in data for key in CHAPTERS):
        known = ", ".join(f"[{key}]" for key in CHAPTERS)
        yield finding((CHAPTERS[0],), f"missing: a study needs one of {known}")
    for key, needed in NEEDS.items():
        for other in needed:
            if key in data and other not in data:
                yield finding((other,), f"missing: [{key}] needs it")


def _levels(control: Table) -> Iterator[PathFault]:
    first, last = control.get("log10_authority_first"), control.get("log10_authority_last")
    if isinstance(first, int | float) and isinstance(last, int | float) and not first < last:
        message = f"must be > log10_authority_first = {first:g}"
        yield finding(("control", "log10_authority_last"), message, last)


def _two_sensors(data: Table) -> Iterator[PathFault]:
    """Figures 10a and 10b show one sensor each, encoder and bus in the paper; the third is [siso]'s own."""
    performance, given = table_of(data, "siso").get("sensor"), table_of(data, "sito").get("sensors")
    match given:
        case [str() as first, str() as second] if len({first, second, performance}) == 3:
            return
        case list():
            message = "must be two sensors (Figures 10a and 10b), neither of them siso.sensor"
            yield finding(("sito", "sensors"), message, given)
        case _:
            return


def _rubs(data: Table) -> Iterator[PathFault]:
    """Friction slips once it has given: without that distance, or a torque to slip at, there is none."""
    rig = table_of(data, "rig")
    coulomb, viscous = rig.get("gimbal_friction_nm"), rig.get("gimbal_viscous_nms_per_rad")
    if _is_positive(coulomb) and "gimbal_presliding_deg" not in rig:
        advice = "how far a gimbal gives before it slips, studies/mace-1993.toml has 0.05; or no friction, 0"
        where = ("rig", "gimbal_friction_nm")
        yield finding(where, "needs 'gimbal_presliding_deg' beside it", coulomb, hint=advice)
    if _is_positive(viscous) and coulomb == 0:
        where, message = ("rig", "gimbal_viscous_nms_per_rad"), "has no effect where gimbal_friction_nm is 0"
        yield finding(where, message, viscous, hint="0, or give gimbal_friction_nm")


def _is_positive(value: Any) -> bool:
    return isinstance(value, int | float) and value > 0


def _gap(data: Table) -> Iterator[PathFault]:
    """A gap has flanks and flanks have a gap between them."""
    rig, pair = table_of(data, "rig"), ("gimbal_deadband_deg", "gimbal_flank_nm_per_rad")
    for key, other in (pair, pair[::-1]):
        if key in rig and other not in rig:
            yield finding(("rig", key), f"given without {other}", rig[key], hint="give both or neither")


def _documents(data: Table) -> Iterator[PathFault]:
    """Settings name articles and environments of the study."""
    wanted = [("control", "article"), ("figure_6", "article"), ("siso", "article"), ("siso", "environment")]
    wanted += [("promise", "article"), ("promise", "environment")]
    for where, key in wanted:
        name, known = table_of(data, where).get(key), table_of(data, key)
        if isinstance(name, str) and known and name not in known:
            yield finding((where, key), f"no {key} of this name in [{key}]", name, hint=nearest(name, known))
    for key in ("orbit", "lab"):
        if table_of(data, "environment") and key not in table_of(data, "environment"):
            yield finding(("environment", key), "missing: the path of an environment file")


def port_findings(form: StudyForm, ports: dict[str, tuple[list[str], list[str]]]) -> list[PathFault]:
    """Ports that an article of the study lacks, or that are named twice.

    ``ports`` gives actuators and sensors by article; an article that the study lacks is skipped.
    """
    wanted: list[tuple[str, str, str | Names, list[str]]] = []
    if form.control is not None and form.control.article in ports:
        drives, angles = ports[form.control.article]
        wanted += [
            ("control", "inputs", form.control.inputs, drives),
            ("control", "disturbances", form.control.disturbances, drives),
            ("control", "angles", form.control.angles, angles),
            ("control", "metric", form.control.metric, angles),
            ("control", "pd_loops", form.control.pd_loops, [a for a in drives if a in angles]),
        ]
    if form.figure_6 is not None and form.figure_6.article in ports:
        drives, sensors = ports[form.figure_6.article]
        wanted += [
            ("figure_6", "input", form.figure_6.input, drives),
            ("figure_6", "outputs", form.figure_6.outputs, [*sensors, *(f"{s}_rate" for s in sensors)]),
        ]
    if form.siso is not None and form.siso.article in ports:
        drives, sensors = ports[form.siso.article]
        wanted.append(("siso", "actuator", form.siso.actuator, drives))
        wanted.append(("siso", "sensor", form.siso.sensor, sensors))
        if form.sito is not None:
            wanted.append(("sito", "sensors", form.sito.sensors, sensors))
    if form.promise is not None and form.promise.article in ports:
        drives, sensors = ports[form.promise.article]
        both = [a for a in drives if a in sensors]
        wanted += [
            ("promise", "inputs", form.promise.inputs, drives),
            ("promise", "outputs", form.promise.outputs, sensors),
            ("promise", "joints", form.promise.joints, both),
            ("promise", "actuator", form.promise.actuator, drives),
            ("promise", "sensor", form.promise.sensor, sensors),
            ("promise", "pd_loops", form.promise.pd_loops, both),
        ]
    places = [
        ((where, key), given, known) if isinstance(given, str) else ((where, key, i), name, known)
        for where, key, given, known in wanted
        for i, name in enumerate([given] if isinstance(given, str) else given)
    ]
    twice = [
        finding((where, key, i), "is there twice", name, hint="each port once")
        for where, key, given, _ in wanted
        if not isinstance(given, str)
        for i, name in enumerate(given)
        if name in given[:i]
    ]
    return twice + [
        finding(path, "the article has no such port", name, hint=nearest(name, known))
        for path, name, known in places
        if name not in known
    ]
