r"""Root mean square in a frequency band, in closed form.

rms^2 = 2 \int_{f1}^{f2} |G|^2 S df with a two-sided intensity S. With G = \sum_i c_i b_i / (jw - l_i) each
pair of poles contributes \int dw / ((jw - l_i)(-jw - l_j^*)), a difference of logarithms over l_i + l_j^*
(Gawronski and Juang 1990, Int. J. Systems Science 21, "Model reduction in limited time and frequency
intervals"). Grids are wrong by as much as they miss the resonances.
"""

from __future__ import annotations

import itertools
from typing import cast

import numpy as np
import scipy.integrate as si
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, NumericalError
from middeck.systems.response import statespace_response
from middeck.systems.stability import GROWTH_LIMIT
from middeck.systems.statespace import StateSpace

AGREEMENT = 1e-11
"""Relative difference of each output's response from its pole sum up to which the pole sum is used: the
squares are then good to 1e-10 with room to spare."""
CLUSTER = 1e-2
"""Poles closer to the origin than this part of the lower band limit may be defective: kept together."""


def band_rms(
    system: StateSpace, intensity: Float[np.ndarray, "input input"], band_hz: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """Rms of each output within ``band_hz`` under white noise of two-sided ``intensity`` [unit^2/Hz].

    ``inf`` where a pole grows, or lies on the imaginary axis within the band (an integral over frequency
    would stay finite for the first and look good). Poles on the axis outside the band are no obstacle, the
    double ones of rigid-body motion at the origin included. Raises `ConfigError` for a band that is not
    0 <= low < high.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])           # |G|^2 = 1 / (1 + w^2)
    >>> float(band_rms(lag, np.eye(1), (0.0, 1.0 / (2.0 * np.pi)))[0] ** 2 * np.pi / np.arctan(1.0))
    1.0
    """
    w1, w2 = _check_band(band_hz)
    root = _square_root(intensity)
    B, D = system.B @ root, system.D @ root
    values, V = np.linalg.eig(system.A) if len(system.A) else (np.zeros(0), np.zeros((0, 0)))
    on_axis = (
        (np.abs(np.real(values)) <= GROWTH_LIMIT)
        & (np.abs(np.imag(values)) >= w1)
        & (np.abs(np.imag(values)) <= w2)
    )
    if np.any(np.real(values) > GROWTH_LIMIT) or np.any(on_axis):
        return np.full(len(system.C), np.inf)
    noisy = StateSpace(system.A, B, system.C, D)
    modal = _as_pole_sum(noisy, values.astype(complex), V, (w1, w2))
    square = _block_integral(noisy, w1, w2) if modal is None else _pair_integral(*modal, D, w1, w2)
    # A negative square is rounding about zero.
    return np.sqrt(np.maximum(square, 0.0) / np.pi)


def band_rms_by_quadrature(
    system: StateSpace, intensity: Float[np.ndarray, "input input"], band_hz: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """The same by adaptive quadrature of |G|^2, cut at the resonances: slow, independent, for checks.

    The integrand is evaluated by solving with (jw I - A); no eigenvalue enters but to place the cuts.
    Absolute tolerance 1e-13 of the whole for each piece. It is an integral and does not know whether the
    system is stable.
    """
    w1, w2 = _check_band(band_hz)
    root = _square_root(intensity)
    noisy = StateSpace(system.A, system.B @ root, system.C, system.D @ root)
    cuts = np.unique(np.concatenate([_cuts(np.linalg.eigvals(system.A), w1, w2), [w1, w2]]))
    scale = np.ones(len(system.C))

    def density(w: float) -> Float[np.ndarray, " output"]:
        G = statespace_response(noisy, np.array([w]))[0]
        return np.sum(np.abs(G) ** 2, axis=1) / scale

    # One pass to know each output's size, so that small outputs get the same relative accuracy.
    rough = np.array([density(w) for w in (cuts[1:] + cuts[:-1]) / 2.0])
    total = np.sum(rough * np.diff(cuts)[:, None], axis=0)
    scale = np.where(total > 0.0, total, 1.0)
    square = np.zeros(len(scale))
    for low, high in itertools.pairwise(cuts):
        part = si.quad_vec(density, low, high, epsabs=1e-13, epsrel=0.0, norm="max", quadrature="gk21")
        square = square + cast("tuple[np.ndarray, float]", part)[0]
    return np.sqrt(square * scale / np.pi)


def _check_band(band_hz: tuple[float, float]) -> tuple[float, float]:
    low, high = band_hz
    if not 0.0 <= low < high:
        raise ConfigError(f"band {band_hz} Hz: the limits must be ordered and not negative")
    return 2.0 * np.pi * low, 2.0 * np.pi * high


def _square_root(intensity: Float[np.ndarray, "input input"]) -> Float[np.ndarray, "input input"]:
    values, vectors = np.linalg.eigh(np.asarray(intensity, dtype=float))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _cuts(values: np.ndarray, w1: float, w2: float) -> Float[np.ndarray, " cut"]:
    """Around each resonance: the peak and three, thirty and three hundred half-widths to both sides."""
    peaks = values[np.imag(values) > 0.0]
    offsets = np.array([-300.0, -30.0, -3.0, 0.0, 3.0, 30.0, 300.0])
    cuts = (np.imag(peaks)[:, None] + np.abs(np.real(peaks))[:, None] * offsets).ravel()
    octaves = w2 * 0.5 ** np.arange(1, 24)
    cuts = np.concatenate([cuts, octaves])
    return cuts[(cuts > w1) & (cuts < w2)]


def _as_pole_sum(
    system: StateSpace, values: np.ndarray, V: np.ndarray, band: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Poles, C V and V^-1 B, or None where the eigenvectors cannot represent the system."""
    try:
        Bv = np.linalg.solve(V.astype(complex), system.B)
    except np.linalg.LinAlgError:
        return None
    Cv = system.C @ V
    # Eigenvectors of a defective pair coincide to rounding and make Bv huge: squares would overflow.
    if not np.abs(Bv).max(initial=0.0) < 1e100:
        return None
    probe = _probes(values, np.linalg.norm(Cv, axis=0) * np.linalg.norm(Bv, axis=1), band)
    direct = statespace_response(system, probe)
    summed = (Cv / (1j * probe[:, None, None] - values)) @ Bv + system.D
    error = np.linalg.norm(summed - direct, axis=2).max(axis=0, initial=0.0)
    size = np.linalg.norm(direct, axis=2).max(axis=0, initial=0.0)
    return (values, Cv, Bv) if np.all(error <= AGREEMENT * size) else None


def _probes(values: np.ndarray, weight: np.ndarray, band: tuple[float, float]) -> Float[np.ndarray, " line"]:
    """Where a pole sum would show that it is wrong: within the band, and at its four strongest resonances."""
    low = band[0] or 1e-4 * band[1]
    peak = np.where(
        (np.imag(values) > low) & (np.imag(values) < band[1]),
        weight / np.maximum(np.abs(np.real(values)), 1e-300),
        0.0,
    )
    strongest = np.argsort(-peak)[:4]
    return np.concatenate([np.geomspace(low, band[1], 3), np.imag(values)[strongest[peak[strongest] > 0.0]]])


def _log_integral(values: np.ndarray, w1: float, w2: float) -> Complex[np.ndarray, " pole"]:
    """The integral of dw / (jw - l) for poles that are not right of the axis (so no branch is crossed)."""
    return -1j * (np.log(1j * w2 - values) - np.log(1j * w1 - values))


def _pair_integral(
    values: np.ndarray, Cv: np.ndarray, Bv: np.ndarray, D: np.ndarray, w1: float, w2: float
) -> Float[np.ndarray, " output"]:
    L = _log_integral(values, w1, w2)
    X = (Bv @ Bv.conj().T) * _pair_kernel(values, L, w1, w2)
    square = np.real(np.sum((Cv @ X) * Cv.conj(), axis=1))
    cross = np.real(np.sum(((Cv * L) @ Bv) * D, axis=1))
    return square + 2.0 * cross + np.sum(D**2, axis=1) * (w2 - w1)


def _pair_kernel(values: np.ndarray, L: np.ndarray, w1: float, w2: float) -> Complex[np.ndarray, "pole pole"]:
    """The integral of dw / ((jw - l_i)(-jw - l_j^*)) for each pair.

    It is minus the divided difference of L between l_i and m_j = -l_j^*. Where the two nearly meet (light
    damping of one mode with itself, poles at the origin) the difference quotient cancels; there the
    derivative L' is averaged between them instead, by a Gauss rule.
    """
    a, m = np.broadcast_arrays(values[:, None], -np.conj(values)[None, :])
    gap = a - m
    reach = np.minimum(np.abs(1j * w1 - a), np.abs(1j * w2 - a))
    # A band that contains the resonance lies between the two: no cancellation, and no path for the rule.
    between = (np.imag(a) > w1) & (np.imag(a) < w2) & (np.imag(m) > w1) & (np.imag(m) < w2)
    near = (np.abs(gap) < 0.1 * reach) & ~between
    safe = np.where(near, 1.0, gap)
    kernel = -(L[:, None] + L.conj()[None, :]) / safe
    if near.any():
        kernel[near] = _mean_derivative(a[near], m[near], w1, w2)
    return kernel


def _mean_derivative(a: np.ndarray, m: np.ndarray, w1: float, w2: float) -> Complex[np.ndarray, " pair"]:
    # Poles of L' are ten path lengths away or more: 12 Gauss points leave (1/40)^24.
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x = m + 0.5 * (nodes[:, None] + 1.0) * (a - m)
    slope = 1j * (1.0 / (1j * w2 - x) - 1.0 / (1j * w1 - x))
    return -0.5 * weights @ slope


def _block_integral(system: StateSpace, w1: float, w2: float) -> Float[np.ndarray, " output"]:
    """The same without eigenvectors, by Schur form: X = int R B B^H R^H dw from one Sylvester equation.

    A R = jw R - I gives A X + X A^H = -(L W + W L^H) with W = B B^H and L = int R dw, a difference of matrix
    logarithms. It is singular for poles at the origin: those are split off, and their part is a power
    series in A/w, finite where they are nilpotent.
    """
    T, Q, k = _ordered_schur(system.A, CLUSTER * w1)
    B, C = Q.conj().T @ system.B, system.C @ Q
    Y = (
        sla.solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:])
        if 0 < k < len(T)
        else np.zeros((k, len(T) - k))
    )
    B1, B2, C1, C2 = B[:k] - Y @ B[k:], B[k:], C[:, :k], C[:, :k] @ Y + C[:, k:]
    powers = _scaled_powers(T[:k, :k] / w1) if k else []
    L1 = _origin_log(powers, w1, w2, k)
    L2 = -1j * (_shifted_log(T[k:, k:], w2) - _shifted_log(T[k:, k:], w1))
    X = np.zeros((len(T), len(T)), dtype=complex)
    X[:k, :k] = _origin_pairs(powers, B1, w1, w2)
    X[:k, k:] = _sylvester(T[:k, :k], T[k:, k:], L1, L2, B1 @ B2.conj().T)
    X[k:, :k] = X[:k, k:].conj().T
    X[k:, k:] = _sylvester(T[k:, k:], T[k:, k:], L2, L2, B2 @ B2.conj().T)
    Cs, LB = np.hstack([C1, C2]), np.vstack([L1 @ B1, L2 @ B2])
    square = np.real(np.sum((Cs @ X) * Cs.conj(), axis=1))
    cross = np.real(np.sum((Cs @ LB) * system.D, axis=1))
    return square + 2.0 * cross + np.sum(system.D**2, axis=1) * (w2 - w1)


def _ordered_schur(A: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Complex Schur form with the poles inside ``radius`` first, and their number."""

    def inside(pole: complex) -> bool:
        return abs(pole) < radius

    form = cast("tuple[np.ndarray, np.ndarray, int]", sla.schur(A, output="complex", sort=inside))
    return form


def _shifted_log(T: np.ndarray, w: float) -> Complex[np.ndarray, "row column"]:
    """log(jw I - T) of a triangular matrix."""
    if not len(T):
        return T
    return np.asarray(cast("np.ndarray", sla.logm(1j * w * np.eye(len(T)) - T)))


def _sylvester(
    A1: np.ndarray, A2: np.ndarray, L1: np.ndarray, L2: np.ndarray, W: np.ndarray
) -> Complex[np.ndarray, "row column"]:
    if not W.size:
        return W
    return np.asarray(sla.solve_sylvester(A1, A2.conj().T, -(L1 @ W + W @ L2.conj().T)))


def _scaled_powers(A: np.ndarray) -> list[np.ndarray]:
    """I, A, A^2 ... until nothing is left of them."""
    powers = [np.eye(len(A), dtype=complex)]
    while np.linalg.norm(powers[-1]) > 1e-17:
        powers.append(powers[-1] @ A)
        if len(powers) > 100:
            raise NumericalError(
                "poles near the origin, badly scaled: their band integral does not converge",
                hint="scale the states, or raise the lower limit of the band",
            )
    return powers


def _origin_log(powers: list[np.ndarray], w1: float, w2: float, k: int) -> Complex[np.ndarray, "row column"]:
    """int (jw I - A)^-1 dw = sum A^n int (jw)^-(n+1) dw."""
    total = np.zeros((k, k), dtype=complex)
    for n, power in enumerate(powers):
        total += power * (1j ** -(n + 1)) * _power_integral(n + 1, w2 / w1)
    return total


def _origin_pairs(
    powers: list[np.ndarray], B: np.ndarray, w1: float, w2: float
) -> Complex[np.ndarray, "row column"]:
    total = np.zeros((len(B), len(B)), dtype=complex)
    for n, left in enumerate(powers):
        for m, right in enumerate(powers):
            phase = (1j ** -(n + 1)) * ((-1j) ** -(m + 1))
            total += phase * _power_integral(n + m + 2, w2 / w1) * (left @ B) @ (right @ B).conj().T
    return total / w1 if len(B) else total


def _power_integral(n: int, ratio: float) -> float:
    """The integral of x^-n from 1 to ``ratio``."""
    return float(np.log(ratio)) if n == 1 else (1.0 - ratio ** (1 - n)) / (n - 1)
