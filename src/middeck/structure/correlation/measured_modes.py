"""Modes as a test sees them: frequencies, dampings, shapes at named nodes and directions, and their noise."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Complex, Float

from middeck.errors import ConfigError, DataError
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import PosePoints, pose_jacobian
from middeck.structure.model.component import WAYS
from middeck.structure.model.connectivity import some_names
from middeck.structure.modes.results.component_outputs import drawn_inside, motions_inside, points_inside
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.values import record

AXES = ("x", "y", "z", "rx", "ry", "rz")
ANGLE, TRAVEL = "angle", "travel"
SENSOR, ACTUATOR = "sensor", "actuator"
DIRECTIONS = (*AXES, ANGLE, TRAVEL, SENSOR, ACTUATOR)
STRAIGHT = (*AXES[:3], TRAVEL)
PORTS = (SENSOR, ACTUATOR)
COUNT = 26
UNSEEN = 1e-9
"""Motion at the channels, of the largest that any mode has there, that may be rounding: not seen."""
NAMED = 5  # modes that a test lacks, each in a sentence of its own


@record(kw_only=True)
class MeasuredModes:
    """Modes identified in a test.

    Attributes:
        frequency_hz, damping: Natural frequencies [Hz] and damping ratios, NaN where none is stated.
        node, direction: Place and direction of each channel: a node, a joint, a mesh node or one that a
            component recovers, with "x", "y", "z" (translation along the world axes) or "rx", "ry", "rz"
            (rotation about them); a joint relative to its carrier, with "angle" or, where it slides,
            "travel"; a sensor of the article, with "sensor": its reading; or an actuator, with "actuator":
            the motion that its force works on.
        shape: Real or complex, of any scale from mode to mode; within a mode metres beside radians.
        frequency_std_hz, damping_std, shape_std: Standard deviations of the estimates, where the test states
            them; that of a complex shape is of real and imaginary part together.
        position_m: Position of each channel in world axes [m], where the test states it.
        modal_mass: Modal mass [kg] of each real shape as it stands, where it is known, as for computed
            shapes.
        lines: Nodes that lines of a picture join, one after the other, where the test states any.
        source: Description of the test in a file: model, description, program, date.
        warnings: Oddities found by the reader of a file.

    A survey of frequencies alone has no channels.

    Raises `DataError` for what no test can have measured: a frequency that is not positive, a shape that is
    zero or not finite, an unknown direction, two channels alike.
    """

    frequency_hz: Float[np.ndarray, " mode"]
    damping: Float[np.ndarray, " mode"]
    node: tuple[str, ...]
    direction: tuple[str, ...]
    shape: Complex[np.ndarray, "channel mode"]
    frequency_std_hz: Float[np.ndarray, " mode"] | None = None
    damping_std: Float[np.ndarray, " mode"] | None = None
    shape_std: Float[np.ndarray, "channel mode"] | None = None
    position_m: Float[np.ndarray, "channel 3"] | None = None
    modal_mass: Float[np.ndarray, " mode"] | None = None
    lines: tuple[tuple[str, ...], ...] = ()
    source: str = ""
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what, hint in _faults(self):
            raise DataError(what, where="measured modes", hint=hint)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, e.g. "n1 x"."""
        return tuple(f"{n} {d}" for n, d in zip(self.node, self.direction, strict=True))

    @property
    def is_real(self) -> bool:
        """Whether no shape has an imaginary part."""
        return not np.any(np.imag(self.shape))


@record
class MeasurementNoise:
    """Standard deviations of measured modes, where a test does not state them mode by mode.

    Attributes:
        frequency: Standard deviation of a frequency over the frequency.
        shape: Standard deviation of a channel over the rms of the mode's channels of its sort: translations,
            or rotations and joint angles.
    """

    frequency: float
    shape: float

    def __post_init__(self) -> None:
        for name, value in (("frequency", self.frequency), ("shape", self.shape)):
            if not 0.0 <= value < 1.0:
                raise ConfigError(
                    f"the noise of the {name} is {value}",
                    where=f"MeasurementNoise.{name}",
                    hint="a relative standard deviation, 0 to below 1, e.g. 0.001 and 0.02",
                )


NODES = "the node in the article of each row of shapes; frequencies alone have node, direction and shape []"


