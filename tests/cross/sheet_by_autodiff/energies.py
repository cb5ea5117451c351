"""Potential and kinetic energy of each part of a hanging structure, written once and differentiated by JAX.

No force, no stiffness and no geometric stiffness is written down here: all of them are derivatives of an
energy in small changes (dx, theta) of the poses, with R_new = exp(theta) R, taken at no change.

The beam is Reissner's (1972; Simo 1985): geometrically exact strains, sampled once an element, in a section
half-way between its two ends. A single sample sees bending as constant and lets the element shear instead;
the residual bending flexibility of MacNeal (1978), a shear stiffness of 12 EI / h^2, is what makes it
Bernoulli's beam again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402 (double precision first)
import numpy as np  # noqa: E402

# Five Gauss points on [0, 1]: exact for products of two cubics.
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(5)
POINTS, WEIGHTS = 0.5 * (POINTS + 1.0), 0.5 * WEIGHTS
X_AXIS = np.array([1.0, 0.0, 0.0])


class Section(NamedTuple):
    """An element's length [m], stiffnesses [N, N m^2] and inertias [kg/m, kg m]."""

    length: float
    EA: float
    EI: float
    GJ: float
    rho_A: float
    rho_I: float


class Ends(NamedTuple):
    """Both nodes of an element, and the rigid offsets from them to its ends (node frames)."""

    x_a: Any
    R_a: Any
    x_b: Any
    R_b: Any
    offset_a: Any
    offset_b: Any


class Gimbal(NamedTuple):
    """A stage that turns about the node's x axis, and on it a payload that turns about the stage's z axis."""

    offset: Any
    stage_mass: float
    stage_cg: Any
    stage_inertia: Any
    payload_mass: float
    payload_cg: Any
    payload_inertia: Any


# Rotations ----------------------------------------------------------------------------------------------


def skew(v):
    """The matrix of v x."""
    zero = 0.0 * v[0]
    return jnp.array([[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]])


def small_rotation(theta):
    """exp(theta) by its series, smooth at zero; enough terms for the turns between neighbours (|theta|^8)."""
    s = jnp.dot(theta, theta)
    sine = 1.0 - s / 6.0 + s * s / 120.0 - s**3 / 5040.0
    cosine = 0.5 - s / 24.0 + s * s / 720.0 - s**3 / 40320.0
    K = skew(theta)
    return jnp.eye(3) + sine * K + cosine * K @ K


def small_rotation_vector(R):
    """The rotation vector of a small rotation: asin(x)/x in its series."""
    axial = 0.5 * jnp.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s = jnp.dot(axial, axial)
    return axial * (1.0 + s / 6.0 + 3.0 * s * s / 40.0 + 15.0 * s**3 / 336.0 + 105.0 * s**4 / 3456.0)


def about_x(angle):
    """Rotation about x."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def about_z(angle):
    """Rotation about z."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


# Beams --------------------------------------------------------------------------------------------------


def _cubics(s, h):
    """Hermite's cubics for (position, slope) at either end."""
    return (
        1 - 3 * s**2 + 2 * s**3,
        h * (s - 2 * s**2 + s**3),
        3 * s**2 - 2 * s**3,
        h * (s**3 - s**2),
    )


def _cubic_slopes(s, h):
    return ((-6 * s + 6 * s * s) / h, 1 - 4 * s + 3 * s * s, (6 * s - 6 * s * s) / h, 3 * s * s - 2 * s)


def beam_energy(change, ends: Ends, section: Section, gravity):
    """Strain energy, and the weight at heights of the Hermite curve through both ends (y is up)."""
    h, EI = section.length, section.EI
    R_a = small_rotation(change[3:6]) @ ends.R_a
    R_b = small_rotation(change[9:12]) @ ends.R_b
    a = ends.x_a + change[0:3] + R_a @ ends.offset_a
    b = ends.x_b + change[6:9] + R_b @ ends.offset_b
    turn = small_rotation_vector(R_a.T @ R_b)
    middle = R_a @ small_rotation(turn / 2.0)
    stretch = middle.T @ (b - a) / h - X_AXIS
    bend = turn / h
    density = section.EA * stretch[0] ** 2 + 12.0 * EI / h**2 * (stretch[1] ** 2 + stretch[2] ** 2)
    density += section.GJ * bend[0] ** 2 + EI * (bend[1] ** 2 + bend[2] ** 2)
    energy = h / 2.0 * density
    for s, weight in zip(POINTS, WEIGHTS, strict=True):
        N = _cubics(s, h)
        height = N[0] * a[1] + N[1] * R_a[1, 0] + N[2] * b[1] + N[3] * R_b[1, 0]
        energy += gravity * section.rho_A * h * weight * height
    return energy


