"""The damping ratio of every mode, from the losses of the parts that hold its energy.

Three sources add up: a base (of flexibility and suspension, or from a measured table), the loss in the
material, and viscous devices. A mode that is given its own ratio has that and nothing else.

- Base: with a loss factor of 2 zeta_f in all that strains and of 2 zeta_s in all else that holds the article,
  a mode with the parts s and r of its energy in these has zeta = s zeta_f + r zeta_s (the modal strain energy
  method, see below). r = 1 - s unless weight or preload softens the mode: their energy has no loss,
  and s alone may be above one. In orbit r = 0. Or by rank, where the article says so.

- Material: a loss factor eta makes the stiffness of a member k (1 + j eta). To first order the mode loses
  the fraction sum_i eta_i U_i / U of its energy U = omega^2 / 2, and zeta = sum_i eta_i U_i / (2 U)
  (Ungar and Kerwin 1962, J. Acoust. Soc. Am. 34; Johnson and Kienholz 1982, AIAA J. 20). Gravity and
  preload store energy without loss: they are in U and in no U_i.
- Devices: C = sum_d c_d r_d' r_d with r_d the rate of damper d per coordinate; zeta = phi' C phi / (2 omega).
  What C does between modes is left out; to first order mode j joins mode i with the amplitude
  |phi_i' C phi_j| omega / |omega_i^2 - omega_j^2| in quadrature (Rayleigh 1877, Theory of Sound, section
  102). The largest is reported, and warned about above `COUPLING_LIMIT`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Inexact

from middeck.errors import ConfigError
from middeck.structure.model.article import Damping, DampingTable
from middeck.structure.modes.motions.dampers import damper_matrix, number_of
from middeck.structure.modes.motions.strain_shares import lossy_shares, member_energy
from middeck.structure.modes.names.kinds import CURE, is_held, kinds_by_rank
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.loss_coupling import LossFactors, coupled_pairs
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.values import record

COUPLING_LIMIT = 0.03
"""Amplitude of a neighbour in a damped mode above which its ratio may be off by a thousandth: errors of
ratios and frequencies are of the order of its square."""
LARGE_LOSS = 0.026
"""Ratio from loss factors from which on the complex mode's differs by a thousandth: 3/2 of its square."""
UNCOUPLED = 1e-9
"""Part of the largest entry of phi' C phi below which an entry is rounding."""
ROUNDING = 1e-6
"""Energy over that of the stiffest modes that is rounding."""


@record(kw_only=True)
class RatiosByCause:
    """Damping ratios and where they come from.

    Attributes:
        zeta: Ratio of each mode.
        base, material, device: Parts by energy, rank or table, by loss factors, by dampers; a mode's own
            ratio is its base.
    """

    zeta: Float[np.ndarray, " mode"]
    base: Float[np.ndarray, " mode"]
    material: Float[np.ndarray, " mode"]
    device: Float[np.ndarray, " mode"]


@record(kw_only=True)
class ModalDamping(RatiosByCause):
    """Damping ratios, where they come from and what they leave out.

    Attributes:
        coupling: Largest amplitude of one mode in another that dampers cause and that is left out.
        warnings: Coupling above `COUPLING_LIMIT`, modes that share their losses, losses above `LARGE_LOSS`,
            rigid modes that a damper holds, names that no mode has.
    """

    coupling: float
    warnings: tuple[str, ...]


def estimate_damping(
    modes: Modes, damping: Damping | None = None, *, count: int | None = None
) -> ModalDamping:
    """The ratio of each of the lowest ``count`` modes (all by default) under ``damping`` (the article's).

    Raises `ConfigError` for a mode outside of the table, a member, joint, spring or attach point that there
    is not, a damper at an axis that does not move, a mode number too high, and a sum that is not below one.
    """
    damping = modes.equilibrium.model.structure.damping if damping is None else damping
    count = len(modes.omega) if count is None else min(count, len(modes.omega))
    found, parts, C = _estimate(modes, damping, count)
    warnings = _undamped_rigid(modes, np.diag(C)) + tuple(
        f"a damping ratio is given for mode {key!r}, which there is not here"
        for key, _ in damping.by_mode
        if find_mode(modes, key) is None
    )
    plain = np.abs(parts.sum(axis=0) - 1.0) > ROUNDING
    warnings += _coupled_losses(modes, damping, found.base + found.material, plain)
    warnings += _large_losses(modes, found.material)
    coupling, i, j = _coupling(C, modes.omega[:count])
    if coupling > COUPLING_LIMIT:
        pair = f"{modes.name[i]!r} and {modes.name[j]!r}"
        warnings += (f"dampers couple modes {pair} by {coupling:.2g}; modal damping leaves that out",)
    return ModalDamping(
        zeta=found.zeta,
        base=found.base,
        material=found.material,
        device=found.device,
        coupling=coupling,
        warnings=warnings,
    )


