"""Allowed shift of each mode before the loop becomes unstable, mode by mode and in both directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, form_loop, split_unmoved
from middeck.control.analysis.stability.stability import (
    LoopStability,
    decide_loop,
    find_roots,
    judge_roots,
    loop_poles,
    require_known,
)
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.control.law.rounding_of_results import measure_known
from middeck.errors import ConfigError
from middeck.systems.plants.mode_blocks import part_modes
from middeck.systems.plants.mode_shift import natural_hz, shift_modes
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import none_grows
from middeck.values import record

STEP, RESOLUTION = 0.0025, 1e-8  # relative changes of a frequency


@record(kw_only=True)
class AllowedShift:
    """Relative shifts of one mode's frequency at which the loop first becomes unstable.

    Attributes:
        mode: Its name.
        down, up: Negative and positive; -``inf`` and ``inf`` where the loop is stable up to ``most``, both
            zero where it is unstable without a shift.
        down_hz, up_hz: Frequency of the pole that reaches the axis; 0 where none does.
    """

    mode: str
    down: float
    up: float
    down_hz: float
    up_hz: float


@named_kinds
def find_allowed_shifts(
    plant: Plant, compensator: Compensator, *, modes: Sequence[str] | None = None, most: float = 0.2
) -> tuple[AllowedShift, ...]:
    """Smallest destabilising shift of each mode alone, damping ratio kept, delays exact.

    A sampled compensator meets the shifted plant sampled anew, hold and delays exact: modes beyond half the
    rate count too.

    Marches outwards in steps of 0.25 % up to ``most`` with eigenvalues (delays by an approximation of high
    order), then bisects with exact delays. Unstable intervals narrower than a step may be stepped over.

    Args:
        modes: None: all oscillating modes that are controllable or observable. Modes of a state space without
            ``state_names`` are named by number and frequency (`part_modes`).

    Raises `ConfigError` for modes that do not exist or do not oscillate (`shift_modes`), or ``most`` not
    between 0 and 1; `NumericalError` where modes without names nearly coincide (`part_modes`), and where
    stability cannot be decided (`decide_stability`). Warns (`UserWarning`) where rounding of the matrices
    makes a shift uncertain (`measure_known`).
    """
    if not 0.0 < most < 1.0:
        raise ConfigError(f"most = {most:g}", hint="0 < most < 1")

    def find(some: Plant, law: Compensator) -> tuple[AllowedShift, ...]:
        return _find(some, law, modes if some is plant else _renamed(some, modes), most)

    def numbers(found: tuple[AllowedShift, ...]) -> Float[np.ndarray, " number"]:
        ends = np.abs([end for one in found for end in (one.down, one.up)])
        return np.log(np.minimum(ends, most))  # beyond, none is sought

    return measure_known("allowed shifts", find, numbers, plant, compensator)


def _renamed(plant: Plant, modes: Sequence[str] | None) -> Sequence[str] | None:
    """The modes of a plant whose entries were moved: names by number and frequency have its frequencies."""
    if modes is None:
        return None
    by_number = {name.partition(",")[0]: name for name in _oscillating(_named(plant))}
    return [by_number.get(name.partition(",")[0], name) for name in modes] if not plant.state_names else modes


def _find(
    plant: Plant, compensator: Compensator, modes: Sequence[str] | None, most: float
) -> tuple[AllowedShift, ...]:
    loop = form_loop(plant, compensator)
    require_known(loop, split_unmoved(loop)[0])
    plant = _named(plant)
    names = _oscillating(plant) if modes is None else tuple(modes)
    return tuple(
        _allowed(mode, lambda x, mode=mode: shift_modes(plant, {mode: 1.0 + x}), compensator, most)
        for mode in names
    )


def _named(plant: Plant) -> Plant:
    """The plant itself where its modes have names, else in blocks of its own modes."""
    named = plant.modal or plant.state_names
    return plant if named else part_modes(plant)


def _oscillating(plant: Plant) -> tuple[str, ...]:
    return tuple(natural_hz(partition_modes(plant).active))


def _allowed(mode: str, plant_at: Callable[[float], Plant], law: Compensator, most: float) -> AllowedShift:
    if not decide_loop(form_loop(plant_at(0.0), law)).stable:
        return AllowedShift(mode=mode, down=0.0, up=0.0, down_hz=0.0, up_hz=0.0)
    ends = [_first(plant_at, law, sign, most) for sign in (-1.0, 1.0)]
    return AllowedShift(mode=mode, down=ends[0][0], up=ends[1][0], down_hz=ends[0][1], up_hz=ends[1][1])


def _first(
    plant_at: Callable[[float], Plant], law: Compensator, sign: float, most: float
) -> tuple[float, float]:
    """The first unstable shift in one direction, and the frequency of the pole."""
    low = 0.0
    for high in np.append(np.arange(STEP, most, STEP), most):
        loop = form_loop(plant_at(sign * float(high)), law)
        if not none_grows(loop_poles(loop), loop.period_s) and not _judged(loop).stable:
            break
        low = float(high)
    else:
        return sign * np.inf, 0.0
    return _bisect(plant_at, law, sign, (low, float(high)))


def _bisect(
    plant_at: Callable[[float], Plant], law: Compensator, sign: float, bracket: tuple[float, float]
) -> tuple[float, float]:
    low, high = bracket
    found = _judged(form_loop(plant_at(sign * high), law))
    while high - low > RESOLUTION:
        middle = 0.5 * (low + high)
        outcome = _judged(form_loop(plant_at(sign * middle), law))
        if outcome.stable:
            low = middle
        else:
            high, found = middle, outcome
    return sign * high, found.frequency_hz


def _judged(loop: FeedbackLoop) -> LoopStability:
    """With rounding left out: beside the axis it leaves every loop open, and `measure_known` asks of it."""
    return judge_roots(find_roots(loop, known=True), loop.period_s)
