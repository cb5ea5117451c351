"""A promise's draws in blocks: each is measured independently, in any order and any process."""

from __future__ import annotations

import dataclasses
import functools
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.monte_carlo import noise_on, uncontrolled_rms
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.updating.orbit.predicted_frequencies import Prediction
from middeck.updating.promise.draws import DrawnPlants, PlantDraws
from middeck.updating.promise.plan import Plan, group_loop, weights_of
from middeck.updating.promise.refined_slips import spread_refined
from middeck.updating.promise.slip import draw_slips
from middeck.updating.promise.slip_run import Slipped, SlipRun, run_slips, set_run
from middeck.updating.promise.stability_probability import LoopNoise
from middeck.values import record

BLOCK = 25
"""Draws in a block: its loops are evaluated together, and an interrupted campaign loses no more."""


@record(kw_only=True)
class Site:
    """Values shared by the draws of one environment: ``predicted`` modes, what is drawn, and compensators."""

    plan: Plan
    title: str
    predicted: Prediction
    drawing: PlantDraws
    laws: Mapping[str, Compensator]

    @functools.cached_property
    def run(self) -> SlipRun | None:
        """Settings of the simulation of joint friction; None where the plan states none."""
        plan = self.plan
        if not plan.joints:
            return None
        slips = draw_slips(plan.joints, plan.draws, np.random.default_rng([plan.seed, len(plan.joints)]))
        slips = spread_refined(slips, plan.joints, self.drawing.refined, self.drawing.n)
        return set_run(self.drawing.plants(range(1)).plants[0], self.laws, slips, plan)


@record(kw_only=True)
class Measured:
    """Some draws, in their order.

    Attributes:
        drawn: Plants with all ports, and what was drawn for each.
        alone: Rms of the performance without a compensator.
        noise: Results under noise, by compensator.
        slipped: Results with friction, by compensator (None: without one); empty where the plan states none.
        warned: Warnings of `noise_on`.
    """

    drawn: DrawnPlants
    alone: Float[np.ndarray, " draw"]
    noise: Mapping[str, LoopNoise]
    slipped: Mapping[str | None, Slipped]
    warned: tuple[str, ...] = ()


def blocks(plan: Plan) -> int:
    """Number of blocks of an environment's draws."""
    return -(-plan.draws // BLOCK)


def measure_block(site: Site, number: int) -> Measured:
    """Block ``number`` of the draws: plants, and every compensator on each of them."""
    plan, which = site.plan, range(number * BLOCK, min((number + 1) * BLOCK, site.plan.draws))
    drawn = site.drawing.plants(which)
    noise: dict[str, LoopNoise] = {}
    alone = np.zeros(0)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        for name, law in site.laws.items():
            seen, weights = seen_by(law, drawn, plan)
            if not noise:  # ports do not matter without a compensator
                alone = uncontrolled_rms(seen.plants, weights, plan.band_hz)
            noise[name] = LoopNoise(*noise_on(seen.plants, law, weights, plan.band_hz))
    return Measured(
        drawn=drawn,
        alone=alone,
        noise=noise,
        slipped={} if site.run is None else run_slips(site.run, drawn.plants, which.start),
        warned=tuple(f"draws {which.start} to {which.stop - 1}: {w.message}" for w in warned),
    )


def join_blocks(site: Site, parts: Sequence[Measured]) -> Measured:
    """All draws but for their friction, with the warnings of each block.

    Raises `ConfigError` where the performance has no finite rms without a compensator.
    """
    for text in (text for part in parts for text in part.warned):
        warnings.warn(text, stacklevel=2)
    alone = np.concatenate([part.alone for part in parts])
    if not np.all(np.isfinite(alone)):
        raise ConfigError(
            "without a compensator the performance has no finite rms: a mode that it sees does not decay",
            where=f"promise in {site.title}",
            hint="inner loops that hold the article; decibels are relative to the rms with them alone",
        )
    drawn = DrawnPlants(
        tuple(plant for part in parts for plant in part.drawn.plants),
        parts[0].drawn.names,
        np.concatenate([part.drawn.drawn for part in parts]),
    )
    noise = {
        name: LoopNoise(*(np.concatenate(x) for x in zip(*(p.noise[name] for p in parts), strict=True)))
        for name in site.laws
    }
    return Measured(drawn=drawn, alone=alone, noise=noise, slipped={})


def seen_by(law: Compensator, drawn: DrawnPlants, plan: Plan) -> tuple[DrawnPlants, LQGWeights]:
    """The plants between the ports of this loop alone, grouped for it, and its weights."""
    u, y = (tuple(p.name for p in side) for side in (law.outputs, law.inputs))
    plants = tuple(group_loop(plan, plant, u, y) for plant in drawn.plants)
    return dataclasses.replace(drawn, plants=plants), weights_of(plan, law.outputs, law.inputs)


def values_of(measured: Measured) -> dict[str, Any]:
    """``measured`` as a ledger holds it, at full precision; without ports, which all plants share."""
    return {
        "plants": [
            {
                "dynamics": {f.name: getattr(p.dynamics, f.name) for f in dataclasses.fields(p.dynamics)},
                "state_names": p.state_names,
                "delay_s": p.delay_s,
            }
            for p in measured.drawn.plants
        ],
        "drawn": measured.drawn.drawn,
        "alone": measured.alone,
        "noise": [list(noise) for noise in measured.noise.values()],
        "slipped": [
            {f.name: getattr(one, f.name) for f in dataclasses.fields(one)}
            for one in measured.slipped.values()
        ],
        "warned": measured.warned,
    }


def restore_block(values: Mapping[str, Any], site: Site) -> Measured:
    """The block of which `values_of` made ``values``."""
    names = (None, *site.laws) if site.plan.joints else ()
    slipped = [Slipped(**one) for one in values["slipped"]]
    plants = tuple(_plant(v, site.drawing.like) for v in values["plants"])
    return Measured(
        drawn=DrawnPlants(plants, site.drawing.names, values["drawn"]),
        alone=values["alone"],
        noise={name: LoopNoise(*noise) for name, noise in zip(site.laws, values["noise"], strict=True)},
        slipped=dict(zip(names, slipped, strict=True)),
        warned=tuple(values["warned"]),
    )


def _plant(values: Mapping[str, Any], like: Plant) -> Plant:
    own: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values["dynamics"].items()}
    return dataclasses.replace(
        like,
        dynamics=dataclasses.replace(like.dynamics, **own),
        state_names=tuple(values["state_names"]),
        delay_s=values["delay_s"],
    )