def _faults(measured: MeasuredModes) -> Iterator[tuple[str, str]]:
    """Faults of impossible measurements, and their remedies."""
    yield from _channel_faults(measured.node, measured.direction, len(measured.shape))
    optional = ("frequency_std_hz", "damping_std", "shape_std")
    if not len(measured.frequency_hz):
        yield "no modes", "at least one measured mode"
    for name in ("frequency_hz", "damping", "shape", *optional, "position_m", "modal_mass"):
        value = getattr(measured, name)
        # A damping that no one stated is not a number.
        if value is not None and not (np.isfinite(value) | ((name == "damping") & np.isnan(value))).all():
            yield f"{name} holds a number that is not finite", "leave the mode or channel out, or repair it"
        if name in optional and value is not None and np.any(value < 0.0):
            yield f"{name} holds a negative number", "standard deviations are >= 0"
    if np.any(measured.frequency_hz <= 0.0):
        least = measured.frequency_hz.min()
        yield f"a frequency of {least} Hz", "must be > 0 Hz; leave rigid-body modes out"
    if measured.modal_mass is not None and np.any(measured.modal_mass <= 0.0):
        yield f"a modal mass of {measured.modal_mass.min()} kg", "must be > 0 kg; leave out what is unknown"
    still = np.flatnonzero(~np.any(measured.shape, axis=0))
    if len(still) and len(measured.shape):
        what = f"the shape of mode {still[0] + 1} is zero"
        yield what, "leave the mode out, or add a channel at which it moves"


def _channel_faults(node: Sequence[str], direction: Sequence[str], rows: int) -> Iterator[tuple[str, str]]:
    if rows and not (node and all(name.strip() for name in node)):
        yield "shapes without names of their nodes", NODES
    if len(node) != rows or len(direction) != rows:
        what = f"{len(node)} nodes and {len(direction)} directions for {rows} rows of shapes"
        yield what, "one node and one direction for each row"
    unknown = sorted(set(direction) - set(DIRECTIONS))
    if unknown:
        yield f"no direction {unknown[0]!r}", f"one of {', '.join(DIRECTIONS)}"
    twice = sorted(p for p, times in Counter(zip(node, direction, strict=True)).items() if times > 1)
    if twice:
        yield f"two channels are {' '.join(twice[0])!r}", "leave one of them out"


def measure_modes(
    modes: Modes,
    at: Sequence[tuple[str, str]] | None = None,
    *,
    chosen: Sequence[int] | None = None,
    noise: MeasurementNoise | None = None,
    rng: np.random.Generator | None = None,
) -> MeasuredModes:
    """Modes as a test of ``modes`` would measure them at the channels ``at`` = (node, direction).

    By default all six directions at every node of the article and the angle of every moving joint; of the
    lowest 26 modes those that are not rigid, or the ones whose indices are ``chosen``. With noise, which
    needs an ``rng``, the standard deviations are stated beside the values.

    Raises `ConfigError` for a channel or a mode that the model does not have.
    """
    at = every_channel(modes.equilibrium.model) if at is None else at
    node, direction = tuple(n for n, _ in at), tuple(d for _, d in at)
    index = _chosen(modes, chosen)
    shape = np.asarray(sensor_rows(modes, node, direction) @ modes.shapes[:, index])
    damping = ratios_by_cause(modes, count=int(index.max(initial=0)) + 1).zeta[index]
    hz = modes.frequency_hz[index]
    model = modes.equilibrium.model
    at_m = np.array([drawn_at(model, _body(model, *channel)) for channel in at]).reshape(-1, 3)
    exact = MeasuredModes(
        frequency_hz=hz, damping=damping, node=node, direction=direction, shape=shape, position_m=at_m,
        modal_mass=np.ones(len(hz)),  # as `Modes` is normalised
    )  # fmt: skip
    if noise is None:
        return exact
    if rng is None:
        raise ConfigError("noise without a random generator", hint="rng=np.random.default_rng(seed)")
    straight = straight_channels(modes, node, direction)
    hz_std, shape_std = noise.frequency * hz, noise.shape * sort_rms(straight, shape)
    return replace(
        exact,
        frequency_hz=hz + hz_std * rng.standard_normal(hz.shape),
        shape=shape + shape_std * rng.standard_normal(shape.shape),
        frequency_std_hz=hz_std,
        shape_std=shape_std,
        modal_mass=None,
    )


def real_shapes(measured: MeasuredModes) -> Float[np.ndarray, "channel mode"]:
    """Shapes turned to the phase in which they are largest."""
    phase = 0.5 * np.angle(np.sum(measured.shape**2, axis=0))
    return np.real(measured.shape * np.exp(-1j * phase))


