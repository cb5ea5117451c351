"""A plant and a law as the two halves of one feedback loop, continuous with exact delays, or sampled."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.control.law.classical import close_static
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.law.kinds import require_continuous, require_sampled
from middeck.control.law.partition import partition_modes
from middeck.control.law.sampled_compensator import SampledCompensator
from middeck.errors import ConfigError
from middeck.signals.ports import port_indices
from middeck.systems.delayed_plant import DelayedPlant, approximate_delays, delay_inputs
from middeck.systems.integrators import part_integrators
from middeck.systems.modal import ModalSystem, output_rows, select_modes
from middeck.systems.plant import Plant, name_states
from middeck.systems.resolvent import Resolvent, balance_states, by_schur_form
from middeck.systems.sampled_plant import SampledPlant
from middeck.systems.statespace import SampledStateSpace, StateSpace
from middeck.values import record

AnyPlant = Plant | DelayedPlant | SampledPlant | SampledStateSpace
"""What is controlled; a bare sampled one from commands to measurements, its delays among its states."""
AnyLaw = Compensator | SampledCompensator | SampledStateSpace
"""What controls it: by named ports, or a bare sampled law from all measurements to all commands."""
At = Literal["inputs", "outputs", "both"]
"""Where a loop is broken or disturbed: at the plant's inputs, at the measurements, or at both at once."""

WELL_APART = 1e3
"""Condition of eigenvectors up to which a sum over poles, a tenth of the work, keeps twelve digits."""


@record
class FeedbackLoop:
    """y = G u and u = K y; what no port reaches or sees is left out.

    Parameters
    ----------
    plant:
        G with its delays, its ports those of the law; or a sampled system.
    law:
        K.
    inputs, outputs:
        Names of u and y.
    """

    plant: DelayedPlant | SampledStateSpace
    law: StateSpace | SampledStateSpace
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


