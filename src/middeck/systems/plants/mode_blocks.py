"""Block diagonal form of a state space, one named block for each mode."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Int

from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.systems.poles.integrator_chains import strictly_upper
from middeck.systems.poles.integrators import part_integrators, realise_residues
from middeck.systems.poles.modal_states import INSEPARABLE, modal_states
from middeck.systems.poles.same_response import responds_otherwise
from middeck.systems.poles.strong_components import strong_components
from middeck.systems.state_space.statespace import StateSpace, add

OWNED = 0.9
"""Share of a state from which on it has the name of those that it is made of."""

KEPT = 4
"""Plants of which `unmix_states` keeps what it found: many authorities are designed on one plant."""


def part_modes(plant: Plant) -> Plant:
    """The plant with two states for each oscillating mode, one for each real pole, integrators together.

    Names: "mode 1, 2.5 Hz" in order of frequency, "pole 1, -3 rad/s", "at rest" (integrators). Responses are
    unchanged; integrators that are in none of them are left out.

    Raises `NumericalError` where modes nearly coincide and share their eigenvectors, and where the states are
    so mixed that rounding hides the modes.

    >>> from middeck.signals.ports import Port
    >>> light = StateSpace([[0.0, 1.0], [-4.0, -0.1]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    >>> part_modes(Plant(dynamics=light, inputs=(Port("force", "N"),), outputs=(Port("way",
    ...     "m"),))).state_names
    ('mode 1, 0.3183 Hz', 'mode 1, 0.3183 Hz')
    """
    system = remove_delays(plant).system
    parted = part_integrators(system)
    chain, moving = realise_residues(parted.residues), parted.moving
    values, vectors = np.linalg.eig(moving.A) if len(moving.A) else (np.zeros(0), np.zeros((0, 0)))
    upper = np.flatnonzero(np.imag(values) > 0.0)
    upper = upper[np.argsort(np.abs(values[upper]), kind="stable")]
    real = np.flatnonzero(np.imag(values) == 0.0)
    pairs = [part(vectors[:, [k]]) for k in upper for part in (np.real, np.imag)]
    V = np.hstack([np.zeros((len(values), 0)), *pairs, *(np.real(vectors[:, [k]]) for k in real)])
    if len(V) and not np.linalg.cond(V) < INSEPARABLE:
        raise NumericalError(
            "the modes of the plant nearly coincide: none of them can be distinguished from the others",
            hint="a plant in modal form, or with state_names",
        )
    label = np.repeat(np.arange(len(upper) + len(real)), [2] * len(upper) + [1] * len(real))
    A = np.where(label[:, None] == label, np.linalg.solve(V, moving.A @ V), 0.0)
    blocks = StateSpace(A, np.linalg.solve(V, moving.B), moving.C @ V, moving.D)
    hz = np.abs(values[upper]) / (2.0 * np.pi)
    names = (
        *("at rest",) * len(chain.A),
        *(f"mode {k + 1}, {f:.4g} Hz" for k, f in enumerate(hz) for _ in range(2)),
        *(f"pole {k + 1}, {rate:.4g} rad/s" for k, rate in enumerate(np.real(values[real]))),
    )
    whole = add(chain, blocks)
    if responds_otherwise(whole, system):
        raise NumericalError(
            "the states are so mixed that rounding hides the modes of the plant",
            hint="states of like sizes, as modal ones",
        )
    return dataclasses.replace(plant, dynamics=whole, state_names=names)


@functools.lru_cache(maxsize=KEPT)
def unmix_states(plant: Plant) -> tuple[Plant, float]:
    """The plant in states in groups that belong to their own poles, and the condition of the old states.

    The second is the condition of the change of states (`modal_states`), 1 where nothing changed. Each
    state keeps a name that it has nearly alone; others are named "mode of 2.5 Hz". States of
    approximated delays stay: their entries hold digits that a change of states would lose. They are named
    "delay" and act on each other only; a state of this name that acts on others, and they on it, is the
    user's.
    """
    system = plant.dynamics
    if not isinstance(system, StateSpace):
        return plant, 1.0
    given = np.array(name_states(plant), dtype=object)
    own = _own_states(system.A, given == "delay")
    found = modal_states(system.A[np.ix_(own, own)])
    if found is None:
        return plant, 1.0
    T = np.eye(len(given))
    T[np.ix_(own, own)] = found.T
    back = np.linalg.inv(T)
    share = np.abs(T * back.T) / np.sum(np.abs(T * back.T), axis=0)
    names = list(given)
    for k, rate in zip(own, found.rate, strict=True):
        held = {name: share[given == name, k].sum() for name in given}
        most = max(held, key=held.__getitem__)
        names[k] = most if held[most] > OWNED else f"mode of {rate / (2.0 * np.pi):.4g} Hz"
    A = back @ system.A @ T
    for states, sizes in found.chains:
        rest = own[states]
        chain = strictly_upper(A[np.ix_(rest, rest)], sizes)
        A[:, rest] = 0.0
        A[np.ix_(rest, rest)] = chain
    inside = StateSpace(A, back @ system.B, system.C @ T, system.D)
    unmixed = dataclasses.replace(plant, dynamics=inside, state_names=tuple(names))
    return unmixed, found.condition


def _own_states(A: np.ndarray, named: Bool[np.ndarray, " state"]) -> Int[np.ndarray, " own"]:
    """States that are not of approximated delays, which are ``named`` so."""
    apart = [part for part in strong_components(A) if not named[part].all()]
    return np.sort(np.concatenate(apart)) if apart else np.zeros(0, dtype=int)
