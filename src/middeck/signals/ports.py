"""Named inputs and outputs, and the transducers behind them on the bench."""

from collections.abc import Sequence
from typing import Literal

from middeck.errors import ConfigError
from middeck.values import record

Role = Literal["", "sensor", "actuator"]


@record(kw_only=True)
class Channel:
    """The transducer behind a port, as far as it is known; empty texts and None stand for unknown.

    Attributes:
        node, direction: Place and positive direction, e.g. ``"12"`` and ``"+z"``; a turn about z is
            ``"+rz"``.
        role: ``"sensor"`` or ``"actuator"``: an input may be a command to an actuator or the reading of a
            force cell.
        gain, raw_unit: Units of the port per unit of the raw signal, e.g. 9.81 m/s^2 per ``"V"``. Samples of
            a record are calibrated already: they are not multiplied by it.
        calibrated: Date of the calibration, as ``"2026-01-31"``.
    """

    node: str = ""
    direction: str = ""
    role: Role = ""
    gain: float | None = None
    raw_unit: str = ""
    calibrated: str = ""


@record
class Port:
    """One scalar input or output of a system.

    Attributes:
        name: Unique among the ports on its side, e.g. ``"pri_rel_z"``; a rate carries the suffix ``_rate``.
        unit: SI unit in words, e.g. ``"N m"``, ``"rad"``, ``"rad/s"``, ``"V"``.
        channel: The transducer that measured it; None for a port of a computed system.
    """

    name: str
    unit: str
    channel: Channel | None = None


def same_ports(first: Sequence[Port], second: Sequence[Port]) -> bool:
    """Whether names, units, nodes and directions agree; a transducer may be calibrated anew between records.

    >>> same_ports([Port("a", "rad")], [Port("a", "rad", Channel(calibrated="2026-01-31"))])
    True
    """
    return [_what(p) for p in first] == [_what(p) for p in second]


def _what(port: Port) -> tuple[str, ...]:
    channel = port.channel or Channel()
    return port.name, port.unit, channel.node, channel.direction


def require_names(names: Sequence[str], what: str) -> None:
    """Raise `ConfigError` for one name where several are asked for: its letters would be taken for names."""
    if isinstance(names, str):
        raise ConfigError(f"{what}: {names!r} is one name, not a tuple of names", hint=f"({names!r},)")


def port_indices(ports: Sequence[Port], names: Sequence[str], side: str) -> list[int]:
    """Positions of ``names`` among ``ports``; raises `ConfigError` naming what there is.

    >>> port_indices([Port("a", "rad"), Port("b", "rad")], ["b"], "output")
    [1]
    """
    require_names(names, f"{side}s")
    known = [p.name for p in ports]
    unknown = [n for n in names if n not in known]
    if unknown:
        raise ConfigError(
            f"no {side} named {', '.join(map(repr, unknown))}", hint=f"one of {', '.join(known)}"
        )
    return [known.index(n) for n in names]


def once(*names: str) -> tuple[str, ...]:
    """Each name once, at its first place."""
    return tuple(dict.fromkeys(names))
