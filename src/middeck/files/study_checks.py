"""Impossible requests of a study: missing signals, a rig without delay, axes that are held."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, cast

from middeck.files.article_checks import tables
from middeck.files.faults import Finding, finding, nearest
from middeck.files.study_form import StudyForm
from middeck.files.toml_lines import Path
from middeck.structure.model.article import JointState, Structure

Table = dict[str, Any]
# Decimals are not exact in binary.
ROUNDING = 1e-9


def signal_findings(data: Table) -> list[Finding]:
    """Faults between the tables of a study; tolerates a broken form."""
    return [*_metric(data), *_loops(data), *_hold(data), *_excitation(data)]


def _names(data: Table, table: str, *keys: str) -> list[str]:
    """All texts in the arrays ``keys`` of ``table``."""
    held = data.get(table)
    arrays = [cast("Table", held).get(key) for key in keys] if isinstance(held, dict) else []
    return [n for a in arrays if isinstance(a, list) for n in cast("list[Any]", a) if isinstance(n, str)]


def _metric(data: Table) -> Iterator[Finding]:
    known = _names(data, "control", "angles", "pd_loops")
    for i, name in enumerate(_names(data, "control", "metric")):
        if known and name not in known:
            yield finding(
                ("control", "metric", i),
                "neither among angles nor among pd_loops: no output of the plant",
                name,
                hint=nearest(name, known),
            )


def _loops(data: Table) -> Iterator[Finding]:
    known = _names(data, "control", "inputs", "disturbances")
    for i, name in enumerate(_names(data, "control", "pd_loops")):
        if known and name not in known:
            yield finding(
                ("control", "pd_loops", i),
                "neither among inputs nor among disturbances: no input of the plant",
                name,
                hint="add it to one of them, or leave its loop out",
            )


def _number(data: Table, table: str, key: str, index: int | None = None) -> float | None:
    """The positive number or zero that stands there; None for anything else."""
    held = data.get(table)
    value = cast("Table", held).get(key) if isinstance(held, dict) else None
    if index is not None:
        items = cast("list[Any]", value) if isinstance(value, list) else []
        value = items[index] if index < len(items) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
        return None
    return float(value)


def _hold(data: Table) -> Iterator[Finding]:
    """A held command takes effect half a sample late in the mean, whatever else is late."""
    sample_hz, delay_s = _number(data, "rig", "sample_hz"), _number(data, "rig", "delay_s")
    if sample_hz and delay_s is not None and delay_s < (1.0 - ROUNDING) * 0.5 / sample_hz:
        message = f"must be >= {0.5 / sample_hz:g} s, the hold's own half sample at {sample_hz:g} Hz"
        yield finding(("rig", "delay_s"), message, delay_s, hint="a longer delay or a higher sample_hz")


def _excitation(data: Table) -> Iterator[Finding]:
    """One period is a whole number of samples, and the band ends below half the rate."""
    sample_hz, period_s = _number(data, "rig", "sample_hz"), _number(data, "siso", "period_s")
    if sample_hz and period_s:
        samples = period_s * sample_hz
        if abs(samples - round(samples)) > ROUNDING * samples:
            message = f"{samples:g} samples at rig.sample_hz = {sample_hz:g} Hz; must be a whole number"
            yield finding(("siso", "period_s"), message, period_s)
    last = _number(data, "siso", "band_hz", 1)
    if sample_hz and last is not None and last >= 0.5 * sample_hz:
        message = f"must end below half of rig.sample_hz = {sample_hz:g} Hz"
        yield finding(("siso", "band_hz", 1), message, last, hint="a narrower band or a higher sample_hz")


def fixed_axes(form: StudyForm, article: str, structure: Structure, data: Table) -> Iterator[Finding]:
    """Axes in the tables ``data`` of ``article`` that a port of the study drives and that do not turn."""
    joints = {j.name: j for j in structure.joints}
    turned = {a.name: joints[a.frame] for a in structure.actuators if a.axis is None}
    seen: set[str] = set()
    for key, port in _driven(form, article):
        joint = turned.get(port)
        if joint is None or joint.name in seen or joint.state in (JointState.FREE, JointState.SPRUNG):
            continue
        seen.add(joint.name)
        yield finding(
            _state_of(data, joint.name),
            f"{key} of the study drives {port!r}: this axis must turn",
            joint.state.value,
            hint=f'"free" or "sprung", or leave the port out of {key}',
        )


def _driven(form: StudyForm, article: str) -> list[tuple[str, str]]:
    """Key and name of every port of ``article`` that the study drives."""
    control, found = form.control, list[tuple[str, str]]()
    if control.article == article:
        arrays: Mapping[str, tuple[str, ...]] = {
            "inputs": control.inputs,
            "disturbances": control.disturbances,
            "pd_loops": control.pd_loops,
        }
        found += [(f"control.{key}", port) for key, ports in arrays.items() for port in ports]
    if form.figure_6.article == article:
        found.append(("figure_6.input", form.figure_6.input))
    if form.siso.article == article:
        found.append(("siso.actuator", form.siso.actuator))
    return found


def _state_of(data: Table, joint: str) -> Path:
    """Where the state of ``joint`` stands, or would."""
    for i, t in tables(data, "gimbal"):
        for axis in "xz":
            if joint == f"{t.get('name')}_{axis}":
                return ("gimbal", i, f"state_{axis}")
    revolutes = {str(t.get("name")): i for i, t in tables(data, "revolute")}
    return ("revolute", revolutes[joint], "state")
