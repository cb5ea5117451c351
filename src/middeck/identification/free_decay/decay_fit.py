"""Frequency and damping of one mode against amplitude, from free decays.

With rates that depend on the amplitude a alone, da/dt = -sigma(a) a and dphi/dt = omega(a) (Nayfeh and Mook
1979, section 2.3), all decays are parts of one curve: each begins somewhere on it, with a phase of its own.
In l = log a both are integrals, t = int dl / sigma and phi = int omega / sigma dl.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline, CubicSpline
from scipy.optimize import least_squares

from middeck.arguments import named_kinds
from middeck.errors import DataError, FitError
from middeck.identification.free_decay.releases import dominant_hz, find_releases, without_tail
from middeck.values import record

ROOM = 1.0  # margin in log amplitude, for phases and starts to be found
POINTS = 801  # points in log amplitude
# Log of the largest and least rate that a search may try: time must advance from point to point in double
# precision.
STEEPEST = 14.0


@record
class Amplitudes:
    """Log amplitudes in falling order, and splines in them."""

    log: Float[np.ndarray, " point"]
    basis: Float[np.ndarray, "point coefficient"]


def amplitudes(least: float, largest: float, coefficients: int) -> Amplitudes:
    """Splines with even knots in log amplitude, cubic from four coefficients, constant in `ROOM` beyond."""
    low, high = np.log(least), np.log(largest)
    log = np.linspace(high + ROOM, low - ROOM, POINTS)
    degree = min(3, coefficients - 1)
    inner = np.linspace(low, high, coefficients - degree + 1)
    knots = np.concatenate([np.full(degree, inner[0]), inner, np.full(degree, inner[-1])])
    basis = np.asarray(BSpline.design_matrix(np.clip(log, low, high), knots, degree).toarray())
    return Amplitudes(log, basis)


def decay_curve(
    at: Amplitudes, log_sigma: Float[np.ndarray, " coefficient"], omega: Float[np.ndarray, " coefficient"]
) -> CubicSpline:
    """(log amplitude, phase) against the time since the largest amplitude."""
    slowness = np.exp(-np.clip(at.basis @ log_sigma, -STEEPEST, STEEPEST))
    time = cumulative_trapezoid(slowness, x=-at.log, initial=0.0)
    phase = cumulative_trapezoid((at.basis @ omega) * slowness, x=-at.log, initial=0.0)
    return CubicSpline(time, np.column_stack([at.log, phase]))


COEFFICIENTS = (1, 2, 3, 4, 5, 6, 8, 10)  # coefficients of the splines that are tried
STEPS = 40  # most steps of a search: one mode takes about five
UNEXPLAINED = 0.5  # largest part of the energy that may be left
TOLD = 25  # number of amplitudes in the result
CLEAR = 3.0  # least amplitude reported, in rms of the residual
ITSELF = 0.1  # part of its frequency: what is nearer to the mode belongs to it
BAND = 9  # lines that count as one: a decaying oscillation is no sharp line
LINE = 0.2  # share of the residual's energy in one band that makes it another oscillation
DEPTH = 0.005  # least amplitude at which rates change, over the largest


@record(kw_only=True)
class FreeDecay:
    """Frequency and damping against the amplitude of a mode.

    Attributes:
        amplitude: Amplitudes in the unit of the samples, ascending, even on a log scale.
        frequency_hz, damping: Rate of the phase over 2 pi; ratio of the decay rate to the rate of the phase.
        frequency_std_hz, damping_std: Standard deviations by leaving out one decay at a time (Efron and
            Tibshirani 1993, sec. 11.5), which counts all that differs between decays, and by the last
            coefficient; infinite for fewer than three decays.
        decays: Samples of each decay that were used.
        residual_rms: Residual rms of each decay.
        one_exponential_rms: Residual rms of all decays at constant frequency and damping.
        coefficients: Number for each of two splines: that of the MDL (Schwarz 1978) and one more.
        warnings: Other oscillations in the residual: the deviations do not include their effect.
    """

    amplitude: Float[np.ndarray, " amplitude"]
    frequency_hz: Float[np.ndarray, " amplitude"]
    frequency_std_hz: Float[np.ndarray, " amplitude"]
    damping: Float[np.ndarray, " amplitude"]
    damping_std: Float[np.ndarray, " amplitude"]
    decays: tuple[slice, ...]
    residual_rms: Float[np.ndarray, " decay"]
    one_exponential_rms: float
    coefficients: int
    warnings: tuple[str, ...] = ()


class _Fit(NamedTuple):
    """Parameters: log sigma, omega of the splines, then time on the curve and phase of each decay."""

    at: Amplitudes
    x: Float[np.ndarray, " parameter"]
    residual: list[Float[np.ndarray, " sample"]]

    @property
    def splines(self) -> int:
        return self.at.basis.shape[1]

    @property
    def cost(self) -> float:
        return float(sum(np.sum(e**2) for e in self.residual))


@named_kinds
def fit_free_decay(
    samples: Float[np.ndarray, " sample"], sample_hz: float, *, decays: Sequence[slice] | None = None
) -> FreeDecay:
    """Frequency and damping of the mode that decays, as functions of its amplitude.

    All decays are fitted together: amplitude and phase follow one curve (`curve`), of which each decay is a
    part. A constant of each decay is taken off. Where a decay ends in noise it is cut there.

    Args:
        samples: One channel, displacement or another measure of the mode.
        sample_hz: Sampling rate.
        decays: Samples of each free decay; found by `find_releases` unless given.

    Raises `DataError` if a sample is not finite or no decay is found, `FitError` if the fit does not follow
    the decays.
    """
    if not np.all(np.isfinite(samples)):
        raise DataError("a sample is not a finite number", hint="cut the record there")
    found = tuple(find_releases(samples, sample_hz) if decays is None else decays)
    if not found:
        raise DataError("no free decay found", hint="name its samples: decays=[slice(first, last)]")
    whole = [slice(*part.indices(len(samples))) for part in found]
    cycle = sample_hz / dominant_hz(samples[whole[0]], sample_hz)
    parts = tuple(without_tail(samples, part, cycle) for part in whole)
    unit = max(float(np.ptp(samples[part])) for part in parts)
    data = [samples[part] / unit for part in parts]
    first = _constant(data, sample_hz)
    shortest, best = _choose(first, data, sample_hz)
    rms = np.array([np.sqrt(np.mean(e**2)) for e in best.residual])
    total = sum(len(y) for y in data)
    if not best.cost <= UNEXPLAINED * sum(float(np.sum((y - np.mean(y)) ** 2)) for y in data):
        raise FitError(
            "the fit does not follow the decays: one mode that decays leaves most of them unexplained",
            hint="filter the mode out of the others, or name the samples of each decay: decays=",
        )
    least, largest = _reached(best, data, sample_hz)
    told = np.geomspace(min(max(CLEAR * float(rms.max()), least), 0.5 * largest), largest, TOLD)
    value = _rates(best, told)
    deviation = np.hypot(_jackknife(best, data, sample_hz, told), value - _rates(shortest, told))
    return FreeDecay(
        amplitude=unit * told,
        frequency_hz=value[0],
        frequency_std_hz=deviation[0],
        damping=value[1],
        damping_std=deviation[1],
        decays=parts,
        residual_rms=unit * rms,
        one_exponential_rms=unit * float(np.sqrt(first.cost / total)),
        coefficients=best.splines,
        warnings=_others(best.residual, sample_hz, float(value[0, -1])),
    )


def _others(
    residual: list[Float[np.ndarray, " sample"]], sample_hz: float, mode_hz: float
) -> tuple[str, ...]:
    """A warning if much of the decays' residual is in one narrow band, as that of noise never is.

    The band around the mode itself does not count.
    """
    longest = max(map(len, residual))
    power = sum((np.abs(np.fft.rfft(e, longest)) ** 2 for e in residual), np.zeros(longest // 2 + 1))
    near = np.convolve(power, np.ones(BAND), "same")
    hz = np.arange(len(power)) * sample_hz / longest
    k = int(np.argmax(np.where(np.abs(hz / mode_hz - 1.0) < ITSELF, 0.0, near)))
    if not near[k] > (LINE + BAND / len(power)) * power.sum():
        return ()
    share = 100.0 * near[k] / power.sum()
    return (
        f"another oscillation near {hz[k]:.4g} Hz is left of the decays, {share:.0f} % of what one mode does "
        "not explain: the deviations do not count what it does; filter it out",
    )


def _choose(first: _Fit, data: list[Float[np.ndarray, " sample"]], sample_hz: float) -> tuple[_Fit, _Fit]:
    """The fit of the minimum description length, and the one to report.

    The second has the next number of coefficients, since the first leaves a bias as large as the noise; but
    one exponential is reported as such. The search ends where two numbers in turn are no shorter.
    """
    tried, best = [first], 0
    for count in COEFFICIENTS[1:]:
        tried.append(_refine(data, sample_hz, _with_coefficients(tried[-1], count, data, sample_hz)))
        best = int(np.argmin([_description(fit, data) for fit in tried]))
        if best < len(tried) - 2:
            break
    return tried[best], tried[min(best + 1, len(tried) - 1) if best else 0]


def _reached(fit: _Fit, data: list[Float[np.ndarray, " sample"]], sample_hz: float) -> tuple[float, float]:
    """The least and the largest amplitude of the decays."""
    curve, begins = _curve(fit), fit.x[2 * fit.splines :: 2]
    ends = [float(curve(b + len(y) / sample_hz)[0]) for b, y in zip(begins, data, strict=True)]
    return float(np.exp(min(ends))), max(float(np.exp(curve(b)[0])) for b in begins)


def _constant(data: list[Float[np.ndarray, " sample"]], sample_hz: float) -> _Fit:
    """The fit of one exponential: from the line and the fall of the first decay."""
    y = data[0] - np.mean(data[0])
    hz = dominant_hz(y, sample_hz)
    half = len(y) // 2
    omega = _line(y, sample_hz, 2.0 * np.pi * hz)[0]
    early, late = (np.sqrt(2.0 * np.mean(part**2)) for part in (y[:half], y[half:]))
    sigma = float(np.log(early / late)) / (half / sample_hz)
    if not sigma > 0.0:
        raise FitError("the first decay does not fall", hint="name the samples of each decay: decays=")
    sizes = [2.0 * _line(d - np.mean(d), sample_hz, omega, sigma)[1] for d in data]
    largest = max(abs(size) for size in sizes)
    ends = [abs(s) * np.exp(-sigma * len(d) / sample_hz) for s, d in zip(sizes, data, strict=True)]
    at = amplitudes(max(min(ends), DEPTH * largest), largest, 1)
    starts = [((at.log[0] - np.log(abs(size))) / sigma, np.angle(size)) for size in sizes]
    x = np.concatenate([[np.log(sigma), omega], np.ravel(starts)])
    return _refine(data, sample_hz, _Fit(at, x, []))


def _line(
    y: Float[np.ndarray, " sample"], sample_hz: float, omega: float, sigma: float = 0.0
) -> tuple[float, complex]:
    """The frequency near ``omega`` [rad/s] at which the decay's own Fourier sum is largest, and that sum."""
    t = np.arange(len(y)) / sample_hz
    weight = np.exp(-sigma * t)
    step = 0.25 * np.pi / t[-1]
    tried = omega + step * np.arange(-16, 17)
    sums = [complex(np.sum(y * weight * np.exp(-1j * w * t)) / np.sum(weight**2)) for w in tried]
    k = int(np.argmax(np.abs(sums)))
    return float(tried[k]), sums[k]


