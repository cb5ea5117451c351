"""Local models: over a few neighbouring lines, a smooth response and a smooth transient.

The DFT of a record that is not a whole number of steady periods obeys, exactly,

    Y(k) = G(k) U(k) + T(k) + V(k),

with one smooth function T for what the record began and ended with (Pintelon and Schoukens 2012, section
2.6.3). Over the lines k + r of a window, G is N(r)/D(r) and T is M(r)/D(r), polynomials in r of order two
with D(0) = 1. With D = 1 it is the local polynomial method (Pintelon, Schoukens, Vandersteen and Barbe 2010),
linear least squares. With D of order two a window can hold a whole resonance (local rational method: McKelvey
and Guerin 2012): D is common to all outputs, as poles are, and is found from

    min over d of sum_o d^H S_o d / sigma_o^2,    d = (1, d1, d2),

where S_o is what U and the transient leave of (Y_o, r Y_o, r^2 Y_o). That leaves D V, which is as strong on
all lines of a window if V comes from forces on the article: such noise peaks with its modes. For noise of
sensors rows are divided by D and the window is solved again (Sanathanan and Koerner 1963), so that V itself
is left. The likelier of the two is taken, by the window and by the others of the record.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Inexact, Int
from scipy.special import expit

from middeck.identification.spectra.variance_of_lines import variance_of
from middeck.values import record as frozen

# Order of each polynomial. Even orders cost the same bias as the next odd one at the middle of a window.
ORDER = 2
TERMS = ORDER + 1
# Entries of the matrices solved at once: what stays in cache.
AT_ONCE = 1 << 17
# Added to unit diagonals: rounding of double precision, where a denominator is not determined by its window.
RIDGE = 1e-13
# Turns of the search for how many windows have noise of forces: they halve what is left, or more.
TURNS = 30


@frozen
class LocalModel:
    """Half width of the window in lines, and whether there is a denominator."""

    half: int
    rational: bool


@frozen(kw_only=True)
class LocalFit:
    """The estimates of the windows, and how well they predict the omitted line.

    Attributes:
        covariance: Covariance of the outputs' residuals.
        line_inverse_power: Inverse of the inputs' power on one line, averaged over the window.
        prediction: Mean square error of each line's outputs predicted without it (Allen 1974).
        denominator: d1 and d2 of each window, zero for polynomials.
        volume: Logarithm of the determinant of the Gram matrix of an output's regressors.
    """

    H: Complex[np.ndarray, "line output input"]
    variance: Float[np.ndarray, "line output input"]
    covariance: Complex[np.ndarray, "line output output"]
    inverse_power: Complex[np.ndarray, "line input input"]
    line_inverse_power: Complex[np.ndarray, "line input input"]
    prediction: Float[np.ndarray, "line output"]
    denominator: Complex[np.ndarray, "line term"]
    volume: Float[np.ndarray, " line"]


def freedom(model: LocalModel, experiments: int, inputs: int, outputs: int) -> float:
    """Complex degrees of freedom that a window leaves."""
    rows = experiments * (2 * model.half + 1)
    return rows - unknowns(experiments, inputs) - (ORDER / outputs if model.rational else 0.0)


def unknowns(experiments: int, inputs: int) -> int:
    """Coefficients of one output: its responses, and a transient for each experiment."""
    return TERMS * (experiments + inputs)


def fit_windows(
    U: Complex[np.ndarray, "line experiment input"],
    Y: Complex[np.ndarray, "line experiment output"],
    lines: Int[np.ndarray, " estimate"],
    model: LocalModel,
) -> LocalFit:
    """The response at ``lines``, each from the window around it (beside it, at the ends of the spectrum).

    Rows are as they are: noise of forces, where there is a denominator.
    """
    return _joined([_solve(*windows, model, None) for windows in _windows(U, Y, lines, model)])


class BothKinds(NamedTuple):
    """Windows with a denominator, fitted for noise of forces and for noise of sensors.

    ``gain`` is the log likelihood of the former less that of the latter; ``worth`` is the number of windows
    that share no line.
    """

    forces: LocalFit
    sensors: LocalFit
    gain: Float[np.ndarray, " line"]
    worth: float

    def likelier(self, odds: float) -> LocalFit:
        """The likelier fit of each window; ``odds`` are the log odds of forces from all windows together."""
        peaks = self.gain + odds > 0.0
        pairs = {
            f.name: (getattr(self.forces, f.name), getattr(self.sensors, f.name))
            for f in dataclasses.fields(LocalFit)
        }
        return LocalFit(**{name: np.where(peaks, a.T, b.T).T for name, (a, b) in pairs.items()})


def both_kinds(
    U: Complex[np.ndarray, "line experiment input"],
    Y: Complex[np.ndarray, "line experiment output"],
    lines: Int[np.ndarray, " estimate"],
    model: LocalModel,
) -> BothKinds:
    """The windows of `fit_windows` with a denominator, once for each kind of noise."""
    parts = [_both_kinds(windows, model) for windows in _windows(U, Y, lines, model)]
    forces, sensors, gain = zip(*parts, strict=True)
    return BothKinds(
        _joined(forces), _joined(sensors), np.concatenate(gain), len(lines) / (2 * model.half + 1)
    )


def _both_kinds(windows: Windows, model: LocalModel) -> tuple[LocalFit, LocalFit, np.ndarray]:
    forces = _solve(*windows, model, None)
    x, d = windows.x, forces.denominator
    weight = 1.0 / (1.0 + d[:, :1] * x + d[:, 1:] * x**2)
    sensors = _solve(*windows, model, weight)
    return forces, sensors, _gain(forces, sensors, weight, windows, model)


def odds_of_forces(kinds: Collection[BothKinds]) -> float:
    """Log odds for noise of forces in a window, given only the other windows.

    The likeliest mixture of the two kinds (Dempster, Laird and Rubin 1977), with one window of each before
    any is seen: narrow windows say little, and the others of a record show what disturbs it.
    """
    worth = sum(both.worth for both in kinds)
    odds = 0.0
    for _ in range(TURNS):
        forces = sum(both.worth * float(np.mean(expit(both.gain + odds))) for both in kinds)
        odds = float(np.log((1.0 + forces) / (1.0 + worth - forces)))
    return odds


def _gain(
    forces: LocalFit,
    sensors: LocalFit,
    weight: Complex[np.ndarray, "line row"],
    windows: Windows,
    model: LocalModel,
) -> Float[np.ndarray, " line"]:
    """Logarithm of the likelihood of forces over that of sensors, the mean of the outputs.

    The restricted one (Patterson and Thompson 1971): regressors divided by D follow most of the noise at a
    peak of few lines, and what they leave there says little.
    """
    experiments, inputs, outputs = *windows.U.shape[1:3], windows.Y.shape[2]
    least = np.finfo(float).tiny
    powers = (np.maximum(np.real(np.linalg.diagonal(f.covariance)), least) for f in (sensors, forces))
    quieter = np.mean(np.subtract(*(np.log(p) for p in powers)), axis=1)
    peak = experiments * np.sum(np.log(np.abs(weight) ** 2), axis=1)
    return freedom(model, experiments, inputs, outputs) * quieter + sensors.volume - forces.volume - peak


def _joined(parts: Sequence[LocalFit]) -> LocalFit:
    names = [f.name for f in dataclasses.fields(LocalFit)]
    return LocalFit(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


class Windows(NamedTuple):
    """Inputs and outputs of some windows, offsets from the own line in halves, and its place."""

    U: Complex[np.ndarray, "line experiment input row"]
    Y: Complex[np.ndarray, "line experiment output row"]
    x: Float[np.ndarray, "line row"]
    own: Int[np.ndarray, " line"]


def _windows(U: np.ndarray, Y: np.ndarray, lines: np.ndarray, model: LocalModel) -> Iterator[Windows]:
    """Some windows at a time."""
    columns = TERMS * (U.shape[2] + (Y.shape[2] if model.rational else 1))
    some = max(16, AT_ONCE // ((2 * model.half + 1) * U.shape[1] * columns))
    for k in range(0, len(lines), some):
        rows, own, x = window_rows(len(U), lines[k : k + some], model.half)
        # Rows last: all products run along them.
        yield Windows(np.moveaxis(U[rows], 1, 3), np.moveaxis(Y[rows], 1, 3), x, own)


def window_rows(count: int, lines: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of each window, the place of its own line among them, and offsets from that line, in halves."""
    start = np.clip(lines - half, 0, count - (2 * half + 1))
    rows = start[:, None] + np.arange(2 * half + 1)
    return rows, lines - start, (rows - lines[:, None]) / half


