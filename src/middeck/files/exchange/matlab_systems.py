"""MATLAB files: A, B, C, D, Ts and names, as the arguments of MATLAB's ``ss`` are called.

In MATLAB: ``s = load('law.mat'); K = ss(s.A, s.B, s.C, s.D, s.Ts, 'InputName', s.InputName, 'OutputName',
s.OutputName);`` and, since u = K y is added, ``feedback(P, K, +1)``.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, DataError
from middeck.files.disk.atomic import replacing
from middeck.files.exchange.named_system import Exchangeable, as_compensator, exchanged, matrices_of
from middeck.files.exchange.transfer_functions import real_matrix, settle_period
from middeck.files.json.channels import build_channel
from middeck.files.json.output import json_text
from middeck.files.laws.compensators import (
    StoredCompensator,
    build_stored,
    build_system,
    how_made,
    with_applied,
)
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant, group_ports, remove_delays
from middeck.systems.plants.plant_from_matrices import name_ports
from middeck.systems.sampling.delayed_sampling import split_delays

GROUPS = ("w", "u", "z", "y")
KINDS = ("", "plant", "compensator", "system")
NEGATIVE, POSITIVE = "negative", "positive"
DELAYS = ("InputDelay", "OutputDelay", "IODelay", "ioDelay")
HINT = "of an ss object K save A = K.A, B = K.B, C = K.C, D = K.D, Ts = K.Ts"


def write_mat(path: str | Path, value: Exchangeable, *, negative_feedback: bool = False) -> None:
    """Write a system, plant or compensator as a MAT file of version 5, whole or not at all.

    Variables: A, B, C, D, Ts (0: continuous), InputName, OutputName, StateName, InputUnit, OutputUnit (cell
    arrays), Kind; of a plant its groups w, u, z and y and its delays [s] as ``ss`` has them, InputDelay and
    OutputDelay, and IODelay [output, input] for what a path is delayed beyond their sum; of a compensator
    Feedback, Method, Authority, Cost and Inert, and Applied where it has that path.
    ``negative_feedback=True`` writes -K, for u = -K y, and says so in Feedback.

    Raises `ConfigError` for what cannot be exchanged.
    """
    import scipy.io

    delays: dict[str, np.ndarray] = {}
    if isinstance(value, Plant):
        value, delays = remove_delays(value), _delays_of(value)
    named = exchanged(value, negative_feedback=negative_feedback)
    contents: dict[str, Any] = {name: getattr(matrices_of(named), name) for name in "ABCD"}
    contents |= {"Ts": named.period_s or 0.0, "StateName": _cells(named.state_names)} | delays
    for side, ports in (("Input", named.inputs), ("Output", named.outputs)):
        contents[f"{side}Name"] = _cells([port.name for port in ports])
        contents[f"{side}Unit"] = _cells([port.unit for port in ports])
        if any(port.channel for port in ports):
            channels = [json_text(port.channel) if port.channel else "" for port in ports]
            contents[f"{side}Channel"] = _cells(channels)
    contents |= _of_its_kind(value, negative_feedback)
    with replacing(Path(path)) as temporary, open(temporary, "wb") as stream:
        scipy.io.savemat(stream, contents, do_compression=True, oned_as="column")


def _delays_of(plant: Plant) -> dict[str, np.ndarray]:
    split = split_delays(plant.delay_s)
    every = {"InputDelay": split.input_s, "OutputDelay": split.output_s, "IODelay": split.rest_s}
    return {name: delay_s for name, delay_s in every.items() if np.any(delay_s)}


def _of_its_kind(value: Exchangeable, negative_feedback: bool) -> dict[str, Any]:
    match value:
        case Plant():
            return {"Kind": "plant"} | {group: _cells(getattr(value, group)) for group in GROUPS}
        case Compensator():
            made = how_made(value)
            applied = {} if value.applied is None else {"Applied": value.applied}
            known = {name.title(): made[name] for name in ("authority", "cost") if made[name] is not None}
            return {
                "Kind": "compensator",
                "Feedback": NEGATIVE if negative_feedback else POSITIVE,
                "Method": made["method"],
                "Inert": _cells(made["inert"]),
                **applied,
                **known,
            }
        case _:
            return {"Kind": "system"}


def _cells(texts: Sequence[str]) -> np.ndarray:
    return np.array(texts, dtype=object)


def load_mat(
    path: str | Path, *, variable: str = "", period_s: float | None = None
) -> Plant | StoredCompensator:
    """The plant, compensator or system in a MAT file, of `write_mat` or with A, B, C and D of any origin.

    Args:
        path: File of version 5 or 7.3.
        variable: The structure that holds A, B, C and D; empty where they stand by themselves.
        period_s: Sampling period [s] of a file without Ts, or with Ts = -1; 0 for a continuous system.

    A compensator is always returned for u = K y added: one written for u = -K y is turned.

    Raises `DataError` naming file and variable, for a file that is missing or broken, matrices that are
    missing, complex, not finite or do not fit, names that are not as many as the ports, or what a plant does
    not say: a matrix E, an internal delay or that of a sampled system, a unit of time other than the second,
    a kind or sign that is not known.
    """
    where = str(path)
    found = _part(_arrays(Path(path)), variable)
    missing = [name for name in "ABCD" if name not in found]
    if missing:
        there = ", ".join(sorted(found)) or "nothing"
        holders = [name[:-2] for name in found if name.endswith(".A") and f"{name[:-2]}.D" in found]
        hint = f"variable={holders[0]!r}" if holders else HINT
        raise DataError(f"no {', '.join(missing)}; there is {there}", where=where, hint=hint)
    _require_plain(found, where)
    try:
        matrices = {name: real_matrix(found[name], name) for name in "ABCD"}
        ts = float(np.ravel(found["Ts"])[0]) if "Ts" in found and np.size(found["Ts"]) else None
        period = settle_period(ts if ts != -1.0 else True, period_s, "Ts")
    except ConfigError as error:
        raise DataError(error.what, where=f"{where}, {error.where}", hint=error.hint) from None
    try:
        return _build(found, matrices, period, where)
    except ConfigError as error:  # a group or a name that is not there
        raise DataError(error.what, where=where, hint=error.hint) from None


def _arrays(path: Path) -> dict[str, np.ndarray]:
    from middeck.files.records.mat import mat_arrays

    try:
        return mat_arrays(path)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", where=str(path), hint="check the path") from None


def _part(arrays: Mapping[str, np.ndarray], variable: str) -> dict[str, np.ndarray]:
    if not variable:
        return dict(arrays)
    return {name[len(variable) + 1 :]: x for name, x in arrays.items() if name.startswith(f"{variable}.")}


def _require_plain(found: Mapping[str, np.ndarray], where: str) -> None:
    """Refuse what would make another system of the same four matrices."""
    E = np.asarray(found.get("E", ()))
    if E.size and not np.array_equal(E, np.eye(len(E))):
        raise DataError(
            "a descriptor matrix E", where=f"{where}, E", hint="ss(E\\A, E\\B, C, D) where E is regular"
        )
    if np.any(found.get("InternalDelay", 0.0)):
        raise DataError("a delay within a loop", where=f"{where}, InternalDelay", hint="pade(s, 3)")
    unit = _text(found, "TimeUnit")
    if unit not in ("", "seconds"):
        raise DataError(f"time in {unit}", where=f"{where}, TimeUnit", hint="chgTimeUnit(s, 'seconds')")
    kind, feedback = _text(found, "Kind"), _text(found, "Feedback")
    if kind not in KINDS:
        raise DataError(f"{kind!r} is no kind", where=f"{where}, Kind", hint=", ".join(KINDS[1:]))
    if feedback not in (("", POSITIVE, NEGATIVE) if kind == "compensator" else ("",)):
        raise DataError(
            f"a feedback of {feedback!r} for a {kind or 'system'}",
            where=f"{where}, Feedback",
            hint=f"{POSITIVE} (u = K y) or {NEGATIVE} (u = -K y), with Kind = compensator",
        )


def _build(
    found: Mapping[str, np.ndarray], matrices: dict[str, np.ndarray], period: float | None, where: str
) -> Plant | StoredCompensator:
    D = matrices["D"]
    inputs = _ports(found, "Input", name_ports("u", D.shape[-1]), where)
    outputs = _ports(found, "Output", name_ports("y", len(D)), where)
    system = build_system(matrices, period, (len(inputs), len(outputs)), where)
    plant = Plant(dynamics=system, inputs=inputs, outputs=outputs, state_names=_texts(found, "StateName"))
    kind, delays = _text(found, "Kind"), [name for name in DELAYS if np.any(found.get(name, 0.0))]
    if delays and (kind == "compensator" or period is not None):
        raise DataError(
            f"a delay of a {kind or 'sampled system'}",
            where=f"{where}, {delays[0]}",
            hint="delays as states: pade(s, 3), or absorbDelay(s) of a sampled system",
        )
    if kind == "compensator":
        return _compensator(found, plant, where)
    rows, columns = system.D.shape
    plant = delay_plant(plant, _delays(found, where, (rows, columns))) if delays else plant
    return group_ports(plant, **{group: _texts(found, group) for group in GROUPS})


def _delays(found: Mapping[str, np.ndarray], where: str, shape: tuple[int, int]) -> np.ndarray:
    """Delay of each path [s]; InputDelay and OutputDelay have one value for each port, or one for all."""
    if "IODelay" in found and "ioDelay" in found:
        raise DataError(
            "the delays of the paths twice", where=f"{where}, IODelay", hint="ioDelay is the older name"
        )
    total = np.zeros(shape)
    for name, form in zip(DELAYS, ((1, shape[1]), (shape[0], 1), shape, shape), strict=True):
        if not np.size(found.get(name, ())):
            continue
        value = np.atleast_2d(real_matrix(found[name], name))
        if value.size == 1:
            value = np.full(form, value.item())
        elif 1 in form and value.shape == form[::-1]:  # a vector may lie either way
            value = value.reshape(form)
        if value.shape != form:
            raise DataError(
                f"delays of shape {value.shape}", where=f"{where}, {name}", hint=f"one number, or {form}"
            )
        total = total + value
    return total


def _compensator(found: Mapping[str, np.ndarray], plant: Plant, where: str) -> StoredCompensator:
    system = as_compensator(plant, negative_feedback=_text(found, "Feedback") == NEGATIVE).dynamics
    made: dict[str, Any] = {"method": _text(found, "Method"), "inert": _texts(found, "Inert")}
    made |= {name.lower(): float(found[name].item()) for name in ("Authority", "Cost") if name in found}
    matrices = {name: getattr(system, name) for name in "ABCD"}
    law = build_stored(matrices, plant.period_s, plant.inputs, plant.outputs, made, where)
    if "Applied" not in found:
        return law
    try:
        return with_applied(law, real_matrix(found["Applied"], "Applied"), where)
    except ConfigError as error:
        raise DataError(error.what, where=f"{where}, {error.where}", hint=error.hint) from None


def _ports(
    found: Mapping[str, np.ndarray], side: str, default: tuple[Port, ...], where: str
) -> tuple[Port, ...]:
    names = _texts(found, f"{side}Name")
    if not any(names):
        return default
    units = _texts(found, f"{side}Unit") or ("",) * len(names)
    channels = _texts(found, f"{side}Channel") or ("",) * len(names)
    if not len(names) == len(units) == len(channels) == len(default):
        raise DataError(
            f"{len(names)} names and {len(units)} units for {len(default)} {side.lower()}s",
            where=f"{where}, {side}Name",
            hint=f"one name, and one unit and channel or none, for each {side.lower()}",
        )
    place = f"{where}, {side}Channel"
    return tuple(
        Port(name, unit, _channel(text, place))
        for name, unit, text in zip(names, units, channels, strict=True)
    )


def _channel(text: str, where: str) -> Any:
    if not text:
        return None
    try:
        return build_channel(json.loads(text), where)
    except json.JSONDecodeError:
        raise DataError(
            f"{text!r} is no table",
            where=where,
            hint="write the file again with `write_mat`, or remove the entry",
        ) from None


def _texts(found: Mapping[str, np.ndarray], name: str) -> tuple[str, ...]:
    value = np.ravel(found.get(name, np.array([], dtype=str)))
    return tuple(map(str, value)) if value.dtype.kind == "U" else ()


def _text(found: Mapping[str, np.ndarray], name: str) -> str:
    return "".join(_texts(found, name)[:1])
