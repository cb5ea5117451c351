"""Shapes followed one to one, whatever basis an eigensolver chose for repeated frequencies."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import ortho_group

from middeck.structure.gravity.tracking import Spectrum, align_repeated, track

LAM = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 5.0, -3.0])


@pytest.fixture
def reference() -> Spectrum:
    """Mass-normalised shapes of a random mass, three of zero frequency and two of another."""
    rng = np.random.default_rng(7)
    A = rng.standard_normal((8, 8))
    mass = A @ A.T + 8.0 * np.eye(8)
    shapes = np.linalg.solve(np.linalg.cholesky(mass).T, ortho_group.rvs(8, random_state=8))
    return Spectrum(LAM, shapes, sp.csr_array(mass))


def scrambled(reference: Spectrum) -> Spectrum:
    """The same modes in another order, of other signs and another basis of each repeated frequency."""
    shapes = reference.shapes.copy()
    shapes[:, :3] = shapes[:, :3] @ ortho_group.rvs(3, random_state=1)
    shapes[:, 4:6] = shapes[:, 4:6] @ ortho_group.rvs(2, random_state=2)
    order = np.array([7, 6, 0, 4, 1, 5, 3, 2])
    return Spectrum(LAM[order], (shapes * [1, -1, 1, -1, 1, 1, -1, 1])[:, order], reference.mass)


def test_every_mode_is_found_again(reference: Spectrum):
    found = track(reference, scrambled(reference))
    # Rounding of matrix products of eight terms.
    assert found.match == pytest.approx(np.ones(8), abs=1e-12)
    assert found.spectrum.lam == pytest.approx(LAM, abs=1e-12)
    assert sorted(found.found) == list(range(8))
    overlap = reference.shapes.T @ (reference.mass @ found.spectrum.shapes)
    assert np.abs(overlap) == pytest.approx(np.eye(8), abs=1e-12)


def test_a_few_modes_are_found_among_all(reference: Spectrum):
    few = Spectrum(LAM[2:5], reference.shapes[:, 2:5], reference.mass)
    found = track(few, scrambled(reference))
    assert found.match == pytest.approx(np.ones(3), abs=1e-12)
    assert found.spectrum.lam == pytest.approx(LAM[2:5], abs=1e-12)


def test_turning_a_repeated_frequency_keeps_the_modes(reference: Spectrum):
    """The basis stays mass-orthonormal, and modes of a single frequency stay as they are."""
    before = scrambled(reference)
    turned = align_repeated(before, reference.shapes[:, :4])
    gram = turned.shapes.T @ (turned.mass @ turned.shapes)
    assert gram == pytest.approx(np.eye(8), abs=1e-12)
    assert turned.lam == pytest.approx(before.lam, abs=1e-12)
    single = [0, 1, 6]
    assert turned.shapes[:, single] == pytest.approx(before.shapes[:, single], abs=0.0)
