"""The hardware rig of an article: motors, sensors and bearings as a study's ``[rig]`` states them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.files.study_form import RigForm
from middeck.realtime.drift import Drift, age_plant
from middeck.realtime.hardware_rig import HardwareRig, build_hardware_rig
from middeck.realtime.motors import Motor, Rotor
from middeck.realtime.sensors import Encoder, Gyro, Sensor
from middeck.structure.article import Actuator, JointState, Structure
from middeck.structure.environment import Environment
from middeck.structure.equilibrium import Equilibrium
from middeck.study.gimbal_elements import build_gimbal_elements
from middeck.study.hidden_errors import draw_hidden_errors
from middeck.study.rig_article import RigArticle, rig_article_plant, solve_rig_article
from middeck.systems.joint_simulation import JointElements


def build_rig_article(structure: Structure, environment: Environment, form: RigForm) -> RigArticle:
    """The truth of a study's rig in one environment: finer, in shear, and wrong by ``hidden_seed``."""
    hidden = None if form.hidden_seed is None else draw_hidden_errors(structure, form.hidden_seed)
    return solve_rig_article(
        structure, environment, hidden, mesh_factor=form.mesh_factor, shear=form.shear_coefficient,
        umbilical_hz=form.umbilical_hz,
    )  # fmt: skip


def build_article_rig(
    article: RigArticle,
    form: RigForm,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    drifts: Sequence[Drift] = (),
    age_s: float = 0.0,
    drifting: bool = False,
    steps: int = 1,
) -> HardwareRig:
    """The rig of ``article`` between torque commands at ``inputs`` and samples of the angles ``outputs``.

    Every free gimbal axis has friction and play if the form says how, commanded or not. A torque on a node is
    a wheel's, at a joint a gimbal's motor's, which also holds the payload; a joint angle is an encoder's, an
    inertial one an integrated gyro's. ``drifts`` have gone on for ``age_s`` when it is switched on; then they
    halt or, ``drifting``, go on. Raises `ConfigError` as `build_hardware_rig`, for an unknown port, and where
    a motor cannot hold its payload.
    """
    equilibrium = article.equilibrium
    structure = equilibrium.model.structure
    elements = build_gimbal_elements(form)
    rubs = [a.name for a in _gimbal_motors(structure)] if elements else []
    plant = rig_article_plant(
        article, inputs=_once(*inputs, *rubs), outputs=_once(*outputs, *rubs), to_hz=form.modes_hz
    )
    hidden = article.hidden
    gains = {} if hidden is None else dict(hidden.gain)
    return build_hardware_rig(
        plant if drifting else age_plant(plant, drifts, age_s),
        motors={name: _motor(equilibrium, name, form) for name in inputs},
        sensors={name: _sensor(structure, name, form, gains.get(name, 1.0)) for name in outputs},
        sample_hz=form.sample_hz,
        delay_s=rig_delay(article, form),
        joints=[JointElements(name, name, elements) for name in rubs],
        steps=steps,
        drifts=drifts if drifting else (),
        age_s=age_s,
    )


def rig_delay(article: RigArticle, form: RigForm) -> float:
    """Total delay of the rig [s]: what the form says, and what is wrong with that."""
    return form.delay_s + (0.0 if article.hidden is None else article.hidden.delay_s)


def _once(*names: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


def _gimbal_motors(structure: Structure) -> list[Actuator]:
    """Motors of free axes whose angle is also a sensor of the same name."""
    free = {j.name for j in structure.joints if j.state is JointState.FREE and not j.slides}
    angles = {s.name for s in structure.sensors if s.axis is None}
    return [a for a in structure.actuators if a.axis is None and a.frame in free and a.name in angles]


def _motor(equilibrium: Equilibrium, name: str, form: RigForm) -> Motor:
    structure = equilibrium.model.structure
    known = {a.name: a for a in structure.actuators}
    if name not in known:
        raise ConfigError(f"no actuator {name!r}", hint=f"one of {', '.join(known)}")
    full, slew = form.gimbal_torque_nm, form.gimbal_slew_nm_per_s
    rotor, holding = None, 0.0
    if known[name].axis is None:
        at = [j.name for j in structure.joints].index(known[name].frame)
        holding = float(equilibrium.holding_torque[at])
    else:
        full, slew = form.wheel_torque_nm, form.wheel_slew_nm_per_s
        rotor = Rotor(form.wheel_rotor_inertia_kg_m2, form.wheel_speed_rad_s)
    return Motor(full, holding, np.inf if slew is None else slew, _resolution(full, form), rotor)


def _sensor(structure: Structure, name: str, form: RigForm, gain: float) -> Sensor:
    known = {s.name: s for s in structure.sensors}
    if name not in known:
        raise ConfigError(f"no sensor {name!r}", hint=f"one of {', '.join(known)}")
    if known[name].axis is None:
        return Encoder(2.0 * np.pi / form.encoder_counts, gain)
    return Gyro(
        bandwidth_hz=form.gyro_bandwidth_hz,
        noise=form.gyro_noise_rad_per_s_per_rthz,
        bias=abs(form.gyro_bias_rad_s),
        bias_walk=form.gyro_bias_walk_rad_per_s_per_rts,
        anti_alias_hz=form.anti_alias_hz,
        resolution=_resolution(form.gyro_range_rad_s, form),
        range=form.gyro_range_rad_s,
        gain=gain,
    )


def _resolution(full: float, form: RigForm) -> float:
    """One step of a converter from -full to full."""
    return 2.0 * full / 2.0**form.converter_bits
