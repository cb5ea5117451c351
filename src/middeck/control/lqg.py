"""Linear-quadratic Gaussian design (Kwakernaak and Sivan 1972, chapters 3 to 5)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.control.compensator import Compensator, driven_ports, measured_ports
from middeck.control.partition import partition_modes
from middeck.control.riccati import RiccatiSolution, solve_riccati
from middeck.control.stabilisability import require_reachable
from middeck.errors import ConfigError
from middeck.systems.plant import Plant, name_states, subsystem
from middeck.systems.statespace import StateSpace
from middeck.values import record


@record
class LQGWeights:
    """What a design is asked to minimise, and against what noise: E[z' W^2 z + rho u' diag(input) u].

    Parameters
    ----------
    output:
        Weight W of each performance output, in the order of the plant's group z (z is multiplied by it).
    input:
        Weight of each squared control input, in the order of the group u.
    disturbed:
        Names of the inputs on which white process noise acts.
    process:
        Its two-sided intensity matrix [unit^2/Hz], in that order.
    sensor:
        Two-sided intensity [unit^2/Hz] of each measurement's white noise, in the order of the group y.
        Process and sensor noise are independent.
    """

    output: Float[np.ndarray, " z"]
    input: Float[np.ndarray, " u"]
    disturbed: tuple[str, ...]
    process: Float[np.ndarray, "w w"]
    sensor: Float[np.ndarray, " y"]

    def __post_init__(self) -> None:
        if len(self.disturbed) != len(self.process):
            raise ConfigError(f"{len(self.disturbed)} disturbed inputs for {len(self.process)} intensities")
        if not np.all(self.input > 0.0):
            raise ConfigError("an input weight is not positive: the control would be unbounded")
        if not np.all(self.sensor > 0.0):
            raise ConfigError(
                "a sensor noise intensity is not positive: the filter would be singular",
                hint="give every measurement some noise, or take the useless one out of y",
            )
        lowest = np.linalg.eigvalsh(self.process).min(initial=0.0)
        symmetric = np.array_equal(self.process, self.process.T)
        # Rounding of an eigenvalue of a symmetric matrix, relative to its size.
        if not symmetric or lowest < -1e-12 * np.abs(self.process).max(initial=0.0):
            raise ConfigError("the process intensity is not symmetric and positive semidefinite")


@record
class KalmanFilter:
    """The stationary filter of a plant; the same at every control authority.

    ``gain`` is L in xhat' = A xhat + B u + L (y - yhat), ``solution`` that of the dual Riccati equation
    (its X is the error covariance), ``inert`` names the modes left out of the design.
    """

    gain: Float[np.ndarray, "state y"]
    solution: RiccatiSolution
    inert: tuple[str, ...]


@record
class LQGCompensator(Compensator):
    """A compensator that knows how it was made.

    Parameters
    ----------
    authority:
        1/rho.
    regulator, estimator:
        The two Riccati solutions: residuals, regulator poles and filter poles.
    cost:
        The minimum of E[z' W^2 z + rho u' diag(input) u] on the design plant, white noise unlimited in band.
    inert:
        Modes of the plant left out because no port reaches or sees them.
    """

    authority: float
    regulator: RiccatiSolution
    estimator: RiccatiSolution
    cost: float
    inert: tuple[str, ...]


def design_filter(plant: Plant, weights: LQGWeights) -> KalmanFilter:
    """The Kalman filter of ``plant``; give it to `design_lqg` in a sweep over authority.

    Raises `NotStabilisableError` naming the modes that do not decay and that no measurement sees, or that
    lie on the axis without process noise.
    """
    part = partition_modes(plant)
    active, names = part.active, name_states(part.active)
    noise = subsystem(active, weights.disturbed, active.y)
    _require_size("sensor intensities", len(weights.sensor), active.y)
    require_reachable(
        noise.A.T,
        noise.C.T,
        names,
        complaint="no measurement in y sees it",
        hint="measure it, or leave it out of the design if no input reaches it either",
    )
    V = weights.process
    solution = solve_riccati(
        noise.A.T,
        noise.C.T,
        noise.B @ V @ noise.B.T,
        np.diag(weights.sensor) + noise.D @ V @ noise.D.T,
        noise.B @ V @ noise.D.T,
        names=names,
    )
    return KalmanFilter(solution.gain.T, solution, part.inert)


def design_lqg(
    plant: Plant, weights: LQGWeights, authority: float, *, kalman: KalmanFilter | None = None
) -> LQGCompensator:
    """The compensator that minimises E[z' W^2 z + rho u' diag(input) u], rho = 1/authority.

    Modes that no port reaches or sees are set aside by name and listed in ``inert``. Direct terms from u to
    z, and from any input to y, are part of the design; one from process noise to z is refused, for it makes
    the cost infinite. Raises `NotStabilisableError` naming the modes that cannot be held and `ConfigError`
    for weights that do not fit the plant.
    """
    if not authority > 0.0:
        raise ConfigError(f"authority is {authority}; it must be positive")
    part = partition_modes(plant)
    active = part.active
    kalman = design_filter(plant, weights) if kalman is None else kalman
    regulator = _design_regulator(active, weights, authority)
    control = subsystem(active, active.u, active.y)
    K, L = regulator.gain, kalman.gain
    law = StateSpace(
        control.A - control.B @ K - L @ control.C + L @ control.D @ K,
        L,
        -K,
        np.zeros((len(active.u), len(active.y))),
    )
    noise = subsystem(active, weights.disturbed, active.z)
    cost = np.sum(regulator.X * (noise.B @ weights.process @ noise.B.T))
    rho_R = np.diag(weights.input) / authority
    cost += np.sum((K @ kalman.solution.X) * (rho_R @ K))
    ports = measured_ports(active), driven_ports(active)
    return LQGCompensator(law, *ports, authority, regulator, kalman.solution, float(cost), part.inert)


def _design_regulator(plant: Plant, weights: LQGWeights, authority: float) -> RiccatiSolution:
    names = name_states(plant)
    _require_size("output weights", len(weights.output), plant.z)
    _require_size("input weights", len(weights.input), plant.u)
    if np.any(subsystem(plant, weights.disturbed, plant.z).D):
        raise ConfigError(
            "process noise reaches a performance output directly: white noise makes the cost infinite",
            hint="put a filter between the noise and the output",
        )
    control = subsystem(plant, plant.u, plant.z)
    require_reachable(control.A, control.B, names, complaint="no control input in u reaches it")
    Cw, Dw = weights.output[:, None] * control.C, weights.output[:, None] * control.D
    R = Dw.T @ Dw + np.diag(weights.input) / authority
    return solve_riccati(control.A, control.B, Cw.T @ Cw, R, Cw.T @ Dw, names=names)


def _require_size(what: str, size: int, group: tuple[str, ...]) -> None:
    if size != len(group):
        raise ConfigError(f"{size} {what} for {len(group)} ports ({', '.join(group)})")
