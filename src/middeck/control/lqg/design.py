"""Linear-quadratic Gaussian design (Kwakernaak and Sivan 1972, chapters 3 to 5)."""

import numpy as np

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator, driven_ports, measured_ports
from middeck.control.law.partition import partition_modes, pose_states
from middeck.control.law.stabilisability import require_reachable
from middeck.control.lqg.design_model import (
    LQGProblem,
    append_integrals,
    join_estimator,
    moves_estimate,
    own_units,
    pose_problem,
    require_finite_cost,
    weigh_effort,
)
from middeck.control.lqg.estimator import KalmanFilter, filter_in_units, filter_of, observed_model
from middeck.control.lqg.known_design import DesignView, design_known
from middeck.control.lqg.weights import LQGWeights, Shaping
from middeck.control.riccati.continuous import RiccatiSolution, solve_riccati
from middeck.errors import ConfigError, NotStabilisableError
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.state_units import in_units
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record

SAME = 1e-6
"""Relative difference of an entry up to which it is the same: rounding moves it less, no one means more."""
ROUNDING = 1e-12
"""What an entry may differ by, relative to the largest of its matrix: of a plant that was made anew, entries
that should be zero are rounding."""


def require_authority(authority: float) -> None:
    """Raise `ConfigError` for an authority that is not positive and finite."""
    if not 0.0 < authority < np.inf:
        raise ConfigError(
            f"authority is {authority}; it must be positive and finite", hint="1/rho > 0, as 10"
        )


def design_regulator(model: LQGProblem, authority: float) -> tuple[RiccatiSolution, np.ndarray]:
    """Minimise E[z'z + u'Ru] on the states of ``model``, then its integrals; and R."""
    require_finite_cost(model)
    A, B = append_integrals(model.A, model.control, model.C2, model.D22, model.integral)
    C, D, plain = weigh_effort(model, authority)
    n, count = len(model.A), len(model.integral)
    Q, S = np.zeros((n + count, n + count)), np.zeros((n + count, B.shape[1]))
    Q[:n, :n], S[:n] = C.T @ C, C.T @ D
    Q[n:, n:] = np.diag(model.integral_weight**2)
    R = D.T @ D + np.diag(plain)
    solution = solve_riccati(
        A,
        B,
        Q,
        R,
        S,
        names=(*model.names, *model.integral_names),
        complaint="no control input in u reaches it",
    )
    return solution, R


@record(kw_only=True)
class LQGCompensator(Compensator):
    """An LQG compensator with its design data.

    Attributes:
        authority: 1/rho.
        regulator, estimator: The two Riccati solutions: residuals, regulator poles and filter poles.
        cost: Minimum of E[z' W^2 z + rho u' diag(input) u] on the design plant under white noise of unlimited
            band; z and u as filtered by the weights; integrals and their sensor noise included.
        inert: Uncontrollable and unobservable modes of the plant, left out.
        state_names: Name of what each state of the compensator estimates or integrates.
    """

    authority: float
    regulator: RiccatiSolution
    estimator: RiccatiSolution
    cost: float
    inert: tuple[str, ...]
    state_names: tuple[str, ...] = ()


@named_kinds
def design_lqg(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    *,
    kalman: KalmanFilter | None = None,
    shaping: Shaping | None = None,
) -> LQGCompensator:
    """The compensator that minimises E[z' W^2 z + rho u' diag(input) u], rho = 1/authority.

    Uncontrollable and unobservable modes are set aside and listed in ``inert``. Direct terms from u to z, and
    from any input to y, are part of the design; one from process noise to z is refused (infinite cost).
    ``shaping`` adds filters, integral action and correlated noise (give the same to `design_filter`). For
    mixed states ``kalman`` is found anew: the states that it estimates depend on last digits. Raises
    `NotStabilisableError` naming the modes that cannot be held and `ConfigError` for weights that do not fit
    the plant. Warns (`UserWarning`) where rounding of the plant's matrices moves the compensator or its cost
    (`design_known`).
    """
    require_authority(authority)

    def design(plant: Plant) -> LQGCompensator:
        return _design(plant, weights, authority, kalman, shaping or Shaping())

    return design_known("law and cost", design, _view, plant)


