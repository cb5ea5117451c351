"""Modal reduction: remove the modes of least contribution between chosen ports in a band.

The contribution of a mode is its largest fraction, within the band, of any path's largest response, which is
independent of units. A removed mode above the band leaves its static gain (residual flexibility), one below
it leaves its gain as a mass (an accelerometer's direct part).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import cast

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Complex, Float

from middeck.arguments import named_kinds
from middeck.control.analysis.stability.delayed_roots import with_conjugates
from middeck.control.law.partition import partition_modes
from middeck.control.reduction.separation import does_not_decay, separate_poles
from middeck.errors import ConfigError
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.resolvent import evaluate_transfer
from middeck.systems.state_space.modal_system import ModalSystem, modal_response, select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

ACROSS = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])
"""Lines across each mode, in half-power half-widths, at which a path's largest response is looked for."""
BESIDE = 1e-6
"""Relative distance of such lines from a mode that does not decay, whose response is infinite there."""


@record(kw_only=True)
class ReducedPlant:
    """A plant of lower order with the same ports.

    Attributes:
        plant: The reduced plant, modal if it was.
        order: Its states.
        kept, dropped: Names of the modes kept exactly, and of those left out.
        error: The largest error within the band.
    """

    plant: Plant
    order: int
    kept: tuple[str, ...]
    dropped: tuple[str, ...]
    error: float


@named_kinds
def reduce_modes(
    plant: Plant,
    modes: int,
    *,
    band_hz: tuple[float, float],
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    static: bool = True,
) -> ReducedPlant:
    """The plant with the ``modes`` that contribute most from ``inputs`` to ``outputs`` within ``band_hz``.

    Rigid modes, and poles that do not decay, are kept and counted. A modal plant stays modal; the modes of a
    state space are its pole pairs and real poles, kept by an invariant subspace. ``static`` keeps the limits
    of dropped modes in the direct term; without it no direct term is added (an LQG design refuses one from
    process noise to a performance output). All ports unless named.

    Raises `ConfigError` for more modes than there are, fewer than must be kept, a band that is none, or
    unknown ports.
    """
    if not 0.0 <= band_hz[0] < band_hz[1] < np.inf:
        raise ConfigError(f"a band of {band_hz} Hz", hint="0 <= low < high, both finite")
    active = partition_modes(plant).active
    u = active.input_indices(tuple(inputs) or [p.name for p in active.inputs])
    y = active.output_indices(tuple(outputs) or [p.name for p in active.outputs])
    band = 2.0 * np.pi * band_hz[0], 2.0 * np.pi * band_hz[1]
    dynamics = active.rational
    if isinstance(dynamics, ModalSystem):
        return _of_modal(active, dynamics, modes, band, (u, y), static)
    return _of_statespace(active, dynamics, modes, band, (u, y), static)


def _of_modal(
    plant: Plant,
    modal: ModalSystem,
    modes: int,
    band: tuple[float, float],
    ports: tuple[list[int], list[int]],
    static: bool,
) -> ReducedPlant:
    seen = modal.select(*ports)
    keep = _most(_contributions(seen, band), modal.zeta * modal.omega <= 0.0, modes)
    smaller = select_modes(modal, keep)
    gone = dataclasses.replace(select_modes(modal, ~keep), direct=None)
    limit = _limits(gone, band)
    if static:
        direct = limit if modal.direct is None else modal.direct + limit
        smaller = dataclasses.replace(smaller, direct=direct)
    left = gone.select(*ports).as_statespace()
    if static:
        left = dataclasses.replace(left, D=left.D - limit[np.ix_(ports[1], ports[0])])
    return ReducedPlant(
        plant=dataclasses.replace(plant, dynamics=smaller),
        order=smaller.order,
        kept=smaller.names,
        dropped=gone.names,
        error=peak_gain(left, band).gain,
    )


def _limits(gone: ModalSystem, band: tuple[float, float]) -> Float[np.ndarray, "output input"]:
    """Static gain of modes in or above the band, direct part of those below it."""
    above = gone.omega >= band[0]
    limit = gone.phi[:, above] @ (gone.psi[above] / gone.omega[above, None] ** 2)
    if gone.phi_acceleration is None:
        return limit
    return limit + gone.phi_acceleration[:, ~above] @ gone.psi[~above]


def _contributions(modal: ModalSystem, band: tuple[float, float]) -> Float[np.ndarray, " mode"]:
    lines = _lines(modal.omega, modal.zeta * modal.omega, band)
    size = np.abs(modal_response(modal, lines)).max(axis=0, initial=0.0)
    share = np.zeros(len(modal.omega))
    for m in np.flatnonzero(modal.zeta * modal.omega > 0.0):
        one = dataclasses.replace(select_modes(modal, np.array([m])), direct=None)
        at = _lines(one.omega, one.zeta * one.omega, band)
        share[m] = _share(np.abs(modal_response(one, at)).max(axis=0), size)
    return share


