"""Less of a model: modes that do nothing, and poles that stand for one, are taken out.

How many states a model needs its Hankel singular values tell: the square roots of the eigenvalues of Wc Wo,
which in modal form are known in closed form, Wc_mn = -b_m b_n^H / (p_m + conj p_n) and likewise Wo (Glover
1984). But balanced truncation mixes modes. Here modes stay what they are: one after the other is dropped, or
two neighbours become one of the residue of both, whichever changes the response least, as long as the change
of no path exceeds a share of that path's largest response. A pole that a zero all but cancels goes the same
way: it is a mode of little residue, or two that undo each other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import (
    MeasurementModel,
    damping_ratio,
    is_single,
    model_response,
    natural_hz,
)
from middeck.values import record

# Lines between the slowest and the fastest mode, and those across each mode, in half-power bandwidths.
BETWEEN = 200
ACROSS = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])


@record
class MinimalModel:
    """A model with fewer modes.

    Attributes:
        model: What is left.
        dropped_hz: Natural frequencies of the modes that were dropped or merged, in that order [Hz].
        error: Largest change of each path's response, as a share of its largest size.
        hankel: Hankel singular values of the first model, each output and input scaled by its largest
            response.
    """

    model: MeasurementModel
    dropped_hz: Float[np.ndarray, " dropped"]
    error: Float[np.ndarray, "output input"]
    hankel: Float[np.ndarray, " state"]


def minimal_model(model: MeasurementModel, *, error: float = 1e-3) -> MinimalModel:
    """The model without modes that change no path's response by more than ``error`` of its largest size.

    Raises `ConfigError` if ``error`` is not a share between zero and one.
    """
    if not 0.0 < error < 1.0:
        raise ConfigError(f"an error of {error} is no share of the response", hint="1e-6 to 0.1")
    hz = _lines(model)
    first = model_response(model, hz)
    size = np.maximum(np.max(np.abs(first), axis=0), np.finfo(float).tiny)
    dropped: list[float] = []
    left, made = model, np.zeros(size.shape)
    while True:
        tried = [
            (np.max(np.abs(model_response(smaller, hz) - first), axis=0) / size, smaller, gone)
            for smaller, gone in _smaller(left)
        ]
        if not tried:
            break
        change, smaller, gone = min(tried, key=lambda t: float(np.max(t[0])))
        if np.max(change) > error:
            break
        left, made = smaller, change
        dropped.append(gone)
    return MinimalModel(left, np.array(dropped), made, _hankel(model, size))


def _lines(model: MeasurementModel) -> np.ndarray:
    f, zeta = natural_hz(model), damping_ratio(model)
    across = (f[:, None] * (1.0 + ACROSS * zeta[:, None])).ravel()
    highest = np.inf if model.sample_hz is None else 0.5 * model.sample_hz
    low, high = 0.1 * f.min(), min(10.0 * f.max(), highest)
    hz = np.unique(np.concatenate([across, np.geomspace(low, high, BETWEEN)]))
    return hz[(hz >= low) & (hz <= high)]


def _smaller(model: MeasurementModel) -> Iterator[tuple[MeasurementModel, float]]:
    """The model without each mode, and with each two neighbours of a kind made one."""
    modes = np.arange(len(model.poles))
    hz = natural_hz(model)
    if len(modes) > 1:
        for m in modes:
            yield _kept(model, modes != m), float(hz[m])
    for kind in (model.is_pair, ~model.is_pair):
        of_kind = np.flatnonzero(kind)
        ranked = of_kind[np.argsort(hz[of_kind])]
        for m, n in pairwise(ranked):
            yield _merged(model, int(m), int(n)), float(hz[n])


def _kept(model: MeasurementModel, keep: np.ndarray) -> MeasurementModel:
    return dataclasses.replace(
        model, poles=model.poles[keep], shapes=model.shapes[:, keep], participation=model.participation[keep]
    )


def _merged(model: MeasurementModel, m: int, n: int) -> MeasurementModel:
    """Mode m with the residue of both, as far as its rank is one, at their mean pole by residue."""
    both = [np.outer(model.shapes[:, k], model.participation[k]) for k in (m, n)]
    weight = np.array([np.linalg.norm(r) for r in both])
    share = weight / max(float(weight.sum()), np.finfo(float).tiny)
    left, size, right = np.linalg.svd(both[0] + both[1])
    poles, shapes, participation = model.poles.copy(), model.shapes.copy(), model.participation.copy()
    if weight.any():
        poles[m] = complex(np.sum(share * model.poles[[m, n]]))
    if is_single(model.poles[[m]], model.sample_hz)[0]:
        poles[m] = poles[m].real + 1j * model.poles[m].imag
    shapes[:, m], participation[m] = left[:, 0] * size[0], right[0]
    merged = dataclasses.replace(model, poles=poles, shapes=shapes, participation=participation)
    return _kept(merged, np.arange(len(poles)) != n)


def _hankel(model: MeasurementModel, size: np.ndarray) -> Float[np.ndarray, " state"]:
    output = np.max(size, axis=1)
    driven = np.max(size / output[:, None], axis=0)
    pair = model.is_pair
    p = np.concatenate([model.poles, model.poles[pair].conj()])
    C = np.hstack([model.shapes, model.shapes[:, pair].conj()]) / output[:, None]
    B = np.vstack([model.participation, model.participation[pair].conj()]) / driven
    if model.sample_hz is None:
        Wc, Wo = _gramian(p, B @ B.conj().T), _gramian(p.conj(), C.conj().T @ C)
    else:
        z = np.exp(p / model.sample_hz)
        Wc = B @ B.conj().T / (1.0 - z[:, None] * z.conj())
        Wo = C.conj().T @ C / (1.0 - z.conj()[:, None] * z)
    squares = np.linalg.eigvals(Wc @ Wo).real
    return np.sort(np.sqrt(np.maximum(squares, 0.0)))[::-1]


def _gramian(p: np.ndarray, right: np.ndarray) -> Complex[np.ndarray, "state state"]:
    return -right / (p[:, None] + p.conj())
