"""From a valid article form to the `Structure` it describes."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TypedDict

import numpy as np
from jaxtyping import Float

from middeck.files.articles import form as forms
from middeck.files.articles.boundary_form import build_bushing, build_load_cases
from middeck.files.articles.components import build_component
from middeck.files.articles.form import ArticleForm, DamperForm, DampingForm
from middeck.files.articles.link_form import build_link
from middeck.structure.model.article import (
    Actuator,
    ActuatorKind,
    AttachPoint,
    Body,
    Damper,
    DamperPlace,
    Damping,
    DampingTable,
    Joint,
    JointState,
    Member,
    Node,
    Sensor,
    SensorKind,
    Spring,
    Structure,
    Wheel,
)
from middeck.structure.model.section import MemberMass, Section, coupled_section, default_up, shifted_section

HERE = Path()
AXES = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}


def build_structure(form: forms.ArticleForm, folder: Path = HERE) -> Structure:
    """The value that a valid form describes; ports are those of `default_ports` and the listed ones.

    Files of components are sought in ``folder``.
    """
    nodes = tuple(_node(n) for n in form.node)
    positions = {n.name: n.position for n in nodes}
    used = dict.fromkeys(name for s in form.strut for name in (s.section, *(t.section for t in s.stations)))
    sections = {name: build_section(form.section[name], form.material) for name in used}
    actuators, sensors = default_ports(form)
    listed_a = tuple(
        Actuator(
            name=a.name,
            frame=a.frame,
            axis=_unit(a.axis),
            kind=ActuatorKind(a.kind),
            offset=np.array(a.offset_m),
        )
        for a in form.actuator
    )
    return Structure(
        title=form.title or form.name,
        nodes=nodes,
        members=tuple(_member(s, sections, form.mesh.elements_per_strut, positions) for s in form.strut),
        joints=(
            *(j for g in form.gimbal for j in _gimbal(g)),
            *(_revolute(r) for r in form.revolute),
            *(_proof_mass(p) for p in form.proof_mass),
        ),
        springs=tuple(
            Spring(
                name=s.name or f"{s.from_}-{s.to}",
                start=s.from_,
                end=s.to,
                stiffness=s.stiffness_n_per_m,
                free_length=s.free_length_m,
            )
            for s in form.spring
        ),
        attach_points=_attach_points(form),
        actuators=(*actuators, *listed_a),
        sensors=(*sensors, *(_sensor(s) for s in form.sensor)),
        damping=_damping(form),
        bushings=tuple(build_bushing(b) for b in form.bushing),
        load_cases=build_load_cases(form.load_case),
        links=tuple(build_link(part) for part in (*form.link, *form.interpolation, *form.equation)),
        components=tuple(build_component(c, folder) for c in form.component),
        wheels=tuple(_wheel(w) for w in form.wheel),
        up=_unit(form.up),
    )


def _sensor(form: forms.SensorForm) -> Sensor:
    kind = SensorKind(form.kind)
    axis_frame = "" if form.axis is None or form.kind == "displacement" else form.axis_frame or form.frame
    return Sensor(
        name=form.name,
        frame=form.frame,
        axis=_unit(form.axis),
        axis_frame=axis_frame,
        kind=kind,
        offset=np.array(form.offset_m),
    )


def default_ports(form: forms.ArticleForm) -> tuple[tuple[Actuator, ...], tuple[Sensor, ...]]:
    """The ports that an article has without listing them.

    The wheel node gives ``bus_x``, ``bus_y``, ``bus_z``: torque on it and its inertial rotation about its own
    axes. A gimbal ``g`` gives ``g_in_x``, ``g_in_z``, the inertial rotation of its payload about the axes of
    the stage, and ``g_rel_x``, ``g_rel_z``, joint torques and angles. A revolute ``r`` gives ``r_rel``, a
    proof mass ``p`` gives ``p_rel``: the force between it and its carrier, and how far it has slid. A wheel
    ``w`` gives ``w``: torque of its motor on its frame about its axis, and the frame's rotation about that.
    """
    actuators: list[Actuator] = []
    sensors: list[Sensor] = []
    if form.wheel_node is not None:
        for letter, axis in AXES.items():
            actuators.append(Actuator(name=f"bus_{letter}", frame=form.wheel_node, axis=axis))
            sensors.append(
                Sensor(name=f"bus_{letter}", frame=form.wheel_node, axis=axis, axis_frame=form.wheel_node)
            )
    for g in form.gimbal:
        sensors += [
            Sensor(name=f"{g.name}_in_{a}", frame=f"{g.name}_z", axis=AXES[a], axis_frame=f"{g.name}_x")
            for a in "xz"
        ]
        sensors += [Sensor(name=f"{g.name}_rel_{a}", frame=f"{g.name}_{a}", axis=None) for a in "xz"]
        actuators += [Actuator(name=f"{g.name}_rel_{a}", frame=f"{g.name}_{a}", axis=None) for a in "xz"]
    for wheel in form.wheel:
        axis = np.array(wheel.axis) / np.linalg.norm(wheel.axis)
        actuators.append(Actuator(name=wheel.name, frame=wheel.frame, axis=axis))
        sensors.append(Sensor(name=wheel.name, frame=wheel.frame, axis=axis, axis_frame=wheel.frame))
    for joint in (*form.revolute, *form.proof_mass):
        sensors.append(Sensor(name=f"{joint.name}_rel", frame=joint.name, axis=None))
        actuators.append(Actuator(name=f"{joint.name}_rel", frame=joint.name, axis=None))
    return tuple(actuators), tuple(sensors)


def tube_section(section: forms.SectionForm, material: forms.MaterialForm) -> Section:
    """Round tube: I = pi (D^4 - d^4) / 64, torsion constant 2 I, shear stiffness k G A if k is given."""
    outer, inner = section.outer_diameter_m or 0.0, section.inner_diameter_m or 0.0
    area = np.pi * (outer**2 - inner**2) / 4.0
    second_moment = np.pi * (outer**4 - inner**4) / 64.0
    E, rho = material.E_pa, material.rho_kg_m3
    G = E / (2.0 * (1.0 + material.nu))
    GA = np.inf if section.shear is None else section.shear * G * area
    EI, rho_I = E * second_moment, rho * second_moment
    return Section(
        EA=E * area,
        GJ=2.0 * G * second_moment,
        EI_y=EI,
        EI_z=EI,
        rho_A=rho * area,
        rho_I_y=rho_I,
        rho_I_z=rho_I,
        GA_y=GA,
        GA_z=GA,
        density=rho,
        mass=MemberMass(section.mass),
        diameters=np.array([outer, inner]),
    )


def build_section(form: forms.SectionForm, materials: dict[str, forms.MaterialForm]) -> Section:
    """A section with its centres; bending stiffness not by a matrix is about the centroid."""
    centres = {
        f"{what}_centre_{axis}": at
        for what, place in (("shear", form.shear_centre_m), ("mass", form.mass_centre_m))
        for axis, at in zip("yz", place, strict=True)
    }
    bare = _centred_section(form, materials)
    return dataclasses.replace(
        shifted_section(bare, form.centroid_m) if any(form.centroid_m) else bare, **centres
    )


def _centred_section(form: forms.SectionForm, materials: dict[str, forms.MaterialForm]) -> Section:
    if form.material is not None:
        return tube_section(form, materials[form.material])
    if form.stiffness is not None:
        coupled = coupled_section(
            np.array(form.stiffness),
            rho_A=form.rho_A_kg_per_m or 0.0,
            rho_I_y=form.rho_I_y_kg_m or 0.0,
            rho_I_z=form.rho_I_z_kg_m or 0.0,
        )
        return dataclasses.replace(coupled, density=form.density_kg_m3, mass=MemberMass(form.mass))
    return Section(
        EA=form.EA_n or 0.0,
        GJ=form.GJ_nm2 or 0.0,
        EI_y=form.EI_y_nm2 or 0.0,
        EI_z=form.EI_z_nm2 or 0.0,
        rho_A=form.rho_A_kg_per_m or 0.0,
        rho_I_y=form.rho_I_y_kg_m or 0.0,
        rho_I_z=form.rho_I_z_kg_m or 0.0,
        GA_y=form.GA_y_n or np.inf,
        GA_z=form.GA_z_n or np.inf,
        density=form.density_kg_m3,
        mass=MemberMass(form.mass),
    )


def _wheel(form: forms.WheelForm) -> Wheel:
    axis = np.array(form.axis) / np.linalg.norm(form.axis)
    return Wheel(name=form.name, frame=form.frame, axis=axis, inertia=form.rotor_inertia_kg_m2)


def _body(mass: float, cg: tuple[float, ...], inertia: object, rotors_excluded: bool = False) -> Body:
    about_cg = np.zeros((3, 3)) if inertia is None else np.array(inertia)
    return Body(mass, np.array(cg), about_cg, rotors_excluded)


def _node(form: forms.NodeForm) -> Node:
    position = np.array([form.x_m, form.y_m, form.z_m])
    body = _body(form.mass_kg, form.cg_m, form.inertia_kg_m2, form.rotors_excluded)
    return Node(form.name, position, form.size_m, body)


def _member(
    strut: forms.StrutForm, sections: dict[str, Section], elements: int, positions: dict[str, np.ndarray]
) -> Member:
    start, end = np.array(strut.from_offset_m), np.array(strut.to_offset_m)
    along = positions[strut.to] + end - positions[strut.from_] - start
    return Member(
        name=strut.name or f"{strut.from_}-{strut.to}",
        start=strut.from_,
        end=strut.to,
        section=sections[strut.section],
        section_name=strut.section,
        tension=strut.tension_n,
        stations=tuple((station.at, sections[station.section]) for station in strut.stations),
        elements=strut.elements or elements,
        up=default_up(along) if strut.up is None else np.array(strut.up),
        start_offset=start,
        end_offset=end,
    )


def _gimbal(form: forms.GimbalForm) -> tuple[Joint, Joint]:
    stage = _body(form.stage_mass_kg, form.stage_cg_m, form.stage_inertia_kg_m2, form.rotors_excluded)
    payload = _body(form.payload_mass_kg, form.payload_cg_m, form.payload_inertia_kg_m2, form.rotors_excluded)
    rest_x = form.rest_x_deg if form.state_x == "sprung" else form.command_x_deg
    rest_z = form.rest_z_deg if form.state_z == "sprung" else form.command_z_deg
    outer = _axis(form.state_x, form.angle_x_deg, form.stiffness_x_nm_per_rad, rest_x)
    inner = _axis(form.state_z, form.angle_z_deg, form.stiffness_z_nm_per_rad, rest_z)
    x, limit = f"{form.name}_x", _limit(form.torque_limit_nm)
    return (
        Joint(
            name=x, parent=form.node, offset=np.array(form.offset_m), axis=AXES["x"], body=stage,
            **outer, travel=_travel(form.travel_x_deg), torque_limit=limit,
        ),
        Joint(
            name=f"{form.name}_z", parent=x, offset=np.zeros(3), axis=AXES["z"], body=payload,
            **inner, travel=_travel(form.travel_z_deg), torque_limit=limit,
        ),
    )  # fmt: skip


def _revolute(form: forms.RevoluteForm) -> Joint:
    axis = np.array(form.axis) / np.linalg.norm(form.axis)
    body = _body(form.mass_kg, form.cg_m, form.inertia_kg_m2, form.rotors_excluded)
    target = form.rest_deg if form.state == "sprung" else form.command_deg
    nominal = _axis(form.state, form.angle_deg, form.stiffness_nm_per_rad, target)
    return Joint(
        name=form.name, parent=form.parent, offset=np.array(form.offset_m), axis=axis, body=body,
        **nominal, travel=_travel(form.travel_deg), torque_limit=_limit(form.torque_limit_nm),
    )  # fmt: skip


def _travel(degrees: tuple[float, float] | None) -> tuple[float, float]:
    low, high = (-np.inf, np.inf) if degrees is None else degrees
    return float(np.deg2rad(low)), float(np.deg2rad(high))


def _limit(torque: float | None) -> float:
    return np.inf if torque is None else torque


def _proof_mass(form: forms.ProofMassForm) -> Joint:
    """A slide of a point mass, at rest where its spring and, in gravity, its weight put it."""
    axis = np.array(form.axis) / np.linalg.norm(form.axis)
    return Joint(
        name=form.name,
        parent=form.node,
        offset=np.array(form.offset_m),
        axis=axis,
        angle=0.0,
        body=_body(form.mass_kg, (0.0, 0.0, 0.0), None),
        state=JointState.SPRUNG,
        stiffness=_spring_of(form),
        target=form.rest_m,
        slides=True,
        travel=(-np.inf, np.inf) if form.travel_m is None else form.travel_m,
    )


def _spring_of(form: forms.ProofMassForm) -> float:
    """Stiffness [N/m], given or by the mass's frequency on a carrier that is held."""
    if form.natural_hz is None:
        return form.stiffness_n_per_m or 0.0
    return form.mass_kg * (2.0 * np.pi * form.natural_hz) ** 2


