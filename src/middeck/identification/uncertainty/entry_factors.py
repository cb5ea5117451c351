"""Derivatives of the entries of a response from few shared functions, and the noise that entries share.

With u = 1/(q - lambda) and l = 1/(q - conj lambda) any term of a pair is z u + conj(z) l = Re z (u + l) + Im
z j(u - l), and its derivative by the pole the same of squares (as for a fit's columns, `problem.factors`).
Terms of real constants are phi psi u l, with derivatives of u l (u + l) and (u l)^2: differences of u and l
would be rounding near the real axis. Only the derivative by its delay is an entry's own.

A disturbance of the article is in all outputs, noise of a measured input in all that it drives. A fit with
one weight for each entry stays unbiased, but its covariance is A^-1 B A^-1 with

    B = 1/2 sum over lines of Re sum_ab conj(J_a) w_a^2 V_ab w_b^2 J_b^T,   V_ab = E[r_a conj(r_b)].
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.spectra.excess_variance import averaged
from middeck.identification.uncertainty.model_unknowns import (
    ModelStructure,
    Places,
    constants_of,
    part_of,
    places_of,
)
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record


@record
class EntrySlopes:
    """Response of one entry of H at some s, and its derivatives by the unknowns it depends on."""

    H: Complex[np.ndarray, " line"]
    place: Int[np.ndarray, " unknown"]
    by: Complex[np.ndarray, "unknown line"]


def entry_slopes(
    model: MeasurementModel,
    structure: ModelStructure,
    s: Complex[np.ndarray, " line"],
    output: int,
    input: int,
) -> EntrySlopes:
    """H_oi and its derivatives at ``s``, which need not lie on the imaginary axis."""
    entry = entry_factors(model, structure, places_of(model, structure), output, input)
    shared = shared_functions(model, structure, s)
    late = np.exp(-s * entry.delay_s)
    H = combined(entry.response[None], shared)[0] * late
    return EntrySlopes(H, entry.place, combined(entry.by, entry.functions(shared, s)) * late)


class EntryFactors(NamedTuple):
    """One entry: which unknowns it depends on, its derivatives and itself by the functions, and its delay.

    The last function of the derivatives is the entry's own, -s H, where a delay is among the unknowns.
    """

    place: Int[np.ndarray, " unknown"]
    by: Float[np.ndarray, "unknown function"]
    response: Float[np.ndarray, " function"]
    delay_s: float

    def functions(
        self, shared: Complex[np.ndarray, "function line"], s: Complex[np.ndarray, " line"]
    ) -> Complex[np.ndarray, "function line"]:
        """The functions of `shared_functions` and the entry's own, all without its delay."""
        if self.by.shape[1] == len(shared):
            return shared
        return np.concatenate([shared, (-s * combined(self.response[None], shared))])


def combined(
    factors: Float[np.ndarray, "row function"], functions: Complex[np.ndarray, "function line"]
) -> Complex[np.ndarray, "row line"]:
    """Real combinations of functions."""
    return (factors @ np.ascontiguousarray(functions).view(float)).view(complex)


def shared_functions(
    model: MeasurementModel, structure: ModelStructure, s: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "function line"]:
    """Four functions of each mode, kind by kind, then 1/s^2, 1/s and 1, at any ``s``.

    u + l and j(u - l) and the same of squares; u l, its square and u l (u + l) of a pair with real constants;
    u and u^2 of a real pole. What a mode does not have is zero.
    """
    T = 0.0 if model.sample_hz is None else 1.0 / model.sample_hz
    q, pole = (np.exp(s * T), np.exp(model.poles * T)) if T else (s, model.poles)
    pair = model.is_pair[:, None]
    u, low = 1.0 / (q - pole[:, None]), pair / (q - pole[:, None].conj())
    both, none = u + low, np.zeros_like(u)
    if structure.real_constants:
        of_poles = [np.where(pair, u * low, u), none, np.where(pair, u * low * both, u**2), (u * low) ** 2]
    else:
        # j(u - l), without a difference of what is nearly equal.
        apart = np.where(pair, -2.0 * np.imag(pole)[:, None] * u * low, 1j * u)
        of_poles = [both, apart, u**2 + low**2, apart * both]
    return np.concatenate([*of_poles, [1.0 / s**2, 1.0 / s, np.ones(len(s))]])