Halves = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""G and K [line, row, column] at complex frequencies s [rad/s]; sampled ones at z = exp(s T)."""


def form_loop(plant: AnyPlant, law: AnyLaw) -> FeedbackLoop:
    """The loop of ``law`` around ``plant``.

    Raises
    ------
    ConfigError
        For ports that do not exist, a sampled law on a continuous plant or the reverse, sizes or periods
        that do not fit.
    """
    if isinstance(plant, SampledPlant):
        return _named_sampled_loop(plant, law)
    if isinstance(plant, SampledStateSpace):
        return _sampled_loop(plant, law.system if isinstance(law, SampledCompensator) else law)
    if isinstance(law, SampledStateSpace):
        raise ConfigError("a sampled law on a continuous plant", hint="build_sampled_plant(plant, period_s)")
    require_continuous(law)
    delayed = plant if isinstance(plant, DelayedPlant) else delay_inputs(plant, 0.0)
    inputs, outputs = (tuple(p.name for p in side) for side in (law.outputs, law.inputs))
    active = partition_modes(delayed.plant).active
    columns, rows = active.input_indices(inputs), active.output_indices(outputs)
    controlled = Plant(
        select_dynamics(active, columns, rows),
        tuple(active.inputs[i] for i in columns),
        tuple(active.outputs[i] for i in rows),
        state_names=name_states(active),
    )
    late = DelayedPlant(controlled, delayed.delay_s[np.ix_(rows, columns)])
    return FeedbackLoop(late, law.system, inputs, outputs)


def _named_sampled_loop(plant: SampledPlant, law: AnyLaw) -> FeedbackLoop:
    if isinstance(law, SampledStateSpace):
        raise ConfigError("a sampled law without names on a plant with them", hint="a SampledCompensator")
    known = require_sampled(law)
    inputs, outputs = (tuple(p.name for p in side) for side in (known.outputs, known.inputs))
    columns, rows = (
        port_indices(plant.inputs, inputs, "input"),
        port_indices(plant.outputs, outputs, "output"),
    )
    whole = plant.system
    D = whole.D[np.ix_(rows, columns)]
    system = SampledStateSpace(whole.A, whole.B[:, columns], whole.C[rows], D, whole.period_s)
    return dataclasses.replace(_sampled_loop(system, known.system), inputs=inputs, outputs=outputs)


def _sampled_loop(plant: SampledStateSpace, law: AnyLaw) -> FeedbackLoop:
    if not isinstance(law, SampledStateSpace):
        raise ConfigError("a continuous law on a sampled plant", hint="sample the law: tustin")
    inputs, outputs = plant.B.shape[1], len(plant.C)
    if law.D.shape != (inputs, outputs) or abs(law.period_s - plant.period_s) > 1e-12 * plant.period_s:
        raise ConfigError(
            f"the law has {law.D.shape} outputs and inputs at {law.period_s} s, the plant wants "
            f"{(inputs, outputs)} at {plant.period_s} s"
        )
    return FeedbackLoop(plant, law, _numbered("u", inputs), _numbered("y", outputs))


def _numbered(letter: str, count: int) -> tuple[str, ...]:
    return tuple(f"{letter}{i + 1}" for i in range(count))


def select_dynamics(plant: Plant, columns: list[int], rows: list[int]) -> ModalSystem | StateSpace:
    """Some inputs and outputs, in the form of the whole."""
    modal = plant.dynamics
    if not isinstance(modal, ModalSystem):
        D = modal.D[np.ix_(rows, columns)]
        return StateSpace(modal.A, modal.B[:, columns], modal.C[rows], D)
    acceleration, direct = modal.phi_acceleration, modal.direct
    return dataclasses.replace(
        modal,
        psi=modal.psi[:, columns],
        phi=modal.phi[rows],
        phi_rate=modal.phi_rate[rows],
        phi_acceleration=None if acceleration is None else acceleration[rows],
        direct=None if direct is None else direct[np.ix_(rows, columns)],
    )


def period_of(loop: FeedbackLoop) -> float | None:
    """The sampling period [s]; None for a continuous loop."""
    return loop.plant.period_s if isinstance(loop.plant, SampledStateSpace) else None


def is_late(loop: FeedbackLoop) -> bool:
    """Whether there is a delay that is not among the states."""
    return isinstance(loop.plant, DelayedPlant) and bool(np.any(loop.plant.delay_s > 0.0))


def evaluate_halves(loop: FeedbackLoop) -> Halves:
    """G with its exact delays, and K, as functions of s; prepared once for many evaluations."""
    law = resolve(loop.law)
    if isinstance(loop.plant, SampledStateSpace):
        sampled, period = resolve(loop.plant), loop.plant.period_s

        def at_z(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z = np.exp(s * period)
            return sampled(z), law(z)

        return at_z
    plant, late = transfer_of(loop.plant.plant.dynamics), loop.plant.delay_s

    def at_s(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = np.asarray(s, dtype=complex)
        return plant(s) * np.exp(-s[:, None, None] * late), law(s)

    return at_s


def transfer_of(dynamics: ModalSystem | StateSpace) -> Resolvent:
    """A plant's transfer function over s, mode by mode where there are modes; integrators by themselves."""
    if isinstance(dynamics, ModalSystem):
        return _sum_modes(dynamics)
    residues, moving = part_transfer(dynamics)
    return _with_integrals(residues, moving) if len(residues) else moving


def part_transfer(
    dynamics: ModalSystem | StateSpace,
) -> tuple[Float[np.ndarray, "chain output input"], Resolvent]:
    """Residues R_1, R_2, ... at the origin, of R_k / s^k, and the rest as a function of s."""
    if not isinstance(dynamics, ModalSystem):
        parted = part_integrators(dynamics)
        return parted.residues, resolve(parted.moving)
    rigid = dynamics.omega == 0.0
    rows = output_rows(still := select_modes(dynamics, rigid))
    moving = dataclasses.replace(select_modes(dynamics, ~rigid), direct=rows.direct)
    if not rigid.any():
        return np.zeros((0, *rows.direct.shape)), _sum_modes(moving)
    return np.array([rows.rate @ still.psi, rows.position @ still.psi]), _sum_modes(moving)


def _with_integrals(residues: np.ndarray, moving: Resolvent) -> Resolvent:
    def evaluate(points: np.ndarray) -> np.ndarray:
        s = np.asarray(points)[:, None, None]
        total = np.zeros((len(points), *residues.shape[1:]), dtype=complex)
        for residue in residues[::-1]:
            total = (total + residue) / s
        return total + moving(points)

    return evaluate


