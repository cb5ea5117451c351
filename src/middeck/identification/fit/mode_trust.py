"""Marks the modes of a fit whose parameters can be trusted."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from middeck.errors import FitError
from middeck.identification.fit.unneeded_modes import DOUBTFUL, mode_significance
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.identification.search.fit_warnings import confounded_delays
from middeck.identification.search.leading_outputs import leads
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.orthogonal import canonical_root
from middeck.identification.uncertainty.parameter_deviations import distinct_poles, uncertainty_of
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# "sound": its deviations hold. "doubtful": it may be noise, or the residual is not noise. "unresolved":
# one of two modes too close for their deviations to hold. "outside": not in the band, so that it stands for
# whatever is there.
Standing = Literal["sound", "doubtful", "unresolved", "outside"]
# No decay rate or frequency is known better than to this share of it.
ROUNDING = 1e-12
# Two poles closer than so many deviations of their distance: the response is no linear function of either
# within its deviation.
APART = 6.0
# Share of a pole's variance that goes when another is known: two modes that the data hardly tell apart have
# 0.95 and more. A mode far from a pair that stands for what is beyond the band has less than 0.1, however
# little is known of that pair.
OF_OTHER = 0.5
# A pole whose half-power width is less than this share of the lines' distance follows one line alone.
OF_ONE_LINE = 0.02
# Half-power widths of a mode within which such a line is one of those that determine it.
BESIDE = 3.0
# Deviations of its residue above which a mode is known whatever is beside it.
ALONE = 30.0


def checked_covariance(covariance: ModelCovariance) -> ModelCovariance:
    """``covariance`` plus the rounding errors of decay rates, frequencies and delays.

    Raises `FitError` where it is not finite: then no number of the fit has a deviation.
    """
    model, at = covariance.model, covariance.at
    if not np.isfinite(covariance.root).all():
        raise FitError(
            "the deviations are not finite: the data do not determine the model",
            hint="fewer states, a longer record, or a record that neither clips nor grows",
        )
    least = np.zeros(at.size)
    own = np.concatenate([at.sigma, at.omega[at.omega >= 0]])
    least[own] = ROUNDING
    delays = np.concatenate([at.delay, at.path.ravel()])
    least[delays[delays >= 0]] = ROUNDING / float(np.max(np.abs(model.poles), initial=1.0))
    fixed, loose = np.split(covariance.root, [covariance.fixed.shape[1]], axis=1)
    return dataclasses.replace(
        covariance, root=np.hstack([canonical_root(np.hstack([fixed, np.diag(least)])), loose])
    )


def standing_of(
    measured: FrequencyResponse,
    covariance: ModelCovariance,
    *,
    holds: bool,
    doubted: Iterable[int] = (),
) -> tuple[Standing, ...]:
    """The standing of each mode. ``holds``: the residual is noise; ``doubted``: modes doubted in any case."""
    model, lines = covariance.model, measured.frequency_hz
    significance = mode_significance(covariance)
    of = uncertainty_of(covariance)
    f, clear = natural_hz(model), (significance >= DOUBTFUL) & np.isfinite(of.natural_hz + of.damping)
    close = _unresolved(covariance, significance)
    found: list[Standing] = []
    for m, hz in enumerate(f):
        # A sampled model has real poles beyond half the rate for much within the band.
        if (model.is_pair[m] or model.sample_hz is None) and not lines[0] <= hz <= lines[-1]:
            found.append("outside")
        elif close[m]:
            found.append("unresolved")
        else:
            found.append("sound" if holds and clear[m] and m not in doubted else "doubtful")
    return tuple(found)


def with_doubt(
    standing: Sequence[Standing], model: MeasurementModel, doubted: Sequence[int]
) -> tuple[Standing, ...]:
    """The standing of each mode, "doubtful" where it was sound and is ``doubted``."""
    of_them = np.isin(model.poles, model.poles[list(doubted)])
    return tuple("doubtful" if d and s == "sound" else s for s, d in zip(standing, of_them, strict=True))


def standing_of_delays(
    measured: FrequencyResponse, covariance: ModelCovariance, *, holds: bool
) -> tuple[Standing, ...]:
    """The standing of each delay: doubtful if it is confounded or leads, or the residual is not noise.

    "sound" where none was fitted.
    """
    model, confounded = covariance.model, confounded_delays(measured, covariance)
    deviation_s = uncertainty_of(covariance).delay_s
    if not covariance.structure.with_delay:
        return ("sound",) * len(model.outputs)
    return tuple(
        "sound" if holds and o not in confounded and not leads(tau, deviation_s[o]) else "doubtful"
        for o, tau in enumerate(model.delay_s)
    )


def _unresolved(covariance: ModelCovariance, significance: np.ndarray) -> np.ndarray:
    """Modes whose pole is not clear of another pair's, by the deviations of both, and depends on it.

    A significant mode stays resolved beside a doubtful one.
    """
    model, of = covariance.model, uncertainty_of(covariance)
    size = 2.0 * np.pi * np.hypot(of.natural_hz, of.damping * natural_hz(model))
    found = np.zeros(len(model.poles), dtype=bool)
    for m in distinct_poles(model):
        for n in distinct_poles(model):
            if m < n and model.is_pair[m] and model.is_pair[n]:
                both = np.hypot(size[m], size[n])  # infinite where one is not determined: warned of elsewhere
                near = abs(model.poles[m] - model.poles[n]) < APART * both < np.inf
                for one, other in ((m, n), (n, m)) if near else ():
                    alone = significance[one] >= ALONE and significance[other] < DOUBTFUL
                    found[one] |= not alone and _share_of_other(covariance, one, other) > OF_OTHER
    return found


def _share_of_other(covariance: ModelCovariance, one: int, other: int) -> float:
    """The share of a pair's variance that comes from not knowing the pole of the other."""
    at, poles = covariance.at, covariance.model.poles
    size = np.abs([poles.real, poles.imag]).T[:, :, None]  # unknowns are logarithms
    own, of_other = (size[m] * covariance.fixed[[at.sigma[m], at.omega[m]]] for m in (one, other))
    direction = np.linalg.qr(of_other.T)[0]
    return float(np.sum((own @ direction) ** 2) / np.sum(own**2))


