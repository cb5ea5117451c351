"""Linear-quadratic Gaussian design for a computer: the continuous problem, sampled exactly.

The cost between samples, its cross term and the noise of a whole period enter the discrete problem as they
are (Levis, Schlueter and Athans 1971, Int. J. Control 13; Åström and Wittenmark 1997, chapter 11).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes, pose_states
from middeck.control.law.stabilisability import require_reachable
from middeck.control.lqg.design import require_authority
from middeck.control.lqg.known_design import DesignView, design_known
from middeck.control.lqg.weights import LQGWeights
from middeck.control.riccati.continuous import RiccatiSolution
from middeck.control.riccati.discrete import solve_discrete_riccati
from middeck.control.sampled.held_plant import HeldPlant, hold_plant
from middeck.control.sampled.quadratic_integrals import integrate_along
from middeck.errors import ConfigError, NumericalError
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.state_units import in_units
from middeck.systems.poles.verdict import CURE
from middeck.systems.sampling.sampled_plant import warnings_on_period
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record

Form = Literal["predictor", "current"]


@record(kw_only=True)
class SampledLQG(Compensator):
    """A sampled LQG compensator with its design data.

    Attributes:
        authority: 1/rho.
        form: ``"predictor"``: u[k] from y up to y[k-1], a whole period to compute in; ``"current"``: from
            y[k] too.
        regulator, estimator: The two Riccati solutions: residuals, regulator poles and filter poles in the
            z-plane.
        cost: The minimum of E[z' W^2 z + rho u' diag(input) u], the mean over time, between the samples too.
        noise_cost: Part of the cost from noise within its own period, the same for any compensator.
        inert: Uncontrollable and unobservable modes of the plant, left out.
    """

    authority: float
    form: Form
    regulator: RiccatiSolution
    estimator: RiccatiSolution
    cost: float
    noise_cost: float
    inert: tuple[str, ...]


@record
class SampledCost:
    """The mean over a period of z' W^2 z + rho u' diag(input) u as x' Q x + 2 x' S u + u' R u at the sample.

    ``noise`` is the part from noise within the period.
    """

    Q: Float[np.ndarray, "state state"]
    S: Float[np.ndarray, "state u"]
    R: Float[np.ndarray, "u u"]
    noise: float


def sample_cost(held: HeldPlant, weights: LQGWeights, authority: float) -> SampledCost:
    """The continuous cost as a function of the state at a sample and of the inputs issued there."""
    seen = weights.output[:, None] * held.performance
    Q = seen.T @ seen
    n, x = len(held.system.A), len(held.dwell)
    whole = np.zeros((n + len(held.inputs),) * 2)
    for segment in held.segments:
        whole += segment.start.T @ integrate_along(held.generator, Q, segment.duration_s) @ segment.start
    whole /= held.system.period_s
    R = whole[n:, n:] + np.diag(weights.input) / authority
    if np.linalg.eigvalsh(R)[0] <= 0.0:
        raise NumericalError("rounding alone makes the sampled cost of control negative", hint=CURE)
    return SampledCost(whole[:n, :n], whole[:n, n:], R, float(np.sum(Q[:x, :x] * held.dwell)))


@named_kinds
def design_sampled_lqg(
    plant: Plant, weights: LQGWeights, authority: float, period_s: float, form: Form = "predictor"
) -> SampledLQG:
    """The sampled compensator of least continuous E[z' W^2 z + rho u' diag(input) u], rho = 1/authority.

    Inputs are held over ``period_s`` and each path is delayed by its own true delay.
    Delays that are no sums of an input's and an output's are approximated (`place_delays`), no others.
    Sensor noise is what an average over the period leaves of white noise: variance = intensity / period_s.
    As the period goes to zero the compensator becomes that of `design_lqg`.

    Raises `NotStabilisableError` naming the modes that cannot be held (also those that sampling makes
    unreachable: a mode at a whole multiple of half the rate), `ConfigError` for weights or a period that do
    not fit and for a ``"current"`` compensator on a plant that responds within the sample. Warns
    (`UserWarning`) where rounding of the plant's matrices moves the compensator or its cost (`design_known`),
    and of a rate for the period (`warnings_on_period`).

    >>> from middeck.systems.plants.plant_from_matrices import make_plant
    >>> walk = make_plant([[0.0]], [[1.0]], [[1.0]], w=["u1"], u=["u1"], z=["y1"], y=["y1"])
    >>> weights = LQGWeights(output=[1.0], input=[1.0], disturbed=("u1",), process=[[1.0]], sensor=[1.0])
    >>> early, late = (design_sampled_lqg(walk, weights, 1.0, 0.1, form) for form in ("current", "predictor"))
    >>> 2.0 < early.cost < late.cost                                   # continuous: 2
    True
    """
    _require_known(authority, form)

    def design(plant: Plant) -> SampledLQG:
        return _design(plant, weights, authority, period_s, form)

    def view(law: SampledLQG) -> DesignView:
        return DesignView(law.dynamics, law.cost, (law.regulator, law.estimator))

    law = design_known("law and cost", design, view, plant)
    warnings_on_period(plant, period_s)
    return law


def _design(plant: Plant, weights: LQGWeights, authority: float, period_s: float, form: Form) -> SampledLQG:
    """`design_sampled_lqg` without its check of rounding."""
    part = partition_modes(plant)
    posed = pose_states(part.active)
    held = hold_plant(plant if posed == part.active else posed, weights, period_s)
    system = held.system
    _require_no_loop(system, form)
    price = sample_cost(held, weights, authority)
    names, sensor = held.state_names, np.diag(held.sensor)
    # Before cost and noise, which may miss the same mode, are blamed for what no port can hold.
    require_reachable(
        system.A, system.B, names, sampled=True, complaint="no control input in u reaches it at this rate"
    )
    estimator = solve_discrete_riccati(
        system.A.T, system.C.T, held.noise, sensor,
        names=names, complaint="no measurement in y sees it at this rate",
    )  # fmt: skip
    regulator = solve_discrete_riccati(
        system.A, system.B, price.Q, price.R, price.S,
        names=names, complaint="no control input in u reaches it at this rate",
    )  # fmt: skip
    law, error = _join(system, regulator.gain, estimator, sensor, form)
    weight = price.R + system.B.T @ regulator.X @ system.B
    cost = np.sum(regulator.X * held.noise) + np.sum((regulator.gain @ error) * (weight @ regulator.gain))
    unit = held.unit  # back in the plant's
    return SampledLQG(
        dynamics=in_units(law, 1.0 / unit),
        inputs=held.outputs,
        outputs=held.inputs,
        authority=authority,
        form=form,
        regulator=regulator.in_units(1.0 / unit),
        estimator=estimator.in_units(unit),
        cost=float(cost) + price.noise,
        noise_cost=price.noise,
        inert=held.inert or part.inert,
        method=f"direct, {form}",
        applied=unit[:, None] * (system.B - estimator.gain.T @ system.D if form == "predictor" else system.B),
    )


def _require_known(authority: float, form: Form) -> None:
    require_authority(authority)
    if form not in get_args(Form):
        raise ConfigError(f"no form {form!r} of an observer", hint=f"one of {', '.join(get_args(Form))}")


def _require_no_loop(system: SampledStateSpace, form: Form) -> None:
    if form == "current" and np.any(system.D):
        raise ConfigError(
            "algebraic loop: the plant responds within the sample, so that y[k] needs u[k], and u[k] y[k]",
            hint="use the predictor form, or give the plant its true delay",
        )


def _join(
    plant: SampledStateSpace, K: np.ndarray, estimator: RiccatiSolution, sensor: np.ndarray, form: Form
) -> tuple[SampledStateSpace, Float[np.ndarray, "state state"]]:
    """The compensator, and the covariance of what it does not know of the state when it issues u."""
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    P, L = estimator.X, estimator.gain.T
    if form == "predictor":
        law = SampledStateSpace(
            A - B @ K - L @ C + L @ D @ K, L, -K, np.zeros((len(K), len(C))), period_s=plant.period_s
        )
        return law, P
    M = np.linalg.solve(C @ P @ C.T + sensor, C @ P).T
    rest = np.eye(len(A)) - M @ C
    step = A - B @ K
    return SampledStateSpace(step @ rest, step @ M, -K @ rest, -K @ M, period_s=plant.period_s), rest @ P
