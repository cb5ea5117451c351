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
from middeck.systems.state_space.modal_system import ModalSystem, output_rows, select_modes
from middeck.systems.state_space.statespace import (
    LinearSystem,
    SampledStateSpace,
    StateSpace,
    add,
    gain_system,
)
from middeck.values import record

KNOWN = 30.0
"""Roundings of each entry, all at their worst, by which residues may err. Of 300 plants mixed by matrices of
condition 1e2 to 1e6 no residue that was found erred by more than one such rounding."""
RANK = 1e-10
"""Relative rank tolerance of residues scaled by rows and columns: omitted parts change no entry by more."""


@record(kw_only=True)
class PartedSystem:
    """C (s I - A)^-1 B + D as the sum of R_k / s^k, k = 1, 2, ..., and of a part without pole at the origin.

    Attributes:
        residues: R_1, R_2, ..., as many as the longest chain of integrators; zero where rounding may be all.
        errors: Bound of the rounding error of each.
        still: The integrators as a system: C_s (s I - A_s)^-1 B_s is the sum of R_k / s^k.
        states: Orthonormal basis of the integrating states.
        leading: The system's state with the largest part in each state of ``moving``.
        moving: The rest of the system, its direct term included; no pole at the origin.
    """

    residues: Float[np.ndarray, "chain output input"]
    errors: Float[np.ndarray, "chain output input"]
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
    if not len(system.A):
        return _without_integrators(system)
    unit = state_units(system)
    balanced = in_units(system, unit)
    turn, sizes = integrating_chains(balanced.A)
    n = sum(sizes)
    if not n:
        return _without_integrators(system)
    A, B, C = turn.T @ balanced.A @ turn, turn.T @ balanced.B, balanced.C @ turn
    chain = strictly_upper(A[:n, :n], sizes)
    # (1, 0; mix, 1) decouples the two parts.
    mix = np.asarray(sla.solve_sylvester(chain, -A[n:, n:], -A[:n, n:])) if n < len(A) else A[:n, n:]
    moving = StateSpace(A[n:, n:], B[n:], C[:, n:] + C[:, :n] @ mix, system.D)
    into = B[:n] - mix @ B[n:]
    still = StateSpace(chain, into, C[:, :n], np.zeros_like(system.D))
    known = _roundings(balanced, turn, n, mix)
    residues = np.zeros((len(sizes), *system.D.shape))
    errors = np.zeros_like(residues)
    seen, lost = C[:, :n], known.seen
    for k in range(len(sizes)):
        errors[k] = lost @ np.abs(into) + np.abs(seen) @ known.driven
        value = seen @ into
        residues[k] = np.where(np.abs(value) > errors[k], value, 0.0)
        seen, lost = seen @ chain, lost @ np.abs(chain) + np.abs(seen) @ known.link
    basis, _ = np.linalg.qr(unit[:, None] * turn[:, :n])
    return PartedSystem(
        residues=residues,
        errors=errors,
        still=still,
        states=basis,
        leading=np.argmax(np.abs(turn[:, n:]), axis=0),
        moving=moving,
    )


def _without_integrators(system: StateSpace) -> PartedSystem:
    every, none = np.arange(len(system.A)), np.zeros((0, *system.D.shape))
    return PartedSystem(
        residues=none,
        errors=none,
        still=gain_system(np.zeros_like(system.D)),
        states=np.zeros((len(every), 0)),
        leading=every,
        moving=system,
    )


@record
class _Roundings:
    """Rounding of what outputs see of integrators, of what drives them, and of their links."""

    seen: Float[np.ndarray, "output still"]
    driven: Float[np.ndarray, "still input"]
    link: Float[np.ndarray, "still still"]


def _roundings(system: StateSpace, turn: np.ndarray, n: int, mix: np.ndarray) -> _Roundings:
    """To first order, entry by entry: what rounding of A turns the integrators into the other states by goes
    as these answer to it at rest."""
    eps = KNOWN * float(np.finfo(float).eps)
    A, B, C = (eps * np.abs(M) for M in (system.A, system.B, system.C))
    right, left = turn[:, :n], np.eye(n, len(turn)) @ turn.T - mix @ turn[:, n:].T
    others = turn[:, n:] + right @ mix
    moving = turn[:, n:].T @ system.A @ turn[:, n:]
    into = np.linalg.solve(moving, turn[:, n:].T @ system.B)
    out = np.linalg.solve(moving.T, (system.C @ others).T).T
    right, left, others = np.abs(right), np.abs(left), np.abs(others)
    aside, along = np.abs(turn[:, n:].T) @ A @ right, left @ A @ others
    return _Roundings(
        seen=C @ right + np.abs(out) @ aside,
        driven=left @ B + along @ np.abs(into),
        link=left @ A @ right,
    )


