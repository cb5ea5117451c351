"""A body's place and rate, read through states that mix displacements with rates at random."""

from __future__ import annotations

import numpy as np
import pytest
from tests.repeats import repeats

from middeck.systems.poles.integrators import part_integrators
from middeck.systems.state_space.statespace import StateSpace


def _mixed_body(rng: np.random.Generator, read: str) -> tuple[StateSpace, float]:
    """A free body among light modes to 1000 rad/s, in mixed states; and the push on what is read of it."""
    count = int(rng.integers(2, 9))
    omega = np.concatenate([[0.0], 10.0 ** rng.uniform(2.5, 3.0, count - 1)])
    push, shape = rng.standard_normal(count), rng.standard_normal(count)
    A, C = np.zeros((2 * count, 2 * count)), np.zeros((1, 2 * count))
    A[::2, 1::2], A[1::2, ::2], A[1::2, 1::2] = np.eye(count), np.diag(-(omega**2)), np.diag(-0.002 * omega)
    C[0, 1::2] = shape * (omega > 0.0)
    C[0, 0 if read == "place" else 1] = shape[0]
    B = np.zeros((2 * count, 1))
    B[1::2, 0] = push
    T = rng.standard_normal((2 * count, 2 * count))
    while np.linalg.cond(T) > 300.0:
        T = rng.standard_normal((2 * count, 2 * count))
    mixed = StateSpace(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T, np.zeros((1, 1)))
    return mixed, float(shape[0] * push[0])


@pytest.mark.parametrize("read", ["place", "rate"])
@pytest.mark.parametrize("seed", repeats([474, *range(800)], 20))
def test_a_place_is_seen_and_a_rate_shows_none(read: str, seed: int) -> None:
    mixed, push = _mixed_body(np.random.default_rng(seed), read)
    residues = part_integrators(mixed).residues[:, 0, 0]
    assert len(residues) == 2
    if read == "rate":
        assert residues[0] == pytest.approx(push, rel=1e-4)
        assert residues[1] == 0.0
    else:
        assert residues[1] == pytest.approx(push, rel=0.05)
