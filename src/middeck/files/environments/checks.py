"""Faults of an environment beyond the form of its keys; tolerates a broken form."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from middeck.files.articles.boundary_checks import bushing_findings, clamp_findings
from middeck.files.articles.boundary_form import ClampForm, GroundBushingForm, build_ground
from middeck.files.articles.name_checks import given_again
from middeck.files.environments.form import TUNED, default_name
from middeck.files.toml.faults import PathFault, finding
from middeck.files.toml.lines import Path
from middeck.files.toml.tables import Table, is_number, table_of, tables


def environment_findings(data: Table) -> list[PathFault]:
    """Everything that is wrong with the environment ``data`` by itself."""
    gravity = table_of(data, "constants").get("gravity_m_s2", 0.0)
    weightless = gravity == 0.0
    found = [*_gravity_findings(data, gravity), *_suspension_findings(data, gravity), *_name_findings(data)]
    found += clamp_findings(("clamp",), tables(data, "clamp"), ClampForm)
    found += bushing_findings(("bushing",), tables(data, "bushing"), GroundBushingForm, build_ground)
    for i, device in tables(data, "device"):
        found += _device_findings(("device", i), device, weightless)
        found += _friction_findings(("device", i), device)
    return found


def _gravity_findings(data: Table, gravity: Any) -> Iterator[PathFault]:
    held = any(data.get(key) for key in ("suspension", "device", "spring", "clamp", "bushing"))
    if is_number(gravity) and gravity > 0.0 and not held:
        advice = "add [suspension], [[device]], [[spring]] or [[clamp]], or leave [constants] out for orbit"
        path = ("constants", "gravity_m_s2")
        yield finding(path, "a missing suspension in gravity", gravity, hint=advice)


def _suspension_findings(data: Table, gravity: Any) -> Iterator[PathFault]:
    suspension = table_of(data, "suspension")
    path: Path = ("suspension",)
    yield from _friction_findings(path, suspension)
    if suspension and gravity == 0.0:
        advice = "give [constants] gravity_m_s2, or use [[spring]]"
        yield finding(path, "cables carry nothing without gravity", hint=advice)
    length: Any = suspension.get("cable_length_m")
    bounce: Any = suspension.get("bounce_hz")
    numbers = all(is_number(x) and x > 0.0 for x in (length, bounce, gravity))
    if suspension.get("device") == "spring" and numbers:
        sink = float(gravity / (2.0 * np.pi * bounce) ** 2)
        if not length > sink:
            message = f"a spring at this bounce_hz stretches by {sink:.4g} m: no free length is left"
            advice = f"more than {sink:.4g}, a higher bounce_hz, or a constant_force device"
            yield finding((*path, "cable_length_m"), message, length, hint=advice)


def _device_findings(path: Path, device: Table, weightless: bool) -> Iterator[PathFault]:
    for this, that in (("stiffness_n_per_m", "bounce_hz"), ("cable_length_m", "anchor_m")):
        if this in device and that in device:
            yield finding((*path, that), f"instead of {this!r}, not beside it", device[that])
        elif this not in device and that not in device:
            yield finding(path, f"needs {this!r} or {that!r}")
    tuned = device.get("force_n", TUNED) == TUNED
    if tuned and "held" not in device:
        advice = 'held = "yz", the world directions pinned while its load is found; or give force_n'
        yield finding(path, "a tuned device needs 'held'", hint=advice)
    if not tuned and "held" in device:
        message = "is for a tuned device; this one has a force"
        yield finding((*path, "held"), message, device["held"], hint=f'force_n = "{TUNED}"')
    idle = [key for key in ("bounce_hz", "cable_length_m") if key in device]
    if weightless and (tuned or idle):
        key = idle[0] if idle else "force_n"
        advice = "give [constants] gravity_m_s2; or force_n, stiffness_n_per_m and anchor_m"
        yield finding((*path, key), "means nothing without gravity", hint=advice)


def _friction_findings(path: Path, device: Table) -> Iterator[PathFault]:
    friction = device.get("friction_n", 0.0)
    if is_number(friction) and friction > 0.0 and "presliding_m" not in device:
        advice = "presliding_m, how far it gives before it slips: 1e-5 to 1e-3 is usual"
        yield finding((*path, "friction_n"), "needs 'presliding_m' beside it", friction, hint=advice)
    if friction == 0.0 and "presliding_m" in device:
        message = "means nothing without 'friction_n'"
        yield finding((*path, "presliding_m"), message, device["presliding_m"])


def _name_findings(data: Table) -> list[PathFault]:
    """Names that two devices or springs have, or two supports: results are listed by them."""
    held = table_of(table_of(data, "suspension"), "held")
    names: list[tuple[Path, Any]] = [(("suspension", "held", name), name) for name in held]
    names += [(("device", i, "name"), d.get("name")) for i, d in tables(data, "device")]
    for i, spring in tables(data, "spring"):
        key = "name" if "name" in spring else "attach"
        names.append((("spring", i, key), spring.get("name", default_name(str(spring.get("attach"))))))
    advice = "a name of its own; a suspension's devices have those of their attach points"
    held_nodes = dict.fromkeys(str(c.get("node")) for _, c in tables(data, "clamp"))
    supports: list[tuple[Path, Any]] = [(("clamp",), node) for node in held_nodes]
    for i, bushing in tables(data, "bushing"):
        key = "name" if "name" in bushing else "attach"
        supports.append((("bushing", i, key), bushing.get("name", f"bushing_{bushing.get('attach')}")))
    return [
        *given_again(names, "names a second device or spring", advice),
        *given_again(supports, "names a second support", "a name of its own, which no clamped node has"),
    ]
