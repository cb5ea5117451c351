"""The study of the 1993 paper, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np

from middeck.files.records import load_record
from middeck.files.studies import Study
from middeck.laboratory.article import RigArticle
from middeck.laboratory.article_rig import build_rig_article
from middeck.structure.comparison import ModeComparison
from middeck.study.gravity import find_modes, study_gravity
from middeck.study.gravity_responses import GravityResponses, study_gravity_responses
from middeck.study.measured_control import MeasuredControl, study_measured_control
from middeck.study.mirror import MirrorFit, study_mirror
from middeck.study.two_sensor_control import TwoSensorControl, study_two_sensor_control
from middeck.study.zero_g_control import ZeroGControl, study_zero_g_control

Outcome = ModeComparison | GravityResponses | ZeroGControl | MeasuredControl | TwoSensorControl | MirrorFit
# Share of the whole time, measured; only for the estimate of the remaining time.
STAGES = {
    "figures 4 and 5": 0.02,
    "figure 6": 0.01,
    "figure 7": 0.08,
    "figure 9": 0.39,
    "figures 10 to 12": 0.46,
    "mirror": 0.04,
}

PAPER_MODES = 26  # Figures 4 and 5 show at least these, however few the controllers are designed on


def run_stages(study: Study) -> Iterator[tuple[str, Callable[[], Outcome]]]:
    """Name and computation of each stage, in order; a stage runs when it is called.

    Every stage draws from its own stream of the study's seed, so that none depends on those before it.
    """
    control, figure_6, siso = study.control, study.figure_6, study.siso
    streams = dict(zip(STAGES, np.random.SeedSequence(study.seed).spawn(len(STAGES)), strict=True))
    rng = {name: np.random.default_rng(stream) for name, stream in streams.items()}
    structure, orbit = study.case(control.article, "orbit")
    _, lab = study.case(control.article, "lab")
    comparison = partial(study_gravity, structure, orbit, lab, max(PAPER_MODES, control.modes_kept))
    found: list[ModeComparison] = []

    def gravity() -> ModeComparison:
        found.append(comparison())
        return found[0]

    def responses() -> GravityResponses:
        in_orbit, in_lab = (find_modes(*study.case(figure_6.article, e)) for e in ("orbit", "lab"))
        return study_gravity_responses(
            in_orbit, in_lab, figure_6, study.rig, study.loop_test, rng["figure 6"]
        )

    def zero_g_control() -> ZeroGControl:
        return study_zero_g_control({"orbit": found[0].orbit, "lab": found[0].lab}, control)

    @cache
    def article() -> RigArticle:
        return build_rig_article(*study.case(siso.article, siso.environment), study.rig)

    def measured_control() -> MeasuredControl:
        return study_measured_control(article(), study.rig, study.loop_test, siso, rng["figure 9"])

    def two_sensor_control() -> TwoSensorControl:
        return study_two_sensor_control(
            article(), study.rig, study.loop_test, siso, study.sito, rng["figures 10 to 12"]
        )

    def mirror() -> MirrorFit:
        return study_mirror(load_record(study.train_file), load_record(study.test_file), study.mirror.states)

    runs = (gravity, responses, zero_g_control, measured_control, two_sensor_control, mirror)
    yield from zip(STAGES, runs, strict=True)