def _damping(form: forms.ArticleForm) -> Damping:
    """``[damping]`` and a damper c = 2 zeta sqrt(k m) at every proof mass that has a ratio."""
    own = tuple(
        Damper(DamperPlace.JOINT, p.name, 2.0 * p.damping * float(np.sqrt(_spring_of(p) * p.mass_kg)))
        for p in form.proof_mass
        if p.damping > 0.0
    )
    damping = build_damping(form)
    return dataclasses.replace(damping, dampers=(*damping.dampers, *own))


class _Axis(TypedDict):
    angle: float  # nominal [rad]
    state: JointState
    stiffness: float  # [N m/rad]
    target: float  # [rad], by default the nominal angle


def _axis(state: str, angle_deg: float, stiffness: float | None, target_deg: float | None) -> _Axis:
    target = angle_deg if target_deg is None else target_deg
    return {
        "angle": float(np.deg2rad(angle_deg)),
        "state": JointState.SPRUNG if state == "hinged" else JointState(state),
        "stiffness": stiffness or 0.0,
        "target": float(np.deg2rad(target)),
    }


def _attach_points(form: forms.ArticleForm) -> tuple[AttachPoint, ...]:
    listed = tuple(AttachPoint(a.name, a.frame, np.array(a.offset_m)) for a in form.attach)
    if form.suspension is None:
        return listed
    pairs = zip(form.suspension.nodes, form.suspension.offsets_m, strict=True)
    return (*(AttachPoint(node, node, np.array(offset)) for node, offset in pairs), *listed)


