"""The loop in which a compensator is reduced: its disturbances, weights and signal sizes.

Default weights come from the loop itself: unit white noise on the group w, each measurement with noise of a
tenth of its rms in the compensator's band, each output and input over its rms.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, closed_matrices, spectral_abscissa
from middeck.control.h2.generalized_plant import GeneralizedPlant, generalize
from middeck.control.law.compensator import Compensator, locate_ports
from middeck.control.lqg.weights import LQGWeights
from middeck.control.reduction.gramian import GramianFactors, factor_gramians, restrict
from middeck.control.riccati.lyapunov import solve_lyapunov
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import StateSpace, gain_system
from middeck.values import record

SENSOR_SHARE = 0.1
"""Noise of a measurement relative to its rms; gives the compensator some weight between its resonances."""


@record
class WeightedLoop:
    """A plant with the compensator's direct term closed, its weights, and typical sizes of u and y."""

    model: GeneralizedPlant
    input_size: Float[np.ndarray, " u"]
    output_size: Float[np.ndarray, " y"]


def pose_loop(
    plant: Plant, compensator: Compensator, weights: LQGWeights | None, authority: float
) -> WeightedLoop:
    """The loop of ``compensator`` and ``plant``; `ConfigError` if it is unstable or ports differ."""
    locate_ports(compensator, plant.inputs, plant.outputs)
    joined = dataclasses.replace(
        plant,
        u=tuple(p.name for p in compensator.outputs),
        y=tuple(p.name for p in compensator.inputs),
        w=plant.w or tuple(p.name for p in compensator.outputs),
    )
    law, direct = proper_law(compensator.system), gain_system(compensator.system.D)
    if weights is None:
        joined = dataclasses.replace(joined, z=_without_direct(joined))
        unit = _unit_weights(joined)
        model = absorb(generalize(joined, unit, 1.0), direct)
        weights, authority = _weights_of_loop(joined, model, law, direct, unit), 1.0
    model = absorb(generalize(joined, weights, authority), direct)
    _, y, u = _mean_squares(model, law, direct, len(weights.disturbed), len(joined.z))
    return WeightedLoop(model, np.sqrt(_positive(u)), np.sqrt(_positive(y)))


def proper_law(system: StateSpace) -> Law:
    """The system without its direct term."""
    return Law(system.A, system.B, system.C)


def absorb(model: GeneralizedPlant, beside: StateSpace) -> GeneralizedPlant:
    """The model with the fixed feedback ``beside`` closed around it, for a free compensator added at u.

    Direct white noise in u is left out: its cost would be infinite for every law.
    """
    nw, nz, (nu, ny) = model.B1.shape[1], len(model.C1), beside.D.shape
    plant = StateSpace(
        model.A,
        np.hstack([model.B1, model.B2]),
        np.vstack([model.C1, model.C2]),
        np.block([[np.zeros((nz, nw)), model.D12], [model.D21, model.D22]]),
    )
    closed = feedback(plant, beside, range(nw, nw + nu), range(nz, nz + ny))
    w, u, z, y = slice(nw), slice(nw, nw + nu), slice(nz), slice(nz, nz + ny)
    return GeneralizedPlant(
        A=closed.A,
        B1=closed.B[:, w],
        B2=closed.B[:, u],
        C1=closed.C[z],
        D12=closed.D[z, u],
        C2=closed.C[y],
        D21=closed.D[y, w],
        D22=closed.D[y, u],
    )


def response_in_loop(model: GeneralizedPlant, law: StateSpace) -> StateSpace:
    """G (I - K G)^-1, from a signal added at u to y."""
    closed = absorb(model, law)
    return StateSpace(closed.A, closed.B2, closed.C2, closed.D22)


