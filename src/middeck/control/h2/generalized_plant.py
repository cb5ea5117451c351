"""Generalized plant of an H2 design: a plant with its weights and noise, normalised.

x' = A x + B1 w + B2 u, e = C1 x + D12 u, y = C2 x + D21 w + D22 u, with white w of unit intensity (process,
then sensor noise) and the cost E[e'e] = E[z' W^2 z + rho u' R u]. States of `Shaping` filters follow the
plant's. The last states of the compensator integrate measurements.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.law.partition import partition_modes
from middeck.control.lqg.design import require_authority
from middeck.control.lqg.design_model import LQGProblem, pose_problem, require_finite_cost, weigh_effort
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.errors import ConfigError
from middeck.systems.norms.band_rms import square_root
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

INNER = 1e-3
"""Fraction of control weight and noise put on the free part of the compensator beside fixed filters."""


@record(kw_only=True)
class GeneralizedPlant:
    """One model of a design, see the module; ``integrals`` are pairs of a row of y and its integral's weight,
    for which the last rows of C1 and D12 are reserved."""

    A: Float[np.ndarray, "state state"]
    B1: Float[np.ndarray, "state w"]
    B2: Float[np.ndarray, "state u"]
    C1: Float[np.ndarray, "e state"]
    D12: Float[np.ndarray, "e u"]
    C2: Float[np.ndarray, "y state"]
    D21: Float[np.ndarray, "y w"]
    D22: Float[np.ndarray, "y u"]
    integrals: tuple[tuple[int, float], ...] = ()


def generalize(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    shaping: Shaping | None = None,
    before: StateSpace | None = None,
    after: StateSpace | None = None,
) -> GeneralizedPlant:
    """The model of ``plant`` without inert modes, filters ``before`` on measurements, ``after`` on commands.

    At the frequency of a notch commands would have no cost and measurements no content, and the free part
    would invert the notch: a thousandth of the control weight and noise is put on its own ports.

    Raises `ConfigError` for weights and filters that do not fit, and for process noise that reaches z
    directly (the cost would be infinite).
    """
    active = partition_modes(plant).active
    _require_loop(active, authority)
    shaping = shaping or Shaping()
    m = pose_problem(active, weights, shaping)
    require_finite_cost(m)
    C, D, plain = weigh_effort(m, authority)
    held, nu = len(m.integral), len(m.plain)
    noise, n = _noise_root(m), len(m.A)
    # The plant's states first, then weights on ports, then colours.
    turn = np.roll(np.arange(n), -sum(len(colour.A) for _, colour in shaping.colours))
    model = GeneralizedPlant(
        A=m.A[np.ix_(turn, turn)],
        B1=np.hstack([m.noise, np.zeros((n, len(m.sensor)))])[turn] @ noise,
        B2=m.control[turn],
        C1=np.vstack([C, np.zeros((nu + held, n))])[:, turn],
        D12=np.vstack([D, np.diag(np.sqrt(plain)), np.zeros((held, nu))]),
        C2=m.C2[:, turn],
        D21=np.hstack([m.D21, np.eye(len(m.sensor))]) @ noise,
        D22=m.D22,
        integrals=tuple(zip(m.integral, m.integral_weight.tolist(), strict=True)),
    )
    if before is None and after is None:
        return model
    model = model if before is None else _filter_measurements(model, before)
    return _priced(model if after is None else _filter_commands(model, after))


def _noise_root(m: LQGProblem) -> Float[np.ndarray, "noise noise"]:
    """A factor of the joint intensity of process and sensor noise."""
    if not np.any(m.cross):
        return np.asarray(sla.block_diag(square_root(m.process), np.diag(np.sqrt(m.sensor))))
    joint = np.block([[m.process, m.cross], [m.cross.T, np.diag(m.sensor)]])
    size = np.sqrt(np.where(np.diag(joint) > 0.0, np.diag(joint), 1.0))
    return size[:, None] * square_root(joint / np.outer(size, size))


def _require_loop(plant: Plant, authority: float) -> None:
    require_authority(authority)
    if not plant.u or not plant.y:
        raise ConfigError(
            "the plant has no port in its group u or y: there is no loop to design", hint="name them: u=, y="
        )


def _priced(m: GeneralizedPlant) -> GeneralizedPlant:
    price, noise = (
        np.sqrt(INNER * np.trace(D.T @ D) / count) * np.eye(count)
        for D, count in ((m.D12, m.B2.shape[1]), (m.D21, len(m.C2)))
    )
    return dataclasses.replace(
        m,
        C1=np.vstack([m.C1, np.zeros((len(price), len(m.A)))]),
        D12=np.vstack([m.D12, price]),
        B1=np.hstack([m.B1, np.zeros((len(m.A), len(noise)))]),
        D21=np.hstack([m.D21, noise]),
    )


def _filter_measurements(m: GeneralizedPlant, f: StateSpace) -> GeneralizedPlant:
    if f.D.shape != (len(m.C2), len(m.C2)):
        raise ConfigError(
            f"the filter before the compensator has shape {f.D.shape} for {len(m.C2)} measurements",
            hint="as many inputs and outputs as measurements in the plant's group y",
        )
    n, k = len(m.A), len(f.A)
    return GeneralizedPlant(
        A=np.block([[m.A, np.zeros((n, k))], [f.B @ m.C2, f.A]]),
        B1=np.vstack([m.B1, f.B @ m.D21]),
        B2=np.vstack([m.B2, f.B @ m.D22]),
        C1=np.hstack([m.C1, np.zeros((len(m.C1), k))]),
        D12=m.D12,
        C2=np.hstack([f.D @ m.C2, f.C]),
        D21=f.D @ m.D21,
        D22=f.D @ m.D22,
    )


def _filter_commands(m: GeneralizedPlant, f: StateSpace) -> GeneralizedPlant:
    if f.D.shape != (m.B2.shape[1], m.B2.shape[1]):
        raise ConfigError(
            f"the filter after the compensator has shape {f.D.shape} for {m.B2.shape[1]} inputs",
            hint="as many inputs and outputs as the plant's group u has inputs",
        )
    n, k = len(m.A), len(f.A)
    return GeneralizedPlant(
        A=np.block([[m.A, m.B2 @ f.C], [np.zeros((k, n)), f.A]]),
        B1=np.vstack([m.B1, np.zeros((k, m.B1.shape[1]))]),
        B2=np.vstack([m.B2 @ f.D, f.B]),
        C1=np.hstack([m.C1, m.D12 @ f.C]),
        D12=m.D12 @ f.D,
        C2=np.hstack([m.C2, m.D22 @ f.C]),
        D21=m.D21,
        D22=m.D22 @ f.D,
    )
