"""The Kalman filter of a plant (Kwakernaak and Sivan 1972, chapter 4)."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.law.partition import partition_modes, pose_states
from middeck.control.law.rounding_of_results import measure_known
from middeck.control.lqg.design_model import LQGProblem, own_units, pose_problem
from middeck.control.lqg.known_design import is_mixed
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.riccati.continuous import RiccatiSolution, solve_riccati
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.state_units import in_units
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record(kw_only=True)
class KalmanFilter:
    """The stationary filter of a plant; the same at every control authority.

    ``gain`` is L in xhat' = A xhat + B u + L (y - C xhat - D u). ``model`` has these matrices, from the
    disturbances and then u, to y: the plant without its inert modes, in states that are not mixed
    (`unmix_states`), with those of colours and weights; ``state_names`` says which is which. States that were
    not mixed are the plant's own, in its units. ``solution`` is that of the dual Riccati equation (its X is
    the error covariance), ``inert`` names the modes left out of the design. ``process``, ``sensor`` and
    ``cross`` are the intensities that it expects.
    """

    gain: Float[np.ndarray, "state y"]
    model: StateSpace
    state_names: tuple[str, ...]
    solution: RiccatiSolution
    inert: tuple[str, ...]
    process: Float[np.ndarray, "w w"]
    sensor: Float[np.ndarray, " y"]
    cross: Float[np.ndarray, "w y"]


@named_kinds
def design_filter(plant: Plant, weights: LQGWeights, shaping: Shaping | None = None) -> KalmanFilter:
    """The Kalman filter of ``plant``; give it to `design_lqg` in a sweep over authority.

    States of colours and of dynamic weights are estimated with the plant's. Raises `NotStabilisableError`
    naming the modes that do not decay and that no measurement sees, or that lie on the axis without process
    noise. Warns (`UserWarning`) where rounding of the plant's matrices moves the errors that the filter
    leaves in performance (`measure_known`).
    """

    def design(plant: Plant) -> tuple[KalmanFilter, LQGProblem]:
        return find_filter(plant, weights, shaping or Shaping())

    def numbers(found: tuple[KalmanFilter, LQGProblem]) -> Float[np.ndarray, " one"]:
        kalman, model = found
        return np.log([np.sum((model.C1 @ kalman.solution.X) * model.C1)])

    what = "errors that the filter leaves"
    return measure_known(what, design, numbers, plant, vague=is_mixed)[0]


def find_filter(plant: Plant, weights: LQGWeights, shaping: Shaping) -> tuple[KalmanFilter, LQGProblem]:
    """The filter and its design model; as `design_filter`, but without its check of rounding."""
    part = partition_modes(plant)
    posed = pose_states(part.active, driven=False)
    model = pose_problem(posed, weights, shaping)
    kalman = filter_of(model, part.inert)
    if part.unit is None or posed != part.active:
        return kalman, model
    unit = own_units(model, part.unit, shaping)
    back = dataclasses.replace(model, C1=model.C1 / unit)
    return filter_in_units(kalman, 1.0 / unit), back


def filter_in_units(kalman: KalmanFilter, unit: Float[np.ndarray, " state"]) -> KalmanFilter:
    """The filter of the states x / ``unit``."""
    return dataclasses.replace(
        kalman,
        gain=kalman.gain / unit[:, None],
        model=in_units(kalman.model, unit),
        solution=kalman.solution.in_units(1.0 / unit),
    )


def filter_of(model: LQGProblem, inert: tuple[str, ...]) -> KalmanFilter:
    """The filter of a problem as posed."""
    solution = estimate_states(model)
    return KalmanFilter(
        gain=solution.gain.T,
        model=observed_model(model),
        state_names=tuple(model.names),
        solution=solution,
        inert=inert,
        process=model.process,
        sensor=model.sensor,
        cross=model.cross,
    )


def estimate_states(model: LQGProblem) -> RiccatiSolution:
    """The dual Riccati equation, noise through direct terms and correlated noise included."""
    through = model.D21 @ model.cross
    return solve_riccati(
        model.A.T,
        model.C2.T,
        model.noise @ model.process @ model.noise.T,
        np.diag(model.sensor) + model.D21 @ model.process @ model.D21.T + through + through.T,
        model.noise @ (model.process @ model.D21.T + model.cross),
        names=model.names,
        complaint="no measurement in y sees it",
    )


def observed_model(model: LQGProblem) -> StateSpace:
    """Model of a filter: from process noise and control to the measurements."""
    drive, through = np.hstack([model.noise, model.control]), np.hstack([model.D21, model.D22])
    return StateSpace(model.A, drive, model.C2, through)