def entry_factors(
    model: MeasurementModel, structure: ModelStructure, at: Places, output: int, input: int
) -> EntryFactors:
    """Of H_oi, for unknowns at their places."""
    modes = len(model.poles)
    rows: list[tuple[Int[np.ndarray, " unknown"], Float[np.ndarray, "unknown function"]]] = []

    def put(place: np.ndarray, kind: int, z: np.ndarray) -> None:
        """Re z of the functions of one kind, and Im z of those of the next."""
        C = np.zeros((modes, 4 * modes + 4))
        m = np.arange(modes) + kind * modes
        C[np.arange(modes), m], C[np.arange(modes), modes + m] = np.real(z), np.imag(z)
        rows.append((place, C))

    T = 0.0 if model.sample_hz is None else 1.0 / model.sample_hz
    sigma, omega = -np.real(model.poles), np.imag(model.poles)
    c, b = constants_of(model, structure)[output], model.participation[:, input]
    if structure.real_constants:
        c, b = np.real(c), np.real(b)
        put(at.sigma, 2, -sigma * c * b)
        put(at.omega, 2, -2j * omega**2 * c * b)
    else:
        # By the pole; what follows the conjugate comes with it.
        z = c * b * (T * np.exp(model.poles * T) if T else 1.0)
        put(at.sigma, 2, -sigma * z)
        put(at.omega, 2, 1j * omega * z)
    put(at.b[:, input, 0], 0, c)
    put(at.b[:, input, 1], 0, 1j * c)
    put(at.c[output, :, 0], 0, b)
    put(at.c[output, :, 1], 0, 1j * b)
    last = 4 * modes + np.array([0, 1, 0, 2, 3, 3])
    constant = [x[output, input] for x in (at.rigid, at.integral, at.lower, at.direct)]
    rows.append(
        (np.array([*constant, at.delay[output], at.path[output, input]]), np.eye(4 * modes + 4)[last])
    )
    place, each = (np.concatenate(x) for x in zip(*rows, strict=True))
    once, which = np.unique(place[place >= 0], return_inverse=True)
    total = np.zeros((len(once), each.shape[1]))
    np.add.at(total, which, each[place >= 0])
    slow = [model.lower[output, input] + part_of(model, model.rigid)[output, input]]
    slow += [part_of(model, model.integral)[output, input], model.direct[output, input]]
    none = np.zeros(2 * modes)
    response = np.concatenate([np.real(c * b), np.imag(c * b), none, slow])
    delay_s = model.delay_s[output] + part_of(model, model.path_delay_s)[output, input]
    by = total if total[:, -1].any() else total[:, :-1]
    return EntryFactors(once, by, response, float(delay_s))


# Mean square coherence of independent noise is one over its degrees of freedom: what is twice that is common.
COMMON = 2.0
# Lines taken together: as many as keep the derivatives of all entries within some megabytes.
CHUNK = 64
# Inputs are orthogonal where their powers are, up to rounding.
SAME = 1e-6


def common_noise(measured: FrequencyResponse, degrees: float) -> Complex[np.ndarray, "line a b"] | None:
    """Correlation of the noise of all entries, output by output; None where it is not significant.

    The covariance of the outputs is averaged over neighbouring lines, like the variances; ``degrees`` are the
    complex degrees of freedom of the average.
    """
    if measured.covariance is None:
        return None
    between = _normalised(averaged(measured.covariance.outputs))
    inputs = _normalised(measured.covariance.inverse_power)
    if not _is_common(between, degrees):
        between = np.broadcast_to(np.eye(between.shape[1], dtype=complex), between.shape)
        if np.abs(inputs - np.eye(inputs.shape[1])).max() < SAME:
            return None
    entries = between.shape[1] * inputs.shape[1]
    return np.einsum("kop,kij->koipj", between, inputs).reshape(len(between), entries, entries)


def _is_common(between: np.ndarray, degrees: float) -> bool:
    """Whether the outputs' noise is significantly correlated; the inputs' powers are known, not estimated."""
    outputs = between.shape[1]
    if outputs < 2:
        return False
    off = np.sum(np.mean(np.abs(between) ** 2, axis=0)) - outputs
    return float(off) / (outputs * (outputs - 1)) > COMMON / max(degrees, 1.0)


def _normalised(raw: np.ndarray) -> Complex[np.ndarray, "line a a"]:
    scale = np.sqrt(np.maximum(np.real(np.linalg.diagonal(raw)), np.finfo(float).tiny))
    return raw / scale[:, :, None] / scale[:, None, :]


def common_scores(
    entries: Iterable[EntrySlopes],
    W: Float[np.ndarray, "unknown direction"],
    correlation: Complex[np.ndarray, "line a b"],
    assumed: Float[np.ndarray, "a line"],
    noise: Float[np.ndarray, "a line"],
) -> Float[np.ndarray, "direction direction"]:
    """W^T B W of the B above; what was assumed beyond the measured noise is independent between entries."""
    each = list(entries)
    spread = np.zeros((W.shape[1], W.shape[1]))
    for first in range(0, assumed.shape[1], CHUNK):
        some = slice(first, first + CHUNK)
        size = np.sqrt(noise[:, some]).T
        joint = correlation[some] * size[:, :, None] * size[:, None, :]
        own = np.arange(len(each))
        joint[:, own, own] = assumed[:, some].T
        power, direction = np.linalg.eigh(joint)
        root = direction * np.sqrt(np.maximum(power, 0.0))[:, None, :] / assumed[:, some].T[:, :, None]
        scores = np.zeros((len(W), *root.shape[::2]), dtype=complex)
        for a, entry in enumerate(each):
            scores[entry.place] += entry.by[:, some, None].conj() * root[:, a, :]
        flat = W.T @ np.ascontiguousarray(scores.reshape(len(W), -1)).view(float)
        spread += 0.5 * (flat @ flat.T)
    return spread
