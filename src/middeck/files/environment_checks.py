"""Faults of an environment beyond the form of its keys; tolerates a broken form."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from middeck.files.environment_form import TUNED, default_name
from middeck.files.faults import Finding, show
from middeck.files.toml_lines import Path

Table = dict[str, Any]


def environment_findings(data: Table) -> list[Finding]:
    """Everything that is wrong with the environment ``data`` by itself."""
    gravity = _table(data, "constants").get("gravity_m_s2", 0.0)
    weightless = gravity == 0.0
    devices = [(("device", i), d) for i, d in enumerate(_tables(data, "device"))]
    found = [*_gravity_findings(data, gravity), *_suspension_findings(data, gravity), *_name_findings(data)]
    for path, device in devices:
        found += _device_findings(path, device, weightless)
        found += _friction_findings(path, device)
    return found


def _gravity_findings(data: Table, gravity: Any) -> list[Finding]:
    found: list[Finding] = []
    held = any(data.get(key) for key in ("suspension", "device", "spring", "clamp", "bushing"))
    if _is_number(gravity) and gravity > 0.0 and not held:
        advice = "add [suspension], [[device]], [[spring]] or [[clamp]], or leave [constants] out for orbit"
        path = ("constants", "gravity_m_s2")
        found.append(
            Finding(path=path, message="a missing suspension in gravity", value=show(gravity), hint=advice)
        )
    if _table(data, "constants").get("gravity_direction") == [0.0, 0.0, 0.0]:
        found.append(Finding(path=("constants", "gravity_direction"), message="must not be the zero vector"))
    return found


def _suspension_findings(data: Table, gravity: Any) -> list[Finding]:
    suspension = _table(data, "suspension")
    path: Path = ("suspension",)
    found = _friction_findings(path, suspension)
    if suspension and gravity == 0.0:
        advice = "give [constants] gravity_m_s2, or use [[spring]]"
        found.append(Finding(path=path, message="cables carry nothing without gravity", hint=advice))
    if suspension.get("held") == {}:
        found.append(
            Finding(path=(*path, "held"), message="no attach point hangs on a cable", hint='n1 = "xyz"')
        )
    length: Any = suspension.get("cable_length_m")
    bounce: Any = suspension.get("bounce_hz")
    numbers = all(_is_number(x) and x > 0.0 for x in (length, bounce, gravity))
    if suspension.get("device") == "spring" and numbers:
        sink = float(gravity / (2.0 * np.pi * bounce) ** 2)
        if not length > sink:
            message = f"a spring at this bounce_hz stretches by {sink:.4g} m: no free length is left"
            advice = f"more than {sink:.4g}, a higher bounce_hz, or a constant_force device"
            found.append(
                Finding(path=(*path, "cable_length_m"), message=message, value=show(length), hint=advice)
            )
    return found


def _device_findings(path: Path, device: Table, weightless: bool) -> list[Finding]:
    found: list[Finding] = []
    for this, that in (("stiffness_n_per_m", "bounce_hz"), ("cable_length_m", "anchor_m")):
        if this in device and that in device:
            found.append(
                Finding(
                    path=(*path, that),
                    message=f"instead of {this!r}, not beside it",
                    value=show(device[that]),
                )
            )
        elif this not in device and that not in device:
            found.append(Finding(path=path, message=f"needs {this!r} or {that!r}"))
    tuned = device.get("force_n", TUNED) == TUNED
    if tuned and "held" not in device:
        advice = 'held = "yz", the world directions pinned while its load is found; or give force_n'
        found.append(Finding(path=path, message="a tuned device needs 'held'", hint=advice))
    if not tuned and "held" in device:
        message = "is for a tuned device; this one has a force"
        found.append(
            Finding(
                path=(*path, "held"), message=message, value=show(device["held"]), hint=f'force_n = "{TUNED}"'
            )
        )
    idle = [key for key in ("bounce_hz", "cable_length_m") if key in device]
    if weightless and (tuned or idle):
        key = idle[0] if idle else "force_n"
        advice = "give [constants] gravity_m_s2; or force_n, stiffness_n_per_m and anchor_m"
        found.append(Finding(path=(*path, key), message="means nothing without gravity", hint=advice))
    return found


def _friction_findings(path: Path, table: Table) -> list[Finding]:
    friction = table.get("friction_n", 0.0)
    if _is_number(friction) and friction > 0.0 and "presliding_m" not in table:
        advice = "presliding_m, how far it gives before it slips: 1e-5 to 1e-3 is usual"
        return [
            Finding(
                path=(*path, "friction_n"),
                message="needs 'presliding_m' beside it",
                value=show(friction),
                hint=advice,
            )
        ]
    if friction == 0.0 and "presliding_m" in table:
        message = "means nothing without 'friction_n'"
        return [Finding(path=(*path, "presliding_m"), message=message, value=show(table["presliding_m"]))]
    return []


def _name_findings(data: Table) -> list[Finding]:
    """Names that two devices or springs have: results are listed by them."""
    held = _table(data, "suspension").get("held")
    names: list[tuple[Path, Any]] = [
        (("suspension", "held", name), name) for name in cast("Table", held if isinstance(held, dict) else {})
    ]
    names += [(("device", i, "name"), d.get("name")) for i, d in enumerate(_tables(data, "device"))]
    for i, spring in enumerate(_tables(data, "spring")):
        key = "name" if "name" in spring else "attach"
        names.append((("spring", i, key), spring.get("name", default_name(str(spring.get("attach"))))))
    advice = "a name of its own; a suspension's devices have those of their attach points"
    first: dict[str, Path] = {}
    found: list[Finding] = []
    for path, name in names:
        if isinstance(name, str) and first.setdefault(name, path) != path:
            found.append(
                Finding(path=path, message="names a second device or spring", value=show(name), hint=advice)
            )
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _table(data: Table, key: str) -> Table:
    value = data.get(key)
    return cast("Table", value) if isinstance(value, dict) else {}


def _tables(data: Table, key: str) -> list[Table]:
    value = data.get(key)
    items = cast("list[Any]", value) if isinstance(value, list) else []
    return [cast("Table", item) if isinstance(item, dict) else {} for item in items]
