"""Block diagonal form of a state space, one named block for each mode."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.errors import NumericalError
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.integrators import part_integrators, realise_residues
from middeck.systems.state_space.modal_states import modal_states
from middeck.systems.state_space.statespace import StateSpace, add, poles

DEPENDENT = 1e8
"""Condition number of unit eigenvectors beyond which modes count as inseparable: half the digits are lost."""


def part_modes(plant: Plant) -> Plant:
    """The plant with two states for each oscillating mode, one for each real pole, integrators together.

    Names: "mode 1, 2.5 Hz" in order of frequency, "pole 1, -3 rad/s", "at rest" (integrators). Responses are
    unchanged; integrators that are in none of them are left out.

    Raises `NumericalError` where modes nearly coincide and share their eigenvectors.

    >>> from middeck.signals.ports import Port
    >>> light = StateSpace([[0.0, 1.0], [-4.0, -0.1]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    >>> part_modes(Plant(dynamics=light, inputs=(Port("force", "N"),), outputs=(Port("way",
    ...     "m"),))).state_names
    ('mode 1, 0.3183 Hz', 'mode 1, 0.3183 Hz')
    """
    parted = part_integrators(remove_delays(plant).system)
    chain, moving = realise_residues(parted.residues), parted.moving
    values, vectors = np.linalg.eig(moving.A) if len(moving.A) else (np.zeros(0), np.zeros((0, 0)))
    upper = np.flatnonzero(np.imag(values) > 0.0)
    upper = upper[np.argsort(np.abs(values[upper]), kind="stable")]
    real = np.flatnonzero(np.imag(values) == 0.0)
    pairs = [part(vectors[:, [k]]) for k in upper for part in (np.real, np.imag)]
    V = np.hstack([np.zeros((len(values), 0)), *pairs, *(np.real(vectors[:, [k]]) for k in real)])
    if len(V) and not np.linalg.cond(V) < DEPENDENT:
        raise NumericalError(
            "the modes of the plant nearly coincide: none of them can be told from the others",
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
    return dataclasses.replace(plant, dynamics=add(chain, blocks), state_names=names)


def unmix_states(plant: Plant) -> Plant:
    """The plant in states of which each group belongs to its own poles, in order of their magnitude.

    Each has the name that most of it had, or "mode of 2.5 Hz" where states had none. The plant as it is where
    its states are not mixed (`modal_states`).
    """
    system = plant.dynamics
    T = modal_states(system.A) if isinstance(system, StateSpace) else None
    if T is None or not isinstance(system, StateSpace):
        return plant
    back = np.linalg.inv(T)
    inside = StateSpace(back @ system.A @ T, back @ system.B, system.C @ T, system.D)
    if plant.state_names:
        given = list(dict.fromkeys(plant.state_names))
        of = np.array(given)[:, None] == np.array(plant.state_names)
        names = tuple(given[k] for k in np.argmax(of @ np.abs(T * back.T), axis=0))
    else:
        names = tuple(f"mode of {rate / (2.0 * np.pi):.4g} Hz" for rate in np.sort(np.abs(poles(system))))
    return dataclasses.replace(plant, dynamics=inside, state_names=names)
