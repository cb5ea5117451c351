"""Plan of a promise: the environments, loops, disturbance and noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import ConfigError
from middeck.signals.ports import Port, once
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.systems.plants.dispersed_frequencies import Dispersion
from middeck.systems.plants.plant import Plant, group_ports, select_ports
from middeck.updating.promise.draws import LoopSpread
from middeck.updating.promise.slip import JointSlip
from middeck.values import record


@record(kw_only=True)
class Ladder:
    """Compensators designed on the refined article itself, of rising authority.

    Attributes:
        drives, reads: Actuators and sensors of the designs.
        authority: 1/rho of the cost E[z' W^2 z + rho u'u].
    """

    drives: tuple[str, ...]
    reads: tuple[str, ...]
    authority: Float[np.ndarray, " level"]

    def __post_init__(self) -> None:
        if not (np.all(np.isfinite(self.authority)) and np.all(np.diff(self.authority, prepend=0.0) > 0.0)):
            raise ConfigError(
                f"authorities of {', '.join(f'{a:g}' for a in self.authority)}",
                where="ladder",
                hint="positive, rising",
            )


@record(kw_only=True)
class Plan:
    """Plan of the promise for a refined article.

    Attributes:
        environments: Environments by name; the first is that of the designs.
        performance: Sensors whose weighted rms is promised, and their weights.
        disturbances: Actuators at which white noise acts, and its two-sided intensity [unit/sqrt(Hz)].
        band_hz: Band in which disturbances act and the rms counts; None for all frequencies.
        noise: Noise of readings, by their unit [unit/sqrt(Hz)].
        inner: Loops without delay that are closed on every plant before all else.
        modes: Kept in each plant.
        draws, seed: 299 draws that are all stable promise 99 %.
        probability: Probability of stability required of the highest authority.
        bounded: Draws on which the bound is computed.
        joints: Joints with dry friction; the others are linear. Their viscous drag is in every plant.
        sweep: Shifts of the refined article's flexible modes on which every compensator is tried too.
    """

    environments: Mapping[str, Environment]
    performance: tuple[str, ...]
    weights: Float[np.ndarray, " z"]
    disturbances: tuple[str, ...]
    intensity: Float[np.ndarray, " w"]
    noise: Mapping[str, float]
    band_hz: tuple[float, float] | None = None
    inner: PDLoops | None = None
    loop: LoopSpread = dataclasses.field(default_factory=LoopSpread)
    modes: int = 26
    draws: int = 300
    seed: int = 0
    probability: float = 0.99
    bounded: int = 10
    laws: Mapping[str, Compensator] = dataclasses.field(default_factory=dict[str, Compensator])
    ladder: Ladder | None = None
    joints: tuple[JointSlip, ...] = ()
    sweep: Dispersion = dataclasses.field(default_factory=Dispersion)

    def __post_init__(self) -> None:
        if not self.environments or not (self.laws or self.ladder):
            what = "environment" if not self.environments else "compensator"
            raise ConfigError(f"no {what}", where="promise", hint="at least one")
        if self.band_hz is not None and not 0.0 <= self.band_hz[0] < self.band_hz[1] < np.inf:
            raise ConfigError(f"a band of {self.band_hz} Hz", where="promise", hint="0 <= low < high")
        for what, given, names in (
            ("weights", self.weights, self.performance),
            ("intensities", self.intensity, self.disturbances),
        ):
            if len(given) != len(names) or not names:
                raise ConfigError(
                    f"{len(given)} {what} for {len(names)} ports", where="promise", hint="one for each"
                )
            if not np.all(np.isfinite(given)) or np.any(given < 0.0) or not np.any(given):
                raise ConfigError(
                    f"{what} of {', '.join(f'{x:g}' for x in given)}",
                    where="promise",
                    hint="zero or positive, and not all zero",
                )


def plant_of(plan: Plan, modes: Modes) -> Plant:
    """The article's plant in modal form, with every port that the plan needs; inner loops still open."""
    loops = () if plan.inner is None else plan.inner.names
    laws = tuple(plan.laws.values())
    drives = [p.name for law in laws for p in law.outputs]
    reads = [p.name for law in laws for p in law.inputs]
    if plan.ladder is not None:
        drives, reads = [*drives, *plan.ladder.drives], [*reads, *plan.ladder.reads]
    rub = [joint.name for joint in plan.joints]
    inner = [name for loop in (*loops, *rub) for name in (loop, f"{loop}{RATE}")]
    return build_plant(
        modes,
        inputs=once(*plan.disturbances, *drives, *loops, *rub),
        outputs=once(*plan.performance, *reads, *inner),
        count=plan.modes,
        w=plan.disturbances,
        z=plan.performance,
    )


def close_inner(plan: Plan, plant: Plant) -> Plant:
    """``plant`` with the plan's inner loops and the viscous drag of its joints."""
    drag = PDLoops(
        tuple(j.name for j in plan.joints),
        np.zeros(len(plan.joints)),
        np.array([j.viscous for j in plan.joints]),
    )
    for loops in (plan.inner, drag):
        if loops is not None and loops.names:
            plant = close_inner_loop(plant, loops)
    return plant


def group_loop(plan: Plan, plant: Plant, drives: Sequence[str], reads: Sequence[str]) -> Plant:
    """``plant`` between disturbances and performance and a compensator's ports: only these are delayed."""
    ports = select_ports(plant, once(*plan.disturbances, *drives), once(*plan.performance, *reads))
    return group_ports(ports, w=plan.disturbances, u=drives, z=plan.performance, y=reads)


def weights_of(plan: Plan, drives: Sequence[Port], reads: Sequence[Port]) -> LQGWeights:
    """Performance, disturbance and noise of a loop between these ports.

    Raises `ConfigError` for a reading in a unit whose noise the plan does not state.
    """
    unknown = [p for p in reads if p.unit not in plan.noise]
    if unknown:
        raise ConfigError(
            f"{unknown[0].name} reads {unknown[0].unit}, and the plan states no noise in that unit",
            where="promise",
            hint=f"noise is stated for {', '.join(plan.noise) or 'nothing'}",
        )
    return LQGWeights(
        output=plan.weights,
        input=np.ones(len(drives)),
        disturbed=plan.disturbances,
        process=np.diag(plan.intensity**2),
        sensor=np.array([plan.noise[p.unit] ** 2 for p in reads]),
    )
