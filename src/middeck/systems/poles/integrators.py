"""Separation of the integrators of a system from its other poles, in any coordinates, with fewest states.

See `middeck.systems.poles.integrator_chains` for how they are found.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int

from middeck.systems.poles.integrator_chains import integrating_chains, strictly_upper
from middeck.systems.poles.state_units import in_units, state_units
from middeck.systems.state_space.modal_system import (
    ModalSystem,
    modal_to_statespace,
    output_rows,
    select_modes,
)
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, add, gain_system
from middeck.values import record

Dynamics = ModalSystem | StateSpace | SampledStateSpace
NOTHING = 1e-12, 3e-14
"""R_1, and R_2 and later, below this fraction of their output's row and input's column (and the pace of the
states) are rounding. Of mixed states R_1 comes from a difference; R_2 of a true zero stays below 4e-15, that
of bodies seen through states of unlike size goes down to 1e-13 (1500 random mixtures each)."""
RANK = 1e-10
"""Relative rank tolerance of residues scaled by rows and columns: omitted parts change no entry by more."""


@record(kw_only=True)
class PartedSystem:
    """C (s I - A)^-1 B + D as the sum of R_k / s^k, k = 1, 2, ..., and of a part without pole at the origin.

    Attributes:
        residues: R_1, R_2, ..., as many as the longest chain of integrators.
        still: The integrators as a system: C_s (s I - A_s)^-1 B_s is the sum of R_k / s^k.
        states: Orthonormal basis of the integrating states.
        leading: For each state of ``moving``, the system's state with the largest part in it.
        moving: The rest of the system, its direct term included; no pole at the origin.
    """

    residues: Float[np.ndarray, "chain output input"]
    still: StateSpace
    states: Float[np.ndarray, "state still"]
    leading: Int[np.ndarray, " moving"]
    moving: StateSpace


def part_integrators(system: StateSpace) -> PartedSystem:
    """Separate the system's integrators from its other poles.

    >>> body = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [2.0]], [[1.0, 0.0]], [[0.0]])
    >>> part_integrators(body).residues.ravel().tolist()                           # 0 / s + 2 / s^2
    [0.0, 2.0]
    """
    outputs, inputs = system.D.shape
    nothing = gain_system(np.zeros((outputs, inputs)))
    none = np.zeros((0, outputs, inputs))
    if not len(system.A):
        return PartedSystem(
            residues=none,
            still=nothing,
            states=np.zeros((0, 0)),
            leading=np.zeros(0, dtype=int),
            moving=system,
        )
    unit = state_units(system)
    balanced = in_units(system, unit)
    turn, sizes = integrating_chains(balanced.A)
    n = sum(sizes)
    if not n:
        every = np.arange(len(system.A))
        return PartedSystem(
            residues=none, still=nothing, states=np.zeros((len(every), 0)), leading=every, moving=system
        )
    A, B, C = turn.T @ balanced.A @ turn, turn.T @ balanced.B, balanced.C @ turn
    chain = strictly_upper(A[:n, :n], sizes)
    # (1, 0; mix, 1) decouples the two parts.
    mix = np.asarray(sla.solve_sylvester(chain, -A[n:, n:], -A[:n, n:])) if n < len(A) else A[:n, n:]
    moving = StateSpace(A[n:, n:], B[n:], C[:, n:] + C[:, :n] @ mix, system.D)
    into = B[:n] - mix @ B[n:]
    still = StateSpace(chain, into, C[:, :n], nothing.D)
    seen, residues = C[:, :n], np.zeros((len(sizes), outputs, inputs))
    # Rounding of a zero residue, relative to all that the output reads and the input drives.
    floor = np.outer(np.linalg.norm(C, axis=1), np.linalg.norm(np.vstack([into, B]), axis=0))
    pace = float(np.linalg.norm(balanced.A, 2))
    for k in range(len(sizes)):
        value = seen @ into
        residues[k] = np.where(np.abs(value) > NOTHING[min(k, 1)] * floor, value, 0.0)
        seen, floor = seen @ chain, floor * pace
    basis, _ = np.linalg.qr(unit[:, None] * turn[:, :n])
    return PartedSystem(
        residues=residues, still=still, states=basis, leading=_leading(turn[:, n:]), moving=moving
    )


def _leading(turn: np.ndarray) -> Int[np.ndarray, " moving"]:
    return np.argmax(np.abs(turn), axis=0) if turn.size else np.zeros(0, dtype=int)


def rest_once(dynamics: Dynamics) -> tuple[Dynamics, int]:
    """The dynamics with the fewest integrators for its responses, and the number of poles dropped.

    Those of a sampled system are its poles at z = 1.

    One force moves only one combination of several rigid modes. Unchanged where nothing is dropped; otherwise
    a state space has its integrators first, with eigenvalues exactly zero (or one).
    """
    if isinstance(dynamics, ModalSystem):
        rigid = dynamics.omega == 0.0
        rows = output_rows(still := select_modes(dynamics, rigid))
        chain = realise_residues(np.array([rows.rate @ still.psi, rows.position @ still.psi]))
        dropped = 2 * int(rigid.sum()) - len(chain.A)
        if not dropped:
            return dynamics, 0
        moving = modal_to_statespace(select_modes(dynamics, ~rigid))
        through = np.zeros_like(moving.D)
        if dynamics.phi_acceleration is not None:
            through = dynamics.phi_acceleration[:, rigid] @ still.psi
        return add(dataclasses.replace(chain, D=through), moving), dropped
    if isinstance(dynamics, SampledStateSpace):
        one = np.eye(len(dynamics.A))
        fewer, dropped = rest_once(StateSpace(dynamics.A - one, dynamics.B, dynamics.C, dynamics.D))
        if not dropped or isinstance(fewer, ModalSystem):
            return dynamics, 0
        return dataclasses.replace(dynamics, A=fewer.A + np.eye(len(fewer.A)), B=fewer.B, C=fewer.C), dropped
    parted = part_integrators(dynamics)
    chain = realise_residues(parted.residues)
    count = parted.states.shape[1]
    return (add(chain, parted.moving), count - len(chain.A)) if count else (dynamics, 0)


def realise_residues(residues: Float[np.ndarray, "chain output input"]) -> StateSpace:
    """Sum of R_k / s^k with the fewest states, all eigenvalues exactly zero.

    From the singular values of the Hankel matrix of residues (Ho and Kalman 1966); omitting parts below
    `RANK` changes no residue by more than that fraction of the largest of its row and column.

    >>> len(realise_residues(np.array([[[0.0, 0.0]], [[1.0, 2.0]]])).A)     # one body that two forces push
    2
    """
    K, outputs, inputs = residues.shape
    empty = StateSpace(
        np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), np.zeros((outputs, inputs))
    )
    if not K:
        return empty
    row = np.abs(residues).max(axis=(0, 2), initial=0.0)
    scaled = residues / np.where(row > 0.0, row, 1.0)[None, :, None]
    column = np.abs(scaled).max(axis=(0, 1), initial=0.0)
    scaled = scaled / np.where(column > 0.0, column, 1.0)[None, None, :]
    pace = _pace(scaled)
    scaled = scaled * pace ** np.arange(K)[:, None, None]
    blocks = [*scaled, *(np.zeros((outputs, inputs)) for _ in range(K + 1))]
    hankel, later = (
        np.vstack([np.hstack(blocks[i + shift : i + shift + K]) for i in range(K)]) for shift in (0, 1)
    )
    left, value, right = np.linalg.svd(hankel)
    rank = int(np.sum(value > RANK * value.max(initial=0.0)))
    if not rank:
        return empty
    root = np.sqrt(value[:rank])
    left, right = left[:, :rank] / root, right[:rank].T / root
    A = left.T @ later @ right
    turn, sizes = integrating_chains(A, RANK, RANK)
    if sum(sizes) < rank:
        # What rounding does not let vanish: the nearest that does.
        sizes = [*sizes, rank - sum(sizes)]
    into, seen = turn.T @ ((root**2)[:, None] * right[:inputs].T), (left[:outputs] * root**2) @ turn
    return StateSpace(
        strictly_upper(turn.T @ A @ turn, sizes) / pace,
        into * np.where(column > 0.0, column, 1.0),
        seen * np.where(row > 0.0, row, 1.0)[:, None],
        empty.D,
    )


def _pace(residues: np.ndarray) -> float:
    """A time unit in which the first and the last residue are of like size."""
    size = np.abs(residues).max(axis=(1, 2), initial=0.0)
    there = np.flatnonzero(size > 0.0)
    if len(there) < 2:
        return 1.0
    first, last = there[0], there[-1]
    return float(np.exp2(np.round(np.log2(size[first] / size[last]) / (last - first))))
