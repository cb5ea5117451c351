"""Several unknowns at once: the covariance of a refinement beside the exact posterior, sampled.

A cantilever with a body on its tip, of a few elements, drawn with a shear stiffness. Its frequencies for the
samples are those of a beam of two planes written here, so that no line of the model, of its slopes or of the
estimate is shared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
import scipy.linalg as sla

import middeck as md
import structure_builders as build
from middeck.structure.correlation.measured_modes import measure_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.updating.refinement.refine import Refined, refine
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

EI, STIFFER, RHO_A, ELEMENTS = 50.0, 1.6, 0.3, 4
MASS, SPIN_X, SPIN_Y, SPIN_Z = 0.4, 0.012, 0.02, 0.015
STAND = Environment(title="stand", gravity=np.zeros(3), clamps=(Clamp(node="foot"),))
BENDING = (0, 1, 3, 4)  # the third is torsion
MODULUS = Unknown(name="modulus", parameters=("members.E",), spread=0.15)
TOP = Unknown(name="top", parameters=("node.top.mass",), spread=0.15)
SPIN = Unknown(name="spin", parameters=("node.top.inertia.xx",), spread=0.2)
SAMPLES = 20_000
WIDER = 1.3  # so much wider than the estimate are the samples drawn: where it is too narrow, they show it


def mast() -> Structure:
    section = Section(
        EA=1e5, GJ=40.0, EI_y=EI, EI_z=STIFFER * EI, GA_y=1e13, GA_z=1e13,
        rho_A=RHO_A, rho_I_y=0.0, rho_I_z=0.0,
    )  # fmt: skip
    top = build.body(MASS, (0.0, 0.0, 0.0), (SPIN_X, SPIN_Y, SPIN_Z))
    return build.structure(
        [build.node("foot", (0, 0, 0)), build.node("top", (0, 1, 0), top)],
        [build.member("foot", "top", section, ELEMENTS, up=(0.0, 0.0, 1.0))],
    )


def log_hz(modulus: np.ndarray, top: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Logarithms of the first two bending frequencies about x and about z, ascending; a row a sample."""
    planes = [(STIFFER * EI, SPIN_X * np.exp(spin)), (EI, np.full(len(spin), SPIN_Z))]
    found = [bending(EI_plane * np.exp(modulus), MASS * np.exp(top), tip)[:, :2] for EI_plane, tip in planes]
    return np.sort(0.5 * np.log(np.concatenate(found, axis=1)) - np.log(2.0 * np.pi), axis=1)


def bending(stiffness: np.ndarray, mass: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Squares of the angular frequencies of a clamped beam of a metre with a body on its tip.

    Cubic elements with their consistent mass (Przemieniecki 1968, "Theory of matrix structural analysis",
    chapter 11).
    """
    h = 1.0 / ELEMENTS
    k = np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
    ) / h**3  # fmt: skip
    m = np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
    ) * RHO_A * h / 420.0  # fmt: skip
    size = 2 * (ELEMENTS + 1)
    K, M = np.zeros((2, size, size))
    for e in range(ELEMENTS):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    K, M = K[2:, 2:], M[2:, 2:]
    every = np.repeat(M[None], len(mass), axis=0)
    every[:, -2, -2] += mass
    every[:, -1, -1] += inertia
    root = np.linalg.inv(np.linalg.cholesky(every))
    return stiffness[:, None] * np.linalg.eigvalsh(root @ K @ root.transpose(0, 2, 1))


def refined(unknowns: Sequence[Unknown], noise: float, model_error: float) -> Refined:
    """On four frequencies of a mast that differs, without their shapes."""
    modes = md.solve_modes(md.solve_equilibrium(mast(), STAND))
    seen = measure_modes(modes, [("top", "x")], chosen=BENDING)
    rng = np.random.default_rng(8)
    truth = [[0.6 * u.spread if u in unknowns else 0.0] for u in (MODULUS, TOP, SPIN)]
    off = log_hz(*np.array(truth))[0] + noise * rng.standard_normal(4)
    alone = dataclasses.replace(
        seen, frequency_hz=np.exp(off), frequency_std_hz=noise * np.exp(off), node=(), direction=(),
        shape=seen.shape[:0], position_m=None,
    )  # fmt: skip
    survey = Survey(name="stand", measured=alone, environment=STAND)
    return refine(mast(), [survey], unknowns, model_error)


def sampled(found: Refined, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of the exact posterior by importance sampling, and the share of samples that count.

    What noise and the model's own errors leave of ln f is normal: each measured mode has an error of its own.
    """
    (compared,) = found.compared
    places = [(MODULUS, TOP, SPIN).index(u) for u in unknowns]
    root = WIDER * np.linalg.cholesky(covariance(found))
    n = np.random.default_rng(9).standard_normal((SAMPLES, len(unknowns)))
    x = found.x + n @ root.T
    every = np.zeros((3, SAMPLES))
    every[places] = x.T
    variance = compared.survey.std**2 + found.estimate.tau[1] ** 2
    away = np.log(compared.survey.measured.frequency_hz) - log_hz(*every)
    log = -0.5 * np.sum(away**2 / variance, axis=1)
    log -= 0.5 * np.sum((x / [u.spread for u in unknowns]) ** 2, axis=1)
    log += 0.5 * np.sum(n**2, axis=1)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ x
    return mean, (x - mean).T * weight @ (x - mean), 1.0 / (SAMPLES * np.sum(weight**2))


def covariance(found: Refined) -> np.ndarray:
    """Of the unknowns."""
    rows = found.estimate.root[: len(found.unknowns)]
    return rows @ rows.T


def test_the_two_beams_are_one():
    """At the article as drawn, to rounding: both are cubic elements."""
    modes = md.solve_modes(md.solve_equilibrium(mast(), STAND))
    np.testing.assert_allclose(
        np.log(modes.frequency_hz[list(BENDING)]), log_hz(*np.zeros((3, 1)))[0], atol=1e-9
    )


@pytest.mark.parametrize(
    ("unknowns", "noise", "model_error"),
    [
        ((MODULUS, TOP, SPIN), 0.01, 1e-6),
        ((MODULUS, TOP, SPIN), 0.002, 0.01),
        ((MODULUS, TOP), 0.005, 1e-6),
    ],
)
def test_the_covariance_of_several_unknowns_is_that_of_the_posterior(
    unknowns: tuple[Unknown, ...], noise: float, model_error: float
):
    """In every direction of the unknowns, so in what each has with the others (correlations to 0.8) as alone.

    4 sigma of the sampling is 5 % of a variance; curvature of ln f over the posterior has no share in it that
    could be told. The mean may be off by the square of the last step, 0.04 deviations.
    """
    found = refined(unknowns, noise, model_error)
    mean, exact, share = sampled(found, unknowns)
    linear, std = covariance(found), np.sqrt(np.diag(exact))
    assert share > 0.5  # the samples are where the posterior is
    assert found.estimate.tau[1] == pytest.approx(model_error, rel=0.7)
    assert np.abs(exact / np.outer(std, std) - np.eye(len(std))).max() > 0.7
    np.testing.assert_allclose((found.x - mean) / std, 0.0, atol=0.06)
    np.testing.assert_allclose(sla.eigh(linear, exact, eigvals_only=True), 1.0, atol=0.05)
    np.testing.assert_allclose(found.estimate.x_std, std, rtol=0.03)
