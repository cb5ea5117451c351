"""From the ``[promise]`` table of a study to a ground test and the plan of a promise."""

from collections.abc import Sequence

import numpy as np

from middeck.control.law.pd_loops import PDLoops
from middeck.files.studies.promise_table import PromiseForm
from middeck.identification.friction.find import JointFriction
from middeck.laboratory.modal_test import ModalTest
from middeck.structure.model.environment import Environment
from middeck.updating.promise.draws import LoopSpread
from middeck.updating.promise.plan import Ladder, Plan
from middeck.updating.promise.slip import JointSlip


def build_modal_test(form: PromiseForm) -> ModalTest:
    """The modal test of the table."""
    return ModalTest(
        inputs=form.inputs,
        outputs=form.outputs,
        torque_nm=np.array(form.torque_nm),
        weaker=form.weaker,
        band_hz=form.band_hz,
        period_s=form.period_s,
        periods=form.periods,
    )


def build_plan(
    form: PromiseForm, orbit: Environment, found: Sequence[JointFriction], *, delay_s: float, seed: int
) -> Plan:
    """The plan for the refined article in ``orbit``: one loop under a disturbance at its motor.

    Its joints have the friction that the ground tests ``found``.
    """
    low, high = form.loop_band_hz
    return Plan(
        environments={"orbit": orbit},
        performance=(form.sensor,),
        weights=np.ones(1),
        disturbances=(form.actuator,),
        intensity=np.array([form.disturbance_nm / np.sqrt(2.0 * (high - low))]),
        noise={"rad": form.angle_noise_rad_per_rthz},
        band_hz=form.loop_band_hz,
        inner=PDLoops(form.pd_loops, np.array(form.pd_kp_nm_per_rad), np.array(form.pd_kd_nms_per_rad)),
        loop=LoopSpread(
            delay_s=delay_s,
            delay_tolerance_s=form.delay_tolerance_s,
            gain_tolerance=form.gain_tolerance,
            umbilical_hz=form.umbilical_hz,
        ),
        modes=form.modes_kept,
        draws=form.draws,
        seed=seed,
        bounded=1,
        ladder=Ladder(
            drives=(form.actuator,), reads=(form.sensor,), authority=10.0 ** np.array(form.log10_authority)
        ),
        joints=tuple(_slips(name, k, form, found) for k, name in enumerate(form.joints)),
    )


def _slips(name: str, k: int, form: PromiseForm, found: Sequence[JointFriction]) -> JointSlip:
    """The mean of all tests; a record says little of drag beside damping, a data sheet does."""
    return JointSlip(
        name=name,
        slip_torque=float(np.mean([one.slip_torque[k] for one in found])),
        slip_angle=float(np.mean([one.slip_angle[k] for one in found])),
        viscous=form.drag_nms_per_rad,
        slip_torque_tolerance=form.slip_tolerance,
        slip_angle_tolerance=form.slip_tolerance,
    )