def every_channel(model: Model) -> list[tuple[str, str]]:
    """Six directions at every node of the article, then the angle or travel of every moving joint."""
    moving = dynamic_coordinates(model)[6 * model.tree.roots :]
    joints = [j for j, free in zip(model.structure.joints, moving, strict=True) if free]
    nodes = [(n.name, d) for n in model.structure.nodes for d in AXES]
    return nodes + [(j.name, TRAVEL if j.slides else ANGLE) for j in joints]


def channels_inside(model: Model) -> list[tuple[str, str]]:
    """Shifts of every point inside components, and its turns where they are outputs."""
    parts = model.structure.components
    return [
        (name, way)
        for name, (k, point) in points_inside(model).items()
        for three in (slice(0, 3), slice(3, 6))
        if {f"{point.name} {w}" for w in WAYS[three]} <= set(parts[k].outputs)
        for way in AXES[three]
    ]


def straight_channels(
    modes: Modes, node: Sequence[str], direction: Sequence[str]
) -> Bool[np.ndarray, " channel"]:
    """Whether each channel is in metres, not radians. A port is of the sort that it reads or moves.

    Raises `ConfigError` for a port that the model does not have.
    """
    sensors, actuators = _port_names(node, direction)
    straight = {(p.name, SENSOR): p.unit == "m" for p in output_rows(modes.equilibrium, sensors).ports}
    straight |= {(p.name, ACTUATOR): p.unit == "N" for p in input_rows(modes.equilibrium, actuators).ports}
    channels = zip(node, direction, strict=True)
    return np.array([straight.get((name, way), way in STRAIGHT) for name, way in channels], dtype=bool)


def _port_names(node: Sequence[str], direction: Sequence[str]) -> tuple[list[str], list[str]]:
    """Sensors and actuators among the channels."""
    channels = list(zip(node, direction, strict=True))
    return [name for name, way in channels if way == SENSOR], [n for n, way in channels if way == ACTUATOR]


def sort_rms(
    straight: Bool[np.ndarray, " channel"], shape: Complex[np.ndarray, "channel mode"]
) -> Float[np.ndarray, "channel mode"]:
    """Rms of each mode over the channels of a channel's sort: translations, or rotations."""
    rms = np.zeros(shape.shape)
    for sort in (straight, ~straight):
        if np.any(sort):
            rms[sort] = np.sqrt(np.mean(np.abs(shape[sort]) ** 2, axis=0))
    return rms


def sensor_rows(modes: Modes, node: Sequence[str], direction: Sequence[str]) -> sp.csr_array:
    """Readings of the channels per unit of every coordinate, at the rest state of ``modes``.

    A channel may stand on an attach point or inside a component too. Raises `ConfigError` for a node, a
    direction, a joint angle or a port that the model does not have, and for an accelerometer.
    """
    model = modes.equilibrium.model
    inside = points_inside(model)
    channels = list(zip(node, direction, strict=True))
    placed = [way not in PORTS and not (name in inside and way in AXES) for name, way in channels]
    places = [
        _place(model, name) if has else (0, np.zeros(3)) for name, has in zip(node, placed, strict=True)
    ]
    points = PosePoints(
        np.array([frame for frame, _ in places], dtype=int),
        np.array([offset for _, offset in places]).reshape(-1, 3),
    )
    motions = pose_jacobian(model.tree, points, modes.equilibrium.poses)
    # Rows of all motions, then those of ports and within components, of angles and of travels of joints.
    elsewhere = [channel for channel, has in zip(channels, placed, strict=True) if not has]
    asked = [(*inside[name], AXES.index(way)) for name, way in elsewhere if way not in PORTS]
    read, moved = iter(_port_rows(modes, node, direction)), iter(motions_inside(modes, asked))
    ports = [next(read if way in PORTS else moved) for _, way in elsewhere]
    own: list[int] = []
    row: list[int] = []
    port = itertools.count(6 * len(node))
    at_joints = 6 * len(node) + len(ports)
    for k, (name, way) in enumerate(channels):
        if not placed[k]:
            row.append(next(port))
        elif way in (ANGLE, TRAVEL):
            row.append(at_joints + len(own))
            own.append(_joint(model, name, way))
        elif way in AXES:
            row.append(6 * k + AXES.index(way))
        else:
            raise ConfigError(f"no direction {way!r}", where=name, hint=f"one of {', '.join(DIRECTIONS)}")
    unit = sp.coo_array((np.ones(len(own)), (np.arange(len(own)), own)), shape=(len(own), model.tree.size))
    parts = [motions, sp.csr_array(np.array(ports).reshape(len(ports), model.tree.size)), unit]
    every: sp.csr_array = sp.csr_array(sp.vstack(parts))
    return sp.csr_array(every[np.array(row, dtype=int)])