def _with_coefficients(
    fit: _Fit, count: int, data: list[Float[np.ndarray, " sample"]], sample_hz: float
) -> _Fit:
    """The same curve in more splines, over the amplitudes that the decays reach."""
    least, largest = _reached(fit, data, sample_hz)
    at = amplitudes(max(least, DEPTH * largest), largest, count)
    rates = [
        np.interp(-at.log, -fit.at.log, fit.at.basis @ c) for c in fit.x[: 2 * fit.splines].reshape(2, -1)
    ]
    start = np.linalg.lstsq(at.basis, np.transpose(rates), rcond=None)[0].T
    x = np.concatenate([start.ravel(), fit.x[2 * fit.splines :]])
    moved = _curve(_Fit(at, x, []))
    x[2 * count :: 2] += np.interp(np.log(largest), at.log[::-1], moved.x[::-1])
    x[2 * count :: 2] -= np.interp(np.log(largest), fit.at.log[::-1], _curve(fit).x[::-1])
    return _Fit(at, x, [])


def _curve(fit: _Fit) -> CubicSpline:
    return decay_curve(fit.at, fit.x[: fit.splines], fit.x[fit.splines : 2 * fit.splines])


def _residual(data: list[Float[np.ndarray, " sample"]], sample_hz: float, fit: _Fit) -> list[np.ndarray]:
    curve, left = _curve(fit), list[np.ndarray]()
    for y, (begin, phase) in zip(data, fit.x[2 * fit.splines :].reshape(-1, 2), strict=True):
        log, turned = curve(begin + np.arange(len(y)) / sample_hz).T
        error = y - np.exp(np.minimum(log, fit.at.log[0])) * np.cos(turned - turned[0] + phase)
        left.append(error - np.mean(error))
    return left


