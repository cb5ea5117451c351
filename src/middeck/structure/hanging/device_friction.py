"""Friction in suspension devices: the band of rest states, and modes against amplitude.

A rest state is sought without friction, the middle of those with it. In motion each device acts by its
describing function at its own amplitude (Krylov and Bogoliubov 1937, Caughey 1960), the same law that a joint
has: `middeck.joints.friction.Friction`, with N and N/m in place of N m and N m/rad.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, EquilibriumError
from middeck.joints.element import check_amplitudes
from middeck.joints.friction import Friction
from middeck.structure.assembly.energy import assemble_carried
from middeck.structure.assembly.factorisation import positive_factor
from middeck.structure.assembly.linked import static_freedom
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.places import transport
from middeck.structure.elements.frames import points_in_world, rigid_columns
from middeck.structure.model.article import Damping
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.values import record

UNMOVED = 1e-9
"""Part of what the most mobile mode moves the devices by, below which a mode moves them by rounding only."""


@record
class RestBand:
    """Half widths of the band in which an article may rest, to first order in the friction.

    Attributes:
        device, travel: Name of each device and spring, and how far its attach point may rest along it [m].
        shift, turn: Shift and turn of the whole article, by mass, along [m] and about [rad] the world axes.
    """

    device: tuple[str, ...]
    travel: Float[np.ndarray, " device"]
    shift: Float[np.ndarray, "3"]
    turn: Float[np.ndarray, "3"]


def estimate_rest_band(equilibrium: Equilibrium) -> RestBand:
    """Largest distance from frictionless rest at which friction may hold the article, for each number alone.

    Every device may hold any force up to its friction, in either direction: the rest states fill K^-1 W'f,
    |f_i| <= F_i, and the largest of a row r of it is the sum of |r K^-1 w_i'| F_i. Raises `EquilibriumError`
    where the rest state is not stable against some motion: friction would then hold it anywhere.
    """
    model, config, loads = equilibrium.model, equilibrium.config, equilibrium.loads
    free = static_freedom(model, config)
    rows = device_rows(equilibrium)
    friction = np.array([0.0 if f is None else f.slip_torque for f in _frictions(equilibrium)])
    # Beside stiff members only carried coordinates keep the digits of what is soft.
    T = transport(config, model.tree)
    carried = rows @ T
    factor = positive_factor(free.matrix(assemble_carried(model, config, loads).tangent))
    if factor is None:
        raise EquilibriumError(
            "a motion has no stiffness: with friction the article could rest anywhere along it",
            where="estimate_rest_band",
            hint="look for modes at zero frequency",
        )
    moved = free.spread(factor.solve(free.part(carried.T)) * friction)
    M = mass_matrix(model, config)
    whole = rigid_columns(model.tree, config, config.x.mean(axis=0))
    rigid = np.linalg.solve(whole.T @ (M @ whole), whole.T @ (M @ (T @ moved)))
    band = np.abs(rigid).sum(axis=1)
    return RestBand(equilibrium.devices, np.abs(carried @ moved).sum(axis=1), band[:3], band[3:])


def device_rows(equilibrium: Equilibrium) -> Float[np.ndarray, "device coordinate"]:
    """Rate at which each device and spring lengthens per unit rate of the coordinates."""
    model, loads = equilibrium.model, equilibrium.loads
    poses = equilibrium.poses
    span = points_in_world(model.points, poses)[loads.attach_point] - loads.anchor
    along = span / np.linalg.norm(span, axis=1)[:, None]
    place = 6 * loads.attach_point[:, None] + np.arange(3)
    J = model.pose_map.jacobian(poses)[place.ravel()].toarray()
    return np.einsum("di,dic->dc", along, J.reshape(*along.shape, -1))


def _frictions(equilibrium: Equilibrium) -> tuple[Friction | None, ...]:
    """Friction of every device; springs have none."""
    environment = equilibrium.environment
    return (*(d.friction for d in environment.hung), *(None for _ in environment.springs))


@record(kw_only=True)
class DeviceFrictionCurve:
    """One mode of a hung article against its amplitude, with the friction of its devices.

    Attributes:
        name: Name of the mode.
        amplitude: Amplitude of the device with friction that travels most [m], zero to peak.
        device, travel: Names of the devices with friction, and the amplitude of each [m].
        stiffness, loss: Equivalents of the friction of each [N/m].
        omega: Angular frequency [rad/s] with the equivalent stiffnesses.
        zeta: Damping ratio -Re s/|s| of the complex eigenvalue, modal damping included.
        shape_change: Largest part of another mode that the equivalent stiffnesses would mix into this one, to
            first order. Above a tenth or so the numbers are a sketch.
    """

    name: str
    amplitude: Float[np.ndarray, " amplitude"]
    device: tuple[str, ...]
    travel: Float[np.ndarray, "amplitude device"]
    stiffness: Float[np.ndarray, "amplitude device"]
    loss: Float[np.ndarray, "amplitude device"]
    omega: Float[np.ndarray, " amplitude"]
    zeta: Float[np.ndarray, " amplitude"]
    shape_change: Float[np.ndarray, " amplitude"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, " amplitude"]:
        """Natural frequencies [Hz]."""
        return self.omega / (2.0 * np.pi)


def sweep_device_amplitude(
    modes: Modes,
    *,
    mode: str | int,
    amplitudes: Float[np.ndarray, " amplitude"],
    damping: Damping | None = None,
) -> DeviceFrictionCurve:
    """Frequency and damping of ``mode`` (name or number) against the travel of its devices.

    Harmonic balance in the shape without friction, each device at the amplitude that the shape gives it. With
    w the travel of each device in the mass-normalised mode,

        s^2 + 2 zeta omega s + w'c w s + omega^2 + w'(k_eq + j k_loss) w = 0.

    Exact where friction leaves the shape as it is, by symmetry or because it is weak: see ``shape_change``.
    ``damping`` is the article's by default.

    Raises `ConfigError` for a mode that there is not or that moves no device with friction, or amplitudes
    that are not positive.
    """
    A = check_amplitudes(amplitudes)
    index = _mode_index(modes, mode)
    frictions = _frictions(modes.equilibrium)
    laws = {i: f for i, f in enumerate(frictions) if f is not None}
    W = device_rows(modes.equilibrium)[list(laws)] @ modes.shapes
    w = W[:, index]
    if not np.abs(w).max(initial=0.0) > UNMOVED * np.abs(W).max(initial=0.0):
        raise ConfigError(
            f"mode {modes.name[index]!r} moves no device with friction",
            where="sweep_device_amplitude",
            hint="give the devices friction_n and presliding_m; a bounce or a tilt moves them",
        )
    travel = A[:, None] * np.abs(w) / np.abs(w).max()
    # A device that does not move sticks, whatever its smallest travel is called.
    swings = np.maximum(travel, UNMOVED * A[:, None])
    equal = [law.describing_function(swings[:, d]) for d, law in enumerate(laws.values())]
    k, loss = np.array([e.stiffness for e in equal]).T, np.array([e.loss for e in equal]).T
    omega = float(modes.omega[index])
    bare = float(ratios_by_cause(modes, damping).zeta[index]) if omega > 0.0 else 0.0
    half = bare * omega + 0.5 * float(np.array([law.viscous for law in laws.values()]) @ w**2)
    held = omega**2 + k @ w**2
    # The root above the real axis: half is small, so that the radicand lies near -held.
    s = -half + 1j * np.sqrt(held - half**2 + 1j * (loss @ w**2))
    names = tuple(modes.equilibrium.devices[i] for i in laws)
    change = _shape_change(modes.omega**2, W, k, index)
    zeta = -np.real(s) / np.abs(s)
    return DeviceFrictionCurve(
        name=modes.name[index],
        amplitude=A,
        device=names,
        travel=travel,
        stiffness=k,
        loss=loss,
        omega=np.sqrt(held),
        zeta=zeta,
        shape_change=change,
    )


def _shape_change(poles: np.ndarray, W: np.ndarray, stiffness: np.ndarray, index: int) -> np.ndarray:
    """First-order change of an eigenvector, its largest other component."""
    others = np.arange(len(poles)) != index
    coupling = np.abs((stiffness * W[:, index]) @ W)[:, others]
    held = poles + stiffness @ W**2
    gap = np.abs(held[:, [index]] - held[:, others])
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(coupling > 0.0, coupling / gap, 0.0)
    return part.max(axis=1, initial=0.0)


def _mode_index(modes: Modes, mode: str | int) -> int:
    if isinstance(mode, str) and mode in modes.name:
        return modes.name.index(mode)
    if isinstance(mode, int) and 0 <= mode < len(modes.omega):
        return mode
    raise ConfigError(
        f"no mode {mode!r}",
        where="sweep_device_amplitude",
        hint=f"a number below {len(modes.omega)}, or one of {', '.join(modes.name[:12])}",
    )
