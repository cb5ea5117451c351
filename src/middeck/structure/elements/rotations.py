"""Rotations as matrices; increments as rotation vectors in the world frame: R_new = exp(theta) R."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Inexact

IDENTITY = np.eye(3)
IDENTITY.setflags(write=False)
# The letter that follows each of x, y, z, and the one before it.
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
# The letter at each place of a cross-product matrix, and its sign.
OTHER = np.array([[0, 2, 1], [2, 0, 0], [1, 0, 0]])
SIGN = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])


def skew(v: Inexact[np.ndarray, "*batch 3"]) -> Inexact[np.ndarray, "*batch 3 3"]:
    """Cross-product matrices: skew(v) @ a = v x a.

    >>> (skew(np.array([1.0, 2.0, 3.0])) @ np.array([0.0, 0.0, 1.0])).tolist()
    [2.0, -1.0, 0.0]
    """
    v = np.asarray(v)
    return v.take(OTHER, -1) * SIGN


def cross(
    a: Inexact[np.ndarray, "*batch 3"], b: Inexact[np.ndarray, "*batch 3"]
) -> Inexact[np.ndarray, "*batch 3"]:
    """a x b along the last axis: `numpy.cross` less its search for the axis, which costs thrice the product.

    >>> cross(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])).tolist()
    [0.0, 0.0, 1.0]
    """
    return a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)


def rotation_exp(theta: Inexact[np.ndarray, "*batch 3"]) -> Inexact[np.ndarray, "*batch 3 3"]:
    """Rotation matrices of rotation vectors [rad] (Rodrigues); analytic in theta.

    >>> np.round(rotation_exp(np.array([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0], 12).tolist()
    [0.0, 1.0, 0.0]
    """
    return IDENTITY + turn_of(theta)


def turn_of(theta: Inexact[np.ndarray, "*batch 3"]) -> Inexact[np.ndarray, "*batch 3 3"]:
    """Rotation matrices less the identity, accurate for small rotations too.

    >>> float(turn_of(np.array([0.0, 0.0, 1e-30]))[1, 0])
    1e-30
    """
    theta = np.asarray(theta)
    angle = np.sqrt(np.sum(theta * theta, axis=-1))[..., None, None]
    S = skew(theta)
    # np.sinc(x) = sin(pi x)/(pi x): exact at zero angle, no branch.
    return np.sinc(angle / np.pi) * S + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * (S @ S)


def rotation_log(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Rotation vector [rad] of a rotation matrix; the angle lies in [0, pi).

    >>> np.round(rotation_log(rotation_exp(np.array([0.1, -0.2, 0.3]))), 12).tolist()
    [0.1, -0.2, 0.3]
    """
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axial))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)))
    return axial if sine == 0.0 else axial * (angle / sine)


def symmetric_double_cross(
    a: Inexact[np.ndarray, "*batch 3"], b: Inexact[np.ndarray, "*batch 3"]
) -> Inexact[np.ndarray, "*batch 3 3"]:
    """Hessian in theta of a . (exp(theta) b) at theta = 0: (a b' + b a')/2 - (a . b) I."""
    outer = a[..., :, None] * b[..., None, :]
    dot = np.sum(a * b, axis=-1)[..., None, None]
    return 0.5 * (outer + np.swapaxes(outer, -1, -2)) - dot * IDENTITY
