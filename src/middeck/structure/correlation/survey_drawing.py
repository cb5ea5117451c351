"""A survey as it is drawn: the lines that join its nodes, and how each of its modes moves them."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from middeck.structure.correlation.measured_modes import AXES, MeasuredModes, drawn_at, real_shapes
from middeck.structure.correlation.placing import place_channels
from middeck.structure.modes.results.drawing import Drawing, Mark, Strand
from middeck.structure.modes.solve import Modes


def build_survey_drawing(modes: Modes, measured: MeasuredModes, title: str = "test") -> Drawing:
    """Measured shapes at the places of the model's nodes, upwards as the model of ``modes`` is.

    Lines are those of the survey (trace lines of a universal file), else the members between measured
    nodes. A complex shape is drawn in the phase in which it is largest. Rotations are not drawn.

    Raises `ConfigError` for a survey none of whose nodes is in the model.
    """
    model = modes.equilibrium.model
    measured = place_channels(model, measured)
    nodes = {node: None for node, way in zip(measured.node, measured.direction, strict=True) if way in AXES}
    members = [(m.start, m.end) for m in model.structure.members]
    lines = measured.lines or [ends for ends in members if nodes.keys() >= set(ends)]
    points = [*nodes, *(name for line in lines for name in line)]
    at = np.array([drawn_at(model, name) for name in points]).reshape(-1, 3)
    ends = np.cumsum([len(nodes), *map(len, lines)], dtype=int).tolist()
    count = len(measured.frequency_hz)
    return Drawing(
        title=model.structure.title,
        environment=title,
        gravity=modes.equilibrium.loads.gravity,
        up=modes.equilibrium.upwards,
        drawn=at,
        rest=at,
        lines=tuple(Strand("member", "line", first, last) for first, last in pairwise(ends)),
        marks=tuple(Mark("node", name, i, (0.0, 0.0, 0.0)) for i, name in enumerate(nodes)),
        motion=_motion(points, measured),
        strain=np.zeros((count, len(lines))),
        number=tuple(range(count)),
        frequency_hz=measured.frequency_hz,
        kind=("measured",) * count,
        name=("measured",) * count,
        alike=(1,) * count,
    )


def _motion(points: Sequence[str], measured: MeasuredModes) -> Float[np.ndarray, "mode point 3"]:
    """Translations of points; directions that were not measured are zero."""
    row = {channel: k for k, channel in enumerate(zip(measured.node, measured.direction, strict=True))}
    shape = real_shapes(measured)
    motion = np.zeros((shape.shape[1], len(points), 3))
    for i, name in enumerate(points):
        for axis, way in enumerate(AXES[:3]):
            if (k := row.get((name, way))) is not None:
                motion[:, i, axis] = shape[k]
    return motion