def gramians_in_loop(models: Sequence[GeneralizedPlant], law: Law) -> GramianFactors:
    """Gramians of the compensator's states in the loop under noises and cost, mean over the models.

    For a stable K they are Enns' Gramians with the weights (I - G K)^-1 behind y and (I - K G)^-1 before u;
    they exist for an unstable K too.
    """
    return _mean([_blocks(*closed_matrices(model, law), len(model.A)) for model in models])


def seen_at_y(models: Sequence[GeneralizedPlant], law: Law, output_size: np.ndarray) -> GramianFactors:
    """Gramian factors as `gramians_in_loop`, observed at y, each measurement relative to its size."""
    found: list[GramianFactors] = []
    for model in models:
        A, B, _ = closed_matrices(model, law)
        C = np.hstack([model.C2, model.D22 @ law.C]) / output_size[:, None]
        found.append(_blocks(A, B, C, len(model.A)))
    return _mean(found)


def _blocks(A: np.ndarray, B: np.ndarray, C: np.ndarray, n: int) -> GramianFactors:
    whole = factor_gramians(StateSpace(A, B, C, np.zeros((len(C), B.shape[1]))))
    return GramianFactors(restrict(whole.reach, slice(n, None)), restrict(whole.see, slice(n, None)))


def _mean(found: list[GramianFactors]) -> GramianFactors:
    def mean(factors: list[np.ndarray]) -> np.ndarray:
        return restrict(np.hstack(factors) / np.sqrt(len(factors)), slice(None))

    return GramianFactors(mean([f.reach for f in found]), mean([f.see for f in found]))


def _without_direct(plant: Plant) -> tuple[str, ...]:
    """Outputs that noise does not reach directly, of the group z (of y where z is empty)."""
    D, w = plant.system.D, plant.input_indices(plant.w)
    names = plant.z or plant.y
    rows = plant.output_indices(names)
    return tuple(name for name, row in zip(names, rows, strict=True) if not np.any(D[row, w]))


def _unit_weights(plant: Plant) -> LQGWeights:
    ones = [np.ones(len(group)) for group in (plant.z, plant.u, plant.y)]
    return LQGWeights(
        output=ones[0], input=ones[1], disturbed=plant.w, process=np.eye(len(plant.w)), sensor=ones[2]
    )


def _weights_of_loop(
    plant: Plant, model: GeneralizedPlant, law: Law, direct: StateSpace, unit: LQGWeights
) -> LQGWeights:
    z, y, u = (_positive(square) for square in _mean_squares(model, law, direct, len(plant.w), len(plant.z)))
    values = law.A if len(law.A) else model.A
    highest_hz = float(np.abs(np.linalg.eigvals(values)).max()) / (2.0 * np.pi)
    noise = SENSOR_SHARE**2 * y / (2.0 * max(highest_hz, np.finfo(float).tiny))
    return dataclasses.replace(unit, output=1.0 / np.sqrt(z), input=1.0 / u, sensor=noise)


def _mean_squares(
    model: GeneralizedPlant, law: Law, direct: StateSpace, noises: int, outputs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean squares of weighted z, of y and of u under the process noise alone."""
    if not spectral_abscissa(model, law) < 0.0:
        raise ConfigError(
            "the compensator to be reduced does not stabilise the plant",
            hint="start from one that stabilises every plant: reduction preserves stability, it creates none",
        )
    A, B, C = closed_matrices(model, law)
    X = solve_lyapunov(A.T, B[:, :noises] @ B[:, :noises].T)
    y = np.hstack([model.C2, model.D22 @ law.C])
    u = direct.D @ y
    u[:, len(model.A) :] += law.C
    z, y, u = (np.einsum("ij,jk,ik->i", rows, X, rows) for rows in (C[:outputs], y, u))
    return z, y, u


def _positive(squares: np.ndarray) -> Float[np.ndarray, " port"]:
    """Roots, with zeros replaced by the largest; one where all are zero."""
    largest = float(squares.max(initial=0.0))
    if not largest > 0.0:
        return np.ones(len(squares))
    return np.where(squares > 1e-24 * largest, squares, largest)