def transient_basis(
    x: Float[np.ndarray, "estimate row"], own: np.ndarray, weight: np.ndarray | None
) -> Inexact[np.ndarray, "estimate term row"]:
    """Orthonormal rows that span the (weighted) transients of each window."""
    if weight is not None:
        span = (x[:, :, None] ** np.arange(TERMS)) * weight[:, :, None]
        return np.linalg.qr(span)[0].mT
    # Unweighted, all windows with their line in the same place share one basis.
    _, first, back = np.unique(own, return_index=True, return_inverse=True)
    return np.ascontiguousarray(np.linalg.qr(x[first][:, :, None] ** np.arange(TERMS))[0].mT)[back]


def _volume_of_transient(
    x: Float[np.ndarray, "estimate row"], weight: np.ndarray | None
) -> Float[np.ndarray, " estimate"]:
    """Logarithm of the determinant of the Gram matrix of a window's transient."""
    span = np.stack([np.ones_like(x), x, x * x], axis=1)
    size = np.ones(x.shape) if weight is None else np.abs(weight)
    return np.linalg.slogdet((span * size[:, None, :] ** 2) @ span.mT)[1]


def beside(
    Q: Inexact[np.ndarray, "estimate term row"], X: Complex[np.ndarray, "estimate column row"]
) -> Complex[np.ndarray, "estimate column row"]:
    """The part of the rows of X that the transients leave."""
    return X - (X @ Q.conj().mT) @ Q


