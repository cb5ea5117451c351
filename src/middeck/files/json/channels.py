"""Reading a channel's transducer: one table of keys for every kind of file."""

import datetime
import math
from dataclasses import fields
from typing import Any, cast

from middeck.errors import DataError
from middeck.signals.ports import Channel, Role

KEYS = tuple(f.name for f in fields(Channel))
ROLES: dict[str, Role] = {"": "", "sensor": "sensor", "actuator": "actuator"}


def build_channel(table: Any, where: str) -> Channel | None:
    """The channel that ``table`` describes by the names of its fields; None if it says nothing.

    Raises `DataError` for an unknown key, a role that is none, a gain that is not a positive number and a
    date that is not one.

    >>> build_channel({"node": "12", "direction": "+z", "gain": 9.81, "raw_unit": "V"}, "here").node
    '12'
    """
    if not isinstance(table, dict):
        raise DataError("not a table of channel data", where=where, hint=f"keys among {', '.join(KEYS)}")
    given = {str(k): v for k, v in cast("dict[Any, Any]", table).items() if v not in (None, "")}
    unknown = [k for k in given if k not in KEYS]
    if unknown:
        raise DataError(f"unknown key {unknown[0]!r}", where=where, hint=f"one of {', '.join(KEYS)}")
    if not given:
        return None
    gain = given.pop("gain", None)
    texts = {k: str(v).strip() for k, v in given.items()}
    named = texts.pop("role", "")
    role = ROLES.get(named)
    if role is None:
        raise DataError(f"role is {named!r}", where=where, hint="sensor or actuator")
    return Channel(
        node=texts.get("node", ""),
        direction=texts.get("direction", ""),
        role=role,
        gain=_gain(gain, where),
        raw_unit=texts.get("raw_unit", ""),
        calibrated=_date(texts.get("calibrated", ""), where),
    )


def _date(text: str, where: str) -> str:
    try:
        return datetime.date.fromisoformat(text).isoformat() if text else ""
    except ValueError:
        what = f"calibrated is {text!r}, not a date"
        raise DataError(what, where=where, hint="write it as 2026-01-31") from None


def _gain(value: Any, where: str) -> float | None:
    if value is None:
        return None
    number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    if not (math.isfinite(number) and number != 0.0):
        raise DataError(
            f"gain is {value!r}",
            where=where,
            hint="units of the channel per raw unit, a finite number, not 0",
        )
    return number
