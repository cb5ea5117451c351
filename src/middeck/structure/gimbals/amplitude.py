"""Frequency and damping of the modes against the amplitude of a joint with friction or play.

Harmonic balance: at the amplitude A of the joint's angle in a mode, its elements act as k_eq(A) + j k_loss(A)
(their describing functions; Krylov and Bogoliubov 1937, Caughey 1960). Since A is the joint's own amplitude
the equivalent structure is known without iteration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from middeck.errors import ConfigError
from middeck.joints.element import JointElement, check_amplitudes, sum_equivalents
from middeck.structure.gimbals.damped import SPARE, follow_damped, pair_undamped
from middeck.structure.gimbals.stiffened_joint import (
    JointSystem,
    build_joint_system,
    joint_receptance,
    solve_undamped,
)
from middeck.structure.gravity.tracking import HALF_SHAPE
from middeck.structure.model.article import Damping
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.values import record

ORDERS = (2, 3)
"""The two largest of the harmonics that harmonic balance neglects."""
LOWEST = 12
"""Modes that are shown where none are named."""


@record(kw_only=True)
class AmplitudeCurves:
    """Modes of a structure against the amplitude of one joint.

    Attributes:
        joint: Its name.
        slides: Whether it slides: then read m, N/m, N s/m for rad, N m/rad, N m s/rad.
        amplitude: Amplitude of its angle [rad] or its travel [m], zero to peak.
        stiffness, loss: Equivalents of its elements [N m/rad]; ``viscous`` [N m s/rad] beside them.
        mode, name: Number and name of each mode without the elements; it is followed from there, with its
            damping.
        omega: Angular frequency [rad/s] with the equivalent stiffness, of the undamped mode that the damped
            one looks most like: where a swing at this amplitude is in quadrature with what drives it. It
            leaps where two undamped modes veer and the damped ones pass each other.
        zeta: Damping ratio -Re s/|s| of the complex eigenvalue, modal damping included; not a number at zero
            frequency.
        likeness: |phi' M phi| of the damped shape with the undamped one whose ``omega`` it is. Below
            `HALF_SHAPE` it is several undamped modes at once: see ``doubtful``.
        overlap: |phi' M phi| with the mode without the elements: how much of it is still the same.
        joint_angle: Angle of the joint per unit of the mass-normalised mode; ``amplitude`` over it is the
            modal amplitude.
        distortion: Largest higher harmonic of the joint's angle over ``amplitude``, to first order: what
            harmonic balance leaves out. Above a tenth or so its numbers are a sketch.
    """

    joint: str
    slides: bool
    amplitude: Float[np.ndarray, " amplitude"]
    stiffness: Float[np.ndarray, " amplitude"]
    loss: Float[np.ndarray, " amplitude"]
    viscous: float
    mode: Int[np.ndarray, " mode"]
    name: tuple[str, ...]
    omega: Float[np.ndarray, "amplitude mode"]
    zeta: Float[np.ndarray, "amplitude mode"]
    likeness: Float[np.ndarray, "amplitude mode"]
    overlap: Float[np.ndarray, "amplitude mode"]
    joint_angle: Float[np.ndarray, "amplitude mode"]
    distortion: Float[np.ndarray, "amplitude mode"]

    @property
    def frequency_hz(self) -> Float[np.ndarray, "amplitude mode"]:
        """Natural frequencies [Hz]."""
        return self.omega / (2.0 * np.pi)

    @property
    def doubtful(self) -> Bool[np.ndarray, "amplitude mode"]:
        """Where a damped mode overlaps no undamped mode by half: its frequency label is arbitrary."""
        return self.likeness < HALF_SHAPE


def sweep_amplitude(
    modes: Modes,
    *,
    joint: str,
    elements: Sequence[JointElement],
    amplitudes: Float[np.ndarray, " amplitude"],
    select: Sequence[int] | None = None,
    damping: Damping | None = None,
) -> AmplitudeCurves:
    """Frequency and damping of the modes ``select`` against the amplitude of ``joint`` with ``elements``.

    ``modes`` are those without the elements, the joint free or on its spring. All of them form the basis; the
    residual flexibility represents those that were not solved for, with an error in omega^2 of the order of
    (omega/omega_highest)^2 times its own effect, and none with all modes. ``select`` is the `LOWEST` modes by
    default, ``damping`` the article's.

    Raises `ConfigError` for a joint that does not move, no elements, amplitudes that are not positive, or an
    unknown mode.
    """
    if not elements:
        raise ConfigError("no element acts at the joint", where="sweep_amplitude", hint="Friction, Deadband")
    A = check_amplitudes(amplitudes)
    chosen = _chosen(modes, select)
    bare = ratios_by_cause(modes, damping).zeta
    system = build_joint_system(modes, joint, bare)
    equal = sum_equivalents(elements, A)
    # Modes that do not move the joint stay as they are.
    omega, zeta = (np.tile(v[chosen], (len(A), 1)) for v in (modes.omega, bare))
    overlap, likeness = np.ones_like(omega), np.ones_like(omega)
    angle, distortion = np.zeros_like(omega), np.zeros_like(omega)
    moved = np.flatnonzero(np.isin(chosen, system.mode))
    poles = np.array([np.flatnonzero(system.mode == m)[0] for m in chosen[moved]], dtype=int)
    damped = follow_damped(system, elements, A, poles)
    count = int(poles.max(initial=0)) + 1 + SPARE
    shapes = np.zeros((len(A), len(system.pole), len(poles)))
    for i, (found, k) in enumerate(zip(damped, equal.stiffness, strict=True)):
        lam, every = solve_undamped(system, float(k), count)
        own = pair_undamped(found, every)
        omega[i, moved], shapes[i] = np.sqrt(lam[own.mode]), every[:, own.mode]
        likeness[i, moved] = own.likeness
        zeta[i, moved] = -np.real(found.s) / np.where(found.s == 0.0, 1.0, np.abs(found.s))
    overlap[:, moved] = np.abs(shapes[:, poles, np.arange(len(poles))])
    series = 1.0 + equal.stiffness[:, None] * system.flexibility
    angle[:, moved] = np.abs(np.einsum("p,apm->am", system.angle, shapes)) / series
    distortion[:, moved] = _distortion(system, elements, A, omega[:, moved])
    zeta[omega == 0.0] = np.nan
    return AmplitudeCurves(
        joint=joint,
        slides=any(j.slides for j in modes.equilibrium.model.structure.joints if j.name == joint),
        amplitude=A,
        stiffness=equal.stiffness,
        loss=equal.loss,
        viscous=sum(e.viscous for e in elements),
        mode=chosen,
        name=tuple(modes.name[m] for m in chosen),
        omega=omega,
        zeta=zeta,
        likeness=likeness,
        overlap=overlap,
        joint_angle=angle,
        distortion=distortion,
    )


def _chosen(modes: Modes, select: Sequence[int] | None) -> Int[np.ndarray, " mode"]:
    count = len(modes.omega)
    chosen = np.arange(min(LOWEST, count)) if select is None else np.array(select, dtype=int).reshape(-1)
    if not len(chosen) or np.any((chosen < 0) | (chosen >= count)):
        raise ConfigError(
            f"no modes {chosen.tolist()}", where="sweep_amplitude", hint=f"numbers from 0 to {count - 1}"
        )
    return chosen


def _distortion(
    system: JointSystem, elements: Sequence[JointElement], amplitude: np.ndarray, omega: np.ndarray
) -> Float[np.ndarray, "amplitude mode"]:
    """Higher harmonics of the elements' torque, on the structure without them."""
    found = np.zeros(omega.shape)
    for order in ORDERS:
        torque = np.abs(sum(e.harmonic(amplitude, order) for e in elements))
        for m in range(omega.shape[1]):
            swings = omega[:, m] > 0.0
            receptance = np.abs(joint_receptance(system, order * omega[swings, m]))
            share = torque[swings] / amplitude[swings] * receptance
            found[swings, m] = np.maximum(found[swings, m], share)
    return found
