"""A law with a double zero at the origin before a free body: their product is finite there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.state_space.statespace import StateSpace
from repeats import repeats

pytestmark = pytest.mark.kernels

OMEGA, ZETA = 7.0, 0.01
"""y = (1/s^2 + 1/(s^2 + 2 ZETA OMEGA s + OMEGA^2)) of the force, and that
-k s^2 / ((s + w)^2 (1 + s/p)) of y."""


def loop_gain(s: Any, k: float, w: float) -> Any:
    body = 1.0 + s**2 / (s**2 + 2.0 * ZETA * OMEGA * s + OMEGA**2)
    return k * body / (s + w) ** 2 / (1.0 + s / (10.0 * w))


def mixed(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    turn = np.linalg.qr(rng.standard_normal(A.shape))[0]
    unit = 10.0 ** rng.uniform(-4.0, 4.0, len(A))
    A, B, C = turn @ A @ turn.T, turn @ B, C @ turn.T
    return A * unit / unit[:, None], B / unit[:, None], C * unit


@pytest.mark.parametrize("kind", ["plain", "mixed"])
@pytest.mark.parametrize("seed", repeats(range(30), 4))
def test_margins_of_two_washouts_before_a_free_body(seed: int, kind: str) -> None:
    """At the lowest frequencies rounding of the zeros was multiplied by the body, and |S| said to be 2e8."""
    rng = np.random.default_rng([243, seed])
    w = 10.0 ** rng.uniform(-0.5, 0.5)
    k = w * w * 10.0 ** rng.uniform(-2.0, -0.3)  # below one at rest
    A, B, C = np.zeros((4, 4)), np.array([[0.0], [1.0], [0.0], [1.0]]), np.array([[1.0, 0.0, 1.0, 0.0]])
    A[0, 1] = A[2, 3] = 1.0
    A[3, 2:] = -(OMEGA**2), -2.0 * ZETA * OMEGA
    p = 10.0 * w
    law = (
        np.array([[-w, 0.0, 0.0], [-w, -w, 0.0], [-p, -p, -p]]),
        np.array([[w], [w], [p]]),
        -k * np.array([[0.0, 0.0, 1.0]]),
    )
    if kind == "mixed":
        A, B, C = mixed(A, B, C, rng)
        law = mixed(*law, rng)
    plant = make_plant(A, B, C)
    K = Compensator(StateSpace(*law, np.zeros((1, 1))), plant.outputs, plant.inputs)
    margins = measure_margins(plant, K)
    lines = np.sort(np.append(np.geomspace(1e-3, 300.0, 5001), OMEGA + np.linspace(-1.0, 1.0, 20_001)))
    L = loop_gain(1j * lines, k, w)
    crossed = np.flatnonzero(np.diff(np.abs(L) > 1.0))
    at = [brentq(lambda x: abs(loop_gain(1j * x, k, w)) - 1.0, *lines[i : i + 2]) for i in crossed]
    phase = min((np.pi - abs(np.angle(loop_gain(1j * x, k, w))) for x in at), default=np.inf)
    (one,) = margins.loops
    if margins.stable:
        assert one.phase_limit_rad == pytest.approx(phase, rel=1e-5)
        assert one.sensitivity.gain == pytest.approx(np.max(1.0 / np.abs(1.0 + L)), rel=1e-4)
