"""The sampled loop of a package and a model, open at the adaptive gain."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import locate_ports
from middeck.control.qualification import align_plant
from middeck.errors import ConfigError
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding_errors import unfold_law
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.statespace import SampledStateSpace, same_period
from middeck.values import record

AMPLIFIED = 1e12
"""Condition number beyond which the loop through the direct terms counts as without a solution."""


@record(kw_only=True)
class GainLoop:
    """x+ = A x + B w, c = C x + D w: the loop opened where the compensator's command c becomes w = g c.

    Closed at a gain g it is A + g B (1 - g D)^-1 C.

    Attributes:
        size_A, size_B, size_C: What the products and sums that make A, B and C add up to in magnitude: their
            roundings are relative to it.
    """

    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state command"]
    C: Float[np.ndarray, "command state"]
    D: Float[np.ndarray, "command command"]
    size_A: Float[np.ndarray, "state state"]
    size_B: Float[np.ndarray, "state command"]
    size_C: Float[np.ndarray, "command state"]
    period_s: float


def form_gain_loop(package: ControllerPackage, plant: Plant) -> GainLoop:
    """The loop of ``package`` between its limits with ``plant``, sampled exactly with its delays.

    The output is p + w and the compensator learns w - c, as in `linear_law`. Modes that the package neither
    reaches nor sees are left out. Raises `ConfigError` for ports or a rate that do not fit, and where the
    inner loop through the direct terms has no solution.
    """
    law = linear_law(package)
    active = align_plant(plant, law)
    if active.period_s is None:
        active = sample_plant(active, package.period_s)
    dynamics = active.dynamics
    if not isinstance(dynamics, SampledStateSpace) or not same_period(dynamics.period_s, package.period_s):
        raise ConfigError(
            "the model has another rate than the package", hint="a continuous model, or its rate"
        )
    drives, reads = locate_ports(law, active.inputs, active.outputs)
    drives, reads = list(drives), list(reads)
    law_parts = _law_parts(package)
    plant_parts = [dynamics.A, dynamics.B[:, drives], dynamics.C[reads], dynamics.D[np.ix_(reads, drives)]]
    through = _solve_inner(law_parts[-1], plant_parts[-1])
    A, B, C, D = _join(plant_parts, _observer(law_parts, -1.0), through)
    sizes = _join(
        [np.abs(part) for part in plant_parts],
        _observer([np.abs(part) for part in law_parts], 1.0),
        np.abs(through),
    )
    return GainLoop(
        A=A, B=B, C=C, D=D, size_A=sizes[0], size_B=sizes[1], size_C=sizes[2], period_s=package.period_s
    )


def closed_at(loop: GainLoop, gain: float) -> Float[np.ndarray, "state state"]:
    """The closed loop at ``gain`` of an affine loop (D = 0).

    >>> one = np.ones((1, 1))
    >>> sizes = {"size_A": one, "size_B": one, "size_C": one}
    >>> lag = GainLoop(A=0.5 * one, B=one, C=-one, D=0.0 * one, **sizes, period_s=0.1)
    >>> closed_at(lag, 0.25).tolist()
    [[0.25]]
    """
    return loop.A + (gain * loop.B) @ loop.C


def _law_parts(package: ControllerPackage) -> list[np.ndarray]:
    """F, G_y, E, C, D, H, J of x+ = F x + G_y y + E e, c = C x + D y, p = H x + J y."""
    unfolded = unfold_law(package, single=False)
    m, p = len(package.inputs), len(package.outputs)
    law, loop = list(unfolded.law), list(unfolded.loop)
    return [
        unfolded.F, unfolded.G[:, :m], unfolded.G[:, m : m + p], unfolded.H[law], unfolded.J[law, :m],
        unfolded.H[loop], unfolded.J[loop, :m],
    ]  # fmt: skip


def _observer(parts: list[np.ndarray], sign: float) -> list[np.ndarray]:
    """The law with e = w - c as input: x+ = (F - E C) x + (G_y - E D) y + E w."""
    F, G, E, C, D, H, J = parts
    return [F + sign * E @ C, G + sign * E @ D, E, C, D, H, J]


def _solve_inner(J: np.ndarray, direct: np.ndarray) -> np.ndarray:
    loop = J @ direct
    if not np.any(loop):
        return np.eye(len(loop))
    if not np.linalg.cond(np.eye(len(loop)) - loop) < AMPLIFIED:
        raise ConfigError(
            "algebraic loop: the inner loop through the direct terms has no solution",
            hint="add a delay to the model or a lag to the inner loop",
        )
    return np.linalg.inv(np.eye(len(loop)) - loop)


def _join(
    plant: list[np.ndarray], law: list[np.ndarray], through: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The plant under u = p + w: u = through (J C_p x_p + H x + w), y = C_p x_p + D_p u."""
    A, B, C, D = plant
    F, G, E, Cc, Dc, H, J = law
    by_plant, by_law = through @ J @ C, through @ H
    y_by_plant, y_by_law, y_by_w = C + D @ by_plant, D @ by_law, D @ through
    return (
        np.block([[A + B @ by_plant, B @ by_law], [G @ y_by_plant, F + G @ y_by_law]]),
        np.vstack([B @ through, G @ y_by_w + E]),
        np.hstack([Dc @ y_by_plant, Cc + Dc @ y_by_law]),
        Dc @ y_by_w,
    )


def size_at(loop: GainLoop, gain: float) -> Float[np.ndarray, "state state"]:
    """Sum of the magnitudes of the terms of `closed_at`."""
    return loop.size_A + (abs(gain) * loop.size_B) @ loop.size_C