def ratios_by_cause(
    modes: Modes, damping: Damping | None = None, *, count: int | None = None
) -> RatiosByCause:
    """The ratios of `estimate_damping` without its warnings, which take longer than they."""
    damping = modes.equilibrium.model.structure.damping if damping is None else damping
    return _estimate(modes, damping, len(modes.omega) if count is None else min(count, len(modes.omega)))[0]


def _estimate(modes: Modes, damping: Damping, count: int) -> tuple[RatiosByCause, np.ndarray, np.ndarray]:
    """Ratios with their parts, shares of energy, and the matrix of dampers."""
    omega, shapes = modes.omega[:count], modes.shapes[:, :count]
    parts = base_parts(modes, damping, modes.equilibrium, omega**2, shapes)
    base = _base(modes, damping, parts)
    material = material_ratios(modes.equilibrium, damping, omega, shapes)
    C = damper_matrix(modes.equilibrium, damping, shapes)
    device = np.divide(np.diag(C), 2.0 * omega, out=np.zeros(count), where=omega > 0.0)
    for key, ratio in damping.by_mode:
        index = find_mode(modes, key)
        if index is not None and index < count:
            base[index], material[index], device[index] = ratio, 0.0, 0.0
    zeta = base + material + device
    worst = int(np.argmax(zeta)) if len(zeta) else 0
    if len(zeta) and not zeta[worst] < 1.0:
        part = parts[0, worst]
        near = f": weight or preload takes {1.0 - 1.0 / part:.2%} of its stiffness" if part > 2.0 else ""
        raise ConfigError(
            f"mode {modes.name[worst]!r} would have the damping ratio {zeta[worst]:.3g}{near}",
            where="damping",
            hint="a modal ratio is below 1; smaller loss factors or dampers, or a rate loop"
            + (", or an article that is farther from falling over" if near else ""),
        )
    return RatiosByCause(zeta=zeta, base=base, material=material, device=device), parts, C


def _coupled_losses(
    modes: Modes, damping: Damping, zeta: np.ndarray, lossless: np.ndarray
) -> tuple[str, ...]:
    """Modes of nearly one frequency whose losses are not those of each alone."""
    count = len(zeta)
    by_energy = damping.table is None and not damping.by_rank
    rest = damping.suspension if is_held(modes.equilibrium) else damping.flexible
    losses = LossFactors(
        2.0 * damping.flexible * by_energy, 2.0 * rest * by_energy, member_losses(modes.equilibrium, damping)
    )
    given = {find_mode(modes, key) for key, _ in damping.by_mode}
    return tuple(
        f"modes {i} {modes.name[i]!r} and {j} {modes.name[j]!r} at {modes.frequency_hz[i]:.4g} and "
        f"{modes.frequency_hz[j]:.4g} Hz share their losses: their ratios would be {a:.3g} and {b:.3g} in "
        f"place of {zeta[i]:.3g} and {zeta[j]:.3g}; {CURE}, or give each its own ratio ([damping.mode])"
        for (i, j), (a, b) in coupled_pairs(
            modes.equilibrium, modes.omega[:count], modes.shapes[:, :count], zeta, losses, lossless
        )
        if not given & {i, j}
    )


def _large_losses(modes: Modes, material: np.ndarray) -> tuple[str, ...]:
    """The root of omega^2 (1 + j eta) is off by 3/8 eta^2 in its ratio and by eta^2/4 in its size."""
    many = np.flatnonzero(material > LARGE_LOSS)
    if not len(many):
        return ()
    worst = int(many[np.argmax(material[many])])
    root = np.sqrt(1.0 + 2j * material[worst])
    return (
        f"loss factors are large for {len(many)} modes, most for {modes.name[worst]!r}: the ratio is half "
        f"the loss factor, {material[worst]:.3g}, where the complex mode has {np.imag(root) / abs(root):.3g} "
        f"and a frequency {abs(root) - 1.0:.2%} higher (`solve_damped`)",
    )


def _base(modes: Modes, damping: Damping, parts: np.ndarray) -> np.ndarray:
    count = parts.shape[1]
    swings = modes.omega[:count] > 0.0
    base = base_ratios(damping, parts, swings)
    if damping.table is not None:
        base[swings] = _interpolate(damping.table, modes.frequency_hz[:count][swings])
    return base


def base_ratios(
    damping: Damping, parts: Inexact[np.ndarray, "2 mode"], swings: Bool[np.ndarray, " mode"]
) -> Inexact[np.ndarray, " mode"]:
    """The base of each mode from its `base_parts`, and that of modes at zero; analytic."""
    return np.where(swings, parts[0] * damping.flexible + parts[1] * damping.suspension, damping.rigid)