def _unit(axis: tuple[float, float, float] | None) -> Float[np.ndarray, "3"] | None:
    return None if axis is None else np.array(axis) / np.linalg.norm(axis)


def usual_damping() -> tuple[float, float]:
    """Damping ratios of strain and of the suspension in an article without ``[damping]``."""
    usual = DampingForm()
    return usual.flexible, usual.suspension


def build_damping(form: ArticleForm) -> Damping:
    """Ratios, table, loss factors by member, dampers, and modes of their own.

    More definite data replace a default: a table replaces both, loss factors the flexible one.
    """
    d = form.damping
    given = d.model_fields_set
    lossy = bool(d.material or d.section)
    flexible = 0.0 if "flexible" not in given and (d.table or lossy) else d.flexible
    suspension = 0.0 if "suspension" not in given and d.table else d.suspension
    return Damping(
        flexible=flexible,
        suspension=suspension,
        rigid=d.rigid,
        table=_table(d),
        loss_factor=_loss_factors(form),
        dampers=tuple(_damper(device) for device in d.device),
        by_mode=tuple((int(key) if key.isdigit() else key, ratio) for key, ratio in d.mode.items()),
        by_rank=d.rule == "rank",
    )


def _table(form: DampingForm) -> DampingTable | None:
    table = form.table
    if table is None:
        return None
    return DampingTable(np.array(table.frequency_hz), np.array(table.ratio), table.outside == "hold")


def _loss_factors(form: ArticleForm) -> tuple[tuple[str, float], ...]:
    """Loss factor of each member, by its section or else by the material of its section."""
    d = form.damping
    found: list[tuple[str, float]] = []
    for strut in form.strut:
        material = form.section[strut.section].material
        eta = d.section.get(strut.section, 0.0 if material is None else d.material.get(material, 0.0))
        if eta > 0.0:
            found.append((strut.name or f"{strut.from_}-{strut.to}", eta))
    return tuple(found)


def _damper(form: DamperForm) -> Damper:
    places = {DamperPlace.JOINT: form.joint, DamperPlace.SPRING: form.spring, DamperPlace.DEVICE: form.attach}
    place, at = next((place, at) for place, at in places.items() if at is not None)
    c = form.c_joint_nms_per_rad if place is DamperPlace.JOINT else form.c_ns_per_m
    return Damper(place, at, c or 0.0)
