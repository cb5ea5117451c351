"""MATLAB files: A, B, C, D, Ts and names, as the arguments of MATLAB's ``ss`` are called.

In MATLAB: ``s = load('law.mat'); K = ss(s.A, s.B, s.C, s.D, s.Ts, 'InputName', s.InputName, 'OutputName',
s.OutputName);`` and, since u = K y is added, ``feedback(P, K, +1)``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.control.law.sampled_compensator import SampledCompensator
from middeck.errors import ConfigError, DataError
from middeck.files.atomic import replacing
from middeck.files.channels import build_channel
from middeck.files.compensators import Stored, build_stored, build_system, how_made, period_of
from middeck.files.exchange.foreign import real_matrix, settle_period
from middeck.files.exchange.named import (
    Exchangeable,
    NamedSystem,
    as_plant,
    name_ports,
    named_system,
    negated,
)
from middeck.files.json_output import json_text
from middeck.signals.ports import Port
from middeck.systems.plant import Plant
from middeck.systems.sampled_plant import SampledPlant

GROUPS = ("w", "u", "z", "y")
KINDS = ("", "plant", "compensator", "system")
NEGATIVE, POSITIVE = "negative", "positive"
DELAYS = ("InputDelay", "OutputDelay", "IODelay", "ioDelay", "InternalDelay")
HINT = "s.A = K.A; ... save('law.mat', '-struct', 's') of an ss object's matrices"


def write_mat(path: str | Path, value: Exchangeable, *, negative_feedback: bool = False) -> None:
    """Write a system, plant or compensator as a MAT file of version 5, whole or not at all.

    Variables: A, B, C, D, Ts (0: continuous), InputName, OutputName, StateName, InputUnit, OutputUnit (cell
    arrays), Kind; of a plant its groups w, u, z and y; of a compensator Feedback, Method, Authority, Cost and
    Inert. ``negative_feedback=True`` writes -K, for u = -K y, and says so in Feedback.

    Raises `ConfigError` for what cannot be exchanged.
    """
    named = named_system(value, negative_feedback=negative_feedback)
    write_variables(path, named, _of_its_kind(value, negative_feedback))


def write_variables(path: str | Path, named: NamedSystem, kind: Mapping[str, Any]) -> None:
    """A system's matrices and names, and what belongs to its kind, whole or not at all."""
    import scipy.io

    contents: dict[str, Any] = {name: getattr(named.system, name) for name in "ABCD"}
    contents |= {"Ts": period_of(named.system) or 0.0, "StateName": _cells(named.state_names)}
    for side, ports in (("Input", named.inputs), ("Output", named.outputs)):
        contents[f"{side}Name"] = _cells([port.name for port in ports])
        contents[f"{side}Unit"] = _cells([port.unit for port in ports])
        if any(port.channel for port in ports):
            channels = [json_text(port.channel) if port.channel else "" for port in ports]
            contents[f"{side}Channel"] = _cells(channels)
    contents |= kind
    with replacing(Path(path)) as temporary, open(temporary, "wb") as stream:
        scipy.io.savemat(stream, contents, do_compression=True, oned_as="column")


def _of_its_kind(value: Exchangeable, negative_feedback: bool) -> dict[str, Any]:
    match value:
        case Plant() | SampledPlant():
            return {"Kind": "plant"} | {group: _cells(getattr(value, group)) for group in GROUPS}
        case Compensator() | SampledCompensator():
            made = how_made(value)
            known = {name.title(): made[name] for name in ("authority", "cost") if made[name] is not None}
            return {
                "Kind": "compensator",
                "Feedback": NEGATIVE if negative_feedback else POSITIVE,
                "Method": made["method"],
                "Inert": _cells(made["inert"]),
                **known,
            }
        case _:
            return {"Kind": "system"}


def _cells(texts: Sequence[str]) -> np.ndarray:
    cells = np.empty(len(texts), dtype=object)
    cells[:] = list(texts)
    return cells


def load_mat(
    path: str | Path, *, variable: str = "", period_s: float | None = None
) -> NamedSystem | Plant | SampledPlant | Stored:
    """The plant, compensator or system in a MAT file, of `write_mat` or with A, B, C and D of any origin.

    Parameters
    ----------
    path:
        File of version 5 or 7.3.
    variable:
        The structure that holds A, B, C and D; empty where they stand by themselves.
    period_s:
        For a file without Ts, or with Ts = -1; 0 for a continuous system.

    Returns
    -------
    A compensator always for u = K y added: one that was written for u = -K y is turned.

    Raises
    ------
    DataError
        Naming file and variable, for a file that is missing or broken, matrices that are missing, complex,
        not finite or do not fit, names that are not as many as the ports, or what A, B, C and D alone do not
        say: a matrix E, a delay, a unit of time other than the second, a kind or sign that is not known.
    """
    where = str(path)
    found = _part(_arrays(Path(path)), variable)
    missing = [name for name in "ABCD" if name not in found]
    if missing:
        there = ", ".join(sorted(found)) or "nothing"
        raise DataError(f"no {', '.join(missing)}; there is {there}", where=where, hint=HINT)
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
    late = [name for name in DELAYS if np.any(found.get(name, 0.0))]
    if late:
        raise DataError(
            "a delay, which A, B, C and D do not hold",
            where=f"{where}, {late[0]}",
            hint="0 there, and a DelayedPlant here; or pade(s, 3)",
        )
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
) -> NamedSystem | Plant | SampledPlant | Stored:
    D = matrices["D"]
    inputs = _ports(found, "Input", name_ports("u", D.shape[-1]), where)
    outputs = _ports(found, "Output", name_ports("y", len(D)), where)
    system = build_system(matrices, period, (len(inputs), len(outputs)), where)
    named = NamedSystem(system, inputs, outputs, _texts(found, "StateName"))
    match _text(found, "Kind"):
        case "compensator":
            return _compensator(found, named, where)
        case "plant":
            return as_plant(named, **{group: _texts(found, group) for group in GROUPS})
        case _:
            return named


def _compensator(found: Mapping[str, np.ndarray], named: NamedSystem, where: str) -> Stored:
    system = negated(named.system) if _text(found, "Feedback") == NEGATIVE else named.system
    made: dict[str, Any] = {"method": _text(found, "Method"), "inert": _texts(found, "Inert")}
    made |= {name.lower(): float(found[name].item()) for name in ("Authority", "Cost") if name in found}
    matrices = {name: getattr(system, name) for name in "ABCD"}
    return build_stored(matrices, period_of(system), named.inputs, named.outputs, made, where)


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
        raise DataError(f"{text!r} is no table", where=where) from None


def _texts(found: Mapping[str, np.ndarray], name: str) -> tuple[str, ...]:
    value = np.ravel(found.get(name, np.array([], dtype=str)))
    return tuple(map(str, value)) if value.dtype.kind == "U" else ()


def _text(found: Mapping[str, np.ndarray], name: str) -> str:
    return "".join(_texts(found, name)[:1])