def base_parts(
    modes: Modes,
    damping: Damping,
    equilibrium: Equilibrium,
    lam: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> Inexact[np.ndarray, "2 mode"]:
    """Weights of the flexible and of the suspension's ratio in the bases of the lowest modes; analytic.

    ``equilibrium``, ``lam`` (omega^2) and ``shapes`` are those of ``modes``, or perturbed. In orbit what does
    not strain is the article's own preload, and has no loss.
    """
    if damping.by_rank:
        kinds = kinds_by_rank(modes.equilibrium, modes.kind)[: len(lam)]
        flexible = np.array([float(kind == "flexible") for kind in kinds])
        return np.array([flexible, 1.0 - flexible])
    parts = lossy_shares(equilibrium, lam, shapes)
    if is_held(modes.equilibrium):
        return parts
    whole = (np.abs(np.real(parts[0]) - 1.0) <= ROUNDING) | (np.real(lam) == 0.0)
    return np.array([np.where(whole, 1.0, parts[0]), np.zeros(len(lam))])


def damped_kinds(modes: Modes) -> tuple[str, ...]:
    """Kinds by rank where the article's damping goes by rank, else those of ``modes``."""
    if modes.equilibrium.model.structure.damping.by_rank:
        return kinds_by_rank(modes.equilibrium, modes.kind)
    return modes.kind


def _interpolate(table: DampingTable, frequency_hz: np.ndarray) -> np.ndarray:
    low, high = table.frequency_hz[0], table.frequency_hz[-1]
    outside = frequency_hz[(frequency_hz < low) | (frequency_hz > high)]
    if len(outside) and not table.hold:
        raise ConfigError(
            f"a mode at {outside[0]:.4g} Hz is outside of the damping measured from {low:g} to {high:g} Hz",
            where="damping.table",
            hint='measure further, keep fewer modes, or hold the last ratio (outside = "hold")',
        )
    return np.interp(np.log(frequency_hz), np.log(table.frequency_hz), table.zeta)


def material_ratios(
    equilibrium: Equilibrium,
    damping: Damping,
    omega: Inexact[np.ndarray, " mode"],
    shapes: Inexact[np.ndarray, "coordinate mode"],
) -> Inexact[np.ndarray, " mode"]:
    """Damping ratio of each mode from loss factors; analytic."""
    if not damping.loss_factor:
        return np.zeros(len(omega))
    lost = member_energy(equilibrium, shapes) @ member_losses(equilibrium, damping)
    return np.divide(lost, omega**2, out=np.zeros_like(lost), where=np.real(omega) > 0.0)


def member_losses(equilibrium: Equilibrium, damping: Damping) -> Inexact[np.ndarray, " member"]:
    """Loss factor of each member, in the order of the structure."""
    members = [m.name for m in equilibrium.model.structure.members]
    eta = np.zeros(len(members), np.result_type(float, *(value for _, value in damping.loss_factor)))
    for name, value in damping.loss_factor:
        eta[number_of(name, "member", members)] = value
    return eta


def find_mode(modes: Modes, key: str | int) -> int | None:
    """Number of a mode; None for a name that no mode has in this environment."""
    if isinstance(key, str):
        return modes.name.index(key) if key in modes.name else None
    if not 0 <= key < len(modes.omega):
        raise ConfigError(
            f"no mode {key}", where="damping.mode", hint=f"a number from 0 to {len(modes.omega) - 1}"
        )
    return key


def _undamped_rigid(modes: Modes, own: np.ndarray) -> tuple[str, ...]:
    """A damping ratio says nothing of a mode without a frequency."""
    held = (modes.omega[: len(own)] == 0.0) & (own > UNCOUPLED * own.max(initial=0.0))
    names = ", ".join(repr(modes.name[i]) for i in np.flatnonzero(held))
    advice = "no ratio holds that: close it as a rate loop (PDLoops)"
    return (f"a damper works on the rigid modes {names}; {advice}",) if names else ()


def _coupling(C: np.ndarray, omega: np.ndarray) -> tuple[float, int, int]:
    """The largest amplitude of one mode in another, and which two."""
    apart = np.abs(omega[:, None] ** 2 - omega**2)
    swings = np.maximum(omega[:, None], omega)
    real = (np.abs(C) > UNCOUPLED * np.abs(C).max(initial=0.0)) & (swings > 0.0) & ~np.eye(len(C), dtype=bool)
    amplitude = np.zeros_like(C)
    with np.errstate(divide="ignore"):  # equal frequencies: coupled without limit
        np.divide(np.abs(C) * swings, apart, out=amplitude, where=real)
    if not amplitude.any():
        return 0.0, 0, 0
    i, j = np.unravel_index(int(np.argmax(amplitude)), amplitude.shape)
    return float(amplitude[i, j]), int(i), int(j)
