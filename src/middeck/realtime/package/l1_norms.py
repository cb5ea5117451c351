"""The largest that each signal of a stable sampled system can become: its l1 norm."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.errors import NumericalError
from middeck.systems.state_space.balancing import balance

BLOCK = 64
TAIL = 0.02
"""What of the series may be bounded instead of summed."""
MOST = 1 << 13
"""Most samples that are added up; the rest is bounded, however much it is."""
CONDITION = 1e8
"""Of the eigenvectors, up to which their modes bound the rest: to eight digits."""
DOUBLINGS = 24
"""Of the power of F that is tried to contract: up to 2^23 samples."""
NO_NORM = "no norm is found in which the system contracts: no peak is bounded"

Array = np.ndarray


def bound_peaks(
    F: Float[np.ndarray, "state state"],
    G: Float[np.ndarray, "state input"],
    H: Float[np.ndarray, "signal state"],
    J: Float[np.ndarray, "signal input"],
    most: int = MOST,
) -> Float[np.ndarray, "signal input"]:
    """An upper bound of |J| + sum |H F^k G|: the peak of each signal for inputs of magnitude one.

    That sum is the gain of the peak (Desoer and Vidyasagar 1975, section 4.8). Its first samples are added
    up, ``most`` at most; the rest is bounded mode by mode, each by the geometric series of its pole, or where
    eigenvectors nearly coincide in a norm in which F contracts. Raises `NumericalError` for an unstable F.

    >>> peak = bound_peaks(np.array([[0.5]]), np.eye(1), np.eye(1), np.zeros((1, 1)))
    >>> 2.0 <= float(peak[0, 0]) < 2.05
    True
    """
    total = np.abs(J)
    if len(F) == 0:
        return total
    rest_of = _bound_rest(F, H)
    if most == 0:
        return total + rest_of(G)
    rows, power = np.empty((BLOCK, *H.shape)), H
    for k in range(BLOCK):
        rows[k], power = power, power @ F
    leap, x, rest = np.linalg.matrix_power(F, BLOCK), G, rest_of(G)
    flat = rows.reshape(-1, len(F))
    for _ in range(0, most, BLOCK):
        total = total + np.abs(flat @ x).reshape(BLOCK, *J.shape).sum(axis=0)
        x = leap @ x
        rest = rest_of(x)
        # Inputs may be of any size: each is measured by the largest that it does.
        size = np.maximum(total.max(axis=0), np.finfo(float).tiny)
        if np.all((rest / size).sum(axis=1) <= TAIL * (total / size).sum(axis=1)):
            break
    return total + rest


def _bound_rest(F: Array, H: Array) -> Callable[[Array], Array]:
    """A bound of sum |H F^k x| as a function of x."""
    poles, vectors = np.linalg.eig(F)
    radius = float(np.abs(poles).max())
    if not radius < 1.0:
        raise NumericalError(f"a pole of magnitude {radius:.9f}: no peak is bounded", hint="a stable system")
    if np.linalg.cond(vectors) < CONDITION:
        seen, inverse = np.abs(H @ vectors) / (1.0 - np.abs(poles)), np.linalg.inv(vectors)
        return lambda x: seen @ np.abs(inverse @ x)
    try:
        return _bound_in_norm(F, H, radius)
    except NumericalError:
        return _bound_by_powers(F, H)


def _bound_in_norm(F: Array, H: Array, radius: float) -> Callable[[Array], Array]:
    """The same without eigenvectors: by how much F contracts in the norm x' P x, which is measured."""
    balanced, scale = balance(F)
    wanted = 0.5 * (1.0 + radius)
    try:
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # what it gives is measured
            form = sla.solve_discrete_lyapunov((balanced / wanted).T, np.eye(len(F)))
        root = np.linalg.cholesky(form).T
        found = float(np.linalg.norm(sla.solve_triangular(root, (root @ balanced).T, trans=1), 2))
    except (np.linalg.LinAlgError, ValueError):
        raise NumericalError(NO_NORM, hint="a modal form") from None
    if not found < 1.0:
        raise NumericalError(NO_NORM, hint="a modal form")
    norms = np.linalg.norm(sla.solve_triangular(root, (H * scale).T, trans=1), axis=0) / (1.0 - found)
    return lambda x: norms[:, None] * np.linalg.norm(root @ (x / scale[:, None]), axis=0)


def _bound_by_powers(F: Array, H: Array) -> Callable[[Array], Array]:
    """The same for what hardly contracts within a sample, as long delays do: by a power of F that does."""
    power, scale = balance(F)
    seen, lost = np.abs(H * scale), np.zeros_like(F)
    for _ in range(DOUBLINGS):
        size = np.abs(power) + lost  # of F^(2^k), with what rounding took from it
        q = float(size.sum(axis=1).max())
        if q < 0.5:
            whole = seen.sum(axis=1, keepdims=True) / (1.0 - q)
            return lambda x: whole * np.abs(x / scale[:, None]).max(axis=0)
        seen = seen + seen @ size
        rounding = len(F) * np.finfo(float).eps * np.abs(power) @ np.abs(power)
        power, lost = power @ power, size @ lost + lost @ np.abs(power) + rounding
        if not np.isfinite(lost).all():
            break
    raise NumericalError(NO_NORM, hint="a modal form")
