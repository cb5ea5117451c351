"""Plants on which a compensator is tried: articles in environments, fitted models, shifted modes."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.cli.given.design_plants import issue_warnings
from middeck.cli.given.typed_article import solve_case
from middeck.cli.options import TypedPlants, TypedSetup, typed
from middeck.cli.shown.file_of_an_error import reading
from middeck.control.analysis.shifts.shifts import find_allowed_shifts
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.control.qualification import align_plant, qualify_compensator, sampled_forms
from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import PROMISE, looks_like
from middeck.files.measured.models import load_model
from middeck.files.promises.promise_plants import PromisedPlants, load_promised_plants
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.plants.measured_plant import measured_plant
from middeck.structure.modes.results.dispersed_modes import dispersed_modes
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plants.dispersed_frequencies import DispersedModes, dispersed_factors
from middeck.systems.plants.mode_shift import natural_hz, shift_modes
from middeck.systems.plants.plant import (
    Plant,
    delay_plant,
    group_ports,
    name_states,
    select_ports,
)
from middeck.values import record

Law = Compensator
# As far as a shift to instability is looked for.
MOST = 0.2
FOR_ARTICLES = ("overrides", "load_case", "environments", "count")


@record
class Gathered:
    """Plants by name.

    Attributes:
        hold_unknown: Plants of models that do not say whether the inputs of their data were held.
        dispersed: Modes of articles that a sweep shifts.
        promises: Promises whose plants are there.
    """

    plants: dict[str, Plant]
    hold_unknown: tuple[str, ...]
    dispersed: dict[str, DispersedModes]
    promises: tuple[PromisedPlants, ...]


def gather_plants(tried: TypedPlants, law: Law) -> Gathered:
    """Each article in each environment (``lab`` by default), model and promised plant, all with the delay."""
    unused = [option for name in FOR_ARTICLES if (option := typed(name))]
    if unused and all(s.lower().endswith(".json") for s in tried.plants):
        raise ConfigError(
            f"{unused[0]} is for articles and environments", hint="name an article, or leave it out"
        )
    found: dict[str, Plant] = {}
    unknown: list[str] = []
    dispersed: dict[str, DispersedModes] = {}
    promises: list[PromisedPlants] = []
    taken: set[str] = set()
    for source in tried.plants:
        if looks_like(source) == PROMISE:
            promises.append(load_promised_plants(source))
            name = _new_name(source, taken)
            for draw, plant in promises[-1].plants.items():
                found[f"{name}: {draw}"] = delay_plant(_model(source, plant, law), tried.delay_s)
            continue
        if source.lower().endswith(".json"):
            name, model = _new_name(source, taken), load_model(source)
            found[name] = delay_plant(_model(source, model, law), tried.delay_s)
            unknown += [name] if model.hold_s is None else []
            continue
        for environment in tried.environments or ("lab",):
            name = _new_name(source, taken, environment)
            case = TypedSetup(source, environment, tried.overrides, tried.load_case)
            modes, plant = _article(case, law, tried.count)
            found[name] = delay_plant(plant, tried.delay_s)
            dispersed[name] = dispersed_modes(modes, tried.count)
    return Gathered(found, tuple(unknown), dispersed, tuple(promises))


def _new_name(source: str, taken: set[str], environment: str = "") -> str:
    """A short name, or the whole one where that is ``taken``; raises `ConfigError` where that is too."""
    short, whole = Path(source).stem, source
    if environment:
        short, whole = f"{short} in {Path(environment).stem}", f"{source} in {environment}"
    if {short, whole} <= taken:
        raise ConfigError(f"{whole} is given again", where="PLANT", hint="each once")
    name = whole if short in taken else short
    taken.add(name)
    return name


def _article(case: TypedSetup, law: Law, count: int) -> tuple[Modes, Plant]:
    modes = solve_case(case, count, standstill=True)
    issue_warnings(modes)
    structure = modes.equilibrium.model.structure
    u, y = (tuple(port.name for port in side) for side in (law.outputs, law.inputs))
    with reading(case.article):
        _require_ports(u, [a.name for a in structure.actuators], "drives", "the article has no such actuator")
        sensors = [s.name for s in structure.sensors]
        _require_ports(
            [name.removesuffix("_rate") for name in y], sensors, "reads", "the article has no such sensor"
        )
        return modes, build_plant(modes, inputs=u, outputs=y, count=count, w=u, u=u, z=y, y=y)


def _require_ports(wanted: Sequence[str], there: Sequence[str], verb: str, lacks: str) -> None:
    missing = [name for name in wanted if name not in there]
    if missing:
        raise ConfigError(
            f"the compensator {verb} {', '.join(missing)}; {lacks}",
            hint=f"a plant with it; this one has {', '.join(there)}",
        )


def _model(source: str, model: MeasurementModel | Plant, law: Law) -> Plant:
    u, y = (tuple(port.name for port in side) for side in (law.outputs, law.inputs))
    with reading(source):
        _require_ports(u, [p.name for p in model.inputs], "drives", "the model has no such input")
        _require_ports(y, [p.name for p in model.outputs], "reads", "the model has no such output")
        if isinstance(model, Plant):
            return group_ports(select_ports(model, u, y), w=u, u=u, z=y, y=y)
        return measured_plant(model, w=u, u=u, z=y, y=y)


def also_held(gathered: Gathered, law: Law, delay_s: float) -> Gathered:
    """Also each model that may have been held at the rate of ``law``, with half a period less delay.

    The sampled loop adds that half period, which is then among its delays already; what is not known is tried
    both ways. ``delay_s`` is what was added to the delays.
    """
    half_s = 0.5 * law.sampled.period_s
    held = {
        f"{name}, if held": delay_plant(gathered.plants[name], -half_s)
        for name in gathered.hold_unknown
        if np.min(gathered.plants[name].delay_s) - delay_s >= half_s
    }
    return dataclasses.replace(gathered, plants=gathered.plants | held)


def promised_hold_warnings(gathered: Gathered, rates_hz: Sequence[float]) -> list[str]:
    """Warning for promised plants whose delays, those of the plan, may include a hold that a rate adds."""
    delays_s = [float(plant.delay_s.min()) for one in gathered.promises for plant in one.plants.values()]
    return [
        f"promised plants, {rate:g} Hz: their delays (from {1e3 * min(delays_s):.4g} ms, the plan's delay_s) "
        f"count in full, and sample and hold add {500.0 / rate:g} ms; where the plan includes a hold take "
        "that off"
        for rate in rates_hz
        if delays_s and min(delays_s) >= 0.5 / rate
    ]


def hold_warnings(
    gathered: Gathered, law: Law, weights: LQGWeights, rates_hz: Sequence[float], delay_s: float
) -> list[str]:
    """Warning for each model whose delays may include a hold, which a rate would count twice.

    ``delay_s`` is what was added to the delays of the models.
    """
    found = promised_hold_warnings(
        gathered, [1.0 / form.sampled.period_s for form in sampled_forms(law, rates_hz)]
    )
    for name in gathered.hold_unknown:
        for form in sampled_forms(law, rates_hz):
            with reading(name):
                found.append(_held_or_not(name, gathered.plants[name], form, weights, delay_s))
    return found


def _held_or_not(name: str, plant: Plant, law: Compensator, weights: LQGWeights, delay_s: float) -> str:
    period_s = law.sampled.period_s
    rate, half_s = f"{1.0 / period_s:g} Hz", 0.5 * period_s
    assumed = (
        f"{name}, {rate}: the model does not state whether its inputs were held from sample to sample; "
        "assumed: not held (middeck identify --held or --not-held)"
    )
    if np.min(plant.delay_s) - delay_s < half_s:
        return f"{assumed}; a delay is less than half a period, so they were not held at this rate"
    (row,) = qualify_compensator(law, {name: delay_plant(plant, -half_s)}, weights)
    if not row.stable:
        return f"{assumed}; had they been held at this rate, half a period less would make it unstable"
    gain = min((loop.gain_db for loop in row.loops), default=np.inf)
    phase = min((np.degrees(loop.phase_limit_rad) for loop in row.loops), default=np.inf)
    return (
        f"{assumed}; had they been held at this rate, the row would have half a period of delay less: "
        f"stable, gain {gain:.2f} dB, phase {phase:.1f} deg, {row.db:.2f} dB"
    )


def shifted_plants(plants: Mapping[str, Plant], shifts: Sequence[tuple[str, float]]) -> dict[str, Plant]:
    """Each plant as it is, then each shift alone, down and up: modes by `chosen_modes`, and per cent."""
    found: dict[str, Plant] = {}
    for name, plant in plants.items():
        found[name] = plant
        for modes, percent in shifts:
            with reading(name):
                moved = chosen_modes(plant, modes)
                for sign in (-1.0, 1.0):
                    by = sign * percent
                    moved_plant = shift_modes(plant, dict.fromkeys(moved, 1.0 + 0.01 * by))
                    found[f"{name}, {modes} {by:+g} %"] = moved_plant
    return found


def allowed_shifts(plants: Mapping[str, Plant], law: Law) -> list[dict[str, Any]]:
    """Allowed shift of each mode of each plant before the continuous loop is unstable, in per cent.

    Raises `ConfigError` for a sampled compensator.
    """
    if law.period_s is not None:
        raise ConfigError(
            "--limits is for a continuous compensator", hint="--shift MODES PERCENT, one by one"
        )
    found: list[dict[str, Any]] = []
    for name, plant in plants.items():
        with reading(name):
            shifts = find_allowed_shifts(plant, law, most=MOST)
        found += [
            {
                "plant": name,
                "mode": shift.mode,
                "down_percent": 100.0 * shift.down if np.isfinite(shift.down) else None,
                "up_percent": 100.0 * shift.up if np.isfinite(shift.up) else None,
                "down_hz": shift.down_hz if np.isfinite(shift.down) else None,
                "up_hz": shift.up_hz if np.isfinite(shift.up) else None,
            }
            for shift in shifts
        ]
    return found


def chosen_modes(plant: Plant, text: str) -> tuple[str, ...]:
    """Modes by their names, or those that oscillate within a band such as "7:10" Hz.

    Raises `ConfigError` where there is none.
    """
    names = name_states(plant)
    low, colon, high = text.partition(":")
    try:
        band = (float(low), float(high)) if colon else None
    except ValueError:
        band = None
    if band is None:
        return tuple(name.strip() for name in text.split(","))
    hz = natural_hz(plant)
    within = tuple(name for name in dict.fromkeys(names) if band[0] <= hz.get(name, -1.0) <= band[1])
    if not within:
        there = ", ".join(f"{name} {f:.4g} Hz" for name, f in hz.items())
        raise ConfigError(f"no mode between {band[0]:g} and {band[1]:g} Hz", hint=f"there are {there}")
    return within


def all_plants(gathered: Gathered, law: Law, tried: TypedPlants) -> dict[str, Plant]:
    """The plants as they are, with the shifts of ``--shift``, and in the cases of ``--sweep``.

    Raises `ConfigError` for ``--first-bending`` without a sweep.
    """
    plants = shifted_plants(gathered.plants, tried.shifts)
    if tried.sweep:
        return plants | swept_plants(gathered, law, tried.first_bending)
    if tried.first_bending is not None:
        raise ConfigError("--first-bending is for a sweep", hint="--sweep beside it")
    return plants


def swept_plants(gathered: Gathered, law: Law, first_bending: str | None) -> dict[str, Plant]:
    """Each plant in every case of the default robustness sweep (`dispersed_factors`).

    ``first_bending`` names the modes of the first bending, as `chosen_modes`; None takes those of an article.
    Modes that the compensator neither moves nor reads are not shifted. Raises `ConfigError` for a fitted
    model without it.
    """
    found: dict[str, Plant] = {}
    for name, plant in gathered.plants.items():
        with reading(name):
            moved = set(name_states(align_plant(plant, law)))
            modes = _dispersed(plant, gathered.dispersed.get(name), first_bending)
            modes = DispersedModes(
                first_bending=tuple(n for n in modes.first_bending if n in moved),
                others=tuple(n for n in modes.others if n in moved),
            )
            for title, factors in dispersed_factors(modes).items():
                found[f"{name}, {title}"] = shift_modes(plant, factors)
    return found


def _dispersed(plant: Plant, known: DispersedModes | None, first_bending: str | None) -> DispersedModes:
    if first_bending is None and known is not None:
        return known
    hz = natural_hz(plant)
    if first_bending is None:
        raise ConfigError(
            "a fitted model or promised plant does not say which of its modes is the first bending",
            hint=f"--first-bending MODES; there are {', '.join(f'{n} {f:.4g} Hz' for n, f in hz.items())}",
        )
    first = chosen_modes(plant, first_bending)
    names = tuple(hz) if known is None else (*known.first_bending, *known.others)
    return DispersedModes(first_bending=first, others=tuple(name for name in names if name not in first))
