r"""Root mean square in a frequency band, in closed form.

rms^2 = 2 \int_{f1}^{f2} |G|^2 S df with a two-sided intensity S. With G = \sum_i c_i b_i / (jw - l_i) each
pair of poles contributes \int dw / ((jw - l_i)(-jw - l_j^*)), a difference of logarithms over l_i + l_j^*
(Gawronski and Juang 1990, Int. J. Systems Science 21, "Model reduction in limited time and frequency
intervals"). Grids are wrong by as much as they miss the resonances.
"""

from __future__ import annotations

import warnings
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float

from middeck.errors import ConfigError, NumericalError
from middeck.systems.response import statespace_response
from middeck.systems.stability import GROWTH_LIMIT
from middeck.systems.statespace import StateSpace, poles

AGREEMENT = 5e-11
"""Estimated relative error of an rms up to which the sum over poles is used; otherwise the block form."""
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
    noisy = _balanced(system, _square_root(intensity))
    values, V = np.linalg.eig(noisy.A) if len(noisy.A) else (np.zeros(0), np.zeros((0, 0)))
    on_axis = (
        (np.abs(np.real(values)) <= GROWTH_LIMIT)
        & (np.abs(np.imag(values)) >= w1)
        & (np.abs(np.imag(values)) <= w2)
    )
    growing = (np.real(values) > GROWTH_LIMIT) & ~_at_origin(values, noisy.A, w1)
    if np.any(growing) or np.any(on_axis):
        return np.full(len(system.C), np.inf)
    modal = _as_pole_sum(noisy, values.astype(complex), V, (w1, w2))
    square = _block_integral(noisy, w1, w2) if modal is None else _pair_integral(*modal, noisy.D, w1, w2)
    # A negative square is rounding about zero.
    return np.sqrt(np.maximum(square, 0.0) / np.pi)


def _at_origin(values: np.ndarray, A: np.ndarray, w1: float) -> np.ndarray:
    """Poles that cannot be told from a double one at the origin, which rounding splits by sqrt(eps) |A|."""
    split = np.sqrt(np.finfo(float).eps) * np.linalg.norm(A)
    return np.abs(values) < min(CLUSTER * w1, split)


def band_rms_by_quadrature(
    system: StateSpace, intensity: Float[np.ndarray, "input input"], band_hz: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """The same by adaptive quadrature of |G|^2, cut at the resonances: slow, independent, for checks.

    The integrand is evaluated by solving with (jw I - A) in balanced coordinates; no eigenvalue enters but
    to place the first cuts. It is an integral and does not know whether the system is stable.
    """
    w1, w2 = _check_band(band_hz)
    balanced = _balanced(system, _square_root(intensity))
    edges = np.unique(np.concatenate([_cuts(poles(system), w1, w2), [w1, w2]]))
    low, high = edges[:-1], edges[1:]
    whole = _panel_integrals(balanced, low, high)
    square = np.zeros(len(system.C))
    while len(low):
        middle = (low + high) / 2.0
        left, right = (_panel_integrals(balanced, *ends) for ends in ((low, middle), (middle, high)))
        # 1e-13 of the total: also where the panel's own value is uncertain by rounding, halving ends here.
        total = square + np.sum(left + right, axis=0)
        rough = np.any(np.abs(left + right - whole) > 1e-13 * total, axis=1)
        square = square + np.sum((left + right)[~rough], axis=0)
        low, high = np.concatenate([low[rough], middle[rough]]), np.concatenate([middle[rough], high[rough]])
        whole = np.concatenate([left[rough], right[rough]])
    return np.sqrt(square / np.pi)


def _panel_integrals(
    system: StateSpace, low: Float[np.ndarray, " panel"], high: Float[np.ndarray, " panel"]
) -> Float[np.ndarray, "panel output"]:
    """The integral of |G|^2 over each panel by a Gauss rule of 16 points."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    found = np.empty((len(low), len(system.C)))
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        G = statespace_response(system, a + 0.5 * (nodes + 1.0) * (b - a))
        found[i] = 0.5 * (b - a) * weights @ np.sum(np.abs(G) ** 2, axis=2)
    return found


def _check_band(band_hz: tuple[float, float]) -> tuple[float, float]:
    low, high = band_hz
    if not 0.0 <= low < high:
        raise ConfigError(f"band {band_hz} Hz: the limits must be ordered and not negative")
    return 2.0 * np.pi * low, 2.0 * np.pi * high


def _balanced(system: StateSpace, root: Float[np.ndarray, "input input"]) -> StateSpace:
    """The system driven by white noise of unit intensity, in states of comparable size."""
    if not len(system.A):
        return StateSpace(system.A, system.B @ root, system.C, system.D @ root)
    A, (unit, _) = sla.matrix_balance(system.A, separate=True, permute=False)
    return StateSpace(A, (system.B / unit[:, None]) @ root, system.C * unit, system.D @ root)


def _square_root(intensity: Float[np.ndarray, "input input"]) -> Float[np.ndarray, "input input"]:
    values, vectors = np.linalg.eigh(np.asarray(intensity, dtype=float))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _cuts(values: np.ndarray, w1: float, w2: float) -> Float[np.ndarray, " cut"]:
    """Octaves, and each resonance with thirty half-widths to both sides."""
    peaks = values[np.imag(values) > 0.0]
    sides = np.abs(np.real(peaks))[:, None] * np.array([-30.0, 0.0, 30.0])
    cuts = np.concatenate([(np.imag(peaks)[:, None] + sides).ravel(), w2 * 0.5 ** np.arange(1, 24)])
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
    probe, width = _probes(values, np.linalg.norm(Cv, axis=0) * np.linalg.norm(Bv, axis=1), band)
    direct = statespace_response(system, probe)
    summed = (Cv / (1j * probe[:, None, None] - values)) @ Bv + system.D
    error, size = np.linalg.norm(summed - direct, axis=2), np.linalg.norm(direct, axis=2)
    # The change of int |G|^2 is 2 int |G| error, to first order; that of the rms, relatively, half of it.
    estimate, square = width @ (error * size), width @ size**2
    return (values, Cv, Bv) if np.all(estimate <= AGREEMENT * square) else None


def _probes(
    values: np.ndarray, weight: np.ndarray, band: tuple[float, float]
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Where a pole sum would show that it is wrong, and for what width of the band each line stands.

    Lines throughout the band, and its four strongest resonances.
    """
    low = band[0] or 1e-4 * band[1]
    lines = np.geomspace(low, band[1], 6)
    damping = np.maximum(np.abs(np.real(values)), 1e-300)
    inside = (np.imag(values) > low) & (np.imag(values) < band[1])
    strongest = np.argsort(-np.where(inside, weight / damping, 0.0))[: min(4, int(inside.sum()))]
    probe = np.concatenate([lines, np.imag(values)[strongest]])
    return probe, np.concatenate([lines, damping[strongest]])


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
    with warnings.catch_warnings():
        # SciPy holds exp(log T) to 1000 eps of T; loops of high authority reach 1e-11. What counts is the
        # integral, which the tests hold to quadrature at 1e-10.
        warnings.filterwarnings("ignore", "logm result may be inaccurate", RuntimeWarning)
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
