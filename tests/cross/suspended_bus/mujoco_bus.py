"""The suspended bus in MuJoCo: rigid slices of tube joined by three slides and three hinges with springs.

Everything is MuJoCo's own: joint springs, tendons to the anchors, gravity, mass matrix. Only the derivative
of its generalised force, Newton's method and the eigensolution are written here. Stiff joint springs are
linear in the joint coordinates and differentiated by hand, so that differences see gravity and tendons
alone.

A chain in which every joint turns in the same order is accurate to first order where the rest state is bent
and twisted, for the order matters at the square of a joint's turn. Here it is reversed from joint to joint,
which makes a pair symmetric, and the chain second order.
"""

from __future__ import annotations

import mujoco
import numpy as np
import scipy.linalg as sla

from . import case

AXES = ("1 0 0", "0 1 0", "0 0 1")


def _slice(length: float, at: float) -> str:
    """A rigid piece of tube around ``at``, in a body of its own without joints."""
    m = case.MASS_PER_LENGTH * length
    polar, transverse = 2.0 * case.RHO_I * length, case.RHO_I * length + m * length**2 / 12.0
    return (
        f'<body pos="{at!r} 0 0"><inertial pos="0 0 0" mass="{m!r}" '
        f'diaginertia="{polar!r} {transverse!r} {transverse!r}"/></body>'
    )


def _rigid(name: str, mass: float, cg: tuple, inertia: tuple) -> str:
    return (
        f'<body><inertial pos="{_row(cg)}" mass="{mass!r}" diaginertia="{_row(inertia)}"/>'
        f'<site name="{name}" pos="0 0 0"/></body>'
    )


def _row(values: tuple) -> str:
    return " ".join(repr(float(v)) for v in values)


def _flexible_joint(h: float, reverse: bool) -> str:
    slides = [
        f'<joint type="slide" axis="{a}" stiffness="{k / h!r}"/>'
        for a, k in zip(AXES, (case.EA, case.KGA, case.KGA), strict=True)
    ]
    hinges = [
        f'<joint type="hinge" axis="{a}" stiffness="{k / h!r}"/>'
        for a, k in zip(AXES, (case.GJ, case.EI, case.EI), strict=True)
    ]
    joints = slides + hinges
    return "".join(joints[::-1] if reverse else joints)


def _chain(side: float, elements: int, end: str) -> str:
    """Half of the tube, from the middle body towards ``side``, with the end body and what it carries."""
    h = 0.5 * case.LENGTH / elements
    text = _slice(0.5 * h, side * 0.25 * h)
    close = ""
    for i in range(elements):
        step = 0.5 * h if i == 0 else h
        text += f'<body pos="{side * step!r} 0 0">' + _flexible_joint(h, reverse=bool(i % 2))
        last = i == elements - 1
        text += _slice(0.5 * h, side * 0.25 * h) if last else _slice(h, side * 0.5 * h)
        close += "</body>"
    return text + f'<body pos="{side * 0.5 * h!r} 0 0">{end}</body>' + close


def _gimbal(angle: float, stiffness: float) -> str:
    joints = "".join(
        f'<joint name="gimbal_{n}" type="hinge" axis="{AXES[k]}" stiffness="{stiffness!r}" '
        f'springref="{angle!r}"/>'
        for n, k in (("x", 0), ("z", 2))
    )
    inertia = f'mass="{case.PAYLOAD_MASS!r}" diaginertia="{_row(case.PAYLOAD_INERTIA)}"'
    return f'<body>{joints}<inertial pos="{_row(case.PAYLOAD_CG)}" {inertia}/></body>'


