"""The measured aeroplane of `benchmarks/measured/garteur.py` against sums by hand."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
from measured import garteur

BARE = {"left_out": ("plate", "wing to plate")}
ROOT, TIP = 0.025, 0.95


def lumps(article):
    """x [m] and mass [kg] of twenty pieces of every member, and of the bodies."""
    place = {node.name: node.position for node in article.nodes}
    along = (np.arange(20) + 0.5) / 20
    pieces = [np.stack([node.position[0], node.body.mass]) for node in article.nodes]
    for m in article.members:
        a, b = place[m.start], place[m.end]
        mass = m.section.rho_A * np.linalg.norm(b - a) / 20
        pieces += [np.array([x, mass]) for x in a[0] + along * (b[0] - a[0])]
    return np.array(pieces).T


def test_its_mass_is_the_published():
    article = garteur.aeroplane()
    assert lumps(article)[1].sum() == pytest.approx(article.mass, rel=1e-12)
    assert article.mass == pytest.approx(garteur.PUBLISHED_KG, rel=0.005)


def test_two_node_bending_by_rayleigh_and_ritz():
    """A rigid body that heaves and pitches, and on both sides a cantilever bent by its tip mass."""
    article = garteur.aeroplane(**BARE)
    x, mass = lumps(article)
    b, h = 0.1, 0.01
    EI, rho_A, length = 70e9 * b * h**3 / 12.0, 2700.0 * b * h, TIP - ROOT
    sensors = 2700.0 * 0.02**2 * (3 * np.hypot(0.02, np.hypot(0.03, 0.005)) + np.hypot(0.03, 0.005))
    tip = 0.2 + 0.4 * b * h * 2700.0 + 0.05 * rho_A + sensors
    s = np.linspace(0.0, length, 1001)
    w = (3.0 * length * s**2 - s**3) / (2.0 * length**3)
    flexible = tip + rho_A * np.trapezoid(w**2, s), tip + rho_A * np.trapezoid(w, s), 0.2 * 0.18
    M = np.array([2.0 * np.array(flexible), [0.0, mass.sum(), x @ mass], [0.0, 0.0, x**2 @ mass]])
    M = np.triu(M) + np.triu(M, 1).T
    K = np.zeros((3, 3))
    K[0, 0] = 2.0 * 3.0 * EI / length**3
    for at, *_, count in garteur.HUNG:
        K[1:, 1:] += count * garteur.BUNGEE * np.outer([1.0, at], [1.0, at])
    by_hand = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[-1]) / (2.0 * np.pi)
    assert garteur.frequencies(article)[0] == pytest.approx(by_hand, rel=0.01)
