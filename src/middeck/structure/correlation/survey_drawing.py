"""Drawing of a survey: the lines that join its nodes, and their motion in each of its modes."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from middeck.structure.correlation.measured_modes import AXES, MeasuredModes, drawn_at, real_shapes
from middeck.structure.correlation.placing import place_channels
from middeck.structure.correlation.survey_lines import Traced, trace_article
from middeck.structure.modes.results.article_drawing import Drawing, Mark, Strand
from middeck.structure.modes.solve import Modes


def build_survey_drawing(modes: Modes, measured: MeasuredModes, title: str = "test") -> Drawing:
    """Measured shapes at the places of the model's nodes, upwards as the model of ``modes`` is.

    Lines are those of the survey (trace lines of a universal file), else the article's between measured nodes
    (`survey_lines`). A complex shape is drawn in the phase in which it is largest. Rotations are not drawn;
    directions that were not measured are zero.

    Raises `ConfigError` for a survey none of whose nodes is in the model.
    """
    model = modes.equilibrium.model
    measured = place_channels(model, measured)
    channels = zip(measured.node, measured.direction, strict=True)
    nodes = tuple(dict.fromkeys(node for node, way in channels if way in AXES))
    traced = _by_trace_lines(nodes, measured) if measured.lines else trace_article(model, nodes)
    row = {name: i for i, name in enumerate(traced.names)}
    on_lines = (row[name] for _, line in traced.lines for name in line)
    points = np.array([*range(len(nodes)), *on_lines], dtype=int)
    at = np.array([drawn_at(model, name) for name in traced.names]).reshape(-1, 3)[points]
    ends = np.cumsum([len(nodes), *(len(line) for _, line in traced.lines)], dtype=int).tolist()
    count = len(measured.frequency_hz)
    return Drawing(
        title=model.structure.title,
        environment=title,
        gravity=modes.equilibrium.loads.gravity,
        up=modes.equilibrium.upwards,
        drawn=at,
        rest=at,
        lines=tuple(
            Strand(what, "line", *both) for (what, _), both in zip(traced.lines, pairwise(ends), strict=True)
        ),
        marks=tuple(Mark("node", name, i, (0.0, 0.0, 0.0)) for i, name in enumerate(nodes)),
        motion=(traced.share @ _motion(nodes, measured))[:, points],
        strain=np.zeros((count, len(traced.lines))),
        number=tuple(range(1, count + 1)),
        frequency_hz=measured.frequency_hz,
        kind=("measured",) * count,
        name=("measured",) * count,
        alike=(1,) * count,
    )


def _by_trace_lines(nodes: Sequence[str], measured: MeasuredModes) -> Traced:
    """The survey's own lines; what was not measured stands still."""
    names = tuple(dict.fromkeys([*nodes, *(name for line in measured.lines for name in line)]))
    lines = tuple(("member", line) for line in measured.lines)
    return Traced(lines, names, np.eye(len(names), len(nodes)))


def _motion(nodes: Sequence[str], measured: MeasuredModes) -> Float[np.ndarray, "mode node 3"]:
    """Translations of nodes; directions that were not measured are zero."""
    row = {channel: k for k, channel in enumerate(zip(measured.node, measured.direction, strict=True))}
    shape = real_shapes(measured)
    motion = np.zeros((shape.shape[1], len(nodes), 3))
    for i, name in enumerate(nodes):
        for axis, way in enumerate(AXES[:3]):
            if (k := row.get((name, way))) is not None:
                motion[:, i, axis] = shape[k]
    return motion
