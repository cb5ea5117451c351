"""Pade approximations in place of a plant's exact delays, for designs that need finitely many states."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.arguments import named_kinds
from middeck.systems.delay.delayed_integrators import approximate_delayed_integrators
from middeck.systems.delay.pade import evaluate_pade, pade
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.poles.inert_modes import inert_modes, silence_inert
from middeck.systems.poles.rigid_alignment import align_rigid
from middeck.systems.poles.same_response import part_known
from middeck.systems.sampling.delayed_sampling import is_sum, split_delays
from middeck.systems.state_space.feedback import beside
from middeck.systems.state_space.modal_system import ModalSystem, output_rows, select_modes
from middeck.systems.state_space.reached_states import reached_states
from middeck.systems.state_space.statespace import StateSpace, add, gain_system, series
from middeck.values import record

# Delays that differ by less [s] count as equal: far below the resolution of any record.
SAME_DELAY_S = 1e-12

Named = tuple[StateSpace, tuple[str, ...]]
"""A system and the names of its states."""


@named_kinds
def approximate_delays(plant: Plant, order: int) -> Plant:
    """The plant with a Pade approximation of ``order`` states for each separate delay.

    A delay common to all paths goes to the side with fewer channels; further delay of an input or output has
    its own states. Where delays are not a sum of an input's and an output's (`is_sum`), each channel of the
    smaller side has a copy of the states on its paths, except integrators (rigid modes): these are kept once,
    controllable and observable or not, with the integrators that such delays add
    (`middeck.systems.delay.delayed_integrators`), and come last. States: the input delays (named "delay"),
    the plant's, the output delays. Inert modes are separated by exact zeros (`align_rigid`, `silence_inert`).

    A plant without delays stays as it is.

    Raises `ConfigError` for an order below one.
    """
    if not plant.delayed:
        return plant
    on_time = remove_delays(plant)
    modal = None
    if plant.modal is not None:
        modal = silence_inert(align_rigid(plant.modal))
        on_time = dataclasses.replace(on_time, dynamics=modal)
    whole = on_time.system if modal is None else modal.as_statespace()
    system, names = _approximate(whole, modal, name_states(on_time), plant.delay_s, order)
    return dataclasses.replace(on_time, dynamics=system, state_names=names)


def _approximate(
    whole: StateSpace, modal: ModalSystem | None, names: tuple[str, ...], delay_s: np.ndarray, order: int
) -> Named:
    if is_sum(delay_s, SAME_DELAY_S):
        return _delayed_channels(whole, names, delay_s, order)
    if modal is not None:
        parts, apart = _part_modes(modal), None
    else:
        alone = _joined_to_no_port(whole)
        parts, apart = _part_states(*_states(whole, names, ~alone)), _states(whole, names, alone)
    if len(parts.residues):
        system, kept = _approximate_parts(parts, delay_s, order)
    else:
        moving = dataclasses.replace(parts.moving, D=parts.moving.D + parts.direct)
        system, kept = _by_channel(moving, parts.names, delay_s, order)
    if apart is None:
        return system, kept
    inert, others = apart
    return add(system, dataclasses.replace(inert, D=np.zeros_like(inert.D))), (*kept, *others)


def _states(system: StateSpace, names: tuple[str, ...], which: np.ndarray) -> Named:
    part = StateSpace(system.A[np.ix_(which, which)], system.B[which], system.C[:, which], system.D)
    return part, tuple(name for name, there in zip(names, which, strict=True) if there)


def _joined_to_no_port(system: StateSpace) -> np.ndarray:
    """Inert states: separated by exact zeros from all states that are controllable or observable."""
    joined = np.any(system.B, axis=1) | np.any(system.C, axis=0)
    return ~reached_states((system.A != 0.0) | (system.A.T != 0.0), joined)


def evaluate_approximation(
    delay_s: Float[np.ndarray, "output input"], order: int, s: Complex[np.ndarray, " point"]
) -> Complex[np.ndarray, "point output input"]:
    """Approximation of exp(-s tau) of each path in `approximate_delays`, at complex frequencies ``s``
    [rad/s].

    >>> turn = evaluate_approximation(np.array([[0.0, 0.1], [0.2, 0.1]]), 8, np.array([1.0j]))[0]
    >>> bool(np.allclose(turn, np.exp(-1.0j * np.array([[0.0, 0.1], [0.2, 0.1]])), atol=1e-12))
    True
    """
    if is_sum(delay_s, SAME_DELAY_S):
        return _evaluate_sum(delay_s, order, s)
    by_input = delay_s.shape[1] <= delay_s.shape[0]
    alone = [delay_s[:, [k]] if by_input else delay_s[[k]] for k in range(min(delay_s.shape))]
    return np.concatenate([_evaluate_sum(each, order, s) for each in alone], axis=2 if by_input else 1)


def _evaluate_sum(delay_s: np.ndarray, order: int, s: np.ndarray) -> np.ndarray:
    before, after = (
        np.stack([evaluate_pade(_without_rounding(tau), order, s) for tau in side], axis=-1)
        for side in _put_delays(delay_s)
    )
    return after[:, :, None] * before[:, None, :]


def _approximate_parts(parts: _Parts, delay_s: np.ndarray, order: int) -> Named:
    """One copy of the moving part for each channel; integrators once, and last."""
    banks = [_bank(delay_s, i, order) for i in range(delay_s.shape[1])]
    integrals, count = approximate_delayed_integrators(parts.residues, parts.still, parts.direct, banks)
    names = (*(parts.at_rest,) * count, *("delay",) * (len(integrals.A) - count))
    if not len(parts.moving.A):
        return integrals, names
    copies, others = _by_channel(parts.moving, parts.names, delay_s, order)
    return add(copies, integrals), (*others, *names)


@record(kw_only=True)
class _Parts:
    """Integrators as residues and as a system, with one name; the moving part; the direct term."""

    residues: Float[np.ndarray, "chain output input"]
    still: StateSpace
    at_rest: str
    moving: StateSpace
    names: tuple[str, ...]
    direct: Float[np.ndarray, "output input"]


def _part_modes(modal: ModalSystem) -> _Parts:
    rigid = (modal.omega == 0.0) & ~inert_modes(modal)
    moving, still = (select_modes(modal, which) for which in (~rigid, rigid))
    rows = output_rows(still)
    residues = np.array([rows.rate @ still.psi, rows.position @ still.psi])[: 2 * bool(rigid.any())]
    rest = dataclasses.replace(moving, direct=None).as_statespace()
    chains = dataclasses.replace(still, phi_acceleration=None, direct=None).as_statespace()
    return _Parts(
        residues=residues,
        still=chains,
        at_rest=", ".join(still.names),
        moving=rest,
        names=tuple(name for name in moving.names for _ in range(2)),
        direct=rows.direct,
    )


def _part_states(system: StateSpace, names: tuple[str, ...]) -> _Parts:
    none = np.zeros_like(system.D)
    parted = part_known(system)
    share = np.sum(parted.states**2, axis=1)
    # A tenth: traces of rounding name nothing.
    at_rest = ", ".join(dict.fromkeys(names[i] for i in np.flatnonzero(share > 0.1)))
    rest = StateSpace(parted.moving.A, parted.moving.B, parted.moving.C, none)
    own = tuple(names[i] for i in parted.leading)
    return _Parts(
        residues=parted.residues, still=parted.still, at_rest=at_rest, moving=rest, names=own, direct=system.D
    )


def _bank(delay_s: np.ndarray, i: int, order: int) -> StateSpace:
    """Approximate delays from input ``i`` to each output, path by path as in `_by_channel`."""
    if delay_s.shape[1] <= delay_s.shape[0]:
        return _delayed_channels(gain_system(np.ones((len(delay_s), 1))), (), delay_s[:, [i]], order)[0]
    common = delay_s.min(axis=1)
    delayed = series(_pade_of_channels(common, order), _pade_of_channels(delay_s[:, i] - common, order))
    B, D = (matrix.sum(axis=1, keepdims=True) for matrix in (delayed.B, delayed.D))
    return StateSpace(delayed.A, B, delayed.C, D)


def _by_channel(system: StateSpace, names: tuple[str, ...], delay_s: np.ndarray, order: int) -> Named:
    """Approximate one channel of the smaller side at a time; its paths have delays of the other side only."""
    by_input = delay_s.shape[1] <= delay_s.shape[0]
    whole, count = slice(None), min(delay_s.shape)
    channels = [(whole, [k]) if by_input else ([k], whole) for k in range(count)]
    on_path = np.array([_on_path(system.A, system.B[:, i], system.C[o]) for o, i in channels])
    # Keep states on no path once, so that a design can refuse them.
    on_path[0] |= ~on_path.any(axis=0)
    parts: list[Named] = []
    for (rows, columns), kept in zip(channels, on_path, strict=True):
        alone = StateSpace(
            system.A[np.ix_(kept, kept)],
            system.B[kept][:, columns],
            system.C[rows][:, kept],
            system.D[rows][:, columns],
        )
        own = tuple(name for name, there in zip(names, kept, strict=True) if there)
        parts.append(_delayed_channels(alone, own, delay_s[rows][:, columns], order))
    return _join_channels(parts, by_input=by_input)


def _on_path(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """States between an input and an output, by exact zeros."""
    return reached_states(A, np.any(B, axis=1)) & reached_states(A.T, np.any(C, axis=0))


def _join_channels(parts: Sequence[Named], *, by_input: bool) -> Named:
    """Join systems of one input each (outputs added), or of one output each (same inputs)."""
    systems = [system for system, _ in parts]
    side_by_side, stacked = (_block, np.hstack) if by_input else (np.vstack, _block)
    joined = StateSpace(
        _block([s.A for s in systems]),
        side_by_side([s.B for s in systems]),
        stacked([s.C for s in systems]),
        (np.hstack if by_input else np.vstack)([s.D for s in systems]),
    )
    return joined, tuple(name for _, names in parts for name in names)


def _delayed_channels(system: StateSpace, names: tuple[str, ...], delay_s: np.ndarray, order: int) -> Named:
    """Approximate delays that are sums: of inputs in front, of outputs behind, common ones on one side."""
    before, after = (_pade_of_channels(side, order) for side in _put_delays(delay_s))
    delayed = series(series(before, system), after)
    return delayed, (*("delay",) * len(before.A), *names, *("delay",) * len(after.A))


def _put_delays(delay_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Delays of inputs and of outputs whose sums are the delays of the paths."""
    split = split_delays(delay_s)
    of_input, of_output = split.input_s, split.output_s
    if len(of_input) < len(of_output):
        common = of_output.min()
        of_input, of_output = of_input + common, of_output - common
    return of_input, of_output


def _pade_of_channels(delay_s: Float[np.ndarray, " channel"], order: int) -> StateSpace:
    """A Pade approximation for each delayed channel."""
    each = {tau: pade(_without_rounding(tau), order) for tau in dict.fromkeys(delay_s)}
    return beside(*(each[tau] for tau in delay_s))


def _without_rounding(tau: float) -> float:
    return tau if tau > SAME_DELAY_S else 0.0


def _block(blocks: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(scipy.linalg.block_diag(*blocks))