def _solve(
    U: Complex[np.ndarray, "estimate experiment input row"],
    Y: Complex[np.ndarray, "estimate experiment output row"],
    x: Float[np.ndarray, "estimate row"],
    own: np.ndarray,
    model: LocalModel,
    weight: np.ndarray | None,
) -> LocalFit:
    count, experiments, inputs, _ = U.shape
    outputs = Y.shape[2]
    Q = transient_basis(x, own, weight)
    X, Z = _columns(U, Y, x, Q, weight, ORDER if model.rational else 0)
    Xh = X.conj().mT
    A = scaled_inverse(np.sum(X @ Xh, axis=1))
    theta = np.sum(Z @ Xh, axis=1) @ A
    unexplained = (Z - theta[:, None] @ X).reshape(count, experiments, -1, outputs, x.shape[1])
    # Only the constant terms are the response of the own line, at r = 0.
    theta = theta[:, :, :inputs].reshape(count, -1, outputs, inputs)
    d, spread = _denominator(unexplained)
    full = np.concatenate([np.ones((count, 1)), d], axis=1)
    left = np.einsum("kecor,kc->keor", unexplained, full)
    covariance = np.sum(left @ left.conj().mT, axis=1)
    covariance /= freedom(model, experiments, inputs, outputs)
    inverse_power = A[:, :inputs, :inputs].conj()
    slope = theta[:, 1:]
    power = np.sum(U @ U.conj().mT, axis=1) / U.shape[3]
    return LocalFit(
        H=np.einsum("kcoi,kc->koi", theta, full),
        variance=variance_of(covariance, inverse_power)
        + np.real(np.einsum("ktoi,kts,ksoi->koi", slope, spread, slope.conj())),
        covariance=covariance,
        inverse_power=inverse_power,
        line_inverse_power=scaled_inverse(power).conj(),
        prediction=_prediction(Q, X, A, left, own),
        denominator=d if model.rational else np.zeros((count, ORDER)),
        volume=experiments * _volume_of_transient(x, weight) - np.linalg.slogdet(A)[1],
    )


