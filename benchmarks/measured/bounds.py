"""Cramer-Rao bounds of the frozen gimbal, from the truth alone: nothing of the package is used here."""

from __future__ import annotations

import dataclasses

import numpy as np

DIFFERENCE = 1e-6
DRAWS = 20000


@dataclasses.dataclass(frozen=True)
class Gimbal:
    """The truth: frequencies [Hz], damping, output and input vectors of modes, delays [s] of outputs."""

    f: np.ndarray
    zeta: np.ndarray
    phi: np.ndarray
    psi: np.ndarray
    delay_s: np.ndarray

    def response(self, hz: np.ndarray) -> np.ndarray:
        """exp(-s tau) sum phi psi / (s^2 + 2 zeta w s + w^2), (line, output, input)."""
        s, w = 2j * np.pi * hz[:, None], 2.0 * np.pi * self.f
        modes = 1.0 / (s**2 + 2.0 * self.zeta * w * s + w**2)
        return np.exp(-s * self.delay_s)[:, :, None] * np.einsum("om,km,im->koi", self.phi, modes, self.psi)

    @property
    def free(self) -> np.ndarray:
        """All parameters but the first input's vector, which the scale of phi makes redundant."""
        return np.concatenate([self.f, self.zeta, self.phi.ravel(), self.psi[1:].ravel(), self.delay_s])

    def moved(self, p: np.ndarray) -> Gimbal:
        """With other `free` parameters."""
        n, outputs = len(self.f), len(self.phi)
        f, zeta, phi, psi, delay = np.split(p, np.cumsum([n, n, outputs * n, n * (len(self.psi) - 1)]))
        return Gimbal(f, zeta, phi.reshape(outputs, n), np.vstack([self.psi[:1], psi.reshape(-1, n)]), delay)


@dataclasses.dataclass(frozen=True)
class Bound:
    """What an efficient estimator does: median and 95th percentile of the relative complex error on the
    scored lines, deviations of each damping ratio and of each delay [s]."""

    error: float
    error_95: float
    damping: np.ndarray
    delay_s: np.ndarray


def cramer_rao(
    truth: Gimbal, hz: np.ndarray, U: np.ndarray, variance: np.ndarray, scored: np.ndarray
) -> Bound:
    """For inputs U (line, input, experiment) and noise of ``variance`` (output) on each output line."""
    moved = np.einsum("pkoi,kie->pkoe", _slopes(truth, hz), U) / np.sqrt(variance)[:, None]
    rows = moved.reshape(len(moved), -1)
    information = 2.0 * np.real(rows @ rows.conj().T)
    size = 1.0 / np.sqrt(np.diag(information))
    covariance = size[:, None] * np.linalg.inv(information * size[:, None] * size) * size
    slopes = _slopes(truth, scored).reshape(len(information), -1)
    # Sum |dG|^2 is a sum of chi-squares with the eigenvalues of the error's covariance as weights.
    root = np.linalg.cholesky(covariance)
    weights = np.linalg.eigvalsh(root.T @ np.real(slopes @ slopes.conj().T) @ root)
    draws = np.random.default_rng(0).standard_normal((DRAWS, len(weights))) ** 2 @ weights
    errors = np.sqrt(draws / np.sum(np.abs(truth.response(scored)) ** 2))
    deviation, n = np.sqrt(np.diag(covariance)), len(truth.f)
    return Bound(
        float(np.median(errors)),
        float(np.percentile(errors, 95)),
        deviation[n : 2 * n],
        deviation[-len(truth.delay_s) :],
    )


def _slopes(truth: Gimbal, hz: np.ndarray) -> np.ndarray:
    """Central differences; the third derivative of a resonance of 1 % makes 1e-8 of them."""
    p = truth.free
    steps = DIFFERENCE * np.where(np.abs(p) > 0.0, np.abs(p), 1.0)
    ends = ((truth.moved(p + h), truth.moved(p - h)) for h in np.diag(steps))
    pairs = ((a.response(hz) - b.response(hz)) / 2.0 for a, b in ends)
    return np.array([d / h for d, h in zip(pairs, steps, strict=True)])
