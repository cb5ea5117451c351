"""The mode that would improve a fit most, with its input vector, over a grid of poles.

The residual is projected on the terms of each pole, less what linear unknowns of the fit can take up, and the
rank-one part of the residue is kept (matching pursuit, Mallat and Zhang 1993, orthogonal to the fit). This
also finds heavily damped modes and modes outside the band, which leave no peak in the residual.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import build_terms
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.problem.unknowns_layout import Layout
from middeck.identification.search.refine_and_reweigh import Polished
from middeck.values import record

# Damping ratios of candidates beside that of the modes at hand.
HEAVY = (0.1, 0.5)
# Candidates lie so many damping ratios apart; heavy ones from and to these multiples of the band's ends.
SPACING, BELOW, ABOVE = 1.5, 0.1, 2.0
# Least damping ratio of a grid: narrower modes are looked for at the residual's peak alone.
LIGHTEST = 0.005
# What is new of a candidate counts where it is more than so small a share of its square.
NOTHING_NEW = 1e-6


@record
class Candidate:
    """A pole [rad/s], its input vector, and by how much it would lower sum |weight residual|^2 at once."""

    pole: complex
    b: Complex[np.ndarray, " input"]
    gain: float


def find_candidate(data: Data, best: Polished, light: float, peak: float) -> Candidate | None:
    """The pair of poles that explains most of the residual of ``best``, by the weights of ``data``.

    ``light`` is the damping ratio of narrow candidates, ``peak`` a frequency [rad/s] to be among them.
    """
    layout = best.layout
    terms = build_terms(layout, data, best.refined.theta)
    if terms is None:
        return None
    late = np.exp(data.s[:, None] * best.start.point.delay_s.mean(axis=1)[:, None, None])
    left = best.residual(data) * late
    line = np.sqrt(np.mean(data.weight**2, axis=(0, 2)))
    level = np.sqrt(np.mean(data.weight**2, axis=(1, 2)) / np.mean(line**2))
    y = _by_input(left * level[:, None, None] * line[:, None])
    poles = _grid(layout, data, light, peak)
    F = as_real((_terms_of(layout, poles, data.s) * line)[:, :, None])
    return _most_told(poles, F, _directions(_by_input(terms.X * line[:, None])), y)


def _directions(X: Float[np.ndarray, "input column number"]) -> Float[np.ndarray, "input column number"]:
    """Orthonormal over all inputs together."""
    inputs, count, numbers = X.shape
    stacked = np.moveaxis(X, 1, 0).reshape(count, inputs * numbers).T
    size = np.linalg.norm(stacked, axis=0)
    Q = np.linalg.qr(stacked / np.where(size > 0.0, size, 1.0))[0]
    return np.moveaxis(Q.T.reshape(count, inputs, numbers), 0, 1)


def _by_input(x: Complex[np.ndarray, "row line input"]) -> Float[np.ndarray, "input row number"]:
    return np.stack([as_real(x[:, :, i : i + 1]) for i in range(x.shape[2])])


def _grid(layout: Layout, data: Data, light: float, peak: float) -> Complex[np.ndarray, " candidate"]:
    first, last = data.omega[0], data.omega[-1]
    top = min(ABOVE * last, np.pi / layout.options.period_s) if layout.options.period_s else ABOVE * last
    found = [peak * np.array([-light + 1j])]
    for zeta in (max(light, LIGHTEST), *HEAVY):
        low, high = (first, last) if zeta < HEAVY[0] else (BELOW * first, top)
        count = 2 + int(np.log(high / low) / (SPACING * zeta))
        found.append(np.geomspace(low, high, count, endpoint=False) * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))
    return np.concatenate(found)


def _terms_of(layout: Layout, poles: np.ndarray, s: np.ndarray) -> Complex[np.ndarray, "column line"]:
    """One column of each candidate with real constants, two with complex ones; one input."""
    T = layout.options.period_s
    q, pole = (np.exp(s * T), np.exp(poles * T)) if T else (s, poles)
    up, low = 1.0 / (q - pole[:, None]), 1.0 / (q - pole.conj()[:, None])
    if layout.options.real_constants:
        return up * low
    return np.stack([up + low, 1j * (up - low)], axis=1).reshape(-1, len(s))


def _most_told(
    poles: Complex[np.ndarray, " candidate"],
    F: Float[np.ndarray, "column number"],
    own: Float[np.ndarray, "input direction number"],
    y: Float[np.ndarray, "input output number"],
) -> Candidate | None:
    count, inputs = len(poles), len(y)
    each = len(F) // count
    of_each = (F / np.linalg.norm(F, axis=1)[:, None]).reshape(count, each, -1)
    taken = _products(of_each, own)
    told = _products(of_each, y) - taken @ np.einsum("ial,iol->ao", own, y)
    gram = NOTHING_NEW * np.eye(inputs * each) - taken @ taken.mT
    alone = of_each @ of_each.mT
    for i in range(0, inputs * each, each):
        gram[:, i : i + each, i : i + each] += alone
    any_rank = np.linalg.solve(gram, told).reshape(count, inputs, each, -1)
    residue = any_rank[:, :, 0] + (1j * any_rank[:, :, 1] if each > 1 else 0.0)
    b = np.linalg.svd(residue)[0][:, :, 0].astype(complex)
    B = _times(b) if each > 1 else np.real(b)[:, :, None]
    on_b = B.mT @ told
    gain = np.sum(on_b * np.linalg.solve(B.mT @ gram @ B, on_b), axis=(1, 2))
    k = int(np.argmax(gain))
    return Candidate(complex(poles[k]), b[k], float(gain[k])) if np.isfinite(gain[k]) else None


def _products(
    F: Float[np.ndarray, "candidate column number"], rows: Float[np.ndarray, "input row number"]
) -> Float[np.ndarray, "candidate column_of_input row"]:
    each = np.stack([np.tensordot(F, x, axes=(2, 1)) for x in rows], axis=1)
    return each.reshape(len(F), -1, rows.shape[1])


def _times(b: Complex[np.ndarray, "candidate input"]) -> Float[np.ndarray, "candidate column_of_input 2"]:
    """Real and imaginary part of b c of all inputs from those of c."""
    re, im = np.real(b), np.imag(b)
    rows = np.stack([np.stack([re, -im], axis=-1), np.stack([im, re], axis=-1)], axis=2)
    return rows.reshape(len(b), -1, 2)
