"""Every number of a structure and its environment by name, to be read or changed.

``node.n1.mass``, ``node.n1.cg.y``, ``node.n1.inertia.xx``, ``member.n1-n2.EI_y``, ``joint.pri_x.angle``,
``environment.gravity.y``: the name of a part, then of its field, then of a component. ``member.n1-n2.E`` and
``member.n1-n2.rho`` are factors on all stiffnesses and on all inertias of a member, ``members.E`` and
``members.rho`` on those of all members.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.model.article import (
    Actuator,
    ActuatorKind,
    DamperPlace,
    Damping,
    JointState,
    Sensor,
    SensorKind,
    Structure,
)
from middeck.structure.model.environment import Environment
from middeck.structure.model.links import Interpolation, Link
from middeck.structure.model.section import CENTRES, INERTIA, STIFFNESS, Section
from middeck.values import record

AXES = "xyz"
SIX = "123456"  # a bushing's shifts along its axes, then turns about them
SHOWN = 5  # names in a hint
# Fields of each part and their units. Not here is what changes no rest state and no small motion about it:
# travels and torque limits, friction.
BODY = {"mass": "kg", "cg": "m", "inertia": "kg m^2"}
NODE = {"position": "m", "size": "m"}
SECTION = {
    **{"EA": "N", "GJ": "N m^2", "EI_y": "N m^2", "EI_z": "N m^2", "GA_y": "N", "GA_z": "N"},
    **{"rho_A": "kg/m", "rho_I_y": "kg m", "rho_I_z": "kg m"},
}
# Listed where they are not zero.
COUPLED = {"coupling": "N, N m or N m^2", **dict.fromkeys(CENTRES, "m")}
SETTING = {"start_offset": "m", "end_offset": "m", "tension": "N"}
SPRING = {"stiffness": "N/m", "free_length": "m"}
BUSHING = {"stiffness": "N/m, N or N m/rad"}
DAMPING = {"flexible": "", "suspension": "", "rigid": ""}
SUSPENSION = {"cable_length": "m", "bounce_hz": "Hz", "moving_mass": "kg"}
DEVICE = {**SUSPENSION, "force": "N", "stiffness": "N/m", "anchor": "m"}

# What keys of a file became that are no numbers of their own in the article: they went into others.
BECAME = {
    "natural_hz": ("stiffness", "k = m (2 pi natural_hz)^2; a derivative by the mass holds k"),
    "rest_m": ("target", "where the spring is unstressed"),
    "rest_deg": ("target", "in rad"),
    "command_deg": ("target", "in rad"),
    "E_pa": ("E", "a factor on all stiffnesses, of value 1"),
    "rho_kg_m3": ("rho", "a factor on all inertias, of value 1"),
    "outer_diameter_m": ("EI_y", "and the others of a section, each by itself"),
    "inner_diameter_m": ("EI_y", "and the others of a section, each by itself"),
    "gravity_m_s2": ("gravity.y", "a component of the vector in W"),
}

Path = tuple[Any, ...]


@record(kw_only=True)
class ModelParameter:
    """One number: its name, its unit ("" for a factor or a direction), and its value.

    ``spots`` are where it stands: "structure" or "environment", then names of fields and indices. A factor
    (``scales``) multiplies the value. A component of an axis turns it: its length stays one. One that is
    ``unstated``, a coupling of a bushing that has none, is found by its whole name only.
    """

    name: str
    unit: str
    value: float
    spots: tuple[Path, ...]
    scales: bool = False
    unstated: bool = False


def list_parameters(structure: Structure, environment: Environment) -> tuple[ModelParameter, ...]:
    """All parameters but the infinite ones: the shear stiffness of a Bernoulli beam has no derivative.

    >>> from middeck.structure.model.article import Body, Damping, Node, Structure
    >>> ball = Node("ball", np.zeros(3), 0.0, Body(2.0, np.zeros(3), np.eye(3)))
    >>> one = Structure(title="one", nodes=(ball,), members=(), joints=(), springs=(), attach_points=(),
    ...     actuators=(), sensors=(), damping=Damping())
    >>> [p.name for p in list_parameters(one, Environment.orbit()) if p.value == 2.0]
    ['node.ball.mass']
    """
    return tuple(p for p in _walk(structure, environment) if np.isfinite(p.value))


def find_parameters(
    structure: Structure, environment: Environment, patterns: Sequence[str]
) -> tuple[ModelParameter, ...]:
    """The parameters with the given names; ``*`` stands for any text, ``?`` for one letter.

    A pattern leaves out the couplings that a bushing does not have, unless it fits nothing else.
    Raises `ConfigError` for a name or pattern that fits none, with the nearest names.
    """
    return choose_parameters(list_parameters(structure, environment), patterns)


def choose_parameters(
    parameters: Sequence[ModelParameter], patterns: Sequence[str], *, missing: bool = False
) -> tuple[ModelParameter, ...]:
    """`find_parameters` among ``parameters``; with ``missing``, names without a match are left out."""
    every = {p.name: p for p in parameters}
    found: dict[str, ModelParameter] = {}
    for pattern in patterns:
        wild = any(c in pattern for c in "*?[")
        fits = [n for n in every if fnmatchcase(n, pattern)] if wild else [pattern] * (pattern in every)
        fits = [n for n in fits if not every[n].unstated] or fits
        if not fits and not missing:
            raise _unknown(pattern, every)
        found |= {name: every[name] for name in fits}
    return tuple(found.values())


def _unknown(pattern: str, every: Iterable[str]) -> ConfigError:
    whole = pattern.rstrip(".*")
    near = [n for n in every if n.startswith(f"{whole}.")] or [n for n in every if f".{whole}." in f".{n}."]
    near = near or [n for n in every if fnmatchcase(n, f"*.{pattern}")]
    near = near[:SHOWN] or get_close_matches(pattern, every, SHOWN, 0.5)
    hint = f"did you mean {', '.join(near)}?" if near else "e.g. node.*.mass, member.*.EI_y, environment.*"
    return ConfigError(f"no parameter {pattern!r}", where="parameter", hint=_became(pattern, every) or hint)


def _became(pattern: str, every: Iterable[str]) -> str:
    """Parameters that the file's key at the end of ``pattern`` became, of the same part if there is one."""
    *parts, key = pattern.split(".")
    if key not in BECAME:
        return ""
    field, how = BECAME[key]
    ends = [name for name in every if name.endswith(f".{field}")]
    own = [name for name in ends if set(parts) & set(name.split(".")[1:-1])]
    found = own or ends
    return f"{key} became {', '.join(found[:SHOWN])} ({how})" if found else ""