def _columns(
    U: np.ndarray, Y: np.ndarray, x: np.ndarray, Q: np.ndarray, weight: np.ndarray | None, last: int
) -> tuple[
    Complex[np.ndarray, "estimate experiment unknown row"],
    Complex[np.ndarray, "estimate experiment column row"],
]:
    """The parts of r^s U, and of Y to r^last Y, that the transients leave."""
    count, experiments, _, width = U.shape
    # Products: a power with an array of exponents takes ten times as long.
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    if weight is not None:
        powers = powers * weight[:, None, :]
    rU = powers[:, None, :, None, :] * U[:, :, None]
    rY = powers[:, None, : last + 1, None, :] * Y[:, :, None]
    X, Z = (beside(Q, r.reshape(count, -1, width)) for r in (rU, rY))
    return X.reshape(count, experiments, -1, width), Z.reshape(count, experiments, -1, width)


def scaled_inverse(A: Complex[np.ndarray, "estimate a a"]) -> Complex[np.ndarray, "estimate a a"]:
    """Inverse of Gram matrices, scaled to a unit diagonal first."""
    size = 1.0 / np.sqrt(np.maximum(np.real(np.linalg.diagonal(A)), np.finfo(float).tiny))
    unit = A * size[:, :, None] * size[:, None, :] + RIDGE * np.eye(A.shape[1])
    return np.linalg.inv(unit) * size[:, :, None] * size[:, None, :]


def _denominator(
    Z: Complex[np.ndarray, "estimate experiment column output row"],
) -> tuple[Complex[np.ndarray, "estimate term"], Complex[np.ndarray, "estimate term term"]]:
    """d1 and d2 of each window, if Z has columns for them, and their covariance."""
    count, experiments, columns, _, width = Z.shape
    d = np.zeros((count, columns - 1), dtype=complex)
    inverse = np.zeros((count, columns - 1, columns - 1), dtype=complex)
    if columns == 1:
        return d, inverse
    by_output = np.swapaxes(Z, 2, 3)
    S = np.sum(by_output.conj() @ by_output.mT, axis=1)
    power = np.real(S[:, :, 0, 0])
    # Once with each output by its size, and once by what is left of it; more changes little.
    for _ in range(2):
        total = np.einsum("kots,ko->kts", S, 1.0 / np.maximum(power, np.finfo(float).tiny))
        inverse = scaled_inverse(total[:, 1:, 1:])
        d = -(inverse @ total[:, 1:, :1])[:, :, 0]
        full = np.concatenate([np.ones((count, 1)), d], axis=1)
        power = np.maximum(np.real(np.einsum("kt,kots,ks->ko", full.conj(), S, full)), RIDGE * power)
    return d, inverse / (experiments * width)


def _prediction(
    Q: np.ndarray, X: np.ndarray, A: np.ndarray, left: np.ndarray, own: np.ndarray
) -> Float[np.ndarray, "estimate output"]:
    """Mean square of the residual of the own line, had it not been used: e / (1 - leverage)."""
    pick = np.arange(len(own))
    mine = X[pick, :, :, own]
    leverage = np.real(np.einsum("kea,kab,keb->ke", mine.conj(), A, mine))
    leverage += np.sum(np.abs(Q[pick, :, own]) ** 2, axis=1)[:, None]
    # An own line that alone decides something predicts nothing: rounding may bring its leverage to one.
    apart = np.maximum(1.0 - leverage, 1e-6)
    return np.mean(np.abs(left[pick, :, :, own] / apart[:, :, None]) ** 2, axis=1)
