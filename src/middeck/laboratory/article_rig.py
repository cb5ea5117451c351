"""The rig of an article: its motors, sensors and bearings by the settings."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.friction import Friction
from middeck.laboratory.hidden_errors import draw_hidden_errors
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Sensor
from middeck.laboratory.rig.plant.drifting_modes import Drift, age_plant
from middeck.laboratory.rig.rig import Rig, build_rig
from middeck.laboratory.rig_settings import RigSettings
from middeck.laboratory.tested_article import RigArticle, rig_article_plant, solve_rig_article
from middeck.signals.ports import once
from middeck.structure.model.article import Actuator, JointState, SensorKind, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.systems.plants.plant import Plant, delay_plant


def build_rig_article(structure: Structure, environment: Environment, settings: RigSettings) -> RigArticle:
    """The true article of a rig in one environment: finer mesh, shear, hidden errors by ``hidden_seed``."""
    seed = settings.hidden_seed
    hidden = None if seed is None else draw_hidden_errors(structure, seed)
    return solve_rig_article(
        structure, environment, hidden, mesh_factor=settings.mesh_factor, shear=settings.shear,
        umbilical_hz=settings.umbilical_hz,
    )  # fmt: skip


def build_article_rig(
    article: RigArticle,
    settings: RigSettings,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    drifts: Sequence[Drift] = (),
    age_s: float = 0.0,
    drifting: bool = False,
    inner: PDLoops | None = None,
) -> Rig:
    """The rig of ``article`` between torque commands at ``inputs`` and samples of ``outputs``.

    Outputs are angles, and rates ``<angle>_rate``: a gyro's own samples, at a joint a like tachometer's.
    Every free gimbal axis has the settings' friction and play, commanded or not. A torque on a node is
    a wheel's, at a joint a gimbal's motor's, which also holds the payload; a joint angle is an encoder's, an
    inertial one an integrated gyro's. ``inner`` are analogue loops that hold it without delay, through
    sensors with their errors of gain. ``drifts`` have gone on for ``age_s`` when it is switched on; then they
    halt or, ``drifting``, go on. Raises `ConfigError` as `build_rig`, for an unknown port, and where
    a motor cannot hold its payload.
    """
    equilibrium = article.equilibrium
    structure = equilibrium.model.structure
    elements = settings.gimbal_elements
    rubs = [a.name for a in _gimbal_motors(structure)] if elements else []
    plant = held_plant(article, settings, once(*inputs, *rubs), once(*outputs, *rubs), inner)
    gains = _gains(article)
    return build_rig(
        plant if drifting else age_plant(plant, drifts, age_s),
        motors={name: _motor(equilibrium, name, settings) for name in inputs},
        sensors={name: _sensor(structure, name, settings, gains) for name in outputs},
        sample_hz=settings.sample_hz,
        delay_s=rig_delay(article, settings),
        joints=[JointElements(name, name, elements) for name in rubs],
        drifts=drifts if drifting else (),
        age_s=age_s,
    )


def held_plant(
    article: RigArticle,
    settings: RigSettings,
    inputs: Sequence[str],
    outputs: Sequence[str],
    inner: PDLoops | None,
) -> Plant:
    """The article between ideal ``inputs`` and ``outputs``, held by its analogue loops."""
    if inner is None:
        return rig_article_plant(article, inputs=inputs, outputs=outputs, to_hz=settings.modes_hz)
    rates = [f"{name}{RATE}" for name in inner.names]
    plant = rig_article_plant(
        article,
        inputs=once(*inputs, *inner.names),
        outputs=once(*outputs, *inner.names, *rates),
        to_hz=settings.modes_hz,
    )
    gain = np.array([_gains(article).get(name, 1.0) for name in inner.names])
    return close_inner_loop(plant, PDLoops(inner.names, gain * inner.kp, gain * inner.kd))


def linear_plant(
    article: RigArticle,
    settings: RigSettings,
    inputs: Sequence[str],
    outputs: Sequence[str],
    inner: PDLoops | None,
) -> Plant:
    """`held_plant` with the drag of its bearings and the rig's delay: all linear parts of the rig."""
    rubs = tuple(a.name for a in _gimbal_motors(article.equilibrium.model.structure))
    drag = sum(e.viscous for e in settings.gimbal_elements if isinstance(e, Friction))
    ports = once(*inputs, *rubs), once(*outputs, *rubs, *(f"{name}{RATE}" for name in rubs))
    plant = held_plant(article, settings, *ports, inner)
    turning = close_inner_loop(plant, PDLoops(rubs, np.zeros(len(rubs)), np.full(len(rubs), drag)))
    return delay_plant(turning, rig_delay(article, settings))


def _gains(article: RigArticle) -> dict[str, float]:
    """Errors of gain of its sensors, by name; those that are not named have none."""
    return {} if article.hidden is None else dict(article.hidden.gain)


def rig_delay(article: RigArticle, settings: RigSettings) -> float:
    """Total delay of the rig [s]: that of the settings, and its hidden error."""
    return settings.delay_s + (0.0 if article.hidden is None else article.hidden.delay_s)


def _gimbal_motors(structure: Structure) -> list[Actuator]:
    """Motors of free axes whose angle is also a sensor of the same name."""
    free = {j.name for j in structure.joints if j.state is JointState.FREE and not j.slides}
    angles = {s.name for s in structure.sensors if s.axis is None}
    return [a for a in structure.actuators if a.axis is None and a.frame in free and a.name in angles]


def _motor(equilibrium: Equilibrium, name: str, settings: RigSettings) -> Motor:
    structure = equilibrium.model.structure
    known = {a.name: a for a in structure.actuators}
    if name not in known:
        raise ConfigError(f"no actuator {name!r}", hint=f"one of {', '.join(known)}")
    if known[name].axis is not None:
        return settings.wheel
    at = [j.name for j in structure.joints].index(known[name].frame)
    return dataclasses.replace(settings.gimbal, holding=float(equilibrium.holding_torque[at]))


def _sensor(structure: Structure, name: str, settings: RigSettings, gains: Mapping[str, float]) -> Sensor:
    gain = gains.get(name.removesuffix(RATE), 1.0)
    known = {s.name: s for s in structure.sensors}
    own = known.get(name, known.get(name.removesuffix(RATE)))
    if own is None:
        raise ConfigError(f"no sensor {name!r}", hint=f"one of {', '.join(known)}")
    if own.kind is SensorKind.DISPLACEMENT:
        what = f"sensor {own.name!r} reads a displacement, and the rig has gyros and encoders alone"
        raise ConfigError(what, hint="leave it out of the rig; plants and their designs have it")
    if name not in known:
        return dataclasses.replace(settings.gyro, gain=gain, summed=False)
    return dataclasses.replace(settings.encoder if own.axis is None else settings.gyro, gain=gain)