def set_parameter(
    structure: Structure, environment: Environment, parameter: ModelParameter, value: complex
) -> tuple[Structure, Environment]:
    """Both with ``parameter`` at ``value``, which may be complex; all else unchanged."""
    both: dict[str, Any] = {"structure": structure, "environment": environment}
    for side, *path in parameter.spots:
        both[side] = _put(both[side], tuple(path), value, parameter.scales)
    return both["structure"], both["environment"]


def read_parameter(
    structure: Structure, environment: Environment, parameter: ModelParameter
) -> ModelParameter:
    """``parameter`` with its value here; that of a factor is one."""
    if parameter.scales:
        return parameter
    side, *path = parameter.spots[0]
    at: Any = structure if side == "structure" else environment
    for key in path:
        at = getattr(at, key) if isinstance(key, str) else at[key]
    return dataclasses.replace(parameter, value=float(at))


def scale_parameters(structure: Structure, factors: Mapping[str, float]) -> Structure:
    """``structure`` with its parameters of these names multiplied, one after the other.

    Raises `ConfigError` for a name that fits none.
    """
    both = structure, Environment.orbit()
    for name, factor in factors.items():
        for parameter in find_parameters(*both, [name]):
            both = set_parameter(*both, parameter, factor * read_parameter(*both, parameter).value)
    return both[0]


