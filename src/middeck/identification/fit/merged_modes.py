"""Single modes of a fit that may be two, of nearly one pole, which the order rule does not part.

Two modes of poles p + d and p + e, with residues a and b, look like one of the pole that has a d + b e = 0 up
to second order; what is left of them is (a d^2 + b e^2) / (s - p)^3. That mode's deviations tell how well the
mean is known, not how far either of the two lies from it. A term of this form, of any size and phase, beside
all that the fit has free, is sought in what it leaves: a score test (Rao 1948), with two degrees of freedom
for each output, that asks for no second pole.
"""

from __future__ import annotations

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.design import build_terms
from middeck.identification.search.polish import Run

CHANCE = 0.008
"""Probability with which a mode of a clean response is doubted, shared among its modes."""
RANK = 1e-10
"""Columns that are others once more have less than this share of the largest."""


def may_be_two(
    data: Data,
    run: Run,
    residual: Complex[np.ndarray, "output line column"],
    weight: Float[np.ndarray, "output line column"],
) -> Bool[np.ndarray, " mode"]:
    """Which pairs have more left of this form than chance explains; ``weight`` is one over the deviation.

    What is left everywhere counts as noise, and what lines have in common with their neighbours as fewer
    lines. Residues of full rank, and records with transients, are not asked.
    """
    pairs = np.asarray(run.layout.pair)
    found = np.zeros(len(pairs), dtype=bool)
    terms = build_terms(run.layout, data, run.start.theta)
    if run.layout.options.full_rank or data.transient is not None or terms is None:
        return found
    gain, left, rows = np.zeros(len(pairs)), 0.0, 0
    for o, (r, w) in enumerate(zip(residual, weight, strict=True)):
        linear = run.refined.step.linear[o]
        free = np.concatenate([terms.columns(o), terms.slopes(linear, o)])
        Q, R = np.linalg.qr(_rows(free * w))
        Q = Q[:, np.abs(np.diag(R)) > RANK * np.abs(R).max()]
        seen = _rows((r * w)[None])[:, 0]
        seen = seen - Q @ (Q.T @ seen)
        left, rows = left + float(seen @ seen), rows + len(seen) - Q.shape[1]
        for m in np.flatnonzero(pairs):
            more = _rows(_third_order(data.s, run.start.point.poles[m], terms.delay_factors(o)) * w)
            more = more / np.linalg.norm(more, axis=0)
            for _ in range(2):  # the second time takes off what rounding left of the first
                more = more - Q @ (Q.T @ more)
            own, _ = np.linalg.qr(more)
            gain[m] += float(np.sum((own.T @ seen) ** 2))
    scale = max(left / max(rows, 1), 1.0) * _shared(residual * weight)
    limit = scipy.stats.chi2.isf(CHANCE / max(int(pairs.sum()), 1), 2 * len(residual))
    return pairs & (gain > float(limit) * scale)


def doubts_of_merged(
    frequency_hz: Float[np.ndarray, " mode"], merged: Bool[np.ndarray, " mode"]
) -> list[str]:
    """A warning for the modes that may be two."""
    places = ", ".join(f"{hz:.6g}" for hz in np.sort(frequency_hz[merged]))
    if not places:
        return []
    return [
        f"modes at {places} Hz: not resolved, each may be two of nearly one frequency: what the fit leaves "
        f"beside it has the form that two leave (by chance in less than {CHANCE:.1%} of clean responses). "
        "The deviations tell how well the mean of both is known, not either; finer lines, another output or "
        "input, or two states more"
    ]


def _shared(z: Complex[np.ndarray, "output line column"]) -> float:
    """Lines that count as one: the sum of the residual's correlation over neighbours that share it."""
    power, total = float(np.sum(np.abs(z) ** 2)), 1.0
    for lag in range(1, z.shape[1] // 10):
        alike = float(np.sum(np.real(z[:, lag:] * z[:, :-lag].conj()))) / max(power, np.finfo(float).tiny)
        if alike <= 2.0 / np.sqrt(z.size):
            break
        total += 2.0 * alike
    return total


def _third_order(s: np.ndarray, pole: complex, late: np.ndarray) -> Complex[np.ndarray, "2 line column"]:
    """Real and imaginary part of a coefficient of 1 / (s - p)^3, its conjugate included."""
    upper, lower = 1.0 / (s - pole) ** 3, 1.0 / (s - np.conj(pole)) ** 3
    return np.array([upper + lower, 1j * (upper - lower)])[:, :, None] * late


def _rows(columns: Complex[np.ndarray, "column line path"]) -> Float[np.ndarray, "row column"]:
    """Real rows whose squares add up to twice those of complex ones: unit deviation each."""
    flat = columns.reshape(len(columns), -1).T
    return np.sqrt(2.0) * np.concatenate([np.real(flat), np.imag(flat)])