def beam_mass(ends: Ends, section: Section):
    """Quadratic form of the kinetic energy in (v, omega) of both nodes; rotary and polar inertia included."""
    h = section.length
    middle = ends.R_a @ small_rotation(small_rotation_vector(ends.R_a.T @ ends.R_b) / 2.0)
    axis = middle[:, 0]
    along = jnp.outer(axis, axis)
    across = jnp.eye(3) - along
    zero, one = jnp.zeros((3, 3)), jnp.eye(3)
    v_a = jnp.hstack([one, -skew(ends.R_a @ ends.offset_a), zero, zero])
    v_b = jnp.hstack([zero, zero, one, -skew(ends.R_b @ ends.offset_b)])
    omega_a, omega_b = jnp.hstack([zero, one, zero, zero]), jnp.hstack([zero, zero, zero, one])
    slope_a, slope_b = -skew(axis) @ omega_a, -skew(axis) @ omega_b  # omega x axis
    M = jnp.zeros((12, 12))
    for s, weight in zip(POINTS, WEIGHTS, strict=True):
        N, D = _cubics(s, h), _cubic_slopes(s, h)
        v = along @ ((1 - s) * v_a + s * v_b)
        v += across @ (N[0] * v_a + N[1] * slope_a + N[2] * v_b + N[3] * slope_b)
        tilt = across @ (D[0] * v_a + D[1] * slope_a + D[2] * v_b + D[3] * slope_b)
        spin = along @ ((1 - s) * omega_a + s * omega_b)
        rotary = section.rho_I * tilt.T @ tilt + 2.0 * section.rho_I * spin.T @ spin
        M = M + h * weight * (section.rho_A * v.T @ v + rotary)
    return M


# Bodies, gimbals, cables --------------------------------------------------------------------------------


def body_weight(change, x, R, mass, cg, gravity):
    """m g h of a body whose centre of mass stands off its node."""
    return mass * gravity * (x + change[:3] + small_rotation(change[3:6]) @ R @ cg)[1]


def gimbal_weight(change, x, R, angle, gimbal: Gimbal, gravity):
    """m g h of stage and payload; ``change`` ends in the two joint angles."""
    stage, payload = _centres(change, x, R, angle, gimbal)
    return gravity * (gimbal.stage_mass * stage[1] + gimbal.payload_mass * payload[1])


def _centres(change, x, R, angle, gimbal: Gimbal):
    R_node = small_rotation(change[3:6]) @ R
    R_stage = R_node @ about_x(angle[0] + change[6])
    R_payload = R_stage @ about_z(angle[1] + change[7])
    crossing = x + change[:3] + R_node @ gimbal.offset
    return crossing + R_stage @ gimbal.stage_cg, crossing + R_payload @ gimbal.payload_cg


def gimbal_mass(x, R, angle, gimbal: Gimbal):
    """Quadratic form of the kinetic energy in (v, omega) of the node and the two joint rates."""
    J_stage, J_payload = jax.jacfwd(lambda change: _centres(change, x, R, angle, gimbal))(jnp.zeros(8))
    R_stage = R @ about_x(angle[0])
    R_payload = R_stage @ about_z(angle[1])
    zero, none = jnp.zeros((3, 1)), jnp.zeros((3, 3))
    omega_stage = jnp.hstack([none, jnp.eye(3), (R @ X_AXIS)[:, None], zero])
    omega_payload = jnp.hstack([none, jnp.eye(3), (R @ X_AXIS)[:, None], R_stage[:, 2][:, None]])
    I_stage = R_stage @ jnp.diag(gimbal.stage_inertia) @ R_stage.T
    I_payload = R_payload @ jnp.diag(gimbal.payload_inertia) @ R_payload.T
    return (
        gimbal.stage_mass * J_stage.T @ J_stage
        + gimbal.payload_mass * J_payload.T @ J_payload
        + omega_stage.T @ I_stage @ omega_stage
        + omega_payload.T @ I_payload @ omega_payload
    )


def attach_point(change, x, R, offset):
    """Where a point fixed to a node is."""
    return x + change[:3] + small_rotation(change[3:6]) @ R @ offset


def cable_energy(change, x, R, offset, anchor, preload, stiffness, length):
    """Energy of a device that pulls with its preload at the cable's nominal length."""
    stretch = jnp.linalg.norm(anchor - attach_point(change, x, R, offset)) - length
    return preload * stretch + 0.5 * stiffness * stretch**2


def at_no_change(energy: Callable[..., Any], size: int) -> Callable[..., tuple[Any, Any, Any]]:
    """Value, gradient and Hessian of ``energy`` in its first argument, of ``size`` entries, at zero."""

    def evaluate(*state):
        zero = jnp.zeros(size)
        return energy(zero, *state), jax.grad(energy)(zero, *state), jax.hessian(energy)(zero, *state)

    return evaluate


beams = jax.jit(jax.vmap(at_no_change(beam_energy, 12), in_axes=(0, None, None)))
beam_masses = jax.jit(jax.vmap(beam_mass, in_axes=(0, None)))
body = jax.jit(at_no_change(body_weight, 6))
gimbal_state = jax.jit(at_no_change(gimbal_weight, 8))
gimbal_inertia = jax.jit(gimbal_mass)
cable = jax.jit(at_no_change(cable_energy, 6))


@jax.jit
def attach(x, R, offset):
    """An attach point with its Jacobian and its Hessian in the node's six changes."""
    zero = jnp.zeros(6)
    return (
        attach_point(zero, x, R, offset),
        jax.jacfwd(attach_point)(zero, x, R, offset),
        jax.hessian(attach_point)(zero, x, R, offset),
    )