def _put(at: Any, path: Path, value: complex, scales: bool) -> Any:
    """A copy of ``at`` with the number at ``path`` replaced or scaled."""
    if not path:
        return at * value if scales else value
    key, *rest = path
    if isinstance(key, str):
        new = _put(getattr(at, key), tuple(rest), value, scales)
        if key == "axis":
            new = new / np.sqrt(new @ new)
        return dataclasses.replace(at, **{key: new})
    if isinstance(at, np.ndarray):
        new = at.astype(np.result_type(at, np.asarray(value)))
        new[key] = value
        return new
    return (*at[:key], _put(at[key], tuple(rest), value, scales), *at[key + 1 :])


def _walk(structure: Structure, environment: Environment) -> Iterator[ModelParameter]:
    yield from _nodes(structure)
    yield from _members(structure)
    yield from _joints(structure)
    for kind, group, fields in (
        ("attach", "attach_points", {"offset": "m"}),
        ("spring", "springs", SPRING),
        ("bushing", "bushings", BUSHING),
        ("load", "loads", {"force": "N", "moment": "N m", "offset": "m"}),
    ):
        for i, part in enumerate(getattr(structure, group)):
            yield from _fields(f"{kind}.{part.name}", part, ("structure", group, i), fields)
    for i, mass in enumerate(structure.masses):
        yield from _fields(f"mass.{mass.name}", mass.body, ("structure", "masses", i, "body"), BODY)
    yield from _links(structure)
    yield from _ports("actuator", "actuators", structure.actuators)
    yield from _ports("sensor", "sensors", structure.sensors)
    yield from _damping(structure.damping)
    yield from _environment(environment)


def _nodes(structure: Structure) -> Iterator[ModelParameter]:
    for i, node in enumerate(structure.nodes):
        path: Path = ("structure", "nodes", i)
        yield from _fields(f"node.{node.name}", node, path, NODE)
        yield from _fields(f"node.{node.name}", node.body, (*path, "body"), BODY)


def _members(structure: Structure) -> Iterator[ModelParameter]:
    sections: list[tuple[Path, Section]] = []
    for i, member in enumerate(structure.members):
        path: Path = ("structure", "members", i)
        own: list[tuple[Path, Section]] = [((*path, "section"), member.section)]
        own += [((*path, "stations", k, 1), section) for k, (_, section) in enumerate(member.stations)]
        more = {name: unit for name, unit in COUPLED.items() if np.any(getattr(member.section, name))}
        yield from _fields(f"member.{member.name}", member.section, own[0][0], {**SECTION, **more})
        for k, (at, section) in enumerate(own[1:], start=1):
            yield from _fields(f"member.{member.name}.station{k}", section, at, SECTION)
        more = {name: unit for name, unit in SETTING.items() if np.any(getattr(member, name))}
        yield from _fields(f"member.{member.name}", member, path, {"up": "", **more})
        yield from _factors(f"member.{member.name}", own)
        sections += own
    if sections:
        yield from _factors("members", sections)


def _factors(name: str, sections: Sequence[tuple[Path, Section]]) -> Iterator[ModelParameter]:
    for what, fields in (("E", STIFFNESS), ("rho", INERTIA)):
        spots = tuple((*p, f) for p, s in sections for f in fields if _scales(getattr(s, f)))
        yield ModelParameter(name=f"{name}.{what}", unit="", value=1.0, spots=spots, scales=True)


def _scales(value: Any) -> bool:
    """Neither infinite nor an array of zeros."""
    return bool(np.any(value)) if isinstance(value, np.ndarray) else bool(np.isfinite(value))


def _joints(structure: Structure) -> Iterator[ModelParameter]:
    """Angle of a joint that is held there, spring and rest angle of a sprung one, command of a driven one."""
    for i, joint in enumerate(structure.joints):
        path: Path = ("structure", "joints", i)
        turn, torque = ("m", "N/m") if joint.slides else ("rad", "N m/rad")
        fields = {"offset": "m", "axis": ""}
        if joint.state in (JointState.FREE, JointState.LOCKED):
            fields["angle"] = turn
        else:
            fields["target"] = turn
        if joint.state is JointState.SPRUNG:
            fields["stiffness"] = torque
        yield from _fields(f"joint.{joint.name}", joint, path, fields)
        yield from _fields(f"joint.{joint.name}", joint.body, (*path, "body"), BODY)


