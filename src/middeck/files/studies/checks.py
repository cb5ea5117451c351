"""Impossible requests of a study: missing signals, a rig without delay, axes that are held."""

import math
from collections.abc import Iterator
from typing import Any

from middeck.files.studies.form import StudyForm
from middeck.files.toml.faults import PathFault, finding, nearest
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, array_of, is_number, table_of, tables
from middeck.structure.model.article import JointState, Structure

# Decimals are not exact in binary.
ROUNDING = 1e-9


def signal_findings(data: Table) -> list[PathFault]:
    """Faults between the tables of a study; tolerates a broken form."""
    return [*_metric(data), *_loops(data), *_hold(data), *_excitation(data)]


def _names(data: Table, *keys: str) -> list[str]:
    """All texts in the arrays ``keys`` of the table ``control``."""
    return [n for key in keys for n in array_of(table_of(data, "control"), key) if isinstance(n, str)]


def _metric(data: Table) -> Iterator[PathFault]:
    known = _names(data, "angles", "pd_loops")
    for i, name in enumerate(_names(data, "metric")):
        if known and name not in known:
            message = "neither among angles nor among pd_loops: no output of the plant"
            yield finding(("control", "metric", i), message, name, hint=nearest(name, known))


def _loops(data: Table) -> Iterator[PathFault]:
    known = _names(data, "inputs", "disturbances")
    for i, name in enumerate(_names(data, "pd_loops")):
        if known and name not in known:
            message = "neither among inputs nor among disturbances: no input of the plant"
            hint = "add it to one of them, or leave its loop out"
            yield finding(("control", "pd_loops", i), message, name, hint=hint)


def _number(value: Any) -> float | None:
    """The positive number or zero; None for anything else."""
    return float(value) if is_number(value) and 0.0 <= value < math.inf else None


def _hold(data: Table) -> Iterator[PathFault]:
    """A held command has a mean delay of half a sample, beside all other delays."""
    sample_hz, delay_s = (_number(table_of(data, "rig").get(key)) for key in ("sample_hz", "delay_s"))
    if sample_hz and delay_s is not None and delay_s < (1.0 - ROUNDING) * 0.5 / sample_hz:
        message = f"must be >= {0.5 / sample_hz:g} s, the hold's own half sample at {sample_hz:g} Hz"
        yield finding(("rig", "delay_s"), message, delay_s, hint="a longer delay or a higher sample_hz")


def _excitation(data: Table) -> Iterator[PathFault]:
    """One period is a whole number of samples, and the band ends below half the rate."""
    siso = table_of(data, "siso")
    sample_hz, period_s = _number(table_of(data, "rig").get("sample_hz")), _number(siso.get("period_s"))
    if sample_hz and period_s:
        samples = period_s * sample_hz
        if abs(samples - round(samples)) > ROUNDING * samples:
            message = f"{samples:g} samples at rig.sample_hz = {sample_hz:g} Hz; must be a whole number"
            yield finding(("siso", "period_s"), message, period_s)
    last = next(map(_number, array_of(siso, "band_hz")[1:2]), None)
    if sample_hz and last is not None and last >= 0.5 * sample_hz:
        message = f"must end below half of rig.sample_hz = {sample_hz:g} Hz"
        yield finding(("siso", "band_hz", 1), message, last, hint="a narrower band or a higher sample_hz")


def fixed_axes(form: StudyForm, article: str, structure: Structure, data: Table) -> Iterator[PathFault]:
    """Axes in the tables ``data`` of ``article`` that a port of the study drives and that do not turn."""
    joints = {j.name: j for j in structure.joints}
    turned = {a.name: joints[a.frame] for a in structure.actuators if a.axis is None}
    seen: set[str] = set()
    for key, port in _driven(form, article):
        joint = turned.get(port)
        if joint is None or joint.name in seen or joint.state in (JointState.FREE, JointState.SPRUNG):
            continue
        seen.add(joint.name)
        message = f"{key} of the study drives {port!r}: this axis must turn"
        hint = f'"free" or "sprung", or leave the port out of {key}'
        yield finding(_state_of(data, joint.name), message, joint.state.value, hint=hint)


def _driven(form: StudyForm, article: str) -> list[tuple[str, str]]:
    """Key and name of every port of ``article`` that the study drives."""
    control, found = form.control, list[tuple[str, str]]()
    if control is not None and control.article == article:
        arrays = (("inputs", control.inputs), ("disturbances", control.disturbances))
        arrays = (*arrays, ("pd_loops", control.pd_loops))
        found += [(f"control.{key}", port) for key, ports in arrays for port in ports]
    if form.figure_6 is not None and form.figure_6.article == article:
        found.append(("figure_6.input", form.figure_6.input))
    if form.siso is not None and form.siso.article == article:
        found.append(("siso.actuator", form.siso.actuator))
    return found


def _state_of(data: Table, joint: str) -> Path:
    """Place of the state of ``joint``, given or not."""
    for i, t in tables(data, "gimbal"):
        for axis in "xz":
            if joint == f"{t.get('name')}_{axis}":
                return ("gimbal", i, f"state_{axis}")
    revolutes = {str(t.get("name")): i for i, t in tables(data, "revolute")}
    return ("revolute", revolutes[joint], "state")
