"""Gauge readings of an article at rest: displacements, tilts, forces of supports; and their slopes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from enum import Enum

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.structure.rest.equilibrium import Equilibrium, node_shifts
from middeck.structure.sensitivity.rest import RestMotion
from middeck.values import record

# Cosine squared of a tilt beyond which the angle has no slope: the line is upright.
UPRIGHT = 1e-6


class GaugeKind(Enum):
    """Kind of reading of a gauge."""

    SHIFT = "shift"  # how far a point of a node has moved since drawn, along a direction
    TILT = "tilt"  # how far a line of a node has turned towards a direction since drawn
    FORCE = "force"  # of a clamp or bushing on the article along a direction; of a device its pull
    MOMENT = "moment"  # of a clamp or bushing on the article about a direction


@record(kw_only=True)
class Gauge:
    """An instrument on an article at rest.

    Attributes:
        at: A node; of a force or a moment a clamped node, a bushing to the ground, or a device.
        kind: Kind of the reading [m, rad, N, N m].
        direction: In W, of any length; the pull of a device needs none. A tilt is the angle of ``line`` over
            the plane across it, asin(direction . R line), less that as drawn.
        point: Point of a shift, from the node, in its axes [m].
        line: Line of a tilt, in the axes of the node.
        std: Standard deviation of a reading.

    Raises `ConfigError` for a direction or a line of no length, or one along the other.

    >>> Gauge(name="tip", at="n5", kind=GaugeKind.SHIFT, direction=np.array([0.0, 0.0, 1.0]), std=5e-4).unit
    'm'
    """

    name: str
    at: str
    kind: GaugeKind = GaugeKind.SHIFT
    direction: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    point: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    line: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    std: float = 0.0

    def __post_init__(self) -> None:
        for what, hint in self._faults():
            raise ConfigError(what, where=f"gauge {self.name!r}", hint=hint)

    def _faults(self) -> Iterator[tuple[str, str]]:
        turns = self.kind is GaugeKind.TILT
        if not 0.0 <= self.std < np.inf:
            yield f"a deviation of {self.std}", "zero or more, in its unit"
        if self.kind is not GaugeKind.FORCE and not np.any(self.direction):
            yield "no direction", "a vector in the axes of the world"
        if turns and not np.any(self.line):
            yield "a tilt of no line", "a vector in the axes of its node"
        if turns and not np.any(np.cross(self.line, self.direction)):
            what = "a line along the direction towards which it is to turn"
            yield what, "one across it: of a chord along x its tilt towards z"

    @property
    def unit(self) -> str:
        """Unit of the reading."""
        return {"shift": "m", "tilt": "rad", "force": "N", "moment": "N m"}[self.kind.value]

    @property
    def along(self) -> Float[np.ndarray, "3"]:
        """The direction, of length one; zero of a pull."""
        return _unit(self.direction)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / (np.linalg.norm(v) or 1.0)


def read(rest: Equilibrium, gauges: Sequence[Gauge]) -> Float[np.ndarray, " gauge"]:
    """Readings of ``gauges`` in ``rest``. Raises `ConfigError` for a missing node or support."""
    out = np.array([_seen(rest, gauge) @ gauge.along for gauge in gauges])
    for k, gauge in enumerate(gauges):
        if gauge.kind is GaugeKind.TILT:
            drawn = float(_unit(gauge.line) @ gauge.along)
            out[k] = np.arcsin(np.clip(out[k] + drawn, -1.0, 1.0)) - np.arcsin(drawn)
        elif _is_pull(rest, gauge):
            out[k] = rest.tension[rest.devices.index(gauge.at)]
    return out


def lengths(
    rest: Equilibrium, before: Equilibrium | None, gauges: Sequence[Gauge]
) -> Float[np.ndarray, " gauge"]:
    """Length of the change since ``before`` (or since drawn) of which each gauge reads a component.

    Of a shift that of its point, of a tilt that of its line, of a force that of the whole of it: an error of
    the model, or of the mounting of a gauge, is in parts of this.
    """
    out = []
    for gauge in gauges:
        if _is_pull(rest, gauge):
            pull = read(rest, [gauge]) - (0.0 if before is None else read(before, [gauge]))
            out.append(abs(float(pull[0])))
        else:
            change = _seen(rest, gauge) - (0.0 if before is None else _seen(before, gauge))
            out.append(float(np.linalg.norm(change)))
    return np.array(out)


def _seen(rest: Equilibrium, gauge: Gauge) -> np.ndarray:
    """The vector of which it reads a part: of a shift, the change of a line, a force; zero of a pull."""
    if gauge.kind in (GaugeKind.FORCE, GaugeKind.MOMENT):
        if _is_pull(rest, gauge):
            return np.zeros(3)
        support = rest.reactions[_support(rest, gauge)]
        return support.force if gauge.kind is GaugeKind.FORCE else support.moment
    turn = rest.config.R[_node(rest, gauge)] - np.eye(3)
    if gauge.kind is GaugeKind.TILT:
        return turn @ _unit(gauge.line)
    return node_shifts(rest)[gauge.at] + turn @ gauge.point


def motion_rows(rest: Equilibrium, gauges: Sequence[Gauge]) -> Float[np.ndarray, "gauge coordinate"]:
    """Rows of shifts and turns over the coordinates of the frame tree; zero rows for forces."""
    rows = np.zeros((len(gauges), rest.model.tree.size))
    for k, gauge in enumerate(gauges):
        if gauge.kind not in (GaugeKind.SHIFT, GaugeKind.TILT):
            continue
        node, n = _node(rest, gauge), gauge.along
        R, own = rest.config.R[node], rows[k, 6 * node : 6 * node + 6]
        if gauge.kind is GaugeKind.SHIFT:
            own[:3], own[3:] = n, np.cross(R @ gauge.point, n)
        else:
            line = R @ _unit(gauge.line)
            rest_of = 1.0 - float(line @ n) ** 2
            if rest_of < UPRIGHT:
                raise NumericalError(
                    "its line is upright: the angle has no slope",
                    where=f"gauge {gauge.name!r}",
                    hint="points of the gauge that are not above each other",
                )
            own[3:] = np.cross(line, n) / np.sqrt(rest_of)
    return rows


def slopes(rest: Equilibrium, by: RestMotion, gauges: Sequence[Gauge]) -> Float[np.ndarray, "gauge cause"]:
    """Derivatives of the readings, the motion of the rest state included."""
    out = motion_rows(rest, gauges) @ by.motion
    for k, gauge in enumerate(gauges):
        if gauge.kind is GaugeKind.SHIFT:  # since drawn, and what is drawn may move
            node = _node(rest, gauge)
            out[k] -= gauge.along @ by.drawn[6 * node : 6 * node + 3]
        elif _is_pull(rest, gauge):
            out[k] = by.tension[rest.devices.index(gauge.at)]
        elif gauge.kind is not GaugeKind.TILT:
            part = slice(0, 3) if gauge.kind is GaugeKind.FORCE else slice(3, 6)
            out[k] = gauge.along @ by.support[_support(rest, gauge), part]
    return out


def _is_pull(rest: Equilibrium, gauge: Gauge) -> bool:
    return gauge.kind is GaugeKind.FORCE and not np.any(gauge.direction) and gauge.at in rest.devices


def _node(rest: Equilibrium, gauge: Gauge) -> int:
    return _place(gauge, [node.name for node in rest.model.structure.nodes], "node")


def _support(rest: Equilibrium, gauge: Gauge) -> int:
    if not np.any(gauge.direction):
        return _place(gauge, rest.devices, "device")
    return _place(gauge, [r.at for r in rest.reactions], "clamp or bushing to the ground")


def _place(gauge: Gauge, names: Sequence[str], what: str) -> int:
    if gauge.at not in names:
        raise ConfigError(
            f"no {what} {gauge.at!r}",
            where=f"gauge {gauge.name!r}",
            hint=f"there are {', '.join(names)}" if names else f"there is no {what} in this environment",
        )
    return list(names).index(gauge.at)
