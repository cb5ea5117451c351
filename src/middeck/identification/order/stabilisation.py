"""A stabilisation diagram: the poles of models of rising order, and which of them stay where they are.

A pole of the structure is found again at the next order; one that takes up noise is not. The models are
those of one frequency-domain subspace cut off at each order (McKelvey, Akcay and Ljung 1996), with no
refinement, so that a diagram takes less than a second. The rule and its limits are the field's (Heylen,
Lammens and Sas 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, FitError
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.order.thinning import take_lines, thin_lines
from middeck.identification.problem.data import Data, data_of
from middeck.identification.spectra.excess_variance import spread_of
from middeck.identification.start.frequency_subspace import block_rows, subspace_poles
from middeck.identification.start.start import upper_half, weighted_residues
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# As the starts of a fit: block rows beyond the least.
ROWS = 1.5
# A damping ratio beyond which a pole is no mode of a structure.
HEAVY = 0.3
# A cluster holds a stable pole of at least this share of the orders above its first.
SHARE = 0.5
FEWEST = 3
# How far a stable pole may be from that of the order before, relative; and its MAC from one.
BY_HZ, BY_DAMPING, BY_MAC = 0.01, 0.2, 0.05


@record(kw_only=True)
class Stabilisation:
    """Poles of all orders, those of one pair once, in rising order; real poles are left out.

    Attributes:
        order: The order each pole belongs to.
        natural_hz, damping: |pole| / 2 pi [Hz] and damping ratio.
        stable_frequency, stable_damping, stable_shape: Whether the nearest pole of the order before lies
            within the tolerance in frequency; whether its damping, and the MAC of its residue matrix, do so
            too. A single path has no shape: there, its residue is held to the tolerance of the damping.
        cluster: Which cluster the pole belongs to, or -1.
        cluster_hz, cluster_damping: Median over each cluster, by frequency.
    """

    order: Int[np.ndarray, " pole"]
    natural_hz: Float[np.ndarray, " pole"]
    damping: Float[np.ndarray, " pole"]
    stable_frequency: Bool[np.ndarray, " pole"]
    stable_damping: Bool[np.ndarray, " pole"]
    stable_shape: Bool[np.ndarray, " pole"]
    cluster: Int[np.ndarray, " pole"]
    cluster_hz: Float[np.ndarray, " cluster"]
    cluster_damping: Float[np.ndarray, " cluster"]

    @property
    def stable(self) -> Bool[np.ndarray, " pole"]:
        """Whether each pole is stable in frequency, damping and shape."""
        return self.stable_frequency & self.stable_damping & self.stable_shape


@named_kinds
def stabilisation(
    measured: FrequencyResponse,
    *,
    orders: Sequence[int] = tuple(range(2, 61, 2)),
    sample_hz: float | None = None,
) -> Stabilisation:
    """The stabilisation diagram of a measured response.

    A pole is stable if its frequency is within 1 % and its damping within 20 % of that of the order before,
    and the MAC of their residue matrices is 0.95 or more.

    Args:
        measured: Response, with its variance where there is one.
        orders: Rising orders [states]; those that the lines are too few for are left out.
        sample_hz: The sampling rate, for a sampled model; continuous without.

    Raises `ConfigError` for orders that do not rise from one or more; `FitError` if the lines are too few
    for the lowest order.
    """
    if not orders or orders[0] < 1 or any(b <= a for a, b in pairwise(orders)):
        raise ConfigError(
            f"orders {tuple(orders)[:5]} do not rise from one or more", hint="orders such as range(2, 41, 2)"
        )
    if sample_hz is not None and measured.frequency_hz[-1] >= 0.5 * sample_hz:
        raise ConfigError(
            f"the response reaches {measured.frequency_hz[-1]:.6g} Hz, beyond half of {sample_hz:.6g} Hz",
            hint="a band below half the rate, or sample_hz=None",
        )
    data = _some_lines(measured, orders[-1])
    models = list(_models(data, sample_hz, orders))
    flags = [np.zeros((len(models[0].poles), 3), dtype=bool)] + [
        _compare(before, now) for before, now in pairwise(models)
    ]
    return _result(models, np.vstack(flags))


@record
class _Model:
    order: int
    poles: Complex[np.ndarray, " mode"]
    residues: Complex[np.ndarray, "mode entry"]


def _some_lines(measured: FrequencyResponse, states: int) -> Data:
    spread = spread_of(measured, relative=False)
    data = data_of(measured, spread)
    return take_lines(data, spread, thin_lines(data, spread, states * sum(measured.H.shape[1:])))[0]


def _models(data: Data, sample_hz: float | None, orders: Sequence[int]) -> list[_Model]:
    outputs = data.H.shape[0]
    rows = block_rows(data, orders[-1], ROWS)
    possible = [n for n in orders if n <= (rows - 1) * outputs]
    if not possible:
        raise FitError(
            f"{len(data.s)} lines are too few for {orders[0]} states", hint="lower orders, or a longer period"
        )
    options = FitOptions(sample_hz=sample_hz, constants="complex", direct=True)
    delay_s, period_s = np.zeros((outputs, 1)), options.period_s
    models: list[_Model] = []
    for states, found in zip(possible, subspace_poles(data, period_s, possible, rows), strict=True):
        poles, pair = upper_half(found, period_s)
        residues = weighted_residues(data, options, poles, pair, delay_s)[0]
        light = pair & (-np.real(poles) < HEAVY * np.abs(poles))
        models.append(
            _Model(states, poles[light], residues[light].reshape(int(np.sum(light)), residues[0].size))
        )
    return models


def _compare(before: _Model, now: _Model) -> np.ndarray:
    """Columns: frequency, damping, shape."""
    if not len(before.poles):
        return np.zeros((len(now.poles), 3), dtype=bool)
    size, size_before = np.abs(now.poles), np.abs(before.poles)
    k = np.argmin(np.abs(np.log(size[:, None] / size_before)), axis=1)
    zeta, zeta_before = -np.real(now.poles) / size, -np.real(before.poles[k]) / size_before[k]
    frequency = np.abs(size - size_before[k]) <= BY_HZ * size
    damping = frequency & (np.abs(zeta - zeta_before) <= BY_DAMPING * zeta)
    if now.residues.shape[1] > 1:
        shape = _mac(now.residues, before.residues[k]) >= 1.0 - BY_MAC
    else:
        moved = now.residues - before.residues[k]
        shape = np.abs(moved[:, 0]) <= BY_DAMPING * np.abs(now.residues[:, 0])
    return np.stack([frequency, damping, frequency & shape], axis=1)


def _mac(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """|a^H b|^2 / (a^H a  b^H b), row by row (Allemang and Brown 1982)."""
    size = np.sum(np.abs(a) ** 2, axis=-1) * np.sum(np.abs(b) ** 2, axis=-1)
    return np.abs(np.sum(a.conj() * b, axis=-1)) ** 2 / np.maximum(size, np.finfo(float).tiny)


def _result(models: list[_Model], flags: np.ndarray) -> Stabilisation:
    poles = np.concatenate([m.poles for m in models])
    order = np.repeat([m.order for m in models], [len(m.poles) for m in models])
    orders = tuple(m.order for m in models)
    natural_hz, damping = np.abs(poles) / (2.0 * np.pi), -np.real(poles) / np.abs(poles)
    residues = np.concatenate([m.residues for m in models])
    members = _members(order, natural_hz, residues, flags[:, 0] & flags[:, 1] & flags[:, 2])
    kept = [c for c in members if len(c) >= max(FEWEST, SHARE * sum(n >= order[c[0]] for n in orders))]
    kept.sort(key=lambda c: float(np.median(natural_hz[c])))
    cluster = np.full(len(poles), -1)
    for k, c in enumerate(kept):
        cluster[c] = k
    return Stabilisation(
        order=order,
        natural_hz=natural_hz,
        damping=damping,
        stable_frequency=flags[:, 0],
        stable_damping=flags[:, 1],
        stable_shape=flags[:, 2],
        cluster=cluster,
        cluster_hz=np.array([np.median(natural_hz[c]) for c in kept]),
        cluster_damping=np.array([np.median(damping[c]) for c in kept]),
    )


def _members(order: np.ndarray, hz: np.ndarray, residues: np.ndarray, stable: np.ndarray) -> list[list[int]]:
    """Stable poles of like frequency and shape, one of each order, followed from order to order."""
    members: list[list[int]] = []
    for k in np.flatnonzero(stable):
        near = [
            c
            for c in members
            if order[c[-1]] < order[k]
            and abs(hz[c[-1]] - hz[k]) <= BY_HZ * hz[k]
            and _mac(residues[c[-1]], residues[k]) >= 1.0 - BY_MAC
        ]
        if near:
            min(near, key=lambda c: abs(hz[c[-1]] - hz[k])).append(int(k))
        else:
            members.append([int(k)])
    return members