def _refine(data: list[Float[np.ndarray, " sample"]], sample_hz: float, fit: _Fit) -> _Fit:
    def errors(x: np.ndarray) -> np.ndarray:
        return np.concatenate(_residual(data, sample_hz, fit._replace(x=x)))

    solved = least_squares(errors, fit.x, x_scale="jac", xtol=1e-10, ftol=1e-10, max_nfev=STEPS)
    found = fit._replace(x=solved.x)
    return found._replace(residual=_residual(data, sample_hz, found))


def _description(fit: _Fit, data: list[Float[np.ndarray, " sample"]]) -> float:
    total = sum(len(y) for y in data)
    return total * float(np.log(fit.cost / total)) + len(fit.x) * float(np.log(total))


def _rates(fit: _Fit, amplitude: Float[np.ndarray, " amplitude"]) -> Float[np.ndarray, "2 amplitude"]:
    """Frequency [Hz] and damping ratio."""
    rates = fit.at.basis @ fit.x[: 2 * fit.splines].reshape(2, -1).T
    log_sigma, omega = (np.interp(np.log(amplitude), fit.at.log[::-1], rate[::-1]) for rate in rates.T)
    return np.array([omega / (2.0 * np.pi), np.exp(log_sigma) / omega])


def _jackknife(
    fit: _Fit, data: list[Float[np.ndarray, " sample"]], sample_hz: float, told: np.ndarray
) -> Float[np.ndarray, "2 amplitude"]:
    """Deviations from fits without one decay each."""
    n = len(data)
    if n < 3:
        return np.full((2, len(told)), np.inf)
    own = 2 * fit.splines
    left: list[np.ndarray] = []
    for k in range(n):
        x = np.delete(fit.x, [own + 2 * k, own + 2 * k + 1])
        refined = _refine([y for i, y in enumerate(data) if i != k], sample_hz, fit._replace(x=x))
        left.append(_rates(refined, told))
    values = np.array(left)
    return np.sqrt((n - 1) / n * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
