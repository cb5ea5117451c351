r"""Root mean square in a frequency band, in closed form.

rms^2 = 2 \int_{f1}^{f2} |G|^2 S df with a two-sided intensity S. With G = \sum_i c_i b_i / (jw - l_i) each
pair of poles contributes \int dw / ((jw - l_i)(-jw - l_j^*)), a difference of logarithms over l_i + l_j^*
(Gawronski and Juang 1990, Int. J. Systems Science 21, "Model reduction in limited time and frequency
intervals"). Where eigenvectors cannot represent the system (defective poles, such as the double ones of rigid
bodies), the integral is taken by adaptive quadrature, in Schur form or line by line.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Complex, Float
from scipy.linalg import lapack

from middeck.errors import ConfigError
from middeck.systems.norms.axis_poles import on_axis, unbounded_outputs
from middeck.systems.norms.pole_crowds import find_crowds
from middeck.systems.norms.quadrature import integrate
from middeck.systems.poles.refined_poles import refine_poles
from middeck.systems.poles.resolvent import (
    Resolvent,
    by_schur_form,
    by_solving,
    entry_sensitivity,
)
from middeck.systems.poles.same_response import part_known, resolve_parts
from middeck.systems.poles.stability import GROWTH_LIMIT, none_grows
from middeck.systems.poles.state_units import balance_states
from middeck.systems.state_space.statespace import StateSpace, poles

AGREEMENT = 1e-11
"""Largest estimated relative error of an rms for which the sum over LAPACK's poles is used."""
REMAINS = 1e-3
"""Relative residual of a pole sum up to which one correction estimates its error: the next order is a
thousandth of it."""
SCHUR_AGREEMENT = 1e-9
"""Relative difference of the squares up to which the response in Schur form replaces that by solving."""
UNCERTAIN = 1e-4
"""Relative change of an rms by rounding of A (first order, worst case of all entries) that gives a
warning."""
CANCELLED = 1e-6
"""Relative rounding of the square of an rms from which on it is integrated line by line."""
BELOW_BAND = 0.1
"""Fraction of the lower limit below which the spread of a pole at the origin does not reach the band."""
UNDAMPED = 1e-9
"""Least half-width of a resonance for its cuts, over its frequency."""
RESPONSE_TOLERANCE = 1e-11
"""Tolerance of the integral of a response given line by line: the rms errs by less than 1e-9, also where the
response waves more often than a panel has points. It takes a quarter fewer lines than 1e-13."""