def resolve(system: StateSpace | SampledStateSpace) -> Resolvent:
    """C (p I - A)^-1 B + D for many p: by poles where they are well apart, else in Schur form."""
    if not len(system.A):
        return lambda points: np.broadcast_to(system.D.astype(complex), (len(points), *system.D.shape))
    balanced = balance_states(system)
    values, vectors = np.linalg.eig(balanced.A)
    if np.linalg.cond(vectors) < WELL_APART:
        return _sum_poles(balanced, values, vectors)
    return by_schur_form(balanced)


def _sum_poles(system: StateSpace, values: np.ndarray, vectors: np.ndarray) -> Resolvent:
    into, out = np.linalg.solve(vectors.astype(complex), system.B), system.C @ vectors
    residues = (into[:, None, :] * out.T[:, :, None]).reshape(len(values), -1)

    def evaluate(points: np.ndarray) -> np.ndarray:
        terms = 1.0 / (points[:, None] - values)
        return (terms @ residues).reshape(len(points), *system.D.shape) + system.D

    return evaluate


def _sum_modes(modal: ModalSystem) -> Resolvent:
    shapes = [modal.phi, modal.phi_rate, modal.phi_acceleration]
    read = [(power, shape) for power, shape in enumerate(shapes) if shape is not None and shape.any()]
    residues = [
        (shape.T[:, :, None] * modal.psi[:, None, :]).reshape(len(modal.omega), -1) for _, shape in read
    ]
    direct = np.zeros((len(modal.phi), modal.psi.shape[1])) if modal.direct is None else modal.direct

    def evaluate(points: np.ndarray) -> np.ndarray:
        s = points[:, None]
        q = 1.0 / (s**2 + 2.0 * modal.zeta * modal.omega * s + modal.omega**2)
        through = np.zeros((len(points), direct.size), dtype=complex)
        for (power, _), residue in zip(read, residues, strict=True):
            through += (s**power * q) @ residue
        return through.reshape(len(points), *direct.shape) + direct

    return evaluate


def broken_at(loop: FeedbackLoop, at: At) -> tuple[str, ...]:
    """Names of the channels at which the loop is broken."""
    names = {"inputs": loop.inputs, "outputs": loop.outputs, "both": (*loop.inputs, *loop.outputs)}
    if at not in names:
        raise ConfigError(f"a loop broken at {at!r}", hint=f"one of {', '.join(names)}")
    return names[at]


def go_round(G: np.ndarray, K: np.ndarray, at: At) -> Complex[np.ndarray, "line channel channel"]:
    """What comes back to each channel from each: K G, G K, or both halves beside each other.

    With both, v = (u, y) comes back as (K y, G u): one loop whose channels are all of both.
    """
    if at == "inputs":
        return K @ G
    if at == "outputs":
        return G @ K
    nu, ny = K.shape[1:]
    both = np.zeros((len(G), nu + ny, nu + ny), dtype=complex)
    both[:, :nu, nu:], both[:, nu:, :nu] = K, G
    return both


def approximate_halves(loop: FeedbackLoop, order: int | None = None) -> StateSpace:
    """The halves side by side as one system without delays: from (u, y) to (K y, G u).

    States: the plant's, with those of its delays in a Pade approximation of ``order`` (by default as the
    fastest mode asks), then the law's. Of a sampled loop the matrices are its own.
    """
    law, plant = loop.law, loop.plant
    if isinstance(plant, DelayedPlant):
        plant = approximate_delays(plant, order or approximation_order(plant, law)).system
    nu, ny = len(law.D), len(plant.C)
    A, B, C, D = (
        np.asarray(scipy.linalg.block_diag(getattr(plant, name), getattr(law, name))) for name in "ABCD"
    )
    rows = np.concatenate([ny + np.arange(nu), np.arange(ny)])
    return StateSpace(A, B, C[rows], D[rows])


def close_channels(halves: StateSpace, left_open: Sequence[int] = ()) -> StateSpace:
    """Each output of `approximate_halves` led back to its channel, but for those ``left_open``.

    Raises `ConfigError` where the loop through the direct terms has no solution.
    """
    gain = np.eye(len(halves.D))
    gain[list(left_open)] = 0.0
    through = np.eye(len(gain)) - gain @ halves.D
    # 1e-12: the algebraic loop would amplify rounding to a thousandth.
    if len(gain) and np.linalg.cond(through) > 1e12:
        raise ConfigError("the loop through the direct terms has no solution", hint="add a delay or a lag")
    return close_static(halves, gain)
