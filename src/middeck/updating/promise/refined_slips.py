"""Friction of joints from a refinement, in place of that of a plan."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from middeck.updating.promise.plan import Plan
from middeck.updating.promise.slip import DrawnSlips, JointSlip
from middeck.updating.refinement.refine import Refined, RefinedFriction

FIELDS = ("slip_torque", "slip_angle")


def with_refined(plan: Plan, refined: Refined) -> Plan:
    """The plan, with the refined slip torques and slip angles where an unknown moves them.

    Their tolerances are none: `spread_refined` has what the refinement leaves open.
    """
    joints = list(plan.joints)
    for k, friction, moved in _found(plan.joints, refined):
        changed = {name: float(friction.value[i]) for i, name in enumerate(FIELDS) if moved[i]}
        exact = {f"{name}_tolerance": 0.0 for name in changed}
        joints[k] = dataclasses.replace(joints[k], **changed, **exact)
    return dataclasses.replace(plan, joints=tuple(joints))


def spread_refined(
    slips: DrawnSlips, joints: Sequence[JointSlip], refined: Refined, n: Float[np.ndarray, "draw both"]
) -> DrawnSlips:
    """Drawn sliders of ``joints`` with the refinement's uncertainty, at numbers ``n`` of its root."""
    sizes, drawn = np.array([slips.slip_torque, slips.slip_angle]), slips.drawn.copy()
    for k, friction, moved in _found(joints, refined):
        for i in np.flatnonzero(moved):
            off = n @ friction.root[i]
            sizes[i, :, k] *= np.exp(off)
            drawn[:, i * len(joints) + k] = off / friction.log_std[i]
    return dataclasses.replace(slips, slip_torque=sizes[0], slip_angle=sizes[1], drawn=drawn)


def _found(
    joints: Sequence[JointSlip], refined: Refined
) -> Iterator[tuple[int, RefinedFriction, Bool[np.ndarray, "2"]]]:
    """Joints of a plan, named by their motors, whose friction an unknown moves, and which of its numbers."""
    at = {a.name: a.frame for a in refined.structure.actuators if a.axis is None}
    known = {f.joint: f for f in refined.friction()}
    for k, joint in enumerate(joints):
        friction = known.get(at.get(joint.name, ""))
        if friction is not None and np.any(moved := friction.log_std > 0.0):
            yield k, friction, moved