def seen(rows: sp.csr_array, modes: Modes) -> Float[np.ndarray, "channel mode"]:
    """Motion of modes of unit mass at the channels of ``rows``: zero of one that they do not see."""
    motion = np.asarray(rows @ modes.shapes)
    size = np.abs(motion)
    return np.where(size.max(axis=0, initial=0.0) > UNSEEN * size.max(initial=0.0), motion, 0.0)


def _port_rows(modes: Modes, node: Sequence[str], direction: Sequence[str]) -> list[np.ndarray]:
    """Rows of the channels that are ports, in their order."""
    sensors, actuators = _port_names(node, direction)
    read = output_rows(modes.equilibrium, sensors)
    for name, position, acceleration in zip(sensors, read.position, read.acceleration, strict=True):
        if not np.any(position) or np.any(acceleration):
            raise ConfigError(
                f"sensor {name!r} reads no displacement",
                where="measured channels",
                hint="the angle or travel itself; its rate and an acceleration are no channel",
            )
    force = input_rows(modes.equilibrium, actuators).force
    rows = {SENSOR: iter(np.real(read.position)), ACTUATOR: iter(np.real(force))}
    return [next(rows[way]) for way in direction if way in PORTS]


def drawn_at(model: Model, name: str) -> Float[np.ndarray, "3"]:
    """Place [m] of a node, joint, mesh node, attach point or point inside a component, as drawn."""
    if (inside := points_inside(model).get(name)) is not None:
        return drawn_inside(model, *inside)
    frame, offset = _place(model, name)
    return model.drawn.p[frame] + model.drawn.R[frame] @ offset


def _body(model: Model, name: str, way: str) -> str:
    """The frame of a port."""
    structure = model.structure
    parts = {SENSOR: structure.sensors, ACTUATOR: structure.actuators}.get(way, ())
    return next((part.frame for part in parts if part.name == name), name)


def _place(model: Model, name: str) -> tuple[int, np.ndarray]:
    """Frame, and where on it."""
    if name in model.frames:
        return model.frames.index(name), np.zeros(3)
    names = [point.name for point in model.structure.attach_points]
    if name in names:
        pose = model.attach_point[names.index(name)]
        return int(model.points.frame[pose]), model.points.offset[pose]
    near = get_close_matches(name, [*model.frames, *names], 1)
    known = [part.name for part in (*model.structure.nodes, *model.structure.joints)]
    hint = f"did you mean {near[0]!r}?" if near else f"nodes and joints are {some_names(known)}"
    raise ConfigError(f"the model has no node {name!r}", where="measured channels", hint=hint)


def _joint(model: Model, name: str, way: str) -> int:
    fitting = {j.name: i for i, j in enumerate(model.structure.joints) if j.slides == (way == TRAVEL)}
    if name not in fitting:
        raise ConfigError(
            f"{name!r} is no joint with {'an angle' if way == ANGLE else 'a travel'}",
            where="measured channels",
            hint=f"such joints are {', '.join(fitting) or 'not there'}",
        )
    coordinate = 6 * model.tree.roots + fitting[name]
    if not dynamic_coordinates(model)[coordinate]:
        raise ConfigError(f"joint {name!r} does not move", where="measured channels", hint="leave it out")
    return coordinate


def _chosen(modes: Modes, chosen: Sequence[int] | None) -> np.ndarray:
    if chosen is None:
        return np.array([i for i, k in enumerate(modes.kind[:COUNT]) if k != "rigid"], dtype=int)
    for i in chosen:
        if not 0 <= i < len(modes.omega) or modes.kind[i] == "rigid":
            raise ConfigError(
                f"no mode {i} that a test would measure",
                where="chosen modes",
                hint=f"{modes.kind.count('rigid')} to {len(modes.omega) - 1}",
            )
    return np.array(chosen, dtype=int)


def called(measured: MeasuredModes, j: int) -> str:
    """Words for a measured mode, counted from 1 as in tests."""
    return f"measured mode {j + 1} of {measured.frequency_hz[j]:.4g} Hz"


def not_measured(modes: Modes, missing: Sequence[int]) -> list[str]:
    """A sentence for each of the first modes of the model that a test lacks, and one for the others."""
    remarks = [
        f"mode {i} {modes.name[i]!r} of {modes.frequency_hz[i]:.4g} Hz was not measured"
        for i in missing[:NAMED]
    ]
    if len(missing) > NAMED:
        last = modes.frequency_hz[missing[-1]]
        remarks.append(f"nor were {len(missing) - NAMED} more modes of the model, up to {last:.4g} Hz")
    return remarks
