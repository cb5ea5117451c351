"""From the ``[rig]`` and ``[siso]`` tables of a study to the settings of a simulated laboratory."""

import numpy as np

from middeck.files.studies.form import RigForm, SisoForm
from middeck.joints.deadband import Deadband
from middeck.joints.element import JointElement
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro
from middeck.laboratory.rig_settings import LoopTest, RigSettings


def build_rig_settings(form: RigForm) -> RigSettings:
    """The rig of a study file."""
    rotor = Rotor(form.wheel_rotor_inertia_kg_m2, form.wheel_speed_rad_s)
    return RigSettings(
        sample_hz=form.sample_hz,
        delay_s=form.delay_s,
        wheel=_motor(form.wheel_torque_nm, form.wheel_slew_nm_per_s, form.converter_bits, rotor),
        gimbal=_motor(form.gimbal_torque_nm, form.gimbal_slew_nm_per_s, form.converter_bits),
        gimbal_elements=_gimbal_elements(form),
        encoder=Encoder(2.0 * np.pi / form.encoder_counts),
        gyro=Gyro(
            bandwidth_hz=form.gyro_bandwidth_hz,
            noise=form.gyro_noise_rad_per_s_per_rthz,
            bias=abs(form.gyro_bias_rad_s),
            bias_walk=form.gyro_bias_walk_rad_per_s_per_rts,
            anti_alias_hz=form.anti_alias_hz,
            resolution=_count(form.gyro_range_rad_s, form.converter_bits),
            range=form.gyro_range_rad_s,
        ),
        noise_share=form.identification_noise,
        rest_s=form.rest_s,
        modes_hz=form.modes_hz,
        mesh_factor=form.mesh_factor,
        shear=form.shear_coefficient,
        umbilical_hz=form.umbilical_hz,
        hidden_seed=form.hidden_seed,
    )


def _gimbal_elements(form: RigForm) -> tuple[JointElement, ...]:
    """Elements at each gimbal axis beside its motor; none where the form does not define them.

    Friction needs ``gimbal_presliding_deg`` (a study file without it is refused), play
    ``gimbal_deadband_deg`` and ``gimbal_flank_nm_per_rad``.
    """
    elements: list[JointElement] = []
    if form.gimbal_presliding_deg is not None and form.gimbal_friction_nm > 0.0:
        gives = float(np.radians(form.gimbal_presliding_deg))
        stiffness = form.gimbal_friction_nm / gives
        elements.append(Friction(form.gimbal_friction_nm, stiffness, form.gimbal_viscous_nms_per_rad))
    if form.gimbal_deadband_deg is not None and form.gimbal_flank_nm_per_rad is not None:
        gap = float(np.radians(form.gimbal_deadband_deg))
        elements.append(Deadband(gap, form.gimbal_flank_nm_per_rad))
    return tuple(elements)


def build_loop_test(form: SisoForm) -> LoopTest:
    """The experiments of a study file's one loop."""
    return LoopTest(
        actuator=form.actuator,
        band_hz=form.band_hz,
        period_s=form.period_s,
        periods=form.periods,
        open_nm=form.excitation_nm,
        closed_nm=form.closed_excitation_nm,
        pair_shift_hz=form.pair_shift_hz,
    )


def _motor(torque_nm: float, slew: float | None, bits: int, rotor: Rotor | None = None) -> Motor:
    return Motor(
        torque_limit=torque_nm,
        slew_limit=np.inf if slew is None else slew,
        resolution=_count(torque_nm, bits),
        rotor=rotor,
    )


def _count(full: float, bits: int) -> float:
    """One step of a converter from -full to full."""
    return 2.0 * full / 2.0**bits
