"""Disturbance spectra as shaping filters of white noise of unit intensity.

Two-sided densities S(f) [unit^2/Hz]; the filter's |G|^2 is S, the noise in front of it has intensity one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import PortFilters, Shaping, pick
from middeck.control.shaping.leads_and_notches import second_order_section
from middeck.errors import ConfigError, DataError
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.poles.resolvent import by_solving
from middeck.systems.state_space.feedback import beside
from middeck.systems.state_space.statespace import StateSpace, series
from middeck.values import record


@record
class SpectrumFit:
    """A shaping filter fitted to a table of power against frequency, with its errors.

    Attributes:
        filter: Stable, without zeros right of the axis, falling at high frequency; one input, one output.
        rms_error_db, worst_error_db: Errors of 10 log10 of the density over the frequencies of the table.
    """

    filter: StateSpace
    rms_error_db: float
    worst_error_db: float


def line_filter(frequency_hz: float, width_hz: float, rms: float) -> StateSpace:
    """A spectral line of a wheel's harmonic as a lightly damped mode, by half-power width and rms.

    G = g s / (s^2 + 2 zeta w s + w^2), zeta = width / (2 f); its variance is g^2 / (4 zeta w).

    Raises `ConfigError` for a width that is not between zero and twice the frequency, or an rms that is not
    positive.
    """
    if not 0.0 < width_hz < 2.0 * frequency_hz or not 0.0 < rms < np.inf:
        raise ConfigError(
            f"spectral line: frequency {frequency_hz} Hz, width {width_hz} Hz, rms {rms}",
            hint="0 < width < 2 frequency (a wheel whose speed wanders by 1 %: 0.01 frequency), rms > 0",
        )
    omega, half = 2.0 * np.pi * frequency_hz, np.pi * width_hz
    gain = rms * np.sqrt(4.0 * half)
    A = np.array([[0.0, omega], [-omega, -2.0 * half]])
    return StateSpace(A, np.array([[0.0], [gain]]), np.array([[0.0, 1.0]]), np.zeros((1, 1)))


def sum_spectra(filters: Sequence[StateSpace]) -> StateSpace:
    """One filter whose density is the sum of several: an independent noise for each, outputs added."""
    whole = beside(*filters)
    C, D = (M.sum(axis=0, keepdims=True) for M in (whole.C, whole.D))
    return StateSpace(whole.A, whole.B, C, D)


def fit_spectrum(
    frequency_hz: Float[np.ndarray, " line"], density: Float[np.ndarray, " line"], sections: int
) -> SpectrumFit:
    """Fit a table of two-sided density [unit^2/Hz] by a chain of ``sections`` of second order and one lag.

    The logarithms of frequencies and dampings of poles and zeros are fitted, so that the filter is always
    stable and of minimum phase; the misfit is that of log S, with sections added one by one where it is
    largest. (The spectral factor of a rational density; Kwakernaak and Sivan 1972, section 1.11.)

    Raises `DataError` for a table that is not ascending, positive and longer than the filter has numbers.
    """
    f, S = np.asarray(frequency_hz, dtype=float), np.asarray(density, dtype=float)
    if f.shape != S.shape or not np.all(np.isfinite(f * S)) or np.any(S <= 0.0) or np.any(np.diff(f) <= 0.0):
        raise DataError(
            "a spectrum needs ascending frequencies and one positive density for each",
            hint="leave out frequencies without a measurement",
        )
    if f[0] <= 0.0 or len(f) < 4 * sections + 2:
        raise DataError(
            f"{len(f)} frequency lines from {f[0]:g} Hz cannot determine {sections} sections",
            hint=f"positive frequencies, {4 * sections + 2} or more, or fewer sections",
        )
    target = np.log(S)
    found = np.array([np.mean(target), np.log(3.0 * f[-1])])
    found = _improved(found, f, target)
    for _ in range(sections):
        trials = [_improved(_grown(found, f, target, sign), f, target) for sign in (1.0, -1.0)]
        # Take a section even if it does not help: the caller chooses the order.
        found = min(trials, key=lambda p: float(np.sum(_misfit(p, f, target) ** 2)))
    return _described(found, f, S)


def _log_density(p: np.ndarray, f: np.ndarray) -> np.ndarray:
    """log |G|^2 of gain, lag, and sections of (zero, its damping, pole, its damping), all logarithms."""
    log = p[0] - np.log1p((f / np.exp(p[1])) ** 2)
    for zero, zero_damping, pole, pole_damping in p[2:].reshape(-1, 4):
        log = log + _log_square(f, zero, zero_damping) - _log_square(f, pole, pole_damping)
    return log


def _log_square(f: np.ndarray, log_corner: float, log_damping: float) -> np.ndarray:
    """log |1 - r^2 + 2 j zeta r|^2 with r = f / corner."""
    r, zeta = f / np.exp(log_corner), np.exp(log_damping)
    return np.log((1.0 - r**2) ** 2 + (2.0 * zeta * r) ** 2)


def _misfit(p: np.ndarray, f: np.ndarray, target: np.ndarray) -> np.ndarray:
    return _log_density(p, f) - target


def _improved(p: np.ndarray, f: np.ndarray, target: np.ndarray) -> np.ndarray:
    corner, damping = (np.log(f[0] / 30.0), np.log(f[-1] * 30.0)), (np.log(1e-4), np.log(5.0))
    level = (p[0] - 60.0, p[0] + 60.0)
    bounds = np.array([level, corner, *(len(p) // 4) * [corner, damping, corner, damping]])[: len(p)]
    inside = np.clip(p, bounds[:, 0] + 1e-6, bounds[:, 1] - 1e-6)
    answer = least_squares(_misfit, inside, args=(f, target), bounds=bounds.T, x_scale="jac", max_nfev=200)
    return np.asarray(answer.x)


def _grown(p: np.ndarray, f: np.ndarray, target: np.ndarray, sign: float) -> np.ndarray:
    """One more section where the table lies furthest above (below) the filter: a bump (dip) of that size."""
    short = sign * (target - _log_density(p, f))
    at = int(np.argmax(short))
    width = np.count_nonzero(short > short[at] / 2.0) / len(f) * np.log(f[-1] / f[0])
    damping = float(np.clip(width / 2.0, 1e-3, 1.0))
    narrow, wide = np.log(damping), np.log(min(damping * np.exp(max(short[at], 0.1) / 2.0), 4.0))
    zero, pole = (wide, narrow) if sign > 0.0 else (narrow, wide)
    return np.concatenate([p, [np.log(f[at]), zero, np.log(f[at]), pole]])


def _described(p: np.ndarray, f: np.ndarray, S: np.ndarray) -> SpectrumFit:
    lag = 2.0 * np.pi * np.exp(p[1])
    one = np.eye(1)
    system = StateSpace(-lag * one, lag * one, np.exp(p[0] / 2.0) * one, 0.0 * one)
    for section in p[2:].reshape(-1, 4):
        system = series(system, second_order_section(*np.exp(section)))
    fitted = np.abs(by_solving(system)(2j * np.pi * f)[:, 0, 0]) ** 2
    error = 10.0 * np.log10(fitted / S)
    return SpectrumFit(system, float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))


def colour_disturbances(plant: Plant, colours: PortFilters) -> Plant:
    """The plant with filters in front of disturbances: its group w becomes the white noises that drive them.

    The noises are inputs ``"noise of NAME"`` (numbered where a filter takes several) and replace their
    disturbances in w; the original inputs remain, so that commands are not coloured. Inert modes are left
    out. Raises `ConfigError` for filters that are not stable or at ports that are not in w.
    """
    Shaping(colours=colours)  # its checks
    active = partition_modes(plant).active
    chosen = [(n, f) for n, f in zip(active.w, pick(colours, active.w), strict=True) if f is not None]
    if not chosen:
        return active
    system, colour = active.system, beside(*(one for _, one in chosen))
    drive = system.B[:, active.input_indices([name for name, _ in chosen])]
    through = system.D[:, active.input_indices([name for name, _ in chosen])]
    states = np.zeros((len(colour.A), len(active.inputs)))
    dynamics = StateSpace(
        np.block([[colour.A, np.zeros((len(colour.A), len(system.A)))], [drive @ colour.C, system.A]]),
        np.block([[states, colour.B], [system.B, drive @ colour.D]]),
        np.hstack([through @ colour.C, system.C]),
        np.hstack([system.D, through @ colour.D]),
    )
    noises_of = {name: _noise_names(name, one.D.shape[1]) for name, one in chosen}
    noises = tuple(Port(noise, "1") for names in noises_of.values() for noise in names)
    return dataclasses.replace(
        active,
        dynamics=dynamics,
        inputs=(*active.inputs, *noises),
        w=tuple(noise for name in active.w for noise in noises_of.get(name, [name])),
        state_names=(
            *(f"colour of {name}" for name, one in chosen for _ in range(len(one.A))),
            *name_states(active),
        ),
    )


def _noise_names(port: str, count: int) -> list[str]:
    return [f"noise of {port}" + (f" {k + 1}" if count > 1 else "") for k in range(count)]