def band_rms(
    system: StateSpace, intensity: Float[np.ndarray, "input input"], band_hz: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """Rms of each output within ``band_hz`` under white noise of two-sided ``intensity`` [unit^2/Hz].

    ``inf`` where a pole grows (although the integral over frequency is finite), and for outputs that see one
    on the imaginary axis within the band. Poles on the axis outside the band are allowed, also double ones
    (rigid-body motion) and longer chains of integrators. A direct term counts with the width of the band.
    Warns (`UserWarning`) where rounding of A leaves growth undecided or the rms uncertain. Raises
    `ConfigError` for a band that is not 0 <= low < high < inf.

    >>> lag = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])           # |G|^2 = 1 / (1 + w^2)
    >>> float(band_rms(lag, np.eye(1), (0.0, 1.0 / (2.0 * np.pi)))[0] ** 2 * np.pi / np.arctan(1.0))
    1.0
    """
    w1, w2 = _check_band(band_hz)
    noisy = _balanced(system, square_root(intensity))
    if not len(noisy.A):
        return np.sqrt(np.sum(noisy.D**2, axis=1) * (w2 - w1) / np.pi)
    values, V = np.linalg.eig(noisy.A)
    modal = None
    if not _diverges(values, w1, w2):
        modal = _as_pole_sum(noisy, values.astype(complex), V, (w1, w2))
    if modal is None and (form := refine_poles(noisy.A, noisy.B, noisy.C)):
        if _diverges(form.values, w1, w2):
            return _rms_on_axis(noisy, form.values, (w1, w2))
        modal = form.values, form.C, form.B
    if modal is None:
        return _rms_of_dependent_poles(noisy, (w1, w2))
    square, rounding = _pair_integral(*modal, noisy.D, w1, w2)
    # Modes that nearly cancel in an output do so line by line at the root of the rounding.
    lost = rounding > CANCELLED * square
    if lost.any():
        values, C, B = modal
        response = _pole_sum(values, C[lost], B, noisy.D[lost])
        square[lost] = _quadrature(response, values, (w1, w2), tolerance=RESPONSE_TOLERANCE)
    return np.sqrt(square / np.pi)


def _diverges(values: np.ndarray, w1: float, w2: float) -> bool:
    """Whether a pole grows, or lies on the axis within the band."""
    return not none_grows(values) or bool(np.any(on_axis(values, w1, w2)))


def _rms_on_axis(
    system: StateSpace, values: np.ndarray, band: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """Infinite where a pole grows, or of outputs that see one on the axis within the band."""
    if not none_grows(values):
        return np.full(len(system.C), np.inf)
    rms = _rms_of_bounded(_on_axis(by_solving(system)), values, band)
    if band[0] > 0.0 or np.isfinite(rms).all():
        return rms
    # In mixed states rounding shows integrators to outputs that do not see them.
    return np.where(
        np.isfinite(rms), rms, _rms_of_bounded(_on_axis(resolve_parts(part_known(system))), values, band)
    )


def _rms_of_bounded(
    response: Callable[[np.ndarray], np.ndarray], values: np.ndarray, band: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """Rms by quadrature of outputs that see no pole on the axis within the band; of the others infinity."""
    bounded = ~unbounded_outputs(response, values, *band)
    rms = np.full(len(bounded), np.inf)
    if bounded.any():
        rms[bounded] = np.sqrt(_quadrature(lambda omega: response(omega)[:, bounded], values, band) / np.pi)
    return rms


def _rms_of_dependent_poles(system: StateSpace, band: tuple[float, float]) -> Float[np.ndarray, " output"]:
    """Rms by quadrature; warns where rounding of A leaves growth or the rms uncertain."""
    crowd = find_crowds(system.A)
    if _diverges(crowd.means, *band):
        return _rms_on_axis(system, crowd.means, band)
    peaks = np.concatenate([crowd.values, crowd.means])
    response, uncertain = _trusted_response(system, peaks, band)
    # A crowd far below the band is a chain of integrators: its spread is no growth, and not in the band.
    unsure = (np.real(crowd.values) > GROWTH_LIMIT) & (np.abs(crowd.values) > BELOW_BAND * band[0])
    if np.any(unsure):
        rate = np.real(crowd.values[unsure]).max()
        _warn(f"whether a pole grows is undecided: by {rate:.1e} rad/s, which is less than its own rounding")
    elif uncertain > UNCERTAIN:
        _warn(f"rounding of the matrix A alone moves it by a relative {uncertain:.0e} or more")
    # What rounding of A leaves uncertain, halving cannot find.
    floor = float(np.clip(uncertain, 1e-13, 1e-6)) if np.isfinite(uncertain) else 1e-6
    return np.sqrt(_quadrature(response, peaks, band, tolerance=floor) / np.pi)


def _warn(why: str) -> None:
    text = (
        f"rms in a band: {why}; poles nearly coincide and are light. States that keep the parts of a cascade"
    )
    warnings.warn(f"{text} apart (zeros in A) or are better scaled would tell", UserWarning, stacklevel=4)


def _trusted_response(
    system: StateSpace, peaks: np.ndarray, band: tuple[float, float]
) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """Response over omega, in Schur form where accurate enough, and its relative error by rounding of A.

    The backward error is relative to the norm of A in Schur form, and to each of its entries in solving.
    """
    inside = (np.imag(peaks) > band[0]) & (np.imag(peaks) < band[1])
    omega = np.concatenate([np.geomspace(band[0] or 1e-4 * band[1], band[1], 6), np.imag(peaks[inside])])
    width = np.concatenate([omega[:6], np.maximum(np.abs(np.real(peaks[inside])), 1e-300)])
    fast, solved = _on_axis(by_schur_form(system)), _on_axis(by_solving(system))
    H = solved(omega)
    size = np.linalg.norm(H, axis=2)
    off = np.linalg.norm(fast(omega) - H, axis=2)
    moved = np.finfo(float).eps * np.linalg.norm(entry_sensitivity(system, omega), axis=2)
    square = np.maximum(width @ size**2, np.finfo(float).tiny)
    agree = np.all(width @ (off * size) <= SCHUR_AGREEMENT * square)
    uncertain = float(np.max(width @ (moved * np.maximum(size, moved)) / square))
    return (fast if agree else solved), uncertain


def band_rms_by_quadrature(
    system: StateSpace, intensity: Float[np.ndarray, "input input"], band_hz: tuple[float, float]
) -> Float[np.ndarray, " output"]:
    """`band_rms` by adaptive quadrature of |G|^2 cut at the resonances: slow, an independent check.

    The integrand is evaluated in the Schur form of balanced A, which is backward stable and uses no
    eigenvector. The integral is finite also for an unstable system.
    """
    band = _check_band(band_hz)
    response = _on_axis(by_schur_form(_balanced(system, square_root(intensity))))
    return np.sqrt(_quadrature(response, poles(system), band) / np.pi)


def response_rms(
    response: Callable[[np.ndarray], np.ndarray],
    peaks: Complex[np.ndarray, " pole"],
    intensity: Float[np.ndarray, "input input"],
    band_hz: tuple[float, float],
) -> Float[np.ndarray, " output"]:
    """Rms in a band from any ``response`` [line, output, input] over omega [rad/s], e.g. of a loop with
    delays.

    ``peaks``, poles beside which the response may be narrow, place the first cuts; ``inf`` for an output that
    sees one of them on the imaginary axis within the band. To a relative 1e-9 (`RESPONSE_TOLERANCE`).
    """
    band, root = _check_band(band_hz), square_root(intensity)

    def driven(omega: np.ndarray) -> np.ndarray:
        return response(omega) @ root

    if np.any(on_axis(peaks, *band)):
        return _rms_of_bounded(driven, peaks, band)
    return np.sqrt(_quadrature(driven, peaks, band, tolerance=RESPONSE_TOLERANCE) / np.pi)


def weighed_rms(
    system: StateSpace,
    intensity: Float[np.ndarray, "input input"],
    band_hz: tuple[float, float],
    weight: Callable[[np.ndarray], np.ndarray],
    cuts: Float[np.ndarray, " cut"],
) -> Float[np.ndarray, " output"]:
    """Root of 2 times the integral over the band of ``weight`` (of omega, real, not negative) times |G|^2 S.

    Adaptive quadrature in Schur form; ``cuts`` [rad/s] separate intervals in which the weight is smooth.
    ``inf`` where a pole on the axis makes the integral diverge; stability is not checked.
    """
    w1, w2 = _check_band(band_hz)
    noisy = _balanced(system, square_root(intensity))
    if not len(noisy.A):
        noisy = StateSpace(-np.eye(1), np.zeros((1, noisy.B.shape[1])), np.zeros((len(noisy.C), 1)), noisy.D)
    response = _on_axis(by_schur_form(noisy))

    def weighed(omega: np.ndarray) -> np.ndarray:
        return response(omega) * np.sqrt(weight(omega))[:, None, None]

    inside = cuts[(cuts > w1) & (cuts < w2)]
    # Panels beside such a pole are halved until they overflow; a NaN means infinity.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        rms = np.sqrt(_quadrature(weighed, poles(system), (w1, w2), inside) / np.pi)
    return np.where(np.isfinite(rms), rms, np.inf)


def _on_axis(resolvent: Resolvent) -> Callable[[np.ndarray], np.ndarray]:
    return lambda omega: resolvent(1j * omega)


def _quadrature(
    response: Callable[[np.ndarray], np.ndarray],
    values: np.ndarray,
    band: tuple[float, float],
    cuts: Float[np.ndarray, " cut"] | None = None,
    tolerance: float = 1e-13,
) -> Float[np.ndarray, " output"]:
    """The integral of |G|^2 over the band."""
    edges = np.unique(np.concatenate([_cuts(values, *band), () if cuts is None else cuts, band]))
    return integrate(lambda omega: np.sum(np.abs(response(omega)) ** 2, axis=2), edges, tolerance)


def _check_band(band_hz: tuple[float, float]) -> tuple[float, float]:
    low, high = band_hz
    if not 0.0 <= low < high < np.inf:
        raise ConfigError(
            f"band {band_hz} Hz: the limits must be ordered, finite and not negative",
            hint="a wide but finite band; a direct term makes the rms of white noise infinite without one",
        )
    return 2.0 * np.pi * low, 2.0 * np.pi * high


def _balanced(system: StateSpace, root: Float[np.ndarray, "input input"]) -> StateSpace:
    """The system driven by white noise of unit intensity, in states of comparable size."""
    if not len(system.A):
        return StateSpace(system.A, system.B @ root, system.C, system.D @ root)
    balanced = balance_states(system)
    return StateSpace(balanced.A, balanced.B @ root, balanced.C, system.D @ root)


def square_root(intensity: Float[np.ndarray, "input input"]) -> Float[np.ndarray, "input input"]:
    """A factor G with G G' = intensity (semidefinite)."""
    values, vectors = np.linalg.eigh(np.asarray(intensity, dtype=float))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _cuts(values: np.ndarray, w1: float, w2: float) -> Float[np.ndarray, " cut"]:
    """Octaves, and each resonance with thirty half-widths to both sides."""
    peaks = values[np.imag(values) > 0.0]
    # Without damping, which an output that does not see the pole allows, no line may meet it.
    width = np.maximum(np.abs(np.real(peaks)), UNDAMPED * np.imag(peaks))
    sides = width[:, None] * np.array([-30.0, 0.0, 30.0])
    cuts = np.concatenate([(np.imag(peaks)[:, None] + sides).ravel(), w2 * 0.5 ** np.arange(1, 24)])
    return cuts[(cuts > w1) & (cuts < w2)]


def _as_pole_sum(
    system: StateSpace, values: np.ndarray, V: np.ndarray, band: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Poles, C V and V^-1 B; None where the eigenvectors are too ill-conditioned to represent the system."""
    # Dependent eigenvectors (a defective pair) are refused below: SciPy need not warn of them.
    *factors, info = cast("Any", lapack).zgetrf(V)
    if info:
        return None
    Bv, Cv = sla.lu_solve(factors, system.B), system.C @ V
    # Eigenvectors of a defective pair coincide to rounding and make Bv huge: squares would overflow.
    if not np.abs(Bv).max(initial=0.0) < 1e100:
        return None
    probe, width = _probes(values, np.linalg.norm(Cv, axis=0) * np.linalg.norm(Bv, axis=1), band)
    resolved = 1.0 / (1j * probe - values[:, None])
    modal = resolved[:, :, None] * Bv[:, None, :]
    # The error of the pole sum: its residual in (jw I - A) x = B, passed through the pole sum again.
    states = np.tensordot(V, modal, axes=1)
    remains = system.B[:, None, :] - 1j * probe[:, None] * states + np.tensordot(system.A, states, axes=1)
    if np.linalg.norm(remains) > REMAINS * np.sqrt(len(probe)) * np.linalg.norm(system.B):
        return None
    again = sla.lu_solve(factors, remains.reshape(len(values), -1)).reshape(modal.shape)
    summed = np.tensordot(Cv, modal, axes=1) + system.D[:, None, :]
    off = np.tensordot(Cv, resolved[:, :, None] * again, axes=1)
    error, size = np.linalg.norm(off, axis=2), np.linalg.norm(summed, axis=2)
    # The change of int |G|^2 is 2 int |G| error, to first order; that of the rms, relatively, half of it.
    estimate, square = (error * size) @ width, size**2 @ width
    return (values, Cv, Bv) if np.all(estimate <= AGREEMENT * square) else None


def _probes(
    values: np.ndarray, weight: np.ndarray, band: tuple[float, float]
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Test lines of a pole sum, across the band and at its four strongest resonances, and their weights."""
    low = band[0] or 1e-4 * band[1]
    lines = np.geomspace(low, band[1], 6)
    damping = np.maximum(np.abs(np.real(values)), 1e-150)  # below, the ratio may overflow
    inside = (np.imag(values) > low) & (np.imag(values) < band[1])
    strongest = np.argsort(-np.where(inside, weight / damping, 0.0))[: min(4, int(inside.sum()))]
    probe = np.concatenate([lines, np.imag(values)[strongest]])
    return probe, np.concatenate([lines, damping[strongest]])


def _pole_sum(
    values: np.ndarray, Cv: np.ndarray, Bv: np.ndarray, D: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """The response over omega of a sum over poles."""
    residues = Cv.T[:, :, None] * Bv[:, None, :]
    return lambda omega: np.tensordot(1.0 / (1j * omega[:, None] - values), residues, axes=1) + D


def _pair_integral(
    values: np.ndarray, Cv: np.ndarray, Bv: np.ndarray, D: np.ndarray, w1: float, w2: float
) -> tuple[Float[np.ndarray, " output"], Float[np.ndarray, " output"]]:
    """The integral of |G|^2 over the band, and its rounding."""
    # The integral of dw / (jw - l) for poles not right of the axis: no branch is crossed.
    L = -1j * (np.log(1j * w2 - values) - np.log(1j * w1 - values))
    X = (Bv @ Bv.conj().T) * _pair_kernel(values, L, w1, w2)
    square = np.real(np.sum((Cv @ X) * Cv.conj(), axis=1))
    cross = np.real(np.sum(((Cv * L) @ Bv) * D, axis=1))
    direct = np.sum(D**2, axis=1) * (w2 - w1)
    size = np.abs(Cv)
    rounding = np.finfo(float).eps * (np.sum((size @ np.abs(X)) * size, axis=1) + direct)
    return square + 2.0 * cross + direct, rounding


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