def rest_once(system: LinearSystem) -> tuple[LinearSystem, int]:
    """The system with the fewest integrators for its responses, and the number of poles dropped.

    Those of a sampled system are its poles at z = 1.

    One force moves only one combination of several rigid bodies. Unchanged without integrators, and a sampled
    system where nothing is dropped; otherwise integrators come first, with eigenvalues exactly zero (or one).
    """
    if isinstance(system, SampledStateSpace):
        one = np.eye(len(system.A))
        fewer, dropped = rest_once(StateSpace(system.A - one, system.B, system.C, system.D))
        if not dropped:
            return system, 0
        return dataclasses.replace(system, A=fewer.A + np.eye(len(fewer.A)), B=fewer.B, C=fewer.C), dropped
    parted = part_integrators(system)
    chain = realise_residues(parted.residues, parted.errors)
    count = parted.states.shape[1]
    if len(chain.A) >= count:
        chain = parted.still
    return (add(chain, parted.moving), count - len(chain.A)) if count else (system, 0)


def rest_modes_once(modal: ModalSystem) -> tuple[ModalSystem | StateSpace, int]:
    """`rest_once` of modes; modal unless poles are dropped."""
    rigid = modal.omega == 0.0
    rows = output_rows(still := select_modes(modal, rigid))
    chain = realise_residues(np.array([rows.rate @ still.psi, rows.position @ still.psi]))
    dropped = 2 * int(rigid.sum()) - len(chain.A)
    if not dropped:
        return modal, 0
    moving = select_modes(modal, ~rigid).as_statespace()
    through = np.zeros_like(moving.D)
    if modal.phi_acceleration is not None:
        through = modal.phi_acceleration[:, rigid] @ still.psi
    return add(dataclasses.replace(chain, D=through), moving), dropped


def realise_residues(
    residues: Float[np.ndarray, "chain output input"],
    errors: Float[np.ndarray, "chain output input"] | None = None,
) -> StateSpace:
    """Sum of R_k / s^k with the fewest states, all eigenvalues exactly zero.

    From the singular values of the Hankel matrix of residues (Ho and Kalman 1966); omitting parts below
    `RANK` changes no residue by more than that fraction of the largest of its row and column. Where
    ``errors`` are given, rows, columns and the unit of time make these alike, and parts below them are
    omitted, too.

    >>> len(realise_residues(np.array([[[0.0, 0.0]], [[1.0, 2.0]]])).A)     # one body that two forces push
    2
    """
    K, outputs, inputs = residues.shape
    empty = StateSpace(
        np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), np.zeros((outputs, inputs))
    )
    if not K:
        return empty
    alike = np.abs(residues) if errors is None else errors
    row = _or_one(alike.max(axis=(0, 2), initial=0.0))[:, None]
    column = _or_one((alike / row).max(axis=(0, 1), initial=0.0))
    pace = _pace(alike / row / column)
    unit = row * column / pace ** np.arange(K)[:, None, None]
    hankel, later = _hankel(residues / unit)
    left, value, right = np.linalg.svd(hankel)
    lost = 0.0 if errors is None else float(np.linalg.norm(_hankel(errors / unit)[0], 2))
    rank = int(np.sum(value > max(lost, RANK * value.max(initial=0.0))))
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
    # Rounding would show integrators to ports without residues, beyond bounds at rest.
    into[:, ~residues.any(axis=(0, 1))], seen[~residues.any(axis=(0, 2))] = 0.0, 0.0
    return StateSpace(
        strictly_upper(turn.T @ A @ turn, sizes) / pace,
        into * column,
        seen * row,
        empty.D,
    )


def _or_one(sizes: np.ndarray) -> np.ndarray:
    return np.where(sizes > 0.0, sizes, 1.0)


def _hankel(residues: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The block Hankel matrix of residues, and that of the next ones."""
    K = len(residues)
    blocks = [*residues, *np.zeros((K + 1, *residues.shape[1:]))]
    first, later = (
        np.vstack([np.hstack(blocks[i + shift : i + shift + K]) for i in range(K)]) for shift in (0, 1)
    )
    return first, later


def _pace(residues: np.ndarray) -> float:
    """A time unit in which the first and the last residue are of like size."""
    size = np.abs(residues).max(axis=(1, 2), initial=0.0)
    there = np.flatnonzero(size > 0.0)
    if len(there) < 2:
        return 1.0
    first, last = there[0], there[-1]
    return float(np.exp2(np.round(np.log2(size[first] / size[last]) / (last - first))))
