"""Friction and play of the gimbals, from the settings of a study's rig."""

from __future__ import annotations

import numpy as np

from middeck.files.study_form import RigForm
from middeck.systems.deadband import Deadband
from middeck.systems.friction import Friction
from middeck.systems.joint_element import JointElement


def build_gimbal_elements(rig: RigForm, *, preload_nm: float = 0.0) -> tuple[JointElement, ...]:
    """What acts at each gimbal axis beside its motor; nothing where the rig does not say how.

    Friction needs ``gimbal_presliding_deg`` (a study file without it is refused), play
    ``gimbal_deadband_deg`` and ``gimbal_flank_nm_per_rad``.
    ``preload_nm`` is the torque that presses the gear on its flank, e.g. the axis's holding torque in the
    laboratory where no motor takes it.
    """
    elements: list[JointElement] = []
    if rig.gimbal_presliding_deg is not None and rig.gimbal_friction_nm > 0.0:
        gives = float(np.radians(rig.gimbal_presliding_deg))
        stiffness = rig.gimbal_friction_nm / gives
        elements.append(Friction(rig.gimbal_friction_nm, stiffness, rig.gimbal_viscous_nms_per_rad))
    if rig.gimbal_deadband_deg is not None and rig.gimbal_flank_nm_per_rad is not None:
        gap = float(np.radians(rig.gimbal_deadband_deg))
        elements.append(Deadband(gap, rig.gimbal_flank_nm_per_rad, preload_nm))
    return tuple(elements)
