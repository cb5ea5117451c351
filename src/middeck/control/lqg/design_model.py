"""Design model of LQG: the plant between the filters of its disturbances and of its cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.control.lqg.weights import LQGWeights, Shaping, pick, require_sizes, require_states
from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.state_space.feedback import beside
from middeck.systems.state_space.statespace import StateSpace, gain_system, series
from middeck.values import record


@record(kw_only=True)
class LQGProblem:
    """x' = A x + noise w + control u, cost z'z + u' plain u / authority, y = C2 x + D21 w + D22 u + v.

    Attributes:
        A, noise, control: Dynamics; states: colours, plant, weights.
        C1, D11, D12: Weighted performance outputs.
        shaped, shaped_through: Weighted control: rows of control inputs behind their filters, to be divided
            by the root of the authority.
        plain: Weight of each squared control input that has no filter, zero for the others.
        C2, D21, D22: Measurements.
        process, sensor, cross: Intensities of w (of the noises in front of the colours), of v, and of w with
            v.
        names: Name of the part of each state.
        integral: Rows of y that are integrated and the weights of the integrals; and their names.
    """

    A: Float[np.ndarray, "x x"]
    noise: Float[np.ndarray, "x w"]
    control: Float[np.ndarray, "x u"]
    C1: Float[np.ndarray, "z x"]
    D11: Float[np.ndarray, "z w"]
    D12: Float[np.ndarray, "z u"]
    shaped: Float[np.ndarray, "s x"]
    shaped_through: Float[np.ndarray, "s u"]
    plain: Float[np.ndarray, " u"]
    C2: Float[np.ndarray, "y x"]
    D21: Float[np.ndarray, "y w"]
    D22: Float[np.ndarray, "y u"]
    process: Float[np.ndarray, "w w"]
    sensor: Float[np.ndarray, " y"]
    cross: Float[np.ndarray, "w y"]
    names: tuple[str, ...]
    integral: tuple[int, ...]
    integral_weight: Float[np.ndarray, " i"]
    integral_names: tuple[str, ...]


def pose_problem(plant: Plant, weights: LQGWeights, shaping: Shaping) -> LQGProblem:
    """The model of ``plant``, whose modes are all controllable or observable (`partition_modes`).

    Raises `ConfigError` for weights, intensities and filters that do not fit its ports, and without states.
    """
    require_sizes(weights, plant)
    colours = pick(shaping.colours, weights.disturbed)
    on_outputs, on_inputs = pick(shaping.outputs, plant.z), pick(shaping.inputs, plant.u)
    pick(tuple((name, gain_system(np.eye(1))) for name, _ in shaping.integral), plant.y)
    kept = [k for k, weight in enumerate(on_inputs) if weight is not None]
    n_u, n_y = len(plant.u), len(plant.y)
    whole = _middle(plant, weights.disturbed, kept)
    if any(colours):
        whole = series(beside(*_or_one(colours), gain_system(np.eye(n_u))), whole)
    if any(on_outputs) or kept:
        behind = [*_or_one(on_outputs), *_or_one([on_inputs[k] for k in kept])]
        whole = series(whole, beside(*behind, gain_system(np.eye(n_y))))
    require_states(len(whole.A))
    n_z, n_w = len(plant.z), whole.B.shape[1] - n_u
    z, s, y = slice(n_z), slice(n_z, n_z + len(kept)), slice(n_z + len(kept), None)
    scale = weights.output[:, None]
    effort = np.sqrt(weights.input[kept])[:, None]
    process, cross = _intensities(weights, shaping, colours)
    names = (
        *_name_filters("colour of", weights.disturbed, colours),
        *name_states(plant),
        *_name_filters("weight on", plant.z, on_outputs),
        *_name_filters("weight on", plant.u, on_inputs),
    )
    return LQGProblem(
        A=whole.A, noise=whole.B[:, :n_w], control=whole.B[:, n_w:],
        C1=scale * whole.C[z], D11=scale * whole.D[z, :n_w], D12=scale * whole.D[z, n_w:],
        shaped=effort * whole.C[s], shaped_through=effort * whole.D[s, n_w:],
        plain=np.where([weight is None for weight in on_inputs], weights.input, 0.0),
        C2=whole.C[y], D21=whole.D[y, :n_w], D22=whole.D[y, n_w:],
        process=process, sensor=weights.sensor, cross=cross, names=names,
        integral=tuple(plant.y.index(name) for name, _ in shaping.integral),
        integral_weight=np.array([weight for _, weight in shaping.integral]),
        integral_names=tuple(f"integral of {name}" for name, _ in shaping.integral),
    )  # fmt: skip


def own_units(
    model: LQGProblem, unit: Float[np.ndarray, " state"] | None, shaping: Shaping
) -> Float[np.ndarray, " x"]:
    """Units of the states of ``model``: ``unit`` of the plant's, 1 for those of colours and weights."""
    whole = np.ones(len(model.A))
    if unit is not None:
        first = sum(len(colour.A) for _, colour in shaping.colours)
        whole[first : first + len(unit)] = unit
    return whole


def require_finite_cost(model: LQGProblem) -> None:
    """Raise `ConfigError` where process noise reaches z directly."""
    if np.any(model.D11):
        raise ConfigError(
            "process noise reaches a performance output directly: white noise makes the cost infinite",
            hint="put a filter between the noise and the output: a colour of the noise or a weight on the "
            "output whose response falls to zero",
        )


