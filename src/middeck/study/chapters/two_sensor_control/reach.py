"""The authority of a design on the rig up to the first unstable mode."""

from collections.abc import Callable, Mapping

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.laboratory.loop_stability import RigView, fastest_pole, judge_loops
from middeck.study.measured_loop.computation import DesignCase, predicted_db
from middeck.systems.poles.stability import GROWTH_LIMIT
from middeck.values import record

LEVELS = np.arange(0.0, 4.51, 0.25)  # log10 authority

Design = Callable[[float], Compensator]


@record(kw_only=True)
class LoopReach:
    """Limit of a design on the rig, with the pair of modes unchanged and shifted to either side.

    Attributes:
        what, states: The design, and the states of the fit it was made on.
        log10_authority, predicted_db: Those of the last level that is stable on all; None where the lowest is
            not.
        least_db: The least improvement among them at that level, by the rig's own linear loop.
        stopped_hz, stopped_percent: Frequency of the fastest growing pole at the next level, and the shift
            there; None where no level is stopped.
    """

    what: str
    states: int
    log10_authority: float | None
    predicted_db: float | None
    least_db: float | None
    stopped_hz: float | None
    stopped_percent: float | None


def find_reach(what: str, design: Design, case: DesignCase, views: Mapping[float, RigView]) -> LoopReach:
    """Raise the authority level by level until a loop of the ``views`` is unstable."""
    states = case.model.states
    last: tuple[float, Compensator] | None = None
    for level in LEVELS:
        compensator = design(10.0 ** float(level))
        poles = {percent: fastest_pole(view, compensator) for percent, view in views.items()}
        worst = max(poles, key=lambda percent: poles[percent].real)
        if poles[worst].real > GROWTH_LIMIT:
            held = _held(last, case, views)
            stopped_hz = abs(poles[worst].imag) / (2.0 * np.pi)
            return LoopReach(what=what, states=states, **held, stopped_hz=stopped_hz, stopped_percent=worst)
        last = float(level), compensator
    held = _held(last, case, views)
    return LoopReach(what=what, states=states, **held, stopped_hz=None, stopped_percent=None)


def find_level(design: Design, case: DesignCase, improvement_db: float) -> float:
    """The lowest level that predicts the improvement, or else the level that predicts most."""
    found = {float(level): predicted_db(case, design(10.0 ** float(level))) or 0.0 for level in LEVELS}
    enough = (level for level, db in found.items() if db <= -improvement_db)
    return next(enough, min(found, key=lambda level: found[level]))


def _held(
    last: tuple[float, Compensator] | None, case: DesignCase, views: Mapping[float, RigView]
) -> dict[str, float | None]:
    if last is None:
        return dict.fromkeys(("log10_authority", "predicted_db", "least_db"))
    level, compensator = last
    improvements = (loop.improvement_db for loop in judge_loops(views, compensator))
    return {
        "log10_authority": level,
        "predicted_db": predicted_db(case, compensator),
        "least_db": max(db for db in improvements if db is not None),
    }
