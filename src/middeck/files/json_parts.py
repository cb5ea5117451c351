"""Parts that several JSON documents share: keys that must be there, and ports."""

from __future__ import annotations

from typing import Any, cast

from middeck.errors import DataError
from middeck.files.channels import build_channel
from middeck.signals.ports import Port


def require_keys(data: Any, keys: tuple[str, ...], where: str, hint: str) -> None:
    """Raise `DataError` unless ``data`` is a table with all ``keys``."""
    missing = [k for k in keys if not isinstance(data, dict) or k not in data]
    if missing:
        raise DataError(f"keys missing: {', '.join(missing)}", where=where, hint=hint)


def read_ports(value: Any, where: str, hint: str) -> tuple[Port, ...]:
    """The ports of a list of names, units and channels; raises `DataError` where it is none."""
    if not isinstance(value, list) or not value:
        raise DataError("no ports", where=where, hint='a list of {"name": ..., "unit": ...}')
    return tuple(_port(item, where, hint) for item in cast("list[Any]", value))


def _port(item: Any, where: str, hint: str) -> Port:
    require_keys(item, ("name", "unit"), where, hint)
    channel = item.get("channel")
    if channel is None:
        return Port(str(item["name"]), str(item["unit"]))
    return Port(str(item["name"]), str(item["unit"]), build_channel(channel, f"{where}, channel"))
