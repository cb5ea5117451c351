"""Starting laws of any order: LQG laws, reduced or with states added."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float

from middeck.control.h2.closed_cost import Law, evaluate_cost, spectral_abscissa
from middeck.control.h2.generalized_plant import GeneralizedPlant
from middeck.control.h2.law_form import add_laws, join_stations, split_law
from middeck.control.h2.nominal_law import lqg_law
from middeck.systems.poles.stability import all_decay

LADDER = tuple(10.0 ** (-0.5 * k) for k in range(13))
"""Ratios of authority at which a start is sought, the one requested first."""
OWN_BALANCE = (1e-3, 1e-4, 1e-5)
"""Ratios at which laws are reduced by their own Gramians: weak laws are stable and reduce to different sets
of modes, which lead to different minima."""
HALVINGS = 16
SMALL, SPREAD = 6, 32
"""Largest order at which starts unrelated to LQG laws are added, and their number."""

PRIMES = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53])
Stations = list[tuple[list[int], list[int], int]]
ModelsAt = Callable[[float], Sequence[GeneralizedPlant]]


def reduce_law(
    law: Law, order: int, covariance: Float[np.ndarray, "law law"], worth: Float[np.ndarray, "law law"]
) -> Law:
    """Truncation in coordinates in which two Gramians are equal and diagonal (Moore 1981, IEEE TAC 26)."""
    left, right = _factor(worth), _factor(covariance)
    U, s, Vt = np.linalg.svd(left.T @ right)
    s = np.maximum(s[:order], 1e-12 * s[0])
    into, out = (left @ U[:, :order] / np.sqrt(s)).T, right @ Vt[:order].T / np.sqrt(s)
    return Law(into @ law.A @ out, into @ law.B, law.C @ out)


def _factor(gramian: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2.0)
    return vectors * np.sqrt(np.maximum(values, 1e-15 * values.max(initial=0.0)))


def pad_law(law: Law, order: int) -> Law:
    """The `Law` with stable states added over its frequencies, coupled by 1 % of its typical gains."""
    extra = order - len(law.A)
    if extra <= 0:
        return law
    values = np.abs(np.linalg.eigvals(law.A))
    rates = np.geomspace(np.quantile(values, 0.2), np.quantile(values, 0.8), extra)
    small_B, small_C = (0.01 * float(np.sqrt(np.mean(M**2))) for M in (law.B, law.C))
    # Signs alternate differently for each port, so that no two states are equal.
    B = small_B * np.cos(np.outer(np.arange(extra) + 1.0, np.arange(law.B.shape[1]) + 1.0))
    C = small_C * np.cos(np.outer(np.arange(len(law.C)) + 1.0, np.arange(extra) + 2.0))
    return add_laws(law, Law(-np.diag(rates), B, C))


def stabilises(models: Sequence[GeneralizedPlant], law: Law) -> bool:
    """Whether all loops are stable, by their eigenvalues."""
    return all(spectral_abscissa(model, law) < 0.0 for model in models)


def find_starts(models_at: ModelsAt, order: int, stations: Stations) -> Iterator[tuple[Law, float]]:
    """Laws of ``order`` states, each with a ratio of authority at which it stabilises all models (may be
    empty).

    ``models_at`` gives the models at a ratio, the nominal one first.
    """
    if stations:
        yield from _decentralised(models_at, stations)
        return
    whole = order >= len(models_at(1.0)[0].A)
    yield from _first(models_at, order, LADDER)
    for ratio in () if whole else OWN_BALANCE:
        found = _own_balance(models_at, order, ratio)
        if found is not None:
            yield found, ratio


def spread_starts(models: Sequence[GeneralizedPlant], order: int) -> Iterator[tuple[Law, float]]:
    """Small stabilising laws unrelated to LQG laws; none for larger orders or integrals."""
    for number in range(SPREAD if order <= SMALL and not models[0].integrals else 0):
        spread = _weakened(models, _spread_law(models[0], order, number))
        if spread is not None:
            yield spread, 1.0


def _first(models_at: ModelsAt, order: int, ratios: Sequence[float]) -> Iterator[tuple[Law, float]]:
    """The LQG law at the highest stabilising authority, reduced by balancing in the loop if needed."""
    for ratio in ratios:
        models = models_at(float(ratio))
        law = in_the_loop(models[0], order)
        if stabilises(models, law):
            yield law, float(ratio)
            return


def in_the_loop(model: GeneralizedPlant, order: int) -> Law:
    """The LQG law with states added, or reduced by the Gramians of its states in the loop."""
    law, n = lqg_law(model), len(model.A)
    free, integrals = split_law(law, len(model.integrals))
    if order >= n:
        return add_laws(pad_law(free, order), integrals)
    cost = evaluate_cost(model, law)
    covariance = np.eye(n) if cost.covariance is None else cost.covariance[:n, :n]
    worth = np.eye(n) if cost.worth is None else cost.worth[:n, :n]
    return add_laws(reduce_law(free, order, covariance, worth), integrals)


def _own_balance(models_at: ModelsAt, order: int, ratio: float) -> Law | None:
    models = models_at(ratio)
    free, integrals = split_law(lqg_law(models[0]), len(models[0].integrals))
    law = _reduced_alone(free, order)
    return None if law is None else _weakened(models, add_laws(law, integrals))


def _reduced_alone(law: Law, order: int) -> Law | None:
    if order >= len(law.A) or not all_decay(np.linalg.eigvals(law.A)):
        return None
    covariance, worth = (
        np.asarray(sla.solve_continuous_lyapunov(A, -F @ F.T))
        for A, F in ((law.A, law.B), (law.A.T, law.C.T))
    )
    return reduce_law(law, order, covariance, worth)


def _spread_law(model: GeneralizedPlant, order: int, number: int) -> Law:
    """Damped pairs, and a real pole if the order is odd, from below the model's poles to far above them.

    Frequencies, damping and directions follow the quasi-random multiples of square roots of primes
    (Niederreiter 1992, section 3.1).
    """
    poles = np.abs(np.linalg.eigvals(model.A))
    low, high = np.log(0.3 * np.median(poles)), np.log(30.0 * np.median(poles))
    counts = np.arange(1, order + 1), np.arange(1, model.B2.shape[1] + len(model.C2) + 1)
    first = np.mod((number + 1.0) * np.sqrt(PRIMES[: 2 * len(counts[0])]), 1.0)
    rates, damping = np.exp(low + (high - low) * first[:order]), 0.02 + 0.98 * first[order:]
    A = np.diag(-rates)
    for i in range(0, order - 1, 2):
        A[i : i + 2, i : i + 2] = rates[i] * np.array([[0.0, 1.0], [-1.0, -2.0 * damping[i]]])
    turns = np.outer(counts[0], counts[1]) * np.sqrt(2.0) * (number + 1.0)
    ports = np.cos(2.0 * np.pi * turns)
    return Law(A, ports[:, : len(model.C2)], ports[:, len(model.C2) :].T)


def _weakened(models: Sequence[GeneralizedPlant], law: Law) -> Law | None:
    """The law with its gain halved until it stabilises, as a stable law does on stable plants."""
    for _ in range(HALVINGS):
        if stabilises(models, law):
            return law
        law = dataclasses.replace(law, C=law.C / 2.0)
    return None


def _decentralised(models_at: ModelsAt, stations: Stations) -> Iterator[tuple[Law, float]]:
    """Stations designed independently, at the highest authority at which all together stabilise."""
    for ratio in LADDER:
        models = models_at(float(ratio))
        laws = [_alone(models[0], station) for station in stations]
        if any(law is None for law in laws):
            continue
        joined = join_stations(
            [law for law in laws if law is not None], stations, len(models[0].C2), models[0].B2.shape[1]
        )
        if stabilises(models, joined):
            yield joined, float(ratio)
            return


def _alone(model: GeneralizedPlant, station: tuple[list[int], list[int], int]) -> Law | None:
    y, u, order = station
    seen = np.any(model.D21[y] != 0.0, axis=0) | np.any(model.B1 != 0.0, axis=0)
    part = GeneralizedPlant(
        A=model.A, B1=model.B1[:, seen], B2=model.B2[:, u], C1=model.C1, D12=model.D12[:, u], C2=model.C2[y],
        D21=model.D21[y][:, seen], D22=model.D22[y][:, u],
    )  # fmt: skip
    law = lqg_law(part)
    if order >= len(law.A):
        return pad_law(law, order)
    own = _reduced_alone(law, order)
    return in_the_loop(part, order) if own is None else own
