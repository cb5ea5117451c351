"""The law by which losses go to another environment, against complex eigenvalues of matrices.

Of a shape, a hysteretic loss is the same at each frequency: zeta omega^2 stays. A viscous one goes with the
speed: zeta omega stays. Where each shape of the ground has a factor of its own on what the model says that
article and suspension lose in it, losses of any mode elsewhere are sums over the shapes it is made of.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.updating.orbit.predicted_damping import DampingParts, carry_damping

MASS = np.array([[2.0, 0.3, 0.1], [0.3, 1.5, 0.2], [0.1, 0.2, 1.0]])
ELASTIC = np.array([[90.0, -30.0, 0.0], [-30.0, 70.0, -25.0], [0.0, -25.0, 25.0]])
WEIGHT = np.array([[300.0, 40.0, 0.0], [40.0, 60.0, 30.0], [0.0, 30.0, 500.0]])
GROUND, SHAPES = sla.eigh(ELASTIC + WEIGHT, MASS)
# Of each shape on the ground: ratios by stiffness and by dampers, of the article and of its suspension alike,
# so small that no more than 1e-5 of them is of second order.
BY_STIFFNESS, BY_DAMPERS = 1e-5 * np.array([6.0, 1.0, 3.0]), 1e-5 * np.array([1.0, 5.0, 2.0])
MEASURED = np.array([1.8, 0.6, 1.2])
HANGS = [(0.0, 0.0), (0.1, 1.0), (1.0, 1.0)]
"""Parts of the weight's stiffness and of the suspension's losses: in orbit, on the moon, on the ground."""


def matrices(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Imaginary stiffness and dampers that lose ``factor`` times the ratios above in each shape."""
    rows, omega = SHAPES.T @ MASS, np.sqrt(GROUND)
    H = (rows.T * (2.0 * factor * BY_STIFFNESS * omega**2)) @ rows
    return H, (rows.T * (2.0 * factor * BY_DAMPERS * omega)) @ rows


def ratios(weight: float, lossy: float, factor: np.ndarray) -> np.ndarray:
    """Of the damped article, by complex eigenvalues; ``lossy`` times its losses."""
    H, C = matrices(lossy * factor)
    inverse = np.linalg.inv(MASS)
    K = ELASTIC + weight * WEIGHT + 1j * H
    s = np.linalg.eigvals(np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ K, -inverse @ C]]))
    s = s[s.imag > 0.0]
    s = s[np.argsort(np.abs(s))]
    return -s.real / np.abs(s)


def losses(weight: float, hangs: float, hung: bool) -> tuple[DampingParts, np.ndarray]:
    """The model's, and its shapes."""
    lam, shapes = sla.eigh(ELASTIC + weight * WEIGHT, MASS)
    omega = np.sqrt(lam)
    H, C = (np.diag(shapes.T @ part @ shapes) for part in matrices(np.ones(3)))
    article = np.array([H / (2.0 * lam), C / (2.0 * omega)])
    return DampingParts(omega, np.array([article, hung * hangs * article])), shapes


@pytest.mark.parametrize("hung", [False, True])
@pytest.mark.parametrize(("weight", "hangs"), HANGS)
def test_stiffness_loses_by_the_square_of_the_frequency_and_dampers_by_the_frequency(
    weight: float, hangs: float, hung: bool
):
    """Both lose, unlike in each shape, and the modes elsewhere are made of several shapes.

    A suspension that loses as much as the article in each shape: one factor is the likeliest of both.
    """
    ground, _ = losses(1.0, 1.0, hung)
    there, shapes = losses(weight, hangs, hung)
    share = (shapes.T @ MASS @ SHAPES) ** 2
    carried = carry_damping(share, there, ground, ratios(1.0, 1.0 + hung, MEASURED), np.full(3, 0.01))
    truth = ratios(weight, 1.0 + hung * hangs, MEASURED)
    assert carried.zeta == pytest.approx(truth, rel=2e-5)
    assert weight == 1.0 or share.max(axis=1).min() < 0.9
