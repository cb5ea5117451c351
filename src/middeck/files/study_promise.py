"""The table ``[promise]`` of a study: ground tests, what they refine, what is promised for orbit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from middeck.control.law.classical import PDLoops
from middeck.files.form import Finite, Form, NotNegative, Positive, whole, within
from middeck.files.refinements import UnknownForm, build_unknown
from middeck.identification.friction import JointFriction
from middeck.laboratory.modal_test import ModalTest
from middeck.structure.model.environment import Environment
from middeck.updating.draws import LoopSpread
from middeck.updating.plan import Ladder, Plan
from middeck.updating.slip import JointSlip
from middeck.updating.unknowns import Unknown

Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
Band = Annotated[tuple[Positive, Positive], Field(strict=False)]
Authority = Annotated[float, within(least=-12.0, most=12.0)]


class SetUpForm(Form):
    """One set-up of the ground test; ``set`` is what it set, by the names of parameters."""

    name: str
    set: dict[str, Finite] = Field(default_factory=dict)


class PromiseForm(Form):
    """Test on the ground, refine, take gravity out, promise one loop, and fly it."""

    article: str
    environment: str
    hidden_seed: Annotated[int, whole(0, 2**63 - 1)]
    inputs: Names
    outputs: Names
    joints: Names
    drag_nms_per_rad: NotNegative
    slip_tolerance: Annotated[float, within(least=0.0, below=1.0)]
    torque_nm: Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]
    weaker: Annotated[float, within(above=0.0, below=1.0)]
    band_hz: Band
    period_s: Positive
    periods: Annotated[int, whole(2, 1000)]
    states: Annotated[tuple[Annotated[int, whole(2, 1000)], ...], Field(strict=False, min_length=1)]
    gain_std: Annotated[float, within(least=0.0, below=1.0)]
    test: Annotated[tuple[SetUpForm, ...], Field(strict=False, min_length=1)]
    unknown: Annotated[tuple[UnknownForm, ...], Field(strict=False, min_length=1)]
    actuator: str
    sensor: str
    disturbance_nm: Positive
    loop_band_hz: Band
    angle_noise_rad_per_rthz: Positive
    delay_tolerance_s: NotNegative
    gain_tolerance: Annotated[float, within(least=0.0, below=1.0)]
    pd_loops: Names
    pd_kp_nm_per_rad: Annotated[tuple[NotNegative, ...], Field(strict=False, min_length=1)]
    pd_kd_nms_per_rad: Annotated[tuple[NotNegative, ...], Field(strict=False, min_length=1)]
    modes_kept: Annotated[int, whole(7, 10000)]
    draws: Annotated[int, whole(2, 1000000)]
    log10_authority: Annotated[tuple[Authority, ...], Field(strict=False, min_length=1)]
    flight_period_s: Positive
    flight_periods: Annotated[int, whole(2, 1000)]
    flight_states: Annotated[int, whole(2, 1000)]
    ground_log10_authority: Authority


def build_modal_test(form: PromiseForm) -> ModalTest:
    """The ground test."""
    return ModalTest(
        inputs=form.inputs,
        outputs=form.outputs,
        torque_nm=np.array(form.torque_nm),
        weaker=form.weaker,
        band_hz=form.band_hz,
        period_s=form.period_s,
        periods=form.periods,
    )


def build_unknowns(form: PromiseForm) -> tuple[Unknown, ...]:
    """What of the article may differ."""
    return tuple(build_unknown(u) for u in form.unknown)


def build_plan(
    form: PromiseForm, orbit: Environment, found: Sequence[JointFriction], *, delay_s: float, seed: int
) -> Plan:
    """What is promised of the refined article in ``orbit``: one loop under a disturbance at its motor.

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
            delay_s=delay_s, delay_tolerance_s=form.delay_tolerance_s, gain_tolerance=form.gain_tolerance
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