def _links(structure: Structure) -> Iterator[ModelParameter]:
    """Offset of a link, weights of an interpolation, coefficients of an equation; as drawn all links fit."""
    for i, link in enumerate(structure.links):
        path, name = ("structure", "links", i), f"link.{link.name}"
        if isinstance(link, Link):
            yield from _fields(name, link, path, {"offset": "m"})
        elif isinstance(link, Interpolation):
            for k, share in enumerate(link.shares):
                yield from _fields(f"{name}.{share.frame}", share, (*path, "shares", k), {"weight": ""})
        else:
            for k, term in enumerate(link.terms):
                at = f"{name}.{term.frame}.{term.direction}"
                yield from _fields(at, term, (*path, "terms", k), {"coefficient": ""})


def _ports(kind: str, group: str, ports: Sequence[Actuator | Sensor]) -> Iterator[ModelParameter]:
    """Parameters of ports; the place of a torque or an angle has no effect."""
    for i, port in enumerate(ports):
        stands = port.kind not in (ActuatorKind.TORQUE, SensorKind.ANGLE)
        fields = {"axis": "", "offset": "m"} if stands else {"axis": ""}
        yield from _fields(f"{kind}.{port.name}", port, ("structure", group, i), fields)


def _damping(damping: Damping) -> Iterator[ModelParameter]:
    """Damping by kind, mode, material and damper; a table is measured, not designed."""
    path: Path = ("structure", "damping")
    if damping.table is None:
        yield from _fields("damping", damping, path, DAMPING)
    for group, text in (("by_mode", "mode"), ("loss_factor", "loss_factor")):
        for i, (key, value) in enumerate(getattr(damping, group)):
            yield ModelParameter(
                name=f"damping.{text}.{key}", unit="", value=value, spots=((*path, group, i, 1),)
            )
    for i, damper in enumerate(damping.dampers):
        unit = "N m s/rad" if damper.place is DamperPlace.JOINT else "N s/m"
        yield from _fields(
            f"damping.{damper.place.value}.{damper.at}", damper, (*path, "dampers", i), {"c": unit}
        )


def _environment(environment: Environment) -> Iterator[ModelParameter]:
    root: Path = ("environment",)
    yield from _fields("environment", environment, root, {"gravity": "m/s^2"})
    if environment.suspension is not None:
        yield from _fields("environment", environment.suspension, (*root, "suspension"), SUSPENSION)
    for i, device in enumerate(environment.devices):
        yield from _fields(f"environment.device.{device.name}", device, (*root, "devices", i), DEVICE)
    for i, bushing in enumerate(environment.bushings):
        yield from _fields(f"environment.bushing.{bushing.name}", bushing, (*root, "bushings", i), BUSHING)
    for i, spring in enumerate(environment.springs):
        name = f"environment.spring.{spring.name}"
        yield from _fields(name, spring, (*root, "springs", i), {**SPRING, "anchor": "m"})


def _fields(name: str, part: Any, path: Path, fields: dict[str, str]) -> Iterator[ModelParameter]:
    for field, unit in fields.items():
        value = getattr(part, field)
        spot = (*path, field)
        if value is None:
            continue
        if not isinstance(value, np.ndarray):
            yield ModelParameter(name=f"{name}.{field}", unit=unit, value=value, spots=(spot,))
        elif value.ndim == 1:
            for i, axis in enumerate(AXES):
                yield ModelParameter(
                    name=f"{name}.{field}.{axis}", unit=unit, value=float(value[i]), spots=((*spot, i),)
                )
        else:
            names = AXES if len(value) == len(AXES) else SIX
            pairs = [(i, i) for i in range(len(value))]
            pairs += [(i, j) for i in range(len(value)) for j in range(i + 1, len(value))]
            for i, j in pairs:
                spots = tuple((*spot, k) for k in dict.fromkeys([(i, j), (j, i)]))
                yield ModelParameter(
                    name=f"{name}.{field}.{names[i]}{names[j]}",
                    unit=unit,
                    value=float(value[i, j]),
                    spots=spots,
                    unstated=names is SIX and i != j and value[i, j] == 0.0,
                )