def _view(law: LQGCompensator) -> DesignView:
    return DesignView(law.system, law.cost, (law.regulator, law.estimator))


def _design(
    plant: Plant, weights: LQGWeights, authority: float, kalman: KalmanFilter | None, shaping: Shaping
) -> LQGCompensator:
    """`design_lqg` without its check of rounding."""
    part = partition_modes(plant)
    active = pose_states(part.active)
    model = pose_problem(active, weights, shaping)
    try:
        # The last digits of mixed states decide to which of them a filter's gain belongs.
        mixed = active != part.active
        unit = own_units(model, None if mixed else part.unit, shaping)
        if kalman is not None:
            _require_fit(kalman, model)
            if not mixed:
                _require_model(kalman, in_units(observed_model(model), 1.0 / unit))
        anew = kalman is None or mixed
        estimator = filter_of(model, part.inert) if anew else filter_in_units(kalman, unit)
        regulator, R = design_regulator(model, authority)
    except NotStabilisableError:
        _require_ports(model)
        raise
    inside = StateSpace(model.A, model.control, model.C2, model.D22)
    moved = moves_estimate(inside, estimator.gain)
    law = join_estimator(inside, regulator.gain, estimator.gain, model.integral)
    cost = _cost(model, regulator, R, estimator.solution.X)
    integrals = np.ones(len(model.integral))
    whole = 1.0 / np.append(unit, integrals)  # back in the plant's units
    ports = measured_ports(active), driven_ports(active)
    names = (*model.names, *model.integral_names)
    return LQGCompensator(
        dynamics=in_units(law, whole),
        inputs=ports[0],
        outputs=ports[1],
        authority=authority,
        regulator=regulator.in_units(whole),
        estimator=estimator.solution.in_units(unit),
        cost=cost,
        inert=part.inert,
        state_names=names,
        applied=np.vstack([moved, np.zeros((len(model.integral), moved.shape[1]))]) / whole[:, None],
    )


def _require_fit(kalman: KalmanFilter, model: LQGProblem) -> None:
    """Refuse a filter that was designed for another problem."""
    if len(kalman.gain) != len(model.A):
        raise ConfigError(
            f"the filter has {len(kalman.gain)} states, the design {len(model.A)}",
            hint="design the filter for the same plant and with the same shaping",
        )
    if not all(np.array_equal(getattr(kalman, k), getattr(model, k)) for k in ("process", "sensor", "cross")):
        raise ConfigError(
            "the filter was designed for other noise intensities", hint="design it with the same weights"
        )


def _require_model(kalman: KalmanFilter, here: StateSpace) -> None:
    """Refuse a filter of another plant; rounding of the entries, which `design_known` tries, is none."""
    for name in "ABCD":
        one, other = getattr(kalman.model, name), getattr(here, name)
        rounding = ROUNDING * np.abs(other).max(initial=0.0)
        if one.shape != other.shape or np.any(np.abs(one - other) > SAME * np.abs(other) + rounding):
            raise ConfigError(
                "the filter was designed for another plant, or for disturbances at other inputs",
                hint="design_filter with the same plant, weights and shaping",
            )


def _require_ports(model: LQGProblem) -> None:
    """Report uncontrollable and unobservable modes before those missing from cost or noise."""
    require_reachable(model.A, model.control, model.names, complaint="no control input in u reaches it")
    require_reachable(model.A.T, model.C2.T, model.names, complaint="no measurement in y sees it")


def _cost(model: LQGProblem, regulator: RiccatiSolution, R: np.ndarray, error: np.ndarray) -> float:
    """tr(X N) + tr(R K Sigma K'): cost of noise on states and integrals, plus cost of estimation errors."""
    n, rows = len(model.A), list(model.integral)
    joint = np.block([[model.process, model.cross], [model.cross.T, np.diag(model.sensor)]])
    sensors = np.eye(len(model.C2))[rows]
    drive = np.block([[model.noise, np.zeros((n, len(model.C2)))], [model.D21[rows], sensors]])
    noise = np.sum(regulator.X * (drive @ joint @ drive.T))
    gain = regulator.gain[:, :n]
    return float(noise + np.sum((gain @ error) * (R @ gain)))
