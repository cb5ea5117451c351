"""Plant and compensator as the two halves of a feedback loop, continuous with exact delays, or sampled."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.sampled_rounding import sample_known
from middeck.control.law.compensator import Compensator, locate_ports, require_loop
from middeck.control.law.delay_order import approximation_order
from middeck.control.law.partition import partition_modes
from middeck.errors import ConfigError, NumericalError
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, select_ports
from middeck.systems.poles.inert_modes import observed_modes, reached_modes
from middeck.systems.poles.integrators import rest_modes_once, rest_once
from middeck.systems.poles.resolvent import Resolvent, by_schur_form
from middeck.systems.poles.same_response import part_known, responds_otherwise
from middeck.systems.poles.state_units import balance_states, settle_states
from middeck.systems.poles.verdict import CURE
from middeck.systems.state_space.feedback import beside, close_static
from middeck.systems.state_space.modal_system import ModalSystem, output_rows, select_modes
from middeck.systems.state_space.statespace import LinearSystem, StateSpace, poles, same_period
from middeck.values import record

At = Literal["inputs", "outputs", "both"]
"""Where a loop is broken or disturbed: at the plant's inputs, at the measurements, or at both at once."""

AT_REST, ZERO = 1e-9, 1e-13
"""Slowest pole, relative to A, of a compensator whose value at rest is known; and the part of its terms below
which that value, or its slope, is rounding."""
KEPT = 16
"""Loops that are known: stability and margins are asked of the same few fades, one after the other."""
WELL_APART = 1e3
"""Condition of eigenvectors up to which a sum over poles, a tenth of the work, keeps twelve digits."""


@record
class FeedbackLoop:
    """y = G u and u = K y, without uncontrollable and unobservable modes.

    Attributes:
        plant: G, its ports those of the compensator: continuous with its delays, or sampled.
        law: K, in the time domain of the plant.
    """

    plant: Plant
    law: LinearSystem

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of u."""
        return tuple(port.name for port in self.plant.inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of y."""
        return tuple(port.name for port in self.plant.outputs)

    @property
    def period_s(self) -> float | None:
        """The sampling period [s]; None for a continuous loop."""
        return self.plant.period_s


def split_unmoved(loop: FeedbackLoop) -> tuple[FeedbackLoop, Complex[np.ndarray, " pole"]]:
    """The loop without modes uncontrollable from u or unobservable in y, and these modes' poles.

    No return ratio contains them, so that counting its roots must not include them.
    """
    dynamics, alone = loop.plant.dynamics, np.zeros(0, dtype=complex)
    if isinstance(dynamics, ModalSystem):
        moved = reached_modes(dynamics) & observed_modes(dynamics)
        alone = poles(select_modes(dynamics, ~moved).as_statespace())
        dynamics, resting = rest_modes_once(select_modes(dynamics, moved))
    else:
        dynamics, resting = rest_once(dynamics)
    plant = dataclasses.replace(loop.plant, dynamics=dynamics, state_names=())
    return dataclasses.replace(loop, plant=plant), np.concatenate([alone, np.zeros(resting)])


def moved_part(loop: FeedbackLoop) -> FeedbackLoop:
    """The loop without integrators that it does not move: by rounding, mixed states would show them in its
    return ratio. A plant in modal form has them separate already.

    Raises `NumericalError` where rounding hides whether the loop moves them.
    """
    given = loop.plant.dynamics
    if isinstance(given, ModalSystem):
        return loop
    fewer, resting = rest_once(given)
    if resting and responds_otherwise(fewer, given):
        raise NumericalError("rounding of the matrices hides which integrators the loop moves", hint=CURE)
    return dataclasses.replace(loop, plant=dataclasses.replace(loop.plant, dynamics=fewer, state_names=()))


