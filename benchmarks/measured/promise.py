"""The frozen case "Updating and promise": decibels and frontier as promised, and the truth beside them."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import middeck as md
from measured.kept import kept
from measured.rows import miss_row, row
from middeck.campaign.cases import Case
from middeck.control.law.compensator import Compensator
from middeck.control.robust.verification.monte_carlo import which_decay
from middeck.structure.modes.solve import Modes
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.updating.promise.draws import DrawnPlants, draw_plants
from middeck.updating.promise.performance_bound import RobustBound
from middeck.updating.promise.plan import Plan, close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.promise import design_ladder, promise
from middeck.updating.promise.stability_probability import probability_interval

# The frozen case is shared with the tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "truth"))
case = importlib.import_module("promise_case")

SEEDS, DRAWS = 50, 60
LADDERS, ALL_DRAWS = 16, 300
AUTHORITY = 10.0 ** np.array([0.0, 2.0, 4.0, 6.0])
RUNGS = 10.0 ** np.arange(-2.0, 12.01, 0.125)
# A decade is 6 dB here: rungs a quarter apart are 1.5 dB, and "one rung below" was most of the distance.
ALL_RUNGS = 10.0 ** np.arange(-2.0, 6.01, 0.0625)
LEAST_DB = -20.0
# Plants asked of together: a rung that is not stable is known by a few of them.
AT_ONCE = 10
BETWEEN = 8  # rungs looked at for the best
OF_DESIGNS = "authority in the decibels of its law on the model that it was designed on"


class Short(NamedTuple):
    """By how many decibels a promised frontier is below the true one, and what stopping there gives up.

    A rung's authority is said in the decibels that its law reaches on its own model: they grow along the
    ladder, slowly at its end. Those that it reaches on the truth do not: the last stable rung is on the
    brink, and the finer the ladder, the worse it is there. What a promise gives up is against the best rung
    from the promised one to the last.
    """

    below: float  # in decibels of the designs on their own model
    came_apart: float  # the same two rungs, in decibels on the truth
    given_up: float
    decades: float  # of authority, from the promised rung to the true one
    pushed_to: float  # decibels of the ladder's last rung on its own model


class Came(NamedTuple):
    """One compensator: promised levels, what came, and the distance to the bound."""

    median: float
    low: float
    high: float
    cautious: float
    db: float
    above: float


def rows(_: str) -> list[dict[str, Any]]:
    """Fifty truths, four compensators each."""
    start = time.process_time()
    found = [one for seed in range(SEEDS) for one in _compensators(seed)]
    seconds = (time.process_time() - start) / SEEDS
    some = [c for c in found if np.isfinite(c.db) and c.db <= LEAST_DB]
    error = np.array([abs(c.median - c.db) for c in some])
    missed = 100.0 * np.mean([not c.low <= c.db <= c.high for c in some])
    title = f"promise, one axis, linear joints, {len(some)} compensators of {SEEDS} truths"
    return [
        row(title, "|promised median - truth|, median", "dB", np.median(error), 0.2),
        row(title, "the same, largest", "dB", error.max()),
        miss_row(title, "95 % intervals that miss", missed),
        row(title, "pessimism at 99 %, median", "dB", np.median([c.cautious - c.db for c in some]), 0.5),
        row(title, "above the bound of its effort, median", "dB", np.median([c.above for c in some]), 0.3),
        row(title, "the same, largest", "dB", max(c.above for c in some)),
        row(title, f"four by {DRAWS} draws, with refinement and truth", "CPU s", seconds),
    ]  # fmt: skip


def _compensators(seed: int) -> list[Came]:
    refined, asked = case.refined(seed), case.plan(AUTHORITY, DRAWS, bounded=1)
    (found,) = promise(refined, asked).values()
    truth, laws = case.true_plant(seed), design_ladder(case.modes_in_orbit(refined), asked)
    levels = [[o.level_db(share) for share in (0.5, 0.025, 0.975, 0.99)] for o in found.outlooks]
    return [
        Came(*level, case.true_db(truth, law, asked), _above(found.bound[name]))
        for level, (name, law) in zip(levels, laws.items(), strict=True)
    ]


def _above(bound: RobustBound) -> float:
    return bound.worst_db - bound.no_linear_law_below_db


def frontier_rows(options: Any) -> list[dict[str, Any]]:
    """Ladders on the refined model and on the sheet, to authorities at which the truth is unstable."""
    ladders = one_motor_frontiers, all_motors_frontiers
    one, five = (kept(each, LADDERS, options) for each in ladders)
    return [*_frontier_rows("one motor", one), *_frontier_rows("five motors", five)]


def one_motor_frontiers(truth: Case, _: Any) -> list[Short]:
    return _frontiers(truth.index, case.plan(RUNGS, ALL_DRAWS))


def all_motors_frontiers(truth: Case, _: Any) -> list[Short]:
    return _frontiers(truth.index, case.with_all_motors(case.plan(ALL_RUNGS, ALL_DRAWS)))


def _frontier_rows(name: str, of_truths: Sequence[Sequence[Sequence[float]]]) -> list[dict[str, Any]]:
    found = np.array([both for of_truth in of_truths for both in of_truth])
    late, apart, given_up, decades, pushed_to = found[~np.isnan(found[:, 0])].T
    title = f"frontier, {name}, {len(found)} ladders of {LADDERS} truths"
    above = int(np.sum(late < 0.0))
    most = 100.0 * probability_interval(above, len(late), 0.9)[1]
    note = f"{above} of {len(late)}: with 95 % confidence below {most:.0f} %"
    return [
        row(title, "promised above the true one", "%", 100.0 * above / len(late), 2.0, note=note),
        row(title, "promised below the true one, median", "dB", np.median(late), 1.0, note=OF_DESIGNS),
        row(title, "promised below the true one, largest", "dB", late.max(), 3.0),
        row(title, "the same in decades of authority, median", "", np.median(decades)),
        row(title, "the same in decades of authority, largest", "", decades.max()),
        row(title, "decibels that came at the two, apart by, median", "dB", np.median(apart)),
        row(title, "the same, largest", "dB", apart.max()),
        row(title, "given up against the best stable rung, median", "dB", np.median(given_up)),
        row(title, "the same, largest", "dB", given_up.max()),
        row(title, "last rung on its own model, least of the ladders", "dB", pushed_to.max()),
        row(title, "without one rung that is promised", "", len(found) - len(late)),
    ]


def _frontiers(seed: int, asked: Plan) -> list[Short]:
    """Of both ladders."""
    refined = case.refined(seed)
    place = next(iter(asked.environments.values()))
    drawn = draw_plants(
        refined, place, partial(plant_of, asked), draws=asked.draws,
        rng=np.random.default_rng(asked.seed), loop=asked.loop, finish=partial(close_inner, asked),
    ).plants(range(asked.draws))  # fmt: skip
    truth = case.true_plant(seed)
    sheet = md.solve_modes(md.solve_equilibrium(case.sheet()[0], place))
    models = case.modes_in_orbit(refined), sheet
    return [_distance(modes, drawn, truth, asked) for modes in models]


def _distance(modes: Modes, drawn: DrawnPlants, truth: Plant, asked: Plan) -> Short:
    assert asked.ladder is not None
    ladder, count = asked.ladder, len(asked.ladder.authority)
    decade = round(1.0 / np.log10(ladder.authority[1] / ladder.authority[0]))

    @functools.cache
    def rung(k: int) -> Compensator:
        alone = dataclasses.replace(ladder, authority=ladder.authority[k : k + 1])
        return next(iter(design_ladder(modes, dataclasses.replace(asked, ladder=alone)).values()))

    def reached(k: int, plant: Plant) -> float:
        return case.true_db(group_loop(asked, plant, ladder.drives, ladder.reads), rung(k), asked)

    came = functools.cache(partial(reached, plant=truth))
    own = delay_plant(close_inner(asked, plant_of(asked, modes)), asked.loop.delay_s)
    designed = functools.cache(partial(reached, plant=own))

    true = _first_not(lambda k: bool(np.isfinite(came(k))), count, decade) - 1
    worst = [group_loop(asked, plant, ladder.drives, ladder.reads) for plant in drawn.plants]
    said = _first_not(lambda k: _all_stable(rung(k), worst, asked), count, decade) - 1
    last = designed(count - 1)
    for name, k in (("true", true), ("promised", said)):
        at = max(k, 0)
        print(
            f"{name} frontier {k} of {count}: came {came(at):.2f}, designed {designed(at):.2f} dB", flush=True
        )
    if said < 0:
        return Short(np.nan, 0.0, 0.0, 0.0, last)
    if said > true:
        return Short(-1.0, 0.0, 0.0, 0.0, last)
    between = range(said, true + 1, max(1, (true - said) // BETWEEN))
    return Short(
        designed(said) - designed(true),
        abs(came(said) - came(true)),
        came(said) - min(came(k) for k in (*between, true)),
        (true - said) / decade,
        last,
    )


def _first_not(holds: Callable[[int], bool], count: int, stride: int) -> int:
    """Rungs a ``stride`` apart up to the first that does not hold, then between."""
    last = -1
    for k in range(0, count, stride):
        if not holds(k):
            low, high = last, k
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if holds(middle) else (low, middle)
            return high
        last = k
    return count


def _all_stable(law: Compensator, plants: list[Plant], asked: Plan) -> bool:
    """The plant that fails comes first in the list: it is the one to ask next."""
    weights = weights_of(asked, law.outputs, law.inputs)
    for first in range(0, len(plants), AT_ONCE):
        decays = which_decay(plants[first : first + AT_ONCE], law, weights)
        if not decays.all():
            plants.insert(0, plants.pop(first + int(np.argmin(decays))))
            return False
    return True