def _share(part: np.ndarray, size: np.ndarray) -> float:
    """The largest fraction over all paths with a response."""
    return float(np.max(part / np.where(size > 0.0, size, np.inf), initial=0.0))


def _lines(omega: np.ndarray, rate: np.ndarray, band: tuple[float, float]) -> Float[np.ndarray, " line"]:
    """Lines across each mode that decays by ``rate`` > 0 and at the ends of the band, none on another."""
    # Lines at zero frequency would meet rigid modes: a thousandth of the band's width above it.
    low = max(band[0], 1e-3 * band[1])
    decays = rate > 0.0
    across = (omega[decays, None] + ACROSS * rate[decays, None]).ravel()
    lines = np.unique(np.clip(np.append(across, [low, band[1]]), low, band[1]))
    beside = np.abs(lines[:, None] - omega[~decays]) > BESIDE * omega[~decays]
    return lines[beside.all(axis=1)]


def _most(
    share: Float[np.ndarray, " mode"], must: Bool[np.ndarray, " mode"], modes: int
) -> Bool[np.ndarray, " mode"]:
    if not len(share):
        raise ConfigError("the plant has no modes", hint="it needs no reduction")
    if not max(int(must.sum()), 1) <= modes <= len(share):
        raise ConfigError(
            f"cannot keep {modes} modes of {len(share)}: {int(must.sum())} do not decay and must be kept",
            hint=f"from {max(int(must.sum()), 1)} to {len(share)}",
        )
    ranked = np.argsort(-np.where(must, np.inf, share), kind="stable")
    keep = np.zeros(len(share), dtype=bool)
    keep[ranked[:modes]] = True
    return keep


def _of_statespace(
    plant: Plant,
    system: StateSpace,
    modes: int,
    band: tuple[float, float],
    ports: tuple[list[int], list[int]],
    static: bool,
) -> ReducedPlant:
    values, grows, share = _pole_shares(system.select(*ports), band)
    keep = _most(share, grows, modes)
    parts = separate_poles(system, with_conjugates(values[keep]))
    gone = parts.rest
    limit = _static_limit(gone, values[~keep & (np.abs(values) >= band[0])]) if static else gone.D
    smaller = dataclasses.replace(parts.kept, D=limit)
    left = dataclasses.replace(gone, D=gone.D - limit).select(*ports)
    states = tuple(f"modal {i}" for i in range(len(smaller.A)))
    return ReducedPlant(
        plant=dataclasses.replace(plant, dynamics=smaller, state_names=states),
        order=len(smaller.A),
        kept=_pole_names(values[keep]),
        dropped=_pole_names(values[~keep]),
        error=peak_gain(left, band).gain,
    )


def _static_limit(gone: StateSpace, above: np.ndarray) -> Float[np.ndarray, "output input"]:
    """Static gain of the poles ``above``; what lies below the band has its limit in the direct term."""
    if not len(above):
        return gone.D
    springs = separate_poles(gone, with_conjugates(above)).kept
    return gone.D - springs.C @ np.linalg.solve(springs.A, springs.B)


def _pole_shares(
    system: StateSpace, band: tuple[float, float]
) -> tuple[Complex[np.ndarray, " mode"], Bool[np.ndarray, " mode"], Float[np.ndarray, " mode"]]:
    """One pole of each pair, whether it does not decay, and else its largest share of any path."""
    values, left, right = cast(
        "tuple[np.ndarray, np.ndarray, np.ndarray]", sla.eig(system.A, left=True, right=True)
    )
    one = np.flatnonzero(np.imag(values) >= 0.0)
    grows = does_not_decay(system, values[one])
    lines = _lines(np.abs(values[one]), np.where(grows, 0.0, -np.real(values[one])), band)
    size = np.abs(evaluate_transfer(system, 1j * lines)).max(axis=0, initial=0.0)
    share = np.zeros(len(one))
    for i in np.flatnonzero(~grows):
        k = one[i]
        overlap = left[:, k].conj() @ right[:, k]
        at = 1j * _lines(np.abs(values[[k]]), np.abs(np.real(values[[k]])), band)[:, None, None]
        residue = np.outer(system.C @ right[:, k], left[:, k].conj() @ system.B)
        response = residue / (at - values[k])
        if values[k].imag > 0.0:
            response = response + residue.conj() / (at - values[k].conj())
        # Eigenvectors of a double pole do not overlap: give it the largest contribution.
        share[i] = _share(np.abs(response).max(axis=0), size) / max(abs(overlap), np.finfo(float).tiny)
    return values[one], grows, share


def _pole_names(values: Complex[np.ndarray, " mode"]) -> tuple[str, ...]:
    return tuple(f"{abs(pole) / (2.0 * np.pi):.4g} Hz" for pole in values)
