"""Derivatives of the entries of a response by the unknowns of its model, from few shared functions.

With u = 1/(q - lambda) and l = 1/(q - conj lambda) any term of a pair is z u + conj(z) l = Re z (u + l) + Im
z j(u - l), and its derivative by the pole the same of squares (as in `problem.basis_functions`). Terms
of real constants are phi psi u l, with derivatives of u l (u + l) and (u l)^2: differences of u and l would
be rounding near the real axis. Only the derivative by its delay is an entry's own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.model_unknowns import (
    ModelStructure,
    UnknownPlaces,
    constants_of,
    part_of,
    places_of,
)
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
    u and u^2 of a real pole. Functions that a mode lacks are zero.
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
    model: MeasurementModel, structure: ModelStructure, at: UnknownPlaces, output: int, input: int
) -> EntryFactors:
    """Factors of H_oi, for unknowns at their places."""
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
        # The derivative by the pole; that by the conjugate follows.
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