Halves = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""G and K [line, row, column] at complex frequencies s [rad/s]; sampled ones at z = exp(s T)."""


def loop_path(plant: Plant, compensator: Compensator) -> Plant:
    """The plant from the commands of ``compensator`` to its measurements, without inert modes."""
    locate_ports(compensator, plant.inputs, plant.outputs)
    inputs, outputs = (tuple(p.name for p in side) for side in (compensator.outputs, compensator.inputs))
    if plant.period_s is not None:
        active = dataclasses.replace(plant, dynamics=settle_states(plant.sampled))
    else:
        active = partition_modes(plant).active
    return select_ports(active, inputs, outputs)


@functools.lru_cache(maxsize=KEPT)
def form_loop(plant: Plant, compensator: Compensator) -> FeedbackLoop:
    """The loop of ``compensator`` around ``plant``.

    A continuous plant under a sampled compensator is sampled: inputs held over the period, outputs sampled,
    delays exact.

    Raises `ConfigError` for ports that do not exist, a continuous compensator on a sampled plant, and periods
    that differ; `NumericalError` as `sample_known`.
    """
    require_loop(plant, compensator)
    path, period = loop_path(plant, compensator), compensator.period_s
    if period is None:
        if plant.period_s is not None:
            raise ConfigError("a continuous compensator on a sampled plant", hint="emulate(law, period_s)")
        return FeedbackLoop(path, settle_states(compensator.system))
    law = settle_states(compensator.sampled)
    if plant.period_s is None:
        return FeedbackLoop(sample_known(path, law), law)
    if not same_period(period, plant.period_s):
        raise ConfigError(
            f"the compensator's period is {period} s, the plant's {plant.period_s} s",
            hint="the continuous plant, or the compensator at the plant's rate",
        )
    return FeedbackLoop(path, law)


def evaluate_halves(loop: FeedbackLoop) -> Halves:
    """G with its exact delays, and K, as functions of s; prepared once for many evaluations."""
    law, period = _law_of(loop.law), loop.period_s
    if period is not None:
        sampled = resolve(loop.plant.sampled)

        def at_z(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            z = np.exp(s * period)
            return sampled(z), law(z)

        return at_z
    plant, delay_s = transfer_of(loop.plant.continuous), loop.plant.delay_s

    def at_s(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = np.asarray(s, dtype=complex)
        return plant(s) * np.exp(-s[:, None, None] * delay_s), law(s)

    return at_s


def _law_of(law: LinearSystem) -> Resolvent:
    """K, its zeros at the origin exact: a free body's poles there multiply the rounding in place of them.

    Below its slowest pole K = K(0) + s K'(0) + s^2 C A^-2 (s - A)^-1 B, with no terms that rounding may be.
    """
    whole = resolve(law)
    if law.period_s is not None or not len(law.A):
        return whole
    balanced = balance_states(law)
    A, B, C = balanced.A, balanced.B, balanced.C
    slowest = np.abs(np.linalg.eigvals(A)).min()
    if slowest <= AT_REST * np.linalg.norm(A, 2):
        return whole
    inverse = np.linalg.inv(A)
    size = np.abs(C) @ np.abs(inverse)
    still = law.D - C @ inverse @ B
    still[np.abs(still) <= ZERO * (np.abs(law.D) + size @ np.abs(B))] = 0.0
    if np.all(still):
        return whole
    slope = -C @ inverse @ inverse @ B
    slope[np.abs(slope) <= ZERO * (size @ np.abs(inverse) @ np.abs(B))] = 0.0
    rest = resolve(StateSpace(A, B, C @ inverse @ inverse, np.zeros_like(law.D)))

    def evaluate(points: np.ndarray) -> np.ndarray:
        value, slow = np.array(whole(points)), np.abs(points) < slowest
        s = points[slow][:, None, None]
        value[slow] = still + s * slope + s**2 * rest(points[slow])
        return value

    return evaluate


def transfer_of(dynamics: ModalSystem | StateSpace) -> Resolvent:
    """A plant's transfer function over s, as a sum over modes if modal, integrators kept apart."""
    if isinstance(dynamics, ModalSystem):
        return _sum_modes(dynamics)
    residues, moving = part_transfer(dynamics)
    return _with_integrals(residues, moving) if len(residues) else moving


def part_transfer(
    dynamics: ModalSystem | StateSpace,
) -> tuple[Float[np.ndarray, "chain output input"], Resolvent]:
    """Residues R_1, R_2, ... at the origin, of R_k / s^k, and the rest as a function of s.

    Raises `NumericalError` as `part_known`.
    """
    if not isinstance(dynamics, ModalSystem):
        parted = part_known(dynamics)
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


def resolve(system: LinearSystem) -> Resolvent:
    """C (p I - A)^-1 B + D for many p: a sum over poles where well-conditioned, else in Schur form."""
    if not len(system.A):
        return lambda points: np.broadcast_to(system.D.astype(complex), (len(points), *system.D.shape))
    balanced = balance_states(system)
    values, vectors = np.linalg.eig(balanced.A)
    if np.linalg.cond(vectors) < WELL_APART:
        return _sum_poles(balanced, values, vectors)
    return by_schur_form(balanced)


def _sum_poles(system: LinearSystem, values: np.ndarray, vectors: np.ndarray) -> Resolvent:
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
    """Names of the channels where the loop is broken."""
    names = {"inputs": loop.inputs, "outputs": loop.outputs, "both": (*loop.inputs, *loop.outputs)}
    if at not in names:
        raise ConfigError(f"the loop cannot be broken at {at!r}", hint=f"one of {', '.join(names)}")
    return names[at]


def channels_at(loop: FeedbackLoop, at: At) -> range:
    """Indices of those channels in `approximate_halves`."""
    first = len(loop.inputs) if at == "outputs" else 0
    return range(first, first + len(broken_at(loop, at)))


def go_round(G: np.ndarray, K: np.ndarray, at: At) -> Complex[np.ndarray, "line channel channel"]:
    """Loop transfer from channel to channel: K G, G K, or for both (u, y) -> (K y, G u)."""
    if at == "inputs":
        return K @ G
    if at == "outputs":
        return G @ K
    nu, ny = K.shape[1:]
    both = np.zeros((len(G), nu + ny, nu + ny), dtype=complex)
    both[:, :nu, nu:], both[:, nu:, :nu] = K, G
    return both


def approximate_halves(loop: FeedbackLoop, order: int | None = None) -> LinearSystem:
    """Both halves as one system without delays, from (u, y) to (K y, G u).

    States: the plant's with its Pade approximations of ``order`` (by default chosen for the fastest mode),
    then the compensator's.
    """
    law = loop.law
    if loop.period_s is not None:
        plant = loop.plant.sampled
    else:
        order = order or approximation_order(loop.plant, loop.law)
        plant = approximate_delays(loop.plant, order).system
    nu, ny = len(law.D), len(plant.C)
    rows = [*range(ny, ny + nu), *range(ny)]
    return beside(plant, law).select(range(nu + ny), rows)


def close_channels(halves: LinearSystem, left_open: Sequence[int] = ()) -> LinearSystem:
    """Close the channels of `approximate_halves`, except those ``left_open``.

    Raises `ConfigError` where the loop through the direct terms has no solution.
    """
    gain = np.eye(len(halves.D))
    gain[list(left_open)] = 0.0
    return close_static(halves, gain)


def open_channel(halves: LinearSystem, i: int) -> LinearSystem:
    """Transfer of channel ``i`` around the loop, the others closed: minus its return ratio."""
    return close_channels(halves, [i]).select([i], [i])