def warnings_on_standing(covariance: ModelCovariance, standing: Sequence[Standing]) -> list[str]:
    """Warnings for doubtful modes and for modes that are not resolved."""
    model, significance = covariance.model, mode_significance(covariance)
    f = natural_hz(model)
    order = sorted(distinct_poles(model), key=lambda m: f[m])
    found = [
        f"mode at {f[m]:.4g} Hz: doubtful, its residue is {significance[m]:.1f} standard deviations, and "
        f"noise alone may reach {DOUBTFUL:g}; the inputs hardly excite it"
        for m in order
        if standing[m] == "doubtful" and significance[m] < DOUBTFUL
    ]
    close = ", ".join(f"{f[m]:.6g}" for m in order if standing[m] == "unresolved")
    if close:
        found.append(
            f"modes at {close} Hz: not resolved, their distance is below {APART:g} standard deviations, "
            "where linearised standard deviations are not valid; record longer, or add an output or input"
        )
    return found


def warnings_on_delays(standing: Sequence[Standing], excess: float) -> list[str]:
    """A warning for doubtful delays: the share ``excess`` of the residual's variance is not noise."""
    if "doubtful" not in standing:
        return []
    return [
        f"{excess:.0%} of the residual's variance is not noise: an error common to all lines biases the "
        "delays, so their standard deviations are too small; take more states, or a band without modes at "
        "its edges"
    ]


def poles_of_one_line(measured: FrequencyResponse, model: MeasurementModel) -> list[int]:
    """Pairs in the band that hardly decay over many periods: they follow a line that no mode explains."""
    lines, f = measured.frequency_hz, natural_hz(model)
    if len(lines) < 2:
        return []
    near = np.clip(np.searchsorted(lines, f), 1, len(lines) - 1)
    sharp = _half_power_hz(model) < OF_ONE_LINE * (lines[near] - lines[near - 1])
    within = (f >= lines[0]) & (f <= lines[-1])
    return [m for m in distinct_poles(model) if sharp[m] and within[m] and model.is_pair[m]]


def beside_one_line(measured: FrequencyResponse, model: MeasurementModel) -> list[int]:
    """Modes near a line that no mode explains: a pole that follows it takes up a part of them."""
    f, width, odd = natural_hz(model), _half_power_hz(model), poles_of_one_line(measured, model)
    near = np.abs(f[:, None] - f[odd]) < BESIDE * width[:, None]
    return [m for m in np.flatnonzero(near.any(axis=1)).tolist() if m not in odd]


def _half_power_hz(model: MeasurementModel) -> np.ndarray:
    return np.abs(np.real(model.poles)) / np.pi


def warnings_on_one_line(measured: FrequencyResponse, model: MeasurementModel) -> list[str]:
    """A warning for lines that poles without width follow, and for the modes beside them."""
    f, odd = natural_hz(model), poles_of_one_line(measured, model)
    if not odd:
        return []
    places, near = (
        ", ".join(f"{hz:.4g}" for hz in np.sort(f[m])) for m in (odd, beside_one_line(measured, model))
    )
    doubted = f" (doubtful with it: the mode at {near} Hz)" if near else ""
    return [
        f"pole at {places} Hz: follows one line that does not fit the lines beside it{doubted}: hum that "
        "repeats with the period, or a mode far narrower than the lines are apart; record with another "
        "period, or leave the line out"
    ]


def warnings_on_phase(model: MeasurementModel, phase: Iterable[int], delay_s: float) -> list[str]:
    """A warning for the poles that stand for a delay (`modes_that_stand_for_delay`)."""
    f, zeta = natural_hz(model), -np.real(model.poles) / np.abs(model.poles)
    places = ", ".join(f"{f[m]:.4g} Hz ({zeta[m]:.0%})" for m in sorted(phase, key=lambda m: f[m]))
    if not places:
        return []
    return [
        f"poles at {places}: not modes, they stand for a delay of about {delay_s * 1e3:.3g} ms, which this "
        "kind of model lacks; a continuous model has one (--continuous, sampled=False; for rates and "
        "accelerations with --delay output)"
    ]


def warnings_on_lines(lines: Sequence[SteadyLine]) -> list[str]:
    """Warnings for the sines that were taken for hum."""
    return [
        f"a sine at {line.hz:.6g} Hz ({line.name}) lasts through the record without an input that drives "
        "it: it is not a mode and was fitted separately"
        for line in lines
    ]


@record
class SteadyLine:
    """A sine that goes on through the record, not made by its inputs.

    Attributes:
        hz: Its frequency.
        deviation_hz: Standard deviation of that.
        name: "mains 50 Hz", "harmonic 3 of mains 50 Hz", or "steady line".
    """

    hz: float
    deviation_hz: float
    name: str
