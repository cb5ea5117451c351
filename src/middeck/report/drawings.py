"""Which figures a stage gives, and the one sentence that each is there to say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from middeck.plot.figure_3 import figure_3
from middeck.plot.figure_4 import figure_4
from middeck.plot.figure_5 import figure_5
from middeck.plot.figure_6 import figure_6a, figure_6b
from middeck.plot.figure_7 import figure_7a, figure_7b
from middeck.plot.figure_9a import figure_9a
from middeck.plot.figure_9b import figure_9b
from middeck.plot.figure_10 import figure_10a, figure_10b
from middeck.plot.figure_11 import figure_11
from middeck.plot.figure_12 import figure_12a, figure_12b
from middeck.plot.mirror import mirror
from middeck.plot.svg import svg_text
from middeck.report import sentences
from middeck.report.words import Numbers
from middeck.structure.comparison import ModeComparison
from middeck.study.gravity_responses import GravityResponses
from middeck.study.measured_control import MeasuredControl
from middeck.study.mirror import MirrorFit
from middeck.study.stages import Outcome
from middeck.study.two_sensor_control import TwoSensorControl
from middeck.study.zero_g_control import ZeroGControl


class Drawing(NamedTuple):
    """A figure: its key in file names and links, its title, how it is drawn and what it shows."""

    key: str
    title: str | Callable[[Numbers], str]
    draw: Callable[[Any], Figure]
    sentence: Callable[[Numbers], str]

    def heading(self, figures: Numbers) -> str:
        """The title, which for some figures names what was measured."""
        return self.title if isinstance(self.title, str) else self.title(figures)


DRAWINGS: dict[type[Outcome], tuple[Drawing, ...]] = {
    ModeComparison: (
        Drawing("figure-3", "Figure 3: the article in 0-g and hung in 1-g", figure_3, sentences.figure_3),
        Drawing("figure-4", "Figure 4: eigenfrequencies and eigenratios", figure_4, sentences.figure_4),
        Drawing(
            "figure-5", "Figure 5: cross-orthogonality of 0-g and 1-g modes", figure_5, sentences.figure_5
        ),
    ),
    GravityResponses: (
        Drawing("figure-6a", sentences.title_6a, figure_6a, sentences.figure_6a),
        Drawing("figure-6b", sentences.title_6b, figure_6b, sentences.figure_6b),
    ),
    ZeroGControl: (
        Drawing("figure-7a", "Figure 7a: performance against authority", figure_7a, sentences.figure_7a),
        Drawing("figure-7b", "Figure 7b: the flexible modes alone", figure_7b, sentences.figure_7b),
    ),
    MeasuredControl: (
        Drawing("figure-9a", "Figure 9a: measured response and fit", figure_9a, sentences.figure_9a),
        Drawing("figure-9b", "Figure 9b: open and closed loops", figure_9b, sentences.figure_9b),
    ),
    TwoSensorControl: (
        Drawing("figure-10a", sentences.title_10a, figure_10a, sentences.figure_10a),
        Drawing("figure-10b", sentences.title_10b, figure_10b, sentences.figure_10b),
        Drawing("figure-11", "Figure 11: payload held by encoder and bus", figure_11, sentences.figure_11),
        Drawing("figure-12a", "Figure 12a: payload under both penalties", figure_12a, sentences.figure_12a),
        Drawing("figure-12b", "Figure 12b: bus under both penalties", figure_12b, sentences.figure_12b),
    ),
    MirrorFit: (Drawing("mirror", "A real steering mirror, measured and fitted", mirror, sentences.mirror),),
}


def draw_stage(outcome: Outcome, figures: Numbers) -> dict[str, str]:
    """Key to SVG text of every figure of one stage; ``figures`` are the stage's own numbers."""
    return {
        d.key: svg_text(d.draw(outcome), key=d.key, title=d.heading(figures), description=d.sentence(figures))
        for d in DRAWINGS[type(outcome)]
    }
