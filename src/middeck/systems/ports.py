"""Named inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence

from middeck.errors import ConfigError
from middeck.values import record


@record
class Port:
    """One scalar input or output of a system.

    Parameters
    ----------
    name:
        Unique among the ports on its side, e.g. ``"pri_rel_z"``; a rate carries the suffix ``_rate``.
    unit:
        SI unit in words, e.g. ``"N m"``, ``"rad"``, ``"rad/s"``, ``"V"``.
    """

    name: str
    unit: str


def port_indices(ports: Sequence[Port], names: Sequence[str], side: str) -> list[int]:
    """Positions of ``names`` among ``ports``; raises `ConfigError` naming what there is.

    >>> port_indices([Port("a", "rad"), Port("b", "rad")], ["b"], "output")
    [1]
    """
    known = [p.name for p in ports]
    unknown = [n for n in names if n not in known]
    if unknown:
        raise ConfigError(
            f"no {side} named {', '.join(map(repr, unknown))}", hint=f"one of {', '.join(known)}"
        )
    return [known.index(n) for n in names]