def build(variant: dict, elements: int) -> mujoco.MjModel:
    """MJCF of the bus with ``elements`` joints in each half of the tube."""
    bodies = [
        _rigid(f"b{i}", case.BODY_MASS[i], case.BODY_CG, case.BODY_INERTIA[i])
        for i in range(len(case.BODY_X))
    ]
    if variant["payload"]:
        stiffness = case.MOTOR_STIFFNESS if variant["motor_springs"] else 0.0
        bodies[case.PAYLOAD_BODY] += _gimbal(variant["angle"], stiffness)
    anchors, tendons = "", ""
    g = case.GRAVITY if variant["gravity"] else 0.0
    for i, (x, k) in enumerate(zip(case.BODY_X, case.SPRING_STIFFNESS, strict=True)):
        if not variant["gravity"]:
            break
        anchors += f'<site name="a{i}" pos="{x!r} {case.ANCHOR_HEIGHT!r} 0"/>'
        tendons += (
            f'<spatial stiffness="{k!r}" springlength="{case.SPRING_FREE_LENGTH!r}">'
            f'<site site="a{i}"/><site site="b{i}"/></spatial>'
        )
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <compiler angle="radian" boundmass="0" boundinertia="0" balanceinertia="false"/>
      <option gravity="0 {-g!r} 0"><flag contact="disable" constraint="disable"/></option>
      <worldbody>{anchors}<body><freejoint/>{bodies[1]}
      {_chain(-1.0, elements, bodies[0])}{_chain(1.0, elements, bodies[2])}</body></worldbody>
      <tendon>{tendons}</tendon></mujoco>""")


class Bus:
    """MuJoCo's generalised force at rest and its derivative."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
        self.stiffness = np.zeros(model.nv)
        self.stiffness[model.jnt_dofadr[single]] = np.reshape(model.jnt_stiffness, (model.njnt, -1))[
            single, 0
        ]
        self.spring_dof = model.jnt_dofadr[single]
        self.spring_pos = model.jnt_qposadr[single]

    def force(self, q: np.ndarray) -> np.ndarray:
        """Gradient of the potential: gravity, tendons and joint springs."""
        data = self.data
        data.qpos[:], data.qvel[:] = q, 0.0
        for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_fwdVelocity):
            step(self.model, data)
        return data.qfrc_bias - data.qfrc_passive

    def mass(self, q: np.ndarray) -> np.ndarray:
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_makeM(self.model, self.data)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def moved(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        q = q.copy()
        mujoco.mj_integratePos(self.model, q, step, 1.0)
        return q

    def _soft(self, q: np.ndarray) -> np.ndarray:
        """The force less that of the joint springs, which is linear."""
        force = self.force(q)
        turn = q[self.spring_pos] - self.model.qpos_spring[self.spring_pos]
        force[self.spring_dof] -= self.stiffness[self.spring_dof] * turn
        return force

    def tangent(self, q: np.ndarray) -> np.ndarray:
        """Derivative of the force: central differences, good to 1e-8 of the weight (h^2 and eps/h)."""
        n, h = self.model.nv, 1e-4
        K = np.zeros((n, n))
        for j in range(n):
            e = np.zeros(n)
            e[j] = h
            K[:, j] = (self._soft(self.moved(q, e)) - self._soft(self.moved(q, -e))) / (2.0 * h)
        return K + np.diag(self.stiffness)

    def rest(self, q: np.ndarray, moving: np.ndarray) -> np.ndarray:
        """Newton's method in the coordinates ``moving``, with steps of at most 0.2."""
        for _ in range(60):
            residual = self.force(q)[moving]
            if np.abs(residual).max() < 1e-10:
                return q
            step = np.zeros(self.model.nv)
            step[moving] = -np.linalg.solve(self.tangent(q)[np.ix_(moving, moving)], residual)
            q = self.moved(q, step * min(1.0, 0.2 / np.abs(step).max()))
            if np.abs(step).max() < 1e-13:
                return q
        raise RuntimeError("no rest state")


def solve(variant: dict, elements: int) -> dict:
    """Lowest frequencies [Hz] of one variant on one mesh, with what the rest state looks like."""
    bus = Bus(build(variant, elements))
    model = bus.model
    q = bus.data.qpos.copy()
    moving = np.arange(model.nv)
    if variant["payload"]:
        axes = [model.joint(n) for n in ("gimbal_x", "gimbal_z")]
        q[[int(a.qposadr[0]) for a in axes]] = variant["angle"]
        if not variant["motor_springs"]:
            moving = np.setdiff1d(moving, [int(a.dofadr[0]) for a in axes])
    if variant["gravity"]:
        q = bus.rest(q, moving)
    K, M = bus.tangent(q), bus.mass(q)
    skewness = np.abs(K - K.T).max()
    K = 0.5 * (K + K.T)
    floating = 0 if variant["gravity"] else case.RIGID_MODES_0G
    shift = 0.0 if variant["gravity"] else 1.0
    mu = sla.eigh(M, K + shift * M, eigvals_only=True)[::-1][floating : floating + case.MODES]
    hz = np.sqrt(1.0 / mu - shift) / (2.0 * np.pi)
    rest = {"force": float(np.abs(bus.force(q)[moving]).max()), "skewness": float(skewness)}
    return {"hz": hz, "rest": rest, "q": q}
