"""Which packages a supervisor loads: those that a gate has passed, unless it is told to ask for none."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from middeck.errors import ConfigError

Admitted = Mapping[str, str] | Literal["ungated"]
"""The hold of each verdict by the SHA-256 of its package, or that no verdict is asked for."""
NONE_ADMITTED: Mapping[str, str] = MappingProxyType({})


def checked_admitted(admitted: Admitted) -> Admitted:
    """``admitted``; raises `ConfigError` for what is neither a mapping nor ``"ungated"``.

    >>> checked_admitted("ungated")
    'ungated'
    """
    if admitted != "ungated" and not isinstance(admitted, Mapping):
        raise ConfigError(
            f"admitted = {admitted!r}",
            where="Supervisor",
            hint='load_verdicts(["verdict.json"]), or "ungated" to ask for no verdict',
        )
    return admitted


def is_admitted(admitted: Admitted, package: str, hold: str) -> bool:
    """Whether a package of this SHA-256 may be loaded beside ``hold``.

    >>> is_admitted({"ab": "cd"}, "ab", "cd"), is_admitted({"ab": "cd"}, "ab", "other")
    (True, False)
    """
    return admitted == "ungated" or (isinstance(admitted, Mapping) and admitted.get(package) == hold)
