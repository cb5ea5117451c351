"""The unknowns of a fitted model in coordinates of their own, and the response's derivatives by them.

    [log sigma of each mode | log omega_d of each pair | free entries of b | entries of c of each output
     | R | Q | L | D | delay of each output | delay of each path beyond its output's shortest]

as far as the fit had them (`ModelStructure`; R, Q and delays of paths as far as the model has them). The
largest entry of each b is held: the residue c b leaves one factor free. Unlike the search's own vector, this
one is read from a finished model alone, so that every kind of fit has its covariance in the same coordinates.
Any vector is a stable, real model.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.identification.model.measurement_model import MeasurementModel
from middeck.values import record


@record(kw_only=True)
class ModelStructure:
    """The parts of a model that were free in its fit.

    Attributes:
        real_constants: Pairs are phi psi / ((s - p)(s - conj p)) with real phi and psi.
        with_delay, with_lower, with_direct: Whether delays, the term L / s^2 and the constant term D were
            fitted.
        common_delay: Whether all outputs have one delay.
        relative_degree_two: Whether the residues of each path were made to add up to zero.
    """

    real_constants: bool
    with_delay: bool = False
    with_lower: bool = False
    with_direct: bool = False
    common_delay: bool = False
    relative_degree_two: bool = False


@record(kw_only=True)
class UnknownPlaces:
    """Place of each kind of unknown in the vector; -1 where it is not free.

    Modes of one pole (a residue of full rank, whose input vectors are held) share their place, and so do
    outputs of one common delay.
    """

    sigma: Int[np.ndarray, " mode"]
    omega: Int[np.ndarray, " mode"]
    b: Int[np.ndarray, "mode input 2"]
    c: Int[np.ndarray, "output mode 2"]
    rigid: Int[np.ndarray, "output input"]
    integral: Int[np.ndarray, "output input"]
    lower: Int[np.ndarray, "output input"]
    direct: Int[np.ndarray, "output input"]
    delay: Int[np.ndarray, " output"]
    path: Int[np.ndarray, "output input"]
    size: int


def places_of(model: MeasurementModel, structure: ModelStructure) -> UnknownPlaces:
    """The order of the unknowns; last axis of ``b`` and ``c``: real and imaginary part."""
    pair = model.is_pair
    modes, (outputs, inputs) = len(pair), model.direct.shape
    parts = np.stack([np.ones(modes, bool), pair & (not structure.real_constants)], axis=1)
    first = np.argmax(model.poles[:, None] == model.poles[None], axis=1)
    alone = np.bincount(first, minlength=modes)[first] == 1
    free_b = parts[:, None] & alone[:, None, None] & np.ones((modes, inputs, 1), bool)
    free_b[np.arange(modes), np.argmax(np.abs(model.participation), axis=1)] = False
    own = first == np.arange(modes)
    late = np.arange(outputs) < (1 if structure.common_delay else outputs)
    entries = (outputs, inputs)
    free = (
        own,
        own & pair,
        free_b,
        np.broadcast_to(parts, (outputs, modes, 2)),
        np.full(entries, model.rigid is not None),
        np.full(entries, model.integral is not None),
        np.full(entries, structure.with_lower),
        np.full(entries, structure.with_direct),
        late & structure.with_delay,
        _free_paths(model, structure),
    )
    found: list[np.ndarray] = []
    used = 0
    for mask in free:
        place = np.full(mask.shape, -1)
        place[mask] = used + np.arange(np.sum(mask))
        used += int(np.sum(mask))
        found.append(place)
    sigma, omega, b, c, rigid, integral, lower, direct, delay, path = found
    delay = delay[:1].repeat(outputs) if structure.common_delay else delay
    return UnknownPlaces(
        sigma=sigma[first],
        omega=omega[first],
        b=b,
        c=c,
        rigid=rigid,
        integral=integral,
        lower=lower,
        direct=direct,
        delay=delay,
        path=path,
        size=used,
    )


def _free_paths(model: MeasurementModel, structure: ModelStructure) -> Bool[np.ndarray, "output input"]:
    if model.path_delay_s is None or not structure.with_delay:
        return np.zeros(model.direct.shape, bool)
    earliest = np.argmin(model.path_delay_s, axis=1)
    return np.arange(model.direct.shape[1]) != earliest[:, None]


def unknowns_of(model: MeasurementModel, structure: ModelStructure) -> Float[np.ndarray, " unknown"]:
    """The vector of unknowns of a model."""
    at = places_of(model, structure)
    x = np.zeros(at.size)
    omega = np.imag(model.poles)
    phi = constants_of(model, structure)
    _put(x, at.sigma, np.log(-np.real(model.poles)))
    _put(x, at.omega, np.log(np.where(model.is_pair, omega, 1.0)))
    _put(x, at.b, _parts(model.participation))
    _put(x, at.c, _parts(phi))
    for place, value in (
        (at.rigid, part_of(model, model.rigid)),
        (at.integral, part_of(model, model.integral)),
        (at.lower, model.lower),
        (at.direct, model.direct),
        (at.delay, model.delay_s),
        (at.path, part_of(model, model.path_delay_s)),
    ):
        _put(x, place, value)
    return x


def part_of(model: MeasurementModel, part: np.ndarray | None) -> Float[np.ndarray, "output input"]:
    """An optional part of the model."""
    return np.zeros(model.direct.shape) if part is None else part


def _put(x: np.ndarray, place: np.ndarray, value: np.ndarray) -> None:
    x[place[place >= 0]] = value[place >= 0]


def _take(x: np.ndarray, place: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    return np.where(place >= 0, x[np.maximum(place, 0)], otherwise)


def constants_of(model: MeasurementModel, structure: ModelStructure) -> Complex[np.ndarray, "output mode"]:
    """c as the fit has it: phi = 2 j omega_d c of a pair with real constants."""
    return model.shapes * unit_of(model.poles, model.is_pair, structure)


def unit_of(poles: np.ndarray, pair: np.ndarray, structure: ModelStructure) -> np.ndarray:
    """The factor from an output vector to a modal constant, where these are real."""
    return np.where(pair & structure.real_constants, 2j * np.imag(poles), 1.0)


def model_at(
    model: MeasurementModel, structure: ModelStructure, x: Float[np.ndarray, " unknown"]
) -> MeasurementModel:
    """The model with the unknowns ``x``, all else as in ``model``; no delay is negative."""
    at, pair = places_of(model, structure), model.is_pair
    omega = np.where(pair, np.exp(_take(x, at.omega, np.zeros(len(pair)))), np.imag(model.poles))
    poles = -np.exp(x[at.sigma]) + 1j * omega
    b = _complex(x, at.b, model.participation)
    c = _complex(x, at.c, constants_of(model, structure)) / unit_of(poles, pair, structure)
    return dataclasses.replace(
        model,
        poles=poles,
        shapes=c,
        participation=b,
        lower=_take(x, at.lower, model.lower),
        direct=_take(x, at.direct, model.direct),
        delay_s=np.maximum(_take(x, at.delay, model.delay_s), 0.0),
        rigid=None if model.rigid is None else _take(x, at.rigid, model.rigid),
        integral=None if model.integral is None else _take(x, at.integral, model.integral),
        path_delay_s=(
            None if model.path_delay_s is None else np.maximum(_take(x, at.path, model.path_delay_s), 0.0)
        ),
    )


def _parts(z: np.ndarray) -> np.ndarray:
    return np.stack([np.real(z), np.imag(z)], axis=-1)


def _complex(x: np.ndarray, place: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    parts = _take(x, place, _parts(otherwise))
    return parts[..., 0] + 1j * parts[..., 1]


def ties(model: MeasurementModel, structure: ModelStructure) -> Float[np.ndarray, "tie unknown"]:
    """Derivatives of the sum of all residues of each path, where the fit held it at zero."""
    at = places_of(model, structure)
    outputs, inputs = model.direct.shape
    if not structure.relative_degree_two:
        return np.zeros((0, at.size))
    G = np.zeros((outputs, inputs, at.size))
    twice = np.where(model.is_pair, 2.0, 1.0)
    unit = 1.0 / unit_of(model.poles, model.is_pair, structure)
    for m in range(len(model.poles)):
        for o in range(outputs):
            for i in range(inputs):
                c, b = model.shapes[o, m], model.participation[m, i]
                for place, slope in ((at.c[o, m], unit[m] * b), (at.b[m, i], c)):
                    for part, factor in zip(place, (1.0, 1j), strict=True):
                        if part >= 0:
                            G[o, i, part] += twice[m] * (factor * slope).real
    return G.reshape(-1, at.size)