def _middle(plant: Plant, disturbed: tuple[str, ...], kept: list[int]) -> StateSpace:
    """From noise and control to z, the control inputs ``kept`` themselves, and y."""
    system = plant.system
    columns = [*plant.input_indices(disturbed), *plant.input_indices(plant.u)]
    z, y = plant.output_indices(plant.z), plant.output_indices(plant.y)
    echo = np.zeros((len(kept), len(columns)))
    echo[np.arange(len(kept)), len(disturbed) + np.array(kept, dtype=int)] = 1.0
    D = system.D[:, columns]
    return StateSpace(
        system.A,
        system.B[:, columns],
        np.vstack([system.C[z], np.zeros((len(kept), len(system.A))), system.C[y]]),
        np.vstack([D[z], echo, D[y]]),
    )


def _intensities(
    weights: LQGWeights, shaping: Shaping, colours: list[StateSpace | None]
) -> tuple[np.ndarray, np.ndarray]:
    """Intensities of the noises in front of the colours, and their cross intensity with the sensors'."""
    cross = np.zeros((len(weights.process), len(weights.sensor))) if shaping.cross is None else shaping.cross
    if cross.shape != (len(weights.process), len(weights.sensor)):
        raise ConfigError(
            f"the cross intensity has shape {cross.shape}",
            hint=f"one row for each of {len(weights.process)} disturbances, one column for each measurement",
        )
    joint = np.block([[weights.process, cross], [cross.T, np.diag(weights.sensor)]])
    size = np.sqrt(np.where(np.diag(joint) > 0.0, np.diag(joint), 1.0))
    # Compare correlations, which have no units; 1e-9 is rounding of an eigenvalue of some tens of rows.
    if np.linalg.eigvalsh(joint / np.outer(size, size)).min(initial=0.0) < -1e-12:
        raise ConfigError(
            "process and sensor noise have a correlation above one",
            hint="cross^2 <= process * sensor for each pair, and jointly positive semidefinite",
        )
    count = np.array([1 if colour is None else colour.D.shape[1] for colour in colours], dtype=int)
    alone = weights.process - np.diag(np.diag(weights.process))
    if np.any((count > 1) & (np.any(alone, axis=1) | np.any(cross, axis=1))):
        raise ConfigError(
            "a disturbance made of several independent noises cannot correlate with another",
            hint="one noise for each correlated disturbance",
        )
    which = np.repeat(np.arange(len(count)), count)
    same = which[:, None] == which[None, :]
    process = np.where(same, 0.0, weights.process[np.ix_(which, which)])
    return process + np.diag(np.diag(weights.process)[which]), cross[which]


def _or_one(filters: list[StateSpace | None]) -> list[StateSpace]:
    return [gain_system(np.eye(1)) if one is None else one for one in filters]


def _name_filters(what: str, ports: tuple[str, ...], filters: list[StateSpace | None]) -> list[str]:
    return [
        f"{what} {port}"
        for port, one in zip(ports, filters, strict=True)
        for _ in range(0 if one is None else len(one.A))
    ]


class Weighed(NamedTuple):
    """The cost: squares of the rows C x + D u (performance, shaped inputs), and of u by ``plain``."""

    C: Float[np.ndarray, "row state"]
    D: Float[np.ndarray, "row u"]
    plain: Float[np.ndarray, " u"]


def weigh_effort(model: LQGProblem, authority: float) -> Weighed:
    """The cost at this authority, one over which is the weight of effort."""
    effort = 1.0 / np.sqrt(authority)
    return Weighed(
        np.vstack([model.C1, effort * model.shaped]),
        np.vstack([model.D12, effort * model.shaped_through]),
        model.plain / authority,
    )


def append_integrals(
    A: Float[np.ndarray, "x x"],
    B: Float[np.ndarray, "x u"],
    C: Float[np.ndarray, "y x"],
    D: Float[np.ndarray, "y u"],
    integral: Sequence[int],
) -> tuple[np.ndarray, np.ndarray]:
    """A and B with the integrals of some rows of y as last states: integral action."""
    rows, count = list(integral), len(integral)
    longer = np.block([[A, np.zeros((len(A), count))], [C[rows], np.zeros((count, count))]])
    return longer, np.vstack([B, D[rows]])


def join_estimator(
    plant: StateSpace,
    gain: Float[np.ndarray, "u all"],
    injection: Float[np.ndarray, "x y"],
    integral: Sequence[int],
) -> StateSpace:
    """Compensator u = -K (xhat, integrals of some rows of y); these are of measurements, hence exact."""
    n, rows = len(plant.A), list(integral)
    A = np.zeros((n + len(rows), n + len(rows)))
    A[:n] = -moves_estimate(plant, injection) @ gain
    A[:n, :n] += plant.A - injection @ plant.C
    B = np.vstack([injection, np.eye(len(plant.C))[rows]])
    return StateSpace(A, B, -gain, np.zeros((len(gain), len(plant.C))))


def moves_estimate(plant: StateSpace, injection: Float[np.ndarray, "x y"]) -> Float[np.ndarray, "x u"]:
    """Effect of a command on the estimate: by the plant's input, and by the response expected at once."""
    return plant.B - injection @ plant.D
