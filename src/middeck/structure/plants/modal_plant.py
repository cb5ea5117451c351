"""From modes to a plant: modal input and output matrices at the article's named actuators and sensors."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.signals.ports import require_names
from middeck.structure.assembly.wheel_forces import Spin, spinning_wheels
from middeck.structure.model.article import Damping
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.coupled_response import coupling_warnings
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.plants.residual_flexibility import residual_flexibility
from middeck.structure.plants.sensors_and_actuators import input_rows, output_rows
from middeck.structure.plants.whirl_modes import momentum_warnings
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.inert_modes import inert_modes
from middeck.systems.state_space.modal_system import ModalSystem, couple_rates, select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import require_kind


@named_kinds
def build_plant(
    modes: Modes,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    count: int = 26,
    damping: Damping | None = None,
    static: bool = False,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The lowest ``count`` modes between named actuators [N m, N] and sensors [rad, m; with _rate per s].

    Sensor and actuator axes turn with their bodies: both are linearised at the equilibrium. An accelerometer
    [m/s^2] reads acceleration and, under gravity, g times tilt, as a change from its reading at rest; its
    direct term is that of the kept modes.

    Where wheels spin in the environment of ``modes``, their momentum couples the modes: the plant is a state
    space in the coordinates (q, q'/omega) of the modes at standstill, without those in no transfer function.

    Args:
        count: Modes kept.
        damping: The article's by default; warns where it does not fit these modes, and of the paths whose
            response lacks what losses between the modes do (`coupling_warnings`).
        static: Add the residual flexibility of the other modes, so that static gains are right: a direct term
            to angles and to an accelerometer's g times tilt. Rates and accelerations have none: their rest
            grows with frequency and has no place in a state space. `compare_static_gain` shows its effect.

    Raises `ConfigError` for an unknown port, one name where several are asked for, a negative count, a torque
    at a fixed axis, or rigid modes left out where ``static`` is asked for or wheels spin.
    """
    require_kind(modes, Modes, "modes", "solve_modes(solve_equilibrium(structure, environment))")
    for what, names in (("inputs", inputs), ("outputs", outputs), ("w", w), ("u", u), ("z", z), ("y", y)):
        require_names(names, what)
    if count < 0:
        raise ConfigError(f"a plant of {count} modes", hint=f"0 to {len(modes.omega)}")
    equilibrium, count = modes.equilibrium, min(count, len(modes.omega))
    shapes = modes.shapes[:, :count]
    drive, read = input_rows(equilibrium, inputs), output_rows(equilibrium, outputs)
    damped = estimate_damping(modes, damping, count=count)
    spin = spinning_wheels(equilibrium.model, equilibrium.config, equilibrium.environment)
    modal = ModalSystem(
        omega=modes.omega[:count],
        zeta=damped.zeta,
        psi=(drive.force @ shapes).T,
        phi=read.position @ shapes,
        phi_rate=read.rate @ shapes,
        names=modes.name[:count],
        phi_acceleration=read.acceleration @ shapes if np.any(read.acceleration) else None,
        direct=residual_flexibility(modes, drive.force, read.position, count) if static else None,
    )
    texts = (*damped.warnings, *momentum_warnings(modes, spin, damped.zeta))
    if not spin.turns:
        chosen = equilibrium.model.structure.damping if damping is None else damping
        texts += coupling_warnings(modes, chosen, modal, (tuple(inputs), tuple(p.name for p in read.ports)))
    for text in texts:
        warnings.warn(text, UserWarning, stacklevel=3)
    return Plant(
        dynamics=_turning(modal, spin, spin.turn @ shapes) if spin.turns else modal,
        inputs=drive.ports,
        outputs=read.ports,
        w=tuple(w),
        u=tuple(u),
        z=tuple(z),
        y=tuple(y),
    )


def _turning(modal: ModalSystem, spin: Spin, turn: np.ndarray) -> StateSpace:
    """The modes joined by spinning wheels, which sense and act at the ``turn`` of their frames."""
    wheels = dataclasses.replace(
        modal, psi=turn.T, phi=np.zeros_like(turn), phi_rate=turn, phi_acceleration=None, direct=None
    )
    coupled = ~(inert_modes(modal) & inert_modes(wheels))
    turn = turn[:, coupled]
    return couple_rates(select_modes(modal, coupled), turn.T @ spin.forces(turn))
