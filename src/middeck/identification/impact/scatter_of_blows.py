"""Noise of the force and blows that differ in the covariance of a fit, in no direction less than stated.

Noise of the force lasts as long as its window. Its spectrum is then alike on many lines, those of a mode
among them, so that no residual over lines shows what it does to a model. The force where nothing strikes
does. From blow to blow all else may differ, too: each blow's part of the averaged response moves the model by
its own (clustered sandwich, Liang and Zeger 1986), with one degree of freedom less than there are blows.
What counts is beyond the edge of chance, which is large in a few directions (Marchenko and Pastur 1967).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit.fit_response import FitResult
from middeck.identification.impact.averaged_blows import ImpactTest, exponential_window, windowed_spectra
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.spectra.excess_variance import spread_of
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.model_unknowns import ties
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of
from middeck.identification.uncertainty.response_derivatives import entry_slopes


def with_scatter(fit: FitResult, test: ImpactTest) -> FitResult:
    """``fit`` with the covariance that noise of the force and the scatter of blows ask for."""
    known, (heard, apart) = fit.covariance, _parts(test)
    s = 2j * np.pi * test.response.frequency_hz
    measured = spread_of(test.response, relative=False).variance[:, :, 0]
    v = measured + fit.excess[:, None] ** 2
    J = np.zeros((len(known.root), len(v), len(s)), dtype=complex)
    for o in range(len(v)):
        entry = entry_slopes(known.model, known.structure, s, o, 0)
        J[entry.place, o] = entry.by
    rows = as_real(J / np.sqrt(v))
    W, loose = orthogonal.inverse_root(orthogonal.triangle(rows.T), ties(known.model, known.structure))
    W = W[:, : W.shape[1] - loose]

    def moved(H: Complex[np.ndarray, "part output line"], root: np.ndarray) -> np.ndarray:
        """Shifts of unknowns by additions to the response, in directions of a root of the covariance."""
        return np.linalg.lstsq(root, W @ (W.T @ (rows @ as_real(H / np.sqrt(v)).T)), rcond=None)[0]

    steady = W.T @ _under_window(J * np.sqrt(measured) / v, test)
    root = W @ orthogonal.root_of(steady @ steady.T)
    left = np.linalg.lstsq(root, known.fixed, rcond=None)[0]
    root = root @ _beyond_chance(left, len(s) / (test.response.alike or 1.0))
    noise = moved(heard, root)
    root = root @ orthogonal.root_of(np.eye(len(noise)) + noise @ noise.T)
    root = root @ _beyond_chance(moved(apart, root), len(apart) - 1.0)
    free = known.root[:, known.root.shape[1] - known.loose :]
    covariance = dataclasses.replace(
        known,
        root=np.hstack([orthogonal.canonical_root(root), free]),
        degrees=min(known.degrees, len(apart) - 1.0),
    )
    return dataclasses.replace(fit, covariance=covariance, uncertainty=uncertainty_of(covariance))


def _beyond_chance(
    found: Float[np.ndarray, "direction part"], numbers: float
) -> Float[np.ndarray, "direction direction"]:
    """Root of the variance by so many ``numbers``, expected one; one where the excess may be chance."""
    size, direction = np.linalg.eigh(found @ found.T)
    chance = (1.0 + np.sqrt(len(size) / numbers)) ** 2
    return direction * np.sqrt(np.where(size > chance, size, 1.0))


def _under_window(
    slopes: Complex[np.ndarray, "unknown output line"], test: ImpactTest
) -> Float[np.ndarray, "unknown sample"]:
    """Effect on the scores of samples of white noise under the window, of variance one on each line.

    Neighbouring lines of it are alike: in time its samples are independent.
    """
    size, rate = test.blocks.u.shape[2], test.blocks.sample_hz
    kept = np.isin(np.fft.rfftfreq(size, 1.0 / rate), test.response.frequency_hz)
    # A response is by the pulse, which comes some samples after the noise begins.
    U = windowed_spectra(test.blocks.u[:, 0], rate, test.window_s)[:, kept, 0].sum(axis=0)
    full = np.zeros((*slopes.shape[:2], len(kept)), dtype=complex)
    full[..., kept] = slopes * (U / np.abs(U))
    window = exponential_window(size, rate, test.window_s)
    shares = 0.5 * size * np.fft.irfft(full, size) * window / np.sqrt(np.sum(window**2))
    return shares.reshape(len(shares), -1)


def _parts(
    test: ImpactTest,
) -> tuple[Complex[np.ndarray, "part output line"], Complex[np.ndarray, "blow output line"]]:
    """Effects on the averaged response: of noise of the force, and of each blow.

    Of blows that differ in size by their leverage (Bell and McCaffrey 2002): the largest is most of the
    average, and little off it.
    """
    blocks, hz = test.blocks, test.response.frequency_hz
    kept = np.isin(np.fft.rfftfreq(blocks.u.shape[2], 1.0 / blocks.sample_hz), hz)
    U, Y, N = (
        windowed_spectra(x, blocks.sample_hz, test.window_s)[:, kept]
        for x in (blocks.u[:, 0], blocks.y[:, 0], test.rest[..., None])
    )
    power = np.sum(np.abs(U) ** 2, axis=0)
    H, by = np.sum(Y * U.conj(), axis=0) / power, U.conj() / power
    # Each part as that of one blow, in turn.
    heard = H * by[np.arange(len(N)) % len(by)] * N * np.sqrt(len(by) / max(len(N), 1))
    apart = (Y - H * U) * by / np.sqrt(1.0 - np.abs(U) ** 2 / power)
    return heard.swapaxes(1, 2), apart.swapaxes(1, 2)
